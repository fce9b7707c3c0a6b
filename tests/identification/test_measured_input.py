"""Errors of the logged input: noise, lag, and an amplifier's dead zone and limit."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from benchmarks.trials.generate import make_trial
from benchmarks.trials.integrator import Law
from benchmarks.trials.realistic.drive import Plant, simulate
from made_joint import (
    COEFFICIENTS,
    CORE,
    PAPER,
    PUSHED,
    SAMPLE_TIME,
    among_disturbances,
    assert_holds,
    data,
    log,
    made,
    pushed,
    recording,
    seen,
    structure,
)
from scipy.signal import lfilter

import flexid.identification.estimation.input_noise as noise_of_the_input
import flexid.identification.estimation.model_error as modelling
from flexid.estimators.channel_timing import INPUT, Timing, after_a_lag
from flexid.estimators.samples import Samples
from flexid.identification.estimation import answers, input_lag, inputs
from flexid.identification.estimation.disturbed import Disturbed
from flexid.identification.estimation.input_lag import lag_error, likely_lag
from flexid.identification.full_model import amplifier as amplifiers
from flexid.identification.full_model.fitting import fit_to
from flexid.identification.full_model.model import Data, Fitted, Structure, data_of
from flexid.identification.identify import identify
from flexid.identification.preparation.joint import link
from flexid.identification.preparation.recordings import IDEAL, Amplifier
from flexid.identification.preparation.settings import Settings
from flexid.identification.vocabulary.evidence import Estimate, ModelError
from flexid.identification.vocabulary.thresholds import THRESHOLDS
from flexid.recording.recording import Recording
from flexid.recording.velocities import with_velocities

JOINT = link()
GRAVITY = Structure(JOINT, JOINT.optional - {"theta1"}, Timing("cubic"))
TRUTH = {"theta1": 5.0, "theta2": 100.0}
NOISE = 2e-4  # rad, of the motor's encoder; twenty times that of the link's


@cache
def fitted(seed: int, noise: float = NOISE) -> Fitted:
    """Return the link with gravity, fitted to 10 s with a noisy motor position as its input."""
    recording = made(seed)
    count = len(recording)
    motor = noise * np.random.default_rng(seed).standard_normal(count)
    recording = seen(recording, np.zeros(count), motor)
    recording = with_velocities(replace(recording, input=None, input_unit=""))
    data = data_of(JOINT, [recording], (0,))
    return fit_to(GRAVITY, data, TRUTH, 1.0)[0]


@pytest.mark.parametrize("seed", [1, 2])
def test_residuals_are_explained(seed):
    """Assert that the motor encoder's noise explains residuals far above the link's noise."""
    found = fitted(seed)
    beyond = found.excess - 1.0
    assert beyond > 2.0
    assert 0.8 * beyond < modelling.input_noise(found).excess < 3.0 * beyond
    # An encoder as fine as the link's adds little to residuals of pure noise.
    assert modelling.input_noise(fitted(3, 0.0)).excess < 0.2


def test_deviations_are_those_of_many_logs():
    """Assert that estimates of thirty logs scatter as predicted from single logs."""
    values = np.array([fitted(seed).values for seed in range(10, 40)])
    scatter = np.sqrt(np.mean((values - [*TRUTH.values()]) ** 2, axis=0))
    foretold = np.mean(
        [modelling.input_noise(fitted(seed)).deviations for seed in range(10, 14)], axis=0
    )
    np.testing.assert_allclose(scatter, foretold, rtol=0.5)


@pytest.mark.parametrize("excess", [0.0, 1.0])
def test_no_interval_is_narrower(monkeypatch: pytest.MonkeyPatch, excess: float):
    """Assert that an interval is at least as wide as the noise of the input requires."""
    found, error = fitted(1), ModelError(excess, 0.0, 0.0)
    noise = 10.0 * found.fit.deviations
    monkeypatch.setattr(modelling, "input_noise", lambda _: SimpleNamespace(deviations=noise))
    assert modelling.widened(found, error).deviations == pytest.approx(
        np.hypot(found.unit_deviations, noise)
    )


def fitted_with_torque_noise(seed: int, noise: float, chatter: float = 0.0) -> Disturbed:
    """Return the fit with disturbances to a drive whose logged torque has white noise in N m."""
    recorded = pushed(seed, chatter=chatter)
    added = noise * np.random.default_rng(seed + 50).standard_normal(len(recorded))
    noisy = data(replace(recorded, input=recorded.needed_input + added))
    return among_disturbances(structure("motor_viscous"), noisy)


@pytest.mark.parametrize("seed", [2, 3])
def test_noise_of_a_torque_does_not_reduce_its_gain(seed, monkeypatch):
    """Assert that a noisy torque is replaced, and that the gain would else be too small."""
    found = fitted_with_torque_noise(seed, 1.44)
    assert found.input.without_noise
    assert abs(found.fitted.by_name["beta1"] / PUSHED["beta1"] - 1.0) < 0.01
    monkeypatch.setattr(noise_of_the_input, "_noise", lambda _: 0.0)
    as_logged = fitted_with_torque_noise(seed, 1.44).fitted.by_name["beta1"]
    assert as_logged / PUSHED["beta1"] - 1.0 < -0.05


def test_each_recording_has_its_own_noise_of_the_input():
    """Assert that noise is removed from a driven recording, though a longer one is coasting."""
    driven, noise = pushed(2), 1.44 * np.random.default_rng(3).standard_normal(len(pushed(2)))
    coasting = pushed(2, duration=14.0)
    coasting = replace(coasting, input=np.zeros(len(coasting)))
    log = data(replace(driven, input=driven.needed_input + noise), coasting)
    quiet, rest = (own.inputs[:, 0] for own in noise_of_the_input.without_input_noise(log).samples)
    assert np.std(quiet - driven.needed_input) < 0.3 * np.std(noise)
    assert not rest.any()
    assert noise_of_the_input.InputChoice(without_noise=True).removed_from(log) == pytest.approx(
        1.44, rel=0.05
    )


@pytest.mark.parametrize("seed", [2, 3])
def test_noise_that_moves_the_drive_stays(seed):
    """Assert that a torque with a controller's noise is taken as logged, with a doubt."""
    found = fitted_with_torque_noise(seed, 0.0, chatter=1.44)
    assert not found.input.without_noise
    assert found.input.left == pytest.approx(1.0 / np.sqrt(3.0))
    assert abs(found.fitted.by_name["beta1"] / PUSHED["beta1"] - 1.0) < 0.01


def late(recording: Recording) -> Fitted:
    """Return the joint fitted to a recording, with an unknown delay of its input."""
    sought = replace(PAPER, timing=Timing("cubic", sought=(INPUT,)))
    return fit_to(sought, data(recording), {**COEFFICIENTS, INPUT: 1e-3}, 1.0)[0]


def low_passed(values: np.ndarray, lag: float) -> np.ndarray:
    """Return a channel after a first-order lag, given in samples."""
    kept = lag / (1.0 + lag)
    return lfilter([1.0 - kept], [1.0, -kept], values - values[0]) + values[0]


def ahead(noise: float = 1e-5, lag: float = 6e-3) -> Recording:
    """Return a log whose torque acts `lag` s behind its record."""
    recording = made(1, noise=noise)
    torque = recording.needed_input
    return replace(recording, input=torque + lag * np.gradient(torque, SAMPLE_TIME))


@cache
def behind_a_lag(noise: float, lag: float) -> Fitted:
    """Return a fit with the torque `lag` s behind its record, or if negative the reverse."""
    if lag > 0.0:
        return late(ahead(noise, lag))
    recording = made(1, noise=noise)
    return late(replace(recording, input=low_passed(recording.needed_input, -lag / SAMPLE_TIME)))


@pytest.mark.parametrize(
    ("noise", "lag", "share"),
    [
        (3e-4, 6e-3, 1.0),  # the log shows a lag
        (3e-4, -6e-3, 1.0),
        (3e-2, 6e-3, 3.0**-0.5),  # the log does not distinguish lag and delay
    ],
)
def test_a_lag_in_a_delays_place_has_the_error_that_it_makes(noise, lag, share):
    """Assert the predicted error of the motor's gain, about 0.4 %, and none of the delay."""
    place = behind_a_lag(3e-4, lag).names.index("beta1")
    error = COEFFICIENTS["beta1"] - behind_a_lag(3e-4, lag).values[place]
    found = modelling.lagged(behind_a_lag(noise, lag))
    assert found[place] == pytest.approx(share * error, rel=0.1)
    assert found[-1] == 0.0


@pytest.mark.parametrize(
    ("noise", "lag", "expected"),
    [(3e-4, 6e-3, 6e-3), (2e-3, 6e-3, 6e-3), (5e-3, 6e-3, 0.0), (3e-4, -6e-3, 0.0)],
)
def test_a_lag_is_sought_in_a_delays_place(noise, lag, expected):
    """Assert a lag within 3 %, and none that is not likelier by eight deviations, or is a lead."""
    assert likely_lag(behind_a_lag(noise, lag)) == pytest.approx(expected, rel=0.03)


@pytest.mark.parametrize("lag", [5.6e-3, 6.4e-3])
def test_the_error_of_a_lag_is_foretold(lag):
    """Assert the error of the gain if an input is corrected for 5.6 or 6.4 ms instead of 6 ms."""
    recording = ahead(noise=3e-4)
    acts = after_a_lag(recording.needed_input, lag / SAMPLE_TIME)
    found = late(replace(recording, input=acts))
    place = found.names.index("beta1")
    actual = abs(found.values[place] - COEFFICIENTS["beta1"])
    assert actual > 10.0 * found.unit_deviations[place]
    error = lag_error(found, lag)
    assert abs(error[place]) == pytest.approx(actual, rel=0.15)
    assert error[found.names.index(INPUT)] == 0.0


def test_a_lag_without_a_delay_has_an_error():
    """Assert an error that is smaller than the lag's effect if the fit has no delay."""
    recording = made(1, noise=3e-4)
    acts = replace(recording, input=after_a_lag(recording.needed_input, 6e-3 / SAMPLE_TIME))
    found = fit_to(PAPER, data(acts), COEFFICIENTS, 1.0)[0]
    error = np.abs(lag_error(found, 6e-3))
    whole = np.abs(found.values - [COEFFICIENTS[name] for name in found.names])
    assert 0.0 < error.max() < whole.max()


def test_a_lag_with_which_the_motion_diverges_is_none(monkeypatch):
    """Assert that longer lags may make the motion diverge without a warning."""
    found = behind_a_lag(3e-4, 6e-3)
    here = found.minimum.equations.cost

    def diverging(_: Fitted, lag: float, *__: int) -> tuple[float, np.ndarray]:
        return here - 1.0 if lag < 4e-3 else np.inf, found.values

    monkeypatch.setattr(input_lag, "_with_lag", diverging)
    assert likely_lag(found) == 0.0


def test_an_input_behind_a_lag_is_corrected():
    """Assert the lag of an amplifier, and that the intervals hold, and are narrow."""
    found = identify([log(ahead())])
    assert found.choices.amplifier.lag == pytest.approx(6e-3, rel=0.05)
    assert any("its amplifier had a lag of" in warning for warning in found.warnings)
    assert_holds(found, CORE | {"gravity_torque": 5.0}, 2e-3)


def test_a_coil_delays_the_back_emf():
    """Assert that behind a coil's lag the motor's values are known up to the neglected back-EMF.

    Any part of the viscous friction α may be back-EMF, whose lag τ changes the inertia by α τ.
    """
    found = identify([log(replace(ahead(), input_unit="V"))]).coefficients
    least = found["alpha2"].value * 6e-3 / np.sqrt(3.0)
    for name in ("alpha1", "alpha2", "beta1"):
        assert least < found[name].std / found[name].value < 1.4 * least


def test_a_delay_is_no_lag():
    """Assert no such error for a true delay, or for a lead, and no lag in its place."""
    delayed = late(made(1, input_delay=3e-3))
    assert not modelling.lagged(delayed).any()
    assert likely_lag(delayed) == 0.0
    recording = made(1)
    torque, times = recording.needed_input, recording.sample_time * np.arange(len(recording))
    early = late(replace(recording, input=np.interp(times - 3e-3, times, torque)))
    assert early.by_name[INPUT] < 0.0
    assert not modelling.lagged(early).any()


PLANT = Plant(1.0, 0.3, 100.0, motor_viscous=0.2, back_emf=1.0, coulomb=0.3, friction_width=1e-2)
GAIN = 1.0 / 0.3  # rad/s² for each unit of the input
STEP = 2e-3  # s
TONES = np.array([0.7, 3.3, 5.3, 8.1, 12.0, 17.0, 21.0, 25.0])  # rad/s
ENCODER_NOISE = 2e-5  # rad
REST = 1.5  # s
STICKING = 0.25  # V, below stiction


def recorded(
    dead_zone: float = 0.0,
    limit: float = np.inf,
    unit: str = "V",
    *,
    square: bool = False,
    rests: bool = False,
) -> Recording:
    """Return a log of the commanded input, simulated by an independent integrator."""
    rng = np.random.default_rng(20261124)
    times = STEP * np.arange(4000)
    phases = rng.uniform(0.0, 2.0 * np.pi, len(TONES))
    command = 2.5 * np.sin(np.outer(times, TONES) + phases).sum(axis=1)
    if square:
        command = 4.0 * np.sign(np.sin(2.0 * times))
    if rests:  # with a voltage below stiction, as an integral controller leaves it
        held = STICKING * np.sign(np.sin(np.pi * times / REST + 0.3))
        command = np.where(times % (2.0 * REST) < REST, 0.4 * command, held)
    plant = PLANT._replace(dead_zone=dead_zone, saturation=limit - dead_zone)
    course, pushes = np.zeros((len(times), 3)), np.zeros((len(times), 2))
    run = simulate(plant, times, command, Law(), course, pushes, 0.0, 5e-4)
    link, motor = run[:, 0], run[:, 2]
    errors = ENCODER_NOISE * rng.standard_normal((2, len(times)))
    return Recording(STEP, 0.0, link + errors[0], motor + errors[1], command, unit, source="made")


@cache
def under_a_voltage(dead_zone: float, *, square: bool) -> Fitted:
    """Return a fit of the driven joint without knowledge of its amplifier's dead zone."""
    held = structure("motor_viscous", "motor_coulomb", hold="zero")
    start = {"theta2": 100.0, "alpha1": 1 / 3e-3, "alpha2": 4.0, "alpha_coulomb": 1.0, "beta1": 3.0}
    return fit_to(held, data(recorded(dead_zone, square=square)), start, 1.0)[0]


def test_a_dead_zone_that_a_square_wave_hides():
    """Assert the error that a dead zone of 2 % makes: a gain 2 % too small, and no other.

    A log with all voltages allows only a far smaller dead zone.
    """
    hidden = under_a_voltage(0.08, square=True)
    gain = hidden.names.index("beta1")
    error = under_a_voltage(0.0, square=True).values - hidden.values
    foretold = modelling.behind_a_dead_zone(hidden)
    assert foretold[gain] / hidden.values[gain] == pytest.approx(0.02 / 0.98, rel=0.03)
    np.testing.assert_allclose(foretold, error, atol=0.1 * foretold[gain])
    shown, hidden = (under_a_voltage(0.0, square=square) for square in (False, True))
    small, large = (modelling.behind_a_dead_zone(each)[gain] for each in (shown, hidden))
    assert 0.0 < small < 0.2 * large


@pytest.mark.parametrize(
    ("dead_zone", "limit", "passed"),
    [
        (0.0, None, [-5.0, -0.2, 0.0, 0.7, 5.0]),
        (0.5, None, [-4.5, 0.0, 0.0, 0.2, 4.5]),
        (0.5, 3.0, [-2.5, 0.0, 0.0, 0.2, 2.5]),
    ],
)
def test_what_an_amplifier_passes_on(dead_zone: float, limit: float | None, passed: list[float]):
    """Assert the characteristic of an amplifier, point by point."""
    commanded = np.array([-5.0, -0.2, 0.0, 0.7, 5.0])
    np.testing.assert_allclose(Amplifier(dead_zone, limit).passed(commanded), passed, atol=1e-15)


AMPLIFIERS: dict[str, tuple[dict[str, Any], Amplifier]] = {  # that act, and that are found
    "a limit": ({"limit": 6.0}, Amplifier(0.0, 6.0)),
    "a dead zone and a limit": ({"dead_zone": 0.4, "limit": 6.0}, Amplifier(0.4, 6.0)),
    "a limit of a torque": ({"limit": 6.0, "unit": "N m"}, Amplifier(0.0, 6.0)),
    "a linear amplifier": ({}, IDEAL),
    "a dead zone that a square wave hides": ({"dead_zone": 0.4, "square": True}, IDEAL),
    "a dead zone of a torque": ({"dead_zone": 0.4, "unit": "N m"}, Amplifier(0.4)),
    "both of a torque": ({"dead_zone": 0.4, "limit": 6.0, "unit": "N m"}, Amplifier(0.4, 6.0)),
    "a linear amplifier of a torque": ({"unit": "N m"}, IDEAL),
    "a torque on a motor that sticks": ({"rests": True, "unit": "N m"}, IDEAL),
    "a motor that sticks": ({"rests": True}, IDEAL),
    "a dead zone, and a motor that sticks": ({"dead_zone": 0.15, "rests": True}, Amplifier(0.15)),
}


@pytest.mark.parametrize("case", AMPLIFIERS)
def test_an_amplifier_is_found(case: str):
    """Assert dead zone, limit and gain, or the inertia; only what acts is found and warned of."""
    acts, expected = AMPLIFIERS[case]
    recording = recorded(**acts)
    found = identify([log(recording)])
    amplifier = found.choices.amplifier
    assert amplifier.dead_zone == pytest.approx(expected.dead_zone, abs=0.05)
    assert amplifier.limit == (expected.limit and pytest.approx(expected.limit, rel=0.02))
    assert (amplifier == IDEAL) == (expected == IDEAL)
    assert any("amplifier" in warning for warning in found.warnings) == (expected != IDEAL)
    np.testing.assert_array_equal(
        found.recordings[0].input, amplifier.passed(recording.needed_input), strict=True
    )
    nothing = replace(recording, input=None, input_unit="")
    assert Amplifier(0.4, 6.0).behind(nothing) is nothing
    if acts.get("unit", "V") == "V" and not acts.get("square"):
        gain = found.parameters["input_gain_per_motor_inertia"]
        assert gain.value == pytest.approx(GAIN, rel=0.02 if "rests" in acts else 0.01)
    if case in ("a limit of a torque", "a dead zone of a torque", "both of a torque"):
        assert_holds(found, CORE, verdict="determined")
        for name, true in CORE.items():
            assert 1e-3 * true < found.parameters[name].std < 0.02 * true


def test_a_torque_by_a_voltage_has_the_doubts_of_a_voltage():
    """Assert that only such a torque allows for a coil and unseen errors of the amplifier."""
    torque = recorded(unit="N m")
    by_voltage = replace(torque, from_voltage=True)
    exact, doubted = (
        identify([log(each)]).parameters["motor_inertia"] for each in (torque, by_voltage)
    )
    assert exact.std < 1e-4 * CORE["motor_inertia"]
    assert doubted.value == exact.value
    assert 2e-3 * CORE["motor_inertia"] < doubted.std < 5e-3 * CORE["motor_inertia"]
    alone = identify([log(by_voltage)], Settings(model="link", terms=()))
    assert not alone.recordings[0].from_voltage


@pytest.mark.thorough  # 6 s
def test_a_log_that_was_low_passed_is_corrected():
    """Assert that a filter of 20 ms is found, and that values are right with its correction."""
    trial = make_trial("coulomb", 2020)
    logged = low_passed(trial.torque, 20e-3 / (trial.time[1] - trial.time[0]))
    sides = trial.link_position, trial.motor_position
    found = identify([log(recording(trial.time, *sides, logged))])
    assert found.choices.amplifier.log_lag == pytest.approx(20e-3, rel=0.03)
    assert any("low-passed into the log" in warning for warning in found.warnings)
    truth = {name: trial.truth[name] for name in CORE}
    assert_holds(found, truth, 0.05)
    assert all(2.0 * found.parameters[name].half_width > 1e-4 * truth[name] for name in truth)


def test_an_input_that_does_not_drive_the_motor_has_no_filter():
    """Assert no lag for a random walk, which a filter of 1.3 s would suit best."""
    plain = made(1)
    walk = np.cumsum(np.random.default_rng(1).standard_normal(len(plain)))
    balance = amplifiers.DrivenBalance(PAPER, data(replace(plain, input=walk)))
    assert balance.best_log_lag(IDEAL, 0.02) == 0.0


@pytest.mark.parametrize(
    ("early", "sought"), [(0.26, True), (0.24, False), (-0.26, True), (-0.24, False)]
)
def test_a_filter_is_sought_if_the_motor_is_early_or_late(monkeypatch, early, sought):
    """Assert that a motor must move a quarter of a sample before or after its input."""
    reported = SimpleNamespace(by_name={INPUT: -1e-3 * early}, excess=9.0)
    estimate = Estimate((), np.zeros(0), np.zeros((0, 0)), ())
    found = answers.Answer(cast(Any, SimpleNamespace(reported=reported)), cast(Any, None), estimate)
    balance = SimpleNamespace(
        amplifier=lambda **_: IDEAL,
        limit_changes=lambda _: {},
        with_log_lag=lambda amplifier, _: amplifier,
    )
    monkeypatch.setattr(amplifiers, "DrivenBalance", lambda *_: balance)
    monkeypatch.setattr(inputs, "answer", lambda _: found)
    monkeypatch.setattr(input_lag, "likely_lag", lambda _: 0.0)
    monkeypatch.setattr(inputs, "_with_amplifier", lambda _, job: job)
    steps: list[str] = []
    training = SimpleNamespace(samples=[SimpleNamespace(sample_time=1e-3)])
    about = {"input_unit": "N m", "is_voltage": False, "thresholds": THRESHOLDS, "structure": None}
    about["joint"] = SimpleNamespace(kind="rigid")  # whose encoder is on time
    job: Any = SimpleNamespace(**about, training=training, progress=steps.append)
    assert inputs.answer_with_amplifier(job)[2] == IDEAL
    assert bool(steps) == sought


@pytest.mark.parametrize(
    ("before", "left", "searched"),
    [(True, 0.011, False), (True, 0.009, True), (False, 0.011, True)],
)
def test_an_exact_fit_is_sought_again_where_it_may_succeed(monkeypatch, before, left, searched):
    """Assert that a corrected input is searched again unless its disturbances are too large."""

    def with_shares(share: float) -> Any:
        return SimpleNamespace(disturbances=SimpleNamespace(shares={"link": 0.001, "motor": share}))

    first, second = with_shares(0.2), with_shares(left)
    monkeypatch.setattr(answers, "_disturbed", lambda _: second)
    monkeypatch.setattr(answers, "answer", lambda _: first)
    logged = first if before else SimpleNamespace(disturbances=None)
    found = answers.answer_again(cast(Any, None), cast(Any, logged))
    assert found is (first if searched else second)


def test_a_lag_acts_and_is_undone_in_parts_as_in_the_whole():
    """Assert that a lag is inverted exactly, in parts with the same bits as in the whole.

    A lag of an amplifier with a limit has no seam, if enough samples are known.
    """
    sent = np.random.default_rng(4).standard_normal(300)
    amplifier = Amplifier(log_lag=4.5e-3)
    logged = low_passed(sent, 4.5)
    whole = amplifier.reached(logged, 1e-3)
    np.testing.assert_allclose(whole[1:], sent[1:], atol=1e-12)
    parts = (
        amplifier.reached(logged[:100], 1e-3),
        amplifier.reached(logged[100:], 1e-3, logged[:100]),
    )
    np.testing.assert_array_equal(np.concatenate(parts), whole)
    amplifier = Amplifier(limit=1.0, lag=4.5e-3)
    whole = amplifier.reached(sent, 1e-3)
    part = amplifier.reached(sent[100:], 1e-3, sent[:100])
    assert part == pytest.approx(whole[100:], abs=1e-9)
    assert np.std(whole) < 0.5 * np.std(amplifier.passed(sent))


WAVE = np.sin(np.linspace(0.0, 40.0, 4000))
EDGES = np.sign(WAVE) * np.minimum(np.abs(WAVE) / 0.1, 1.0)  # slow edges, 6 % of the time
WAVES = {  # whether a cubic term is identifiable from it
    "switched": (np.sign(WAVE), False),
    "switched between 1 and 2": (1.5 + 0.5 * np.sign(WAVE), False),
    "constant": (np.full(len(WAVE), 2.0), False),
    "switched slowly": (EDGES, False),
    "switched and drifting": (np.sign(WAVE) + np.linspace(-0.1, 0.1, len(WAVE)), False),
    "of three steps": (np.round(1.4 * WAVE), False),
    "of five steps": (np.round(2.0 * WAVE), True),
    "a sine": (WAVE, True),
}


@pytest.mark.parametrize("noise", [0.0, 0.005, 0.05, 0.15])
@pytest.mark.parametrize("wave", WAVES)
def test_what_shows_a_cube_of_the_input(wave: str, noise: float):
    """Assert that a cubic term is not identifiable for an input with two or three levels."""
    inputs, shows = WAVES[wave]
    noisy = inputs + noise * np.random.default_rng(1).standard_normal(len(inputs))
    samples = Samples(np.zeros((len(inputs), 2)), None, noisy[:, None], SAMPLE_TIME)
    assert amplifiers.shows_saturation(Data((samples,), (0,), np.ones(2))) == shows


@pytest.mark.thorough  # 4 s each
@pytest.mark.parametrize("fault", ["noise", "drift", "low-passed"])
def test_a_switched_torque_that_is_not_the_one_that_acts(fault: str):
    """Assert right values and no limit, although noise, drift or a filter distorts the torque."""
    trial = make_trial("torque_steps", 2023 if fault == "low-passed" else 2021)
    drawn = np.random.default_rng(2).standard_normal(len(trial.torque))
    logged = {
        "noise": trial.torque + 0.01 * np.std(trial.torque) * drawn,
        "drift": trial.torque + 0.05 * np.std(trial.torque) * np.sin(0.5 * trial.time),
        "low-passed": low_passed(trial.torque, 5e-3 / (trial.time[1] - trial.time[0])),
    }
    sides = trial.link_position, trial.motor_position
    found = identify([log(recording(trial.time, *sides, logged[fault]))])
    assert found.choices.amplifier.limit is None
    for name in CORE:
        assert found.parameters[name].value == pytest.approx(trial.truth[name], rel=0.02)
        assert found.parameters[name].verdict == "determined"


@pytest.mark.parametrize(("limit", "crossed"), [(0.5, False), (1.0, False), (1.7, True)])
def test_square_waves_cross_no_limit(limit: float, crossed: bool):
    """Assert that square waves on one side of a limit do not cross it, but peaks beyond it do."""
    waves: Any = [SimpleNamespace(inputs=np.full((50, 1), size)) for size in (0.75, -1.5)]
    waves[1].inputs[:1] = 1.8
    assert (
        amplifiers._is_crossed(cast(Any, SimpleNamespace(samples=waves)), Amplifier(limit=limit))
        == crossed
    )


def answered(
    excess: float, cost: float = np.nan, sample_time: float = 1e-3, retreat: str = ""
) -> Any:
    """An answer with disturbances if it has a cost, else an exact one."""
    return SimpleNamespace(
        disturbances=SimpleNamespace(sample_time=sample_time) if np.isfinite(cost) else None,
        cost=cost,
        fits=SimpleNamespace(reported=SimpleNamespace(excess=excess)),
        retreat=retreat,
    )


@pytest.mark.parametrize(
    ("other", "found", "likelier"),
    [
        (answered(5.0), answered(1.0, cost=10.0), True),  # the terms alone, against disturbances
        (answered(1.0, cost=10.0), answered(5.0), False),
        (answered(1.7), answered(2.0), True),  # exact fits: a tenth of the residuals
        (answered(1.9), answered(2.0), False),
        (answered(1.0, cost=80.0), answered(1.0, cost=100.0), True),  # disturbances: by 9
        (answered(1.0, cost=95.0), answered(1.0, cost=100.0), False),
        # of other data a likelihood says nothing
        (answered(1.0, cost=0.0, sample_time=2e-3), answered(1.0, cost=100.0), False),
        (answered(1.0, cost=0.0, retreat="shorter"), answered(1.0, cost=100.0), False),
    ],
)
def test_an_input_is_taken_if_it_is_clearly_likelier(other: Any, found: Any, likelier: bool):
    """Assert how two answers are compared: by kind, by residuals, by likelihoods of like data."""
    assert inputs._is_likelier(other, found) == likelier
