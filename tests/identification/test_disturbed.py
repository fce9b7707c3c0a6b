"""The fit with disturbances: what it finds, and what widens its intervals."""

from collections.abc import Collection
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from disturbed_drive import TRUTH, data, drive, recording, stopping
from scipy.stats import t

from flexid.errors import ConvergenceError
from flexid.estimators.channel_timing import Timing
from flexid.identification.estimation import disturbed
from flexid.identification.estimation.band import FitInBand
from flexid.identification.estimation.disturbed import Disturbed, disturbed_estimate, fit_disturbed
from flexid.identification.full_model.model import Data, Fitted, Structure
from flexid.identification.preparation.joint import flexible
from flexid.identification.structure import gap
from flexid.identification.structure.link_delay import skew
from flexid.identification.vocabulary.estimate import Estimate
from flexid.identification.vocabulary.thresholds import THRESHOLDS, Thresholds
from flexid.models.flexible_joint import HARDENING

JOINT = flexible()
CORE = ("theta2", "alpha1", "beta1")


def fitted(log: Data, *terms: str) -> Disturbed:
    """A log fitted with viscous friction of the motor, and more terms to be considered."""
    on = {c for term in ("motor_viscous", *terms) for c in JOINT.terms[term]}
    structure = Structure(JOINT, frozenset(JOINT.optional - on), Timing("cubic"))
    return fit_disturbed(structure, log, (), ("cubic",), THRESHOLDS, with_play=False)


@cache
def pushed(every: int = 1) -> tuple[Disturbed, Estimate]:
    """A drive whose link is pushed, logged at 500 Hz or a part of it."""
    log = data(recording(*drive(1, link_push=1.0), every))
    found = fitted(log)
    return found, disturbed_estimate(found, log, "N m")[0]


def half_widths(estimate: Estimate) -> dict[str, float]:
    """Half the 95 % interval of each value."""
    quantiles = t.ppf(0.975, np.array(estimate.degrees_of_freedom))
    return dict(zip(estimate.names, quantiles * estimate.deviations, strict=True))


@pytest.mark.parametrize("name", CORE)
def test_a_pushed_link_leaves_the_core_known(name):
    """Assert that intervals hold the truth, and are no wider than a tenth of it."""
    _, estimate = pushed()
    half = half_widths(estimate)[name]
    assert abs(estimate.by_name[name] - TRUTH[name]) <= half
    assert half < 0.1 * TRUTH[name]


@cache
def stopped() -> tuple[Disturbed, Estimate]:
    """A drive with a friction of another law, that moves from stop to stop."""
    log = data(recording(*stopping(1)))
    on = {c for term in ("motor_viscous", "motor_coulomb") for c in JOINT.terms[term]}
    structure = Structure(JOINT, frozenset(JOINT.optional - on), Timing("zero"))
    found = fit_disturbed(structure, log, (), ("zero",), THRESHOLDS, with_play=False)
    return found, disturbed_estimate(found, log, "N m")[0]


@pytest.mark.parametrize("name", CORE)
def test_a_drive_that_stops_leaves_the_core_known(name):
    """Assert the same where friction holds the motor for a good part of the log."""
    found, estimate = stopped()
    assert found.fitted.problem.observer is not None
    assert 0.1 < found.fitted.problem.observer.resting[:, 1].mean() < 0.8
    half = half_widths(estimate)[name]
    assert abs(estimate.by_name[name] - TRUTH[name]) <= half
    assert half < 0.15 * TRUTH[name]


def test_the_push_is_found_in_its_row():
    """Assert that the link's disturbance is found to a factor of 1.5, and the motor's is small."""
    link, motor = pushed()[0].sizes.disturbances
    assert 1.0 / 1.5 < link < 1.5
    assert motor < 0.3 * link


@pytest.mark.parametrize("every", [2, 4])
@pytest.mark.parametrize("name", CORE)
def test_the_rate_of_the_logger_hardly_matters(name, every):
    """Assert that half and a fourth of the samples move a value by a tenth of its interval."""
    _, estimate = pushed()
    _, other = pushed(every)
    apart = abs(other.by_name[name] - estimate.by_name[name])
    assert apart < 0.1 * 2.0 * half_widths(estimate)[name]


@pytest.mark.parametrize("size", [0.06, 1.0])
def test_gravity_is_found_however_far_the_joint_turns(size):
    """Assert that its interval holds the truth within 0.5 rad and beyond, and so do the others."""
    log = data(recording(*drive(3, size=size, gravity=8.0, link_push=0.3 * size)))
    turned = np.ptp(log.samples[0].positions[:, 0])
    assert (turned > 0.5) == (size == 1.0)
    found = fitted(log, "gravity")
    estimate, _ = disturbed_estimate(found, log, "N m")
    for name, truth in {**TRUTH, "theta1": 8.0}.items():
        assert abs(estimate.by_name[name] - truth) <= half_widths(estimate)[name]


def test_a_delay_between_encoders_is_found():
    """Assert that 3 ms are found on a rigid joint, and explain more than 0.8 of the deflection."""
    time, positions, inputs = drive(4, rigid=True)
    late = np.interp(time - 3e-3, time, positions[:, 0])
    log = data(recording(time, np.column_stack((late, positions[:, 1])), inputs))
    found = skew(JOINT, log)
    assert found.delay == pytest.approx(3e-3, rel=0.05)
    assert abs(found.delay - 3e-3) < 4.0 * found.deviation
    assert found.makes_the_deflection
    assert found.excess < 10.0


def test_a_spring_beside_a_delay_is_seen():
    """Assert that a delay that explains nearly all of the deflection leaves what a spring does."""
    time, rates = np.arange(0.0, 16.0, 2e-3), np.geomspace(1.0, 26.0, 15)  # s, rad/s
    phases = np.random.default_rng(6).uniform(0.0, 2.0 * np.pi, len(rates))

    def link(at: np.ndarray) -> np.ndarray:
        return np.sin(np.outer(at, rates) + phases) @ (1.0 / rates)

    acceleration = np.sin(np.outer(time, rates) + phases) @ -rates
    positions = np.column_stack((link(time - 4e-3), link(time) + acceleration / 2e4))
    found = skew(JOINT, data(recording(time, positions, np.zeros_like(time))))
    assert found.delay == pytest.approx(4e-3, rel=0.02)
    assert found.explained > 0.9
    assert found.by_spring > 0.9
    assert not found.makes_the_deflection


def test_a_spring_is_no_delay():
    """Assert that a delay explains less than a fifth of a compliant joint's deflection."""
    found = skew(JOINT, data(recording(*drive(1))))
    assert abs(found.explained) < 0.2
    assert not found.makes_the_deflection
    assert found.excess > 100.0


def test_halves_of_two_drives_widen_the_interval():
    """Assert that a stiffness that changes by 10 % has an interval that reaches both values."""

    def stiffer(time: float) -> float:
        return 1.1 if time > 8.0 else 1.0

    log = data(recording(*drive(5, link_push=0.3, stiffer=stiffer)))
    found = fitted(log)
    estimate, _ = disturbed_estimate(found, log, "N m")
    value, half = estimate.by_name["theta2"], half_widths(estimate)["theta2"]
    assert value - half <= TRUTH["theta2"]
    assert value + half >= 1.1 * TRUTH["theta2"]


@cache
def loose(half_gap: float, hardening: float) -> tuple[Disturbed, Estimate]:
    """A pushed drive whose joint has play or hardens, fitted with either considered."""
    log = data(recording(*drive(7, link_push=0.3, half_gap=half_gap, hardening=hardening)))
    on = {c for term in ("motor_viscous", "cubic_stiffness") for c in JOINT.terms[term]}
    joint = JOINT.scaled(log.samples)
    structure = Structure(joint, frozenset(joint.optional - on), Timing("cubic"))
    found = fit_disturbed(structure, log, (), ("cubic",), THRESHOLDS, with_play=True)
    found = disturbed.fit_disturbed_to(found, log)
    return found, disturbed_estimate(found, log, "N m")[0]


@pytest.mark.parametrize("half_gap", [0.02, 0.08])
def test_play_is_found_beside_disturbances(half_gap: float):
    """Assert that gap and spring are known, where a curved spring would be far too soft."""
    found, estimate = loose(half_gap, 0.0)
    assert gap.is_dead_zone(found.fitted)
    assert gap.half_gap(found.fitted) == pytest.approx(half_gap, rel=0.1)
    for name in CORE:
        half = half_widths(estimate)[name]
        assert abs(estimate.by_name[name] - TRUTH[name]) <= half
        assert half < 0.1 * TRUTH[name]


def test_a_spring_that_hardens_is_no_play():
    """Assert that a curved spring stays one, and is known."""
    found, estimate = loose(0.0, 20.0)
    assert gap.half_gap(found.fitted) == 0.0
    assert "alpha_cubic" in found.fitted.names
    half = half_widths(estimate)["theta2"]
    assert abs(estimate.by_name["theta2"] - TRUTH["theta2"]) <= half < 0.1 * TRUTH["theta2"]


def supposed_play(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Say that least squares finds play in a drive whose spring hardens, and fit that."""

    def likely_play(structure: Structure, _: Data) -> gap.LikelyPlay:
        without = structure.without(HARDENING)
        wide = gap.as_wide(replace(without, absent=without.absent - gap.PLAY), 0.02)
        return gap.LikelyPlay(wide, {**TRUTH, "theta_backlash": 3.0}, 5.0, 0.5)

    monkeypatch.setattr(disturbed, "likely_play", likely_play)
    log = data(recording(*drive(7, link_push=0.3, hardening=20.0)))
    on = {c for term in ("motor_viscous", "cubic_stiffness") for c in JOINT.terms[term]}
    structure = Structure(
        JOINT.scaled(log.samples), frozenset(JOINT.optional - on), Timing("cubic")
    )
    return fit_disturbed(structure, log, (), ("cubic",), THRESHOLDS, with_play=True)


def test_play_that_the_log_denies_is_no_doubt(monkeypatch: pytest.MonkeyPatch):
    """Assert that what least squares takes for play does not count where a fit of it is worse."""
    assert supposed_play(monkeypatch).by_play == 0.0


def test_play_that_has_no_fit_is_a_doubt(monkeypatch: pytest.MonkeyPatch):
    """Assert that then least squares says by how much the spring may be stiffer."""

    def diverging(_: FitInBand) -> FitInBand:
        raise ConvergenceError("prediction error", "the motion diverges")

    nth_fit(monkeypatch, 2, diverging)
    assert supposed_play(monkeypatch).by_play == 5.0


def test_what_a_balance_cannot_do_without_stays(monkeypatch: pytest.MonkeyPatch):
    """Assert that a friction stays, though few blocks let chance explain it."""
    eliminate = disturbed.eliminate

    def too_much(fitted: Fitted, kept: Collection[str], thresholds: Thresholds) -> Any:
        leaner, evidence = eliminate(fitted, kept, thresholds)
        return leaner.without({"alpha_coulomb"}), evidence

    log = data(recording(*stopping(1)))
    on = {c for term in ("motor_viscous", "motor_coulomb") for c in JOINT.terms[term]}
    structure = Structure(JOINT, frozenset(JOINT.optional - on), Timing("zero"))
    monkeypatch.setattr(disturbed, "eliminate", too_much)
    found = fit_disturbed(structure, log, (), ("zero",), THRESHOLDS, with_play=False)
    assert "alpha_coulomb" in found.fitted.names


def nth_fit(monkeypatch: pytest.MonkeyPatch, n: int, becomes: Any) -> None:
    """Let the n-th fit that is made become another one."""
    fit, made = disturbed._fit, []

    def counted(*given: Any, **how: Any) -> Any:
        made.append(fit(*given, **how))
        return becomes(made[-1]) if len(made) == n else made[-1]

    monkeypatch.setattr(disturbed, "_fit", counted)


def test_a_fit_that_goes_astray_begins_where_the_full_one_ended(monkeypatch: pytest.MonkeyPatch):
    """Assert that of two fits to all data that is kept which the log finds likelier."""
    found, _ = pushed()
    log = data(recording(*drive(1, link_push=1.0)))

    def far_off(fit: FitInBand) -> FitInBand:
        sizes = replace(fit.sizes, disturbances=10.0 * fit.sizes.disturbances)
        return replace(fit, cost=fit.cost + 1e4, sizes=sizes)

    nth_fit(monkeypatch, 1, far_off)
    again = disturbed.fit_disturbed_to(found, log)
    assert again.sizes.disturbances == pytest.approx(found.sizes.disturbances, rel=0.5)


def test_a_full_model_without_a_fit_stays_that_of_the_training_data(
    monkeypatch: pytest.MonkeyPatch,
):
    """Assert that the leaner fit to all data is there all the same."""
    found, _ = pushed()
    log = data(recording(*drive(1, link_push=1.0)))

    def diverging(_: FitInBand) -> FitInBand:
        raise ConvergenceError("prediction error", "the motion diverges")

    nth_fit(monkeypatch, 2, diverging)
    again = disturbed.fit_disturbed_to(found, log)
    assert again.full is found.full
    assert again.fitted is not found.fitted


def test_a_full_fit_whose_steps_do_not_end_begins_where_the_leaner_did(
    monkeypatch: pytest.MonkeyPatch,
):
    """Assert that what may hide is not said by a fit that went astray."""
    found, _ = pushed()
    log = data(recording(*drive(1, link_push=1.0)))

    def unended(fit: FitInBand) -> FitInBand:
        minimum = fit.fitted.minimum
        reduced = replace(minimum.reduced, decrement=minimum.equations.cost)
        minimum = replace(minimum, reduced=reduced, last_step=20.0)
        return replace(fit, fitted=replace(fit.fitted, minimum=minimum), cost=fit.cost + 1e4)

    nth_fit(monkeypatch, 2, unended)
    assert disturbed.fit_disturbed_to(found, log).full.converged


def test_a_width_that_leads_nowhere_is_not_taken(monkeypatch: pytest.MonkeyPatch):
    """Assert that play keeps the width that it has where a fit with that of its gap fails."""
    found, _ = loose(0.02, 0.0)
    structure = gap.as_wide(found.fitted.structure, 0.015)
    log = data(recording(*drive(7, link_push=0.3, half_gap=0.02)))
    begun = disturbed._fit(structure, log, found.factor, found.fitted.by_name, found.sizes)

    def diverging(_: FitInBand) -> FitInBand:
        raise ConvergenceError("prediction error", "the motion diverges")

    assert not gap.is_dead_zone(begun.fitted)
    nth_fit(monkeypatch, 1, diverging)
    assert disturbed._as_wide_as_its_gap(begun, log, found.factor) is begun
