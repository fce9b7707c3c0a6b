"""Starting values: least squares on a stiff drive with dry friction, and the first fits."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from made_joint import COEFFICIENTS, JOINT, data, made, posed, seen, structure

from flexid.errors import ConvergenceError
from flexid.estimators.channel_timing import INPUT, Timing
from flexid.estimators.prediction_error import FINE
from flexid.identification.full_model import fits_by_length, fitting, starting
from flexid.identification.full_model.fitting import fit_by_length, lengths, refit
from flexid.identification.full_model.model import LINK, Data, Structure
from flexid.identification.full_model.starting import least_squares_start, starts
from flexid.identification.vocabulary.thresholds import THRESHOLDS
from flexid.models.flexible_joint import PAPER_TERMS
from flexid.recording.recording import Hold

TERMS = (*PAPER_TERMS, "motor_coulomb")
DELAYS = (INPUT, LINK)

STIFF = {
    "link_inertia": 2.5,
    "motor_inertia": 1.0,
    "joint_stiffness": 10000.0,
    "gravity_torque": 35.0,
    "motor_viscous": 3.7,
    "motor_coulomb_up": 13.7,
    "motor_coulomb_down": 13.7,
}
"""A harmonic drive whose motor often sticks under the tones' torque."""


def posed_of(
    data: Data, *terms: str, hold: Hold = "zero", sought: tuple[str, ...] = DELAYS, **about: Any
) -> Structure:
    """Return a structure with these terms and with shapes scaled to the data."""
    base = structure(*(terms or TERMS), hold=hold)
    joint = JOINT.scaled(data.samples)
    return replace(base, joint=joint, timing=Timing(hold, {}, sought), **about)


@pytest.fixture(scope="module")
def stiff():
    """Return a log of the harmonic drive with a held torque."""
    return data(made(3, 12.0, held=True, size=1.5, **STIFF))


def log_of(**more) -> Data:
    """Return a log of the paper's joint."""
    return data(made(5, 6.0, **more))


def first_start(base: Structure, log: Data) -> dict[str, float]:
    """Return the most promising start."""
    return next(starts(base, log, lengths(log)[0]))


def test_a_moving_motor_starts_better_than_a_sticking_one(stiff):
    """Assert that stiction halves the values of least squares, but not those of the first start."""
    base = posed_of(stiff)
    truth = {"alpha1": 10000.0, "beta1": 1.0, "alpha_coulomb": 13.7}
    plain, _ = least_squares_start(base, stiff, 20.0)
    first = first_start(base, stiff)
    given = first_start(replace(base, fixed={"alpha_coulomb": 13.7}), stiff)
    for name, value in truth.items():
        assert plain[name] < 0.5 * value
        assert first[name] == pytest.approx(value, rel=0.05)
        assert name == "alpha_coulomb" or given[name] == pytest.approx(value, rel=0.05)


def test_starts_differ_and_agree_where_nothing_sticks(stiff):
    """Assert that starts are distinct, and close to the truth for a joint without dry friction."""
    plain = log_of(held=True)
    for log, base in (
        (stiff, posed_of(stiff)), (stiff, posed_of(stiff, *PAPER_TERMS)),
        (plain, posed_of(plain, *PAPER_TERMS)),
    ):  # fmt: skip
        ways = [*starts(base, log, lengths(log)[0])]
        assert all(way not in ways[:place] for place, way in enumerate(ways))
        assert len(ways) >= 4
    for start in ways:
        assert {name: start[name] for name in COEFFICIENTS} == pytest.approx(COEFFICIENTS, rel=0.05)


def test_a_row_that_hardly_keeps_moving_is_taken_whole():
    """Assert that a row is left out of moving-only starts if its side moves too rarely."""
    log = log_of(held=True, motor_coulomb_up=14.0, motor_coulomb_down=14.0, size=0.6)
    base = posed_of(log, *TERMS, "link_coulomb")
    fit = least_squares_start(base, log, 60.0)[1]
    assert {*starting._while_moving(fit)} == {"theta1", "theta2", "theta_coulomb"}
    smooth = posed_of(log, *PAPER_TERMS)
    assert starting._while_moving(least_squares_start(smooth, log, 60.0)[1]) == {}


def test_a_strong_spring_starts_as_bent_as_its_link_says():
    """Assert that a start has the cubic stiffness that the link's acceleration shows."""
    log = log_of(held=True, cubic_stiffness=3000.0)
    first = first_start(posed_of(log, *TERMS, "cubic_stiffness"), log)
    assert first["alpha_cubic"] == pytest.approx(10000.0, rel=0.1)
    soft = log_of(held=True, cubic_stiffness=-20.0)
    for way in starts(posed_of(soft, *TERMS, "cubic_stiffness"), soft, lengths(soft)[0]):
        assert way["alpha_cubic"] == 0.0  # so that no motion diverges


def test_one_jolt_makes_no_start_worse(monkeypatch):
    """Assert that starts are ranked by the mean logarithm of residuals, not by their sum."""
    plain = log_of(held=True)
    jolted = plain.samples[0].positions.copy()
    jolted[len(jolted) // 2 :] += 0.3
    segments = replace(lengths(plain)[0], outputs=jolted)
    log = replace(plain, samples=(replace(plain.samples[0], positions=jolted),))
    base = posed_of(plain, *PAPER_TERMS)
    wrong = {**COEFFICIENTS, "theta2": 70.0}
    fit = least_squares_start(base, plain, 20.0)[1]
    several = iter([wrong, COEFFICIENTS, wrong, wrong])
    monkeypatch.setattr(starting, "least_squares_start", lambda *_: (next(several), fit))
    monkeypatch.setattr(starting, "_while_moving", lambda _: wrong)
    assert next(starts(base, log, segments)) == COEFFICIENTS


HOLDS = ("zero", "cubic", "linear")


def test_rest_alone_starts_nothing(monkeypatch: pytest.MonkeyPatch):
    """Assert that least squares without a spring, by which others are divided, gives no start."""
    log = log_of()
    nothing = dict.fromkeys(COEFFICIENTS, 0.0)
    fit = least_squares_start(posed_of(log), log, 20.0)[1]
    monkeypatch.setattr(starting, "least_squares_start", lambda *_: (nothing, fit))
    monkeypatch.setattr(starting, "_while_moving", lambda _: {})
    with pytest.raises(ConvergenceError, match="nearly all of the log is rest: log more motion"):
        next(starts(posed_of(log), log, lengths(log)[0]))


@pytest.mark.parametrize("held", [True, False])
def test_long_segments_know_the_hold(held):
    """Assert that long segments identify the hold, if short ones do not distinguish holds."""
    log = log_of(held=held, noise=2e-7)
    if held:
        alike = replace(THRESHOLDS, hold_fall=1e9)
        found = fits_by_length.fit_full_model(
            posed_of(log), log, ("zero", "linear"), (), lambda _: None, alike
        )
        assert found.tied == ("linear",)
        found = fits_by_length.fit_full_model(posed_of(log), log, ("linear",), (), lambda _: None)
        assert found.hold_reason == "as given"
        assert found.found[-1].structure.timing.hold == "linear"
    found = fits_by_length.fit_full_model(posed_of(log), log, HOLDS, (), lambda _: None)
    assert found.found[-1].structure.timing.hold == ("zero" if held else "cubic")
    assert found.tied == ()
    assert abs(found.found[-1].delays[INPUT]) < 1e-5
    assert "less than with other holds" in found.hold_reason


def test_tied_holds_are_all_in_the_interval():
    """Assert that the delay's covariance includes the shift to each tied hold."""
    log = log_of(held=True, noise=3e-4, input_delay=2.7e-3)
    found = fits_by_length.fit_full_model(posed_of(log), log, HOLDS, (), lambda _: None)
    assert {*found.tied} == {"cubic", "linear"}
    last = found.found[-1]
    assert last.structure.timing.hold == "zero"  # zero hold has the smallest delay
    place = last.names.index(INPUT)
    more = fits_by_length.hold_covariance(last, found.tied)[place, place] ** 0.5
    half = 0.5 * log.samples[0].sample_time
    assert 0.6 * half < more < 0.9 * half  # root of two thirds for three equal holds
    assert not fits_by_length.hold_covariance(last, ()).any()


def test_a_delay_of_half_a_sample_is_a_coincidence():
    """Assert that hold "zero" without delay is preferred if noise makes the holds equal."""
    log = log_of(held=True, noise=3e-4)
    found = fits_by_length.fit_full_model(posed_of(log), log, HOLDS, (), lambda _: None)
    assert found.found[-1].structure.timing.hold == "zero"
    assert found.tied == ()
    assert "half a sample by chance" in found.hold_reason


def test_a_delay_that_leaves_the_data_is_no_fit():
    """Assert that a fitted delay beyond the margin of the data is an error."""
    late = log_of(held=True, link_delay=0.05)
    base = posed_of(late, sought=(LINK,))
    segments = lengths(late)[2]
    assert late.margin < 0.05
    with pytest.raises(ConvergenceError, match="comes out above"):
        refit(base, late, {**COEFFICIENTS, LINK: 0.04}, segments, FINE, None)


@pytest.mark.parametrize("late", [0.0, 0.04])
def test_a_given_delay_may_be_longer_than_the_margin(late):
    """Assert that a given delay may exceed the margin of the data."""
    log = log_of(held=True, link_delay=late)
    timing = Timing("zero", {LINK: late}, (INPUT,))
    base = replace(posed_of(log), timing=timing)
    found = fits_by_length.fit_full_model(base, log, ("zero",), (), lambda _: None).found[-1]
    assert found.structure.absent == base.absent
    assert found.delays[LINK] == late
    assert found.by_name["theta2"] == pytest.approx(COEFFICIENTS["theta2"], rel=1e-2)


@pytest.mark.parametrize("samples", [1, 30])
def test_a_fall_counts_less_where_residuals_are_correlated(samples):
    """Assert that errors correlated over 30 samples count as about 30 times fewer."""
    exact = made(5, 6.0, held=True, noise=0.0)
    sums = np.cumsum(np.random.default_rng(12).standard_normal((2, len(exact) + samples)), axis=1)
    link, motor = 1e-4 * (sums[:, samples:] - sums[:, :-samples]) / samples**0.5
    log = replace(data(seen(exact, link, motor)), noise=np.full(2, 1e-4))
    base = posed_of(log)
    (fitted,) = fit_by_length(base, log, COEFFICIENTS, lengths(log)[-1:])
    assert fitted.excess == pytest.approx(1.0, abs=0.3)
    low, high = (1.0, 2.5) if samples == 1 else (6.0, 90.0)
    assert low <= fits_by_length.residual_variance([fitted]) <= high


def test_starts_of_a_long_log_are_tried_in_part(monkeypatch: pytest.MonkeyPatch):
    """Assert that a subset of segments is fitted first, and gives nearly the same fit as all."""
    fitted_over = []

    def recorded(structure: Structure, own: Data, way: dict[str, float], divisions, **how):
        fitted_over.append(len(divisions[0]))
        return fit_by_length(structure, own, way, divisions, **how)

    structure, own = posed(made(1, 10.0))
    short = lengths(own)[:1]
    (whole,) = starting.first_fits(structure, own, short)
    monkeypatch.setattr(fitting, "_ENOUGH", 1_000)
    monkeypatch.setattr(starting, "fit_by_length", recorded)
    (found,) = starting.first_fits(structure, own, short)
    part, all_of_it = fitted_over
    assert 0.1 * len(short[0]) < part < 0.25 * len(short[0])
    assert all_of_it == len(short[0])
    assert found.values == pytest.approx(whole.values, rel=1e-3)
