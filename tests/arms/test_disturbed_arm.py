"""Arms with disturbances: starts of fits, doubts, and errors of the rig."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from benchmarks.arms.arm import Arm, mjcf
from benchmarks.arms.log import Motion, simulate
from scipy.signal import savgol_filter
from test_identify_arm import MADE
from two_links import ARM

import flexid.arms.disturbed_terms as disturbed_terms
import flexid.arms.fitting as fitting
from flexid.arms.disturbed import DisturbedFit, Job
from flexid.arms.disturbed_terms import fit_disturbed
from flexid.arms.doubts import (
    DIRECTION,
    changes_by_play,
    driving_frictions,
    input_noise,
    looks_like_a_delay,
    looks_like_the_acceleration,
    noise_of_the_inputs,
    other_minima,
    rig_errors,
    term_law,
    times_of_channels,
    with_doubts,
    with_doubts_of_an_exact_fit,
    zeros,
)
from flexid.arms.fitting import exact_fits, fit_from_starts
from flexid.arms.identify import fixed_parameters
from flexid.arms.log import arm_data
from flexid.arms.starts import starts
from flexid.arms.units import ArmUnits
from flexid.arms.unusual import FittedArm, promises, unusual_parts
from flexid.arrays import FloatArray
from flexid.errors import ConvergenceError
from flexid.estimators.channel_timing import INPUT, Timing, before_a_lag, later
from flexid.estimators.prediction_error import Steps
from flexid.estimators.samples import Samples, divide
from flexid.identification.estimation.doubts import ANOTHER_LAW, covariance_of
from flexid.identification.estimation.rig_errors import SMALL_SHARE, likely_changes
from flexid.identification.full_model.fitting import fit_segments
from flexid.identification.full_model.model import Structure
from flexid.identification.preparation.joint import ElasticArm
from flexid.identification.vocabulary.evidence import Estimate
from flexid.models.planar_arm import planar_arm

NOISE = 0.03  # share of the torque's root mean square
FIXED = fixed_parameters(ARM, ArmUnits(ARM.types, ("N m", "N m")))
STRUCTURE = Structure(ElasticArm(planar_arm(ARM)), frozenset(), Timing("zero"), FIXED)


def moved(arm: Arm, noise: float = 0.0) -> Samples:
    """Return six seconds of an arm in MuJoCo."""
    pytest.importorskip("mujoco", reason="mujoco is not installed")
    motion = Motion(duration=6.0, sample_time=2e-3, bits=17, torque_noise=noise)
    log = simulate(arm, motion, np.random.default_rng(3))
    positions = np.stack((log.link, log.motor), axis=2).reshape(len(log.time), -1)
    return Samples(np.ascontiguousarray(positions), None, log.torque, 2e-3)


@cache
def recording() -> Samples:
    """Return a log with a noisy torque."""
    return moved(MADE, NOISE)


SMOOTH = replace(MADE, links=tuple(replace(link, motor_coulomb=0.0) for link in MADE.links))
CURVED = replace(MADE, links=(replace(MADE.links[0], cubic=1e6), MADE.links[1]))


@cache
def disturbed() -> DisturbedFit:
    """Return the fit of that log, started 20 % off."""
    start = {name: 1.2 * value for name, value in MADE.truth().items()}
    return fit_disturbed(STRUCTURE, arm_data([recording()]), (start,))


@cache
def doubted() -> Estimate:
    """Return the estimate of that fit with all doubts."""
    return with_doubts(disturbed())[0]


def test_intervals_hold_the_truth_where_the_torque_is_noisy():
    """Assert that 90 % of values lie within two standard deviations, and stiffnesses within 5 %."""
    estimate, truth = doubted(), MADE.truth()
    errors = np.array([value - truth[name] for name, value in estimate.by_name.items()])
    assert np.mean(np.abs(errors) < 2.0 * estimate.deviations) >= 0.9
    for joint in (1, 2):
        name = f"joint_stiffness_{joint}"
        assert estimate.by_name[name] == pytest.approx(truth[name], rel=0.05)


def test_noise_of_the_inputs_is_found_and_makes_inertias_look_larger():
    """Assert that the torque's noise is found within 20 %, and the sign of its bias."""
    made = disturbed()
    truth = NOISE * np.sqrt(np.mean(recording().inputs ** 2, axis=0))
    assert input_noise(made) == pytest.approx(truth, rel=0.2)
    moved = dict(zip(made.fitted.names, noise_of_the_inputs(made)[:, 0], strict=True))
    assert moved["motor_inertia_2"] > 0.0


def test_what_is_unexplained_makes_inertias_heavier_or_lighter():
    """Assert an inertia's error of the squared share of its own balance, and no other."""
    fitted, shares = disturbed().fitted, disturbed().shares()
    found = looks_like_the_acceleration(disturbed()).sum(axis=1)
    errors = dict(zip(fitted.names, found, strict=True))
    inertia = fitted.by_name["motor_inertia_2"]
    assert errors["motor_inertia_2"] == pytest.approx(shares["motor_2"] ** 2 * inertia)
    assert errors["joint_stiffness_2"] == errors["rotor_coupling_2"] == 0.0


def test_a_deflections_noise_is_its_own():
    """Assert that the noise of a measured deflection excludes the motor encoder's."""
    log = recording()
    rough = log.positions + 1e-3 * np.random.default_rng(2).standard_normal((len(log), 1))
    data = arm_data([replace(log, positions=rough)], {"link_1": "motor_1"})
    noise = replace(disturbed().job, data=data).in_band.noise
    assert noise[0] < 0.2 * noise[1]
    assert noise[2] > 0.5 * noise[1]


def test_a_rival_as_likely_is_doubted_and_one_less_likely_is_not():
    """Assert that another minimum is a doubt only if about as likely."""
    fit, best = disturbed(), disturbed().best
    for worse, columns in ((1.0, 1), (1e3, 0)):
        own = replace(fit, rivals=(replace(best, cost=best.cost + worse),))
        assert other_minima(own).shape == (len(best.fitted.names), columns)


def test_an_observer_predicts_the_deflections():
    """Assert that parameters of the first two thirds predict the rest over a resonance period."""
    found, periods = disturbed().predicted()
    assert min(found.horizons[0.2][f"link_position_{joint}"] for joint in (1, 2)) > 50.0
    assert min(periods.values()) > 50.0


def test_no_start_drives_itself():
    """Assert that dampings and frictions start at zero or above, despite late encoders."""
    late = recording()
    positions = late.positions.copy()
    positions[:, ::2] = np.roll(positions[:, ::2], 4, axis=0)
    balance = STRUCTURE.joint.balance
    found = [*starts(balance, [replace(late, positions=positions)], FIXED)]
    brakes = [name for name in found[0] if "friction" in name or "damping" in name]
    assert len(brakes) == 10
    assert min(start[name] for start in found for name in brakes) == 0.0
    assert all(start["rotor_coupling_2"] >= 0.0 for start in found)


def test_noise_of_the_torque_ends_exact_fits_early():
    """Assert that short segments end exact fits of a noisy torque, with the reason."""
    found = exact_fits(STRUCTURE, arm_data([recording()]), lambda _: None)
    assert len(found.found) < 4
    assert "residuals exceed" in found.failure


def test_a_delay_of_the_torque_is_no_disturbance():
    """Assert that torques three samples late are fitted exactly, with that delay."""
    log = moved(SMOOTH)
    late = replace(log.window(0, len(log) - 3), inputs=log.inputs[3:])
    early = replace(log.window(3, len(log)), inputs=log.inputs[:-3])
    for samples, delay in ((late, 6e-3), (early, -6e-3)):
        found = exact_fits(STRUCTURE, arm_data([samples]), lambda _: None)
        assert found.failure == ""
        assert found.best()[0].by_name[INPUT] == pytest.approx(delay, abs=1e-4)


@pytest.mark.parametrize(
    ("encoder", "shown", "least"),
    [
        ("link_1", "joint_stiffness_1 motor_viscous_friction_1 link_viscous_friction_1", None),
        ("motor_2", "joint_stiffness_2 motor_viscous_friction_2 rotor_coupling_2", 1e-4),
    ],
)
def test_a_late_encoder_is_found(encoder: str, shown: str, least: float | None):
    """Assert that an encoder two samples late is fitted exactly, with that delay."""
    log = moved(SMOOTH)
    early = log.window(2, len(log))
    positions = early.positions.copy()
    place = [row.name for row in STRUCTURE.joint.balance.rows].index(encoder)
    positions[:, place] = log.positions[:-2, place]
    found = exact_fits(STRUCTURE, arm_data([replace(early, positions=positions)]), lambda _: None)
    assert found.failure == ""
    values, truth = found.best()[0].by_name, SMOOTH.truth()
    assert values[f"{encoder}_delay"] == pytest.approx(4e-3, abs=1e-4)
    for name in shown.split():
        assert values[name] == pytest.approx(truth[name], rel=2e-2, abs=least), name


def test_friction_that_falls_off_its_static_value_is_found():
    """Assert both parts of a motor's dry friction, and that its velocity is a doubt."""
    log = moved(MADE)
    speed = np.asarray(savgol_filter(log.positions[:, 1], 9, 2, 1, log.sample_time))
    torques = log.inputs.copy()
    torques[:, 0] += 0.2 * np.sign(speed) * np.exp(-((speed / 0.5) ** 2))
    data = arm_data([replace(log, inputs=torques)])
    found = fit_disturbed(STRUCTURE, data, (MADE.truth(),))
    values, truth = found.fitted.by_name, MADE.truth()
    assert "motor_stribeck_friction_2" not in values
    coulomb, static = "motor_coulomb_friction_1", "motor_stribeck_friction_1"
    velocity = found.job.balance.constants["stribeck_velocity_1"]
    assert 0.3 < velocity < 0.8
    estimate = found.estimate.widened(covariance_of(term_law(found)))
    errors = {coulomb: values[coulomb] - truth[coulomb], static: values[static] - 0.2}
    for name, error in errors.items():
        place = estimate.names.index(name)
        assert abs(error) < 2.0 * estimate.deviations[place]
        assert found.estimate.deviations[place] < 0.5 * estimate.deviations[place]
    assert estimate.deviations[estimate.names.index(static)] > ANOTHER_LAW * values[static]


def test_no_log_shows_the_zeros_of_joints():
    """Assert that moments of a link have the error of its direction, in an exact fit too."""
    exact = exact_fits(STRUCTURE, arm_data([moved(SMOOTH)]), lambda _: None).best()
    certain, (widened, reasons) = exact[1], with_doubts_of_an_exact_fit(*exact)
    along, across = (f"link_moment_{way}_2" for way in ("along", "across"))
    error = DIRECTION * widened.by_name[along]
    for estimate in (widened, doubted()):
        place = estimate.names.index(across)
        assert 0.5 * error < estimate.deviations[place] < 2.0 * error
    place = certain.names.index(across)
    assert certain.deviations[place] < 0.1 * error
    assert "zeros" in reasons[across]


def errors_over(estimate: Estimate, name: str) -> list[float]:
    """Return the errors of a parameter of both joints of `SMOOTH`, in standard deviations."""
    values, truth = estimate.by_name, SMOOTH.truth()
    own = [f"{name}_{joint}" for joint in (1, 2)]
    places = [estimate.names.index(each) for each in own]
    return [
        abs(values[each] - truth[each]) / estimate.deviations[k]
        for each, k in zip(own, places, strict=True)
    ]


def test_a_delay_too_short_to_be_fitted_is_in_the_intervals():
    """Assert that intervals of frictions allow for a torque 6 µs early, of one joint."""
    log = moved(SMOOTH)
    inputs = log.inputs.copy()
    inputs[:, 0] = later(inputs[:, 0], -0.003)
    data = arm_data([replace(log, inputs=inputs)])
    exact = exact_fits(STRUCTURE, data, lambda _: None).best()
    assert exact[0].structure.timing.sought == ()
    widened, _ = with_doubts_of_an_exact_fit(*exact)
    for side in ("motor", "link"):
        name = f"{side}_viscous_friction"
        assert min(errors_over(exact[1], name)) > 2.0
        assert max(errors_over(widened, name)) < 1.0


def test_a_lag_is_in_the_intervals_of_a_delay():
    """Assert that intervals of inertias allow for a lag of 3 ms that looks like a delay."""
    log = moved(SMOOTH)
    inputs = np.column_stack([before_a_lag(torque, 1.5) for torque in log.inputs.T])
    found = fit_disturbed(STRUCTURE, arm_data([replace(log, inputs=inputs)]), (SMOOTH.truth(),))
    assert 2e-3 < found.fitted.by_name[INPUT] < 3e-3
    widened = found.estimate.widened(covariance_of(times_of_channels(found)))
    assert min(errors_over(found.estimate, "motor_inertia")) > 10.0
    assert max(errors_over(widened, "motor_inertia")) < 4.0


@cache
def late() -> DisturbedFit:
    """Return the fit of that log with link encoders half a sample late."""
    positions = recording().positions.copy()
    for link in positions.T[::2]:
        link[:] = later(link, 0.5)
    data = arm_data([replace(recording(), positions=positions)])
    return fit_disturbed(STRUCTURE, data, (MADE.truth(),))


def test_a_disturbed_motor_leaves_damping_and_late_encoders_uncertain():
    """Assert an error of a fitted delay that leaves the link's balance as it is."""
    assert looks_like_a_delay(disturbed()).shape[1] == 0
    found = late()
    first, second = looks_like_a_delay(found).T
    errors = dict(zip(found.fitted.names, first, strict=True))
    damping, stiffness = errors["joint_damping_1"], found.values["joint_stiffness_1"]
    assert damping > 0.0
    assert errors["link_viscous_friction_1"] == -damping
    assert errors["link_1_delay"] == pytest.approx(damping / stiffness)
    assert np.count_nonzero(first) == np.count_nonzero(second) == 3


def test_late_encoders_are_no_damping_of_a_disturbed_arm():
    """Assert that both late link encoders leave damping and friction right."""
    found, truth = late(), MADE.truth()
    values, deviations = found.fitted.by_name, found.estimate.deviations
    assert INPUT not in values
    assert len(found.by_delays) == 3  # other delays were compared
    for place, name in enumerate(found.fitted.names):
        if name in ("link_1_delay", "link_2_delay"):
            assert values[name] == pytest.approx(1e-3, abs=5e-5)
        elif "viscous" in name or "damping" in name:
            assert abs(values[name] - truth[name]) < 4.0 * deviations[place], name


LINKS = ("link_1_delay", "link_2_delay")
KINDS = {"inputs": (INPUT,), "links": LINKS, "both": (INPUT, *LINKS)}


def with_delays(cost: float, sought: tuple[str, ...]) -> DisturbedFit:
    """Return a fit with these delays, a cost, and a friction equal to the number of delays."""
    made = disturbed()
    timing = replace(made.job.structure.timing, sought=sought)
    structure = replace(made.job.structure, timing=timing)
    fitted = SimpleNamespace(structure=structure, by_name={"friction": len(sought)})
    best: Any = SimpleNamespace(fitted=fitted, cost=cost)
    return replace(made, job=replace(made.job, structure=structure), best=best)


@pytest.mark.parametrize(
    ("costs", "chosen", "errors"),
    [
        ((-900.0, -1000.0, -1010.0), "links", (-0.98, 0.0, 1.0)),
        ((-1000.0, -800.0, -1010.0), "inputs", (0.0, 0.255, 2.0)),
        ((-900.0, -1000.0, -1250.0), "both", (-0.255, -0.25, 0.0)),
    ],
)
def test_delays_of_two_kinds_are_fitted_only_if_one_explains_clearly_less(
    costs: tuple[float, ...], chosen: str, errors: tuple[float, ...], monkeypatch: Any
):
    """Assert the likelier kind of delay, and the errors by the others if they are as likely."""
    fits = {
        sought: with_delays(cost, sought)
        for sought, cost in zip(KINDS.values(), costs, strict=True)
    }

    def fit(begun: DisturbedFit, parts: Any) -> DisturbedFit:
        names = {*begun.job.structure.timing.sought, *(name for p in parts for name in p.names)}
        return fits[tuple(name for name in KINDS["both"] if name in names)]

    monkeypatch.setattr(disturbed_terms, "_with_unusual_terms", fit)
    found = disturbed_terms.with_likelier_delays(with_delays(0.0, ()), fits[KINDS["both"]])
    assert found.job.structure.timing.sought == KINDS[chosen]
    changes = [each["friction"] * np.sqrt(3.0) for each in found.by_delays]
    assert changes == pytest.approx(errors, rel=0.03)


def test_a_friction_surely_below_zero_is_told():
    """Assert that only frictions beyond four standard deviations below zero drive the arm."""
    names = ("link_viscous_friction_1", "joint_damping_1", "motor_offset_1", "rotor_coupling_2")
    found: Any = SimpleNamespace(
        fitted=SimpleNamespace(names=names, values=[-5.0, -3.0, -9.0, -9.0]),
        estimate=SimpleNamespace(deviations=[1.0] * 4),
    )
    assert driving_frictions(found) == {"link_viscous_friction_1"}


def test_a_hardening_spring_is_found():
    """Assert the stiffness at rest and the cubic one, exactly and with noise."""
    truth = CURVED.truth()
    exact = exact_fits(STRUCTURE, arm_data([moved(CURVED)]), lambda _: None)
    start = {name: value for name, value in truth.items() if "cubic" not in name}
    noisy = fit_disturbed(STRUCTURE, arm_data([moved(CURVED, NOISE)]), (start,))
    for values, error in ((exact.best()[0].by_name, 2e-3), (noisy.fitted.by_name, 2e-2)):
        assert "cubic_joint_stiffness_2" not in values
        for name in ("joint_stiffness_1", "cubic_joint_stiffness_1", "joint_stiffness_2"):
            assert values[name] == pytest.approx(truth[name], rel=error), name


def with_play(monkeypatch: pytest.MonkeyPatch, half_gap: float) -> None:
    """Give the springs of arms in MuJoCo play."""
    gap = f'springlength="{-half_gap} {half_gap}"'
    monkeypatch.setattr(
        "benchmarks.arms.log.mjcf", lambda *a: mjcf(*a).replace('springlength="0"', gap)
    )


def test_play_widens_a_stiffness(monkeypatch: pytest.MonkeyPatch):
    """Assert that the interval covers a stiffness that play makes appear too small."""
    with_play(monkeypatch, 0.01)
    truth = MADE.truth()["joint_stiffness_1"]
    found = fit_disturbed(STRUCTURE, arm_data([moved(MADE)]), (MADE.truth(),))
    estimate, widest = with_doubts(found)
    place = estimate.names.index("joint_stiffness_1")
    off = truth - estimate.values[place]
    assert off > 5.0 * found.estimate.deviations[place]
    assert off < 1.5 * estimate.deviations[place]
    assert "play" in widest["joint_stiffness_1"]


def test_a_spring_that_hardens_is_doubted_only_if_it_has_play(monkeypatch: pytest.MonkeyPatch):
    """Assert that play with a cubic spring changes values, and a cubic spring alone does not."""
    values = CURVED.truth() | {"torque_constant_1": 1.0, "torque_constant_2": 1.0}
    changes = []
    for gap in (0.0, 0.002):
        with_play(monkeypatch, gap)
        changes.append(changes_by_play(planar_arm(ARM), values, (moved(CURVED),))[0])
    assert changes[0] == {}
    assert changes[1]["joint_stiffness_1"] > 0.02 * values["joint_stiffness_1"]


def refitted(job: Job) -> DisturbedFit:
    """Return the fit continued from its values, with another log or other lengths."""
    made = disturbed()
    near = job.in_band.with_gains_of(made.fitted, made.fitted.by_name, 3)
    return replace(made, job=job, best=replace(made.best, fitted=near))


def told_of(found: DisturbedFit) -> FloatArray:
    """Return the change of values by rig errors in the log, over standard deviations."""
    rigs = [*rig_errors(found.fitted, found.job.deflections)]
    changes = likely_changes(found.fitted, rigs)[:, -1]
    changes += likely_changes(found.fitted, [*zeros(found.fitted)], share=SMALL_SHARE)[:, -1]
    return changes / disturbed().estimate.deviations


def shown(row: int, error: FloatArray, relative_to: dict[str, str]) -> DisturbedFit:
    """Return the fit of a log with an error of one position."""
    positions = recording().positions.copy()
    positions[:, row] += error
    data = arm_data([replace(recording(), positions=positions)], relative_to)
    return refitted(replace(disturbed().job, data=data))


def longer() -> DisturbedFit:
    """Return the fit with a first link stated 2 % too long."""
    job = disturbed().job
    arm = replace(ARM, lengths=(1.02 * ARM.lengths[0], *ARM.lengths[1:]))
    structure = replace(job.structure, joint=ElasticArm(planar_arm(arm)))
    return refitted(replace(job, structure=structure))


def turned() -> DisturbedFit:
    """Return the fit with gravity stated 1.7 degrees off."""
    job = disturbed().job
    arm = replace(ARM, gravity=(9.81 * np.cos(0.03), 9.81 * np.sin(0.03)))
    structure = replace(job.structure, joint=ElasticArm(planar_arm(arm)))
    return refitted(replace(job, structure=structure))


@pytest.mark.parametrize(
    "error", ["eccentric", "motor's scale", "deflection's scale", "length", "gravity"]
)
def test_a_log_tells_of_an_error_of_its_rig(error: str):
    """Assert that the detected rig error undoes most of the change of values."""
    link, motor = recording().positions.T[:2]
    wrong = {
        "eccentric": lambda: shown(0, 2e-3 * np.sin(link), {}),
        "motor's scale": lambda: shown(1, 0.01 * motor, {}),
        "deflection's scale": lambda: shown(0, 0.1 * (link - motor), {"link_1": "motor_1"}),
        "length": longer,
        "gravity": turned,
    }[error]()
    done = (wrong.fitted.values - disturbed().fitted.values) / disturbed().estimate.deviations
    without = told_of(replace(wrong, best=disturbed().best, job=disturbed().job))
    left = np.linalg.norm(done + told_of(wrong) - without)
    assert np.linalg.norm(done) > 1.0
    assert left < 0.5 * np.linalg.norm(done)


def test_a_rig_on_which_the_motion_diverges_says_nothing():
    """Assert that a diverging motion with a rig error raises, so that no interval has NaN."""
    fitted = disturbed().fitted
    segments = fitted.problem.segments
    far = replace(segments, outputs=segments.outputs + 1e200)
    with pytest.raises(ConvergenceError, match="diverges"):
        likely_changes(fitted, [replace(fitted.problem, segments=far)])


def test_a_right_rig_is_hardly_doubted():
    """Assert that for a right rig doubts are mostly below the standard errors."""
    found = disturbed()
    rigs = [*rig_errors(found.fitted, ())]
    assert len(rigs) == 7  # sine, cosine and scale for two joints, and one length
    sizes = np.linalg.norm(likely_changes(found.fitted, rigs), axis=1)
    assert np.median(sizes / found.estimate.deviations) < 1.0


def test_each_start_is_tried_over_few_segments_first(monkeypatch: pytest.MonkeyPatch):
    """Assert that starts are tried on few segments, and the first success then on all."""
    still = Samples(np.zeros((1000, 4)), None, np.zeros((1000, 2)), 2e-3)
    segments, asked = divide([still], 0.02), []

    def fit_segments(structure: Any, data: Any, segments: Any, start: Any, *_: Any) -> Any:
        asked.append((len(segments), start["number"]))
        if start["number"] == 1:
            raise ConvergenceError("prediction error", "diverges")
        return SimpleNamespace(by_name={"number": 10 * start["number"]})

    monkeypatch.setattr(fitting, "starts", lambda *_: [{"number": n} for n in (1, 2, 3)])
    monkeypatch.setattr(fitting, "by_misfit", lambda *given: given[3])
    monkeypatch.setattr(fitting, "fit_segments", fit_segments)
    likely, fit = fitting.fit_from_starts(STRUCTURE, arm_data([still]), segments)
    assert likely == ({"number": 2}, {"number": 3})
    assert fit is not None
    assert fit.by_name == {"number": 200}
    few = asked[0][0]
    assert few < len(segments)
    assert asked == [(few, 1), (few, 2), (len(segments), 20)]


def fitted_without() -> FittedArm:
    """Return a fit of linear springs to an arm whose first spring hardens."""
    data = arm_data([moved(CURVED)])
    segments = divide(data.samples, 0.4)
    _, first = fit_from_starts(STRUCTURE, data, segments)
    assert first is not None
    return fit_segments(STRUCTURE, data, segments, first.by_name, None, Steps(0.1))


def test_a_step_promises_what_a_fit_brings():
    """Assert that the true part has the best prediction, close to the actual gain of its fit."""
    fitted = fitted_without()
    squares = fitted.minimum.equations.cost
    parts = unusual_parts(STRUCTURE)
    promised = {part.names[0]: cost for cost, part in promises(fitted, parts[:-1])}
    assert {"cubic_joint_stiffness_2", INPUT, "link_1_delay"} < promised.keys()
    assert min(promised, key=lambda name: promised[name]) == "cubic_joint_stiffness_1"
    structure = parts[0].added(STRUCTURE)
    states = fitted.minimum.point.initial_states
    found = fit_segments(
        structure, fitted.data, fitted.problem.segments, fitted.by_name, states, Steps(0.1)
    )
    brought = squares - found.minimum.equations.cost
    assert brought > 0.1 * squares
    assert abs(squares - promised["cubic_joint_stiffness_1"] - brought) < 0.2 * brought
