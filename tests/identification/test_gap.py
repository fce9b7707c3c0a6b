"""Play of the joint: a dead zone with the width of its own gap, on simulated logs."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from made_joint import COEFFICIENTS, TRUTH, data, fitted, log, made, made_fit, posed, seen

import flexid.identification.structure.gap as gap
from flexid.errors import ConvergenceError
from flexid.identification.estimation.final_fits import FinalFits
from flexid.identification.estimation.model_error import widened
from flexid.identification.full_model.fits_by_length import FitsByLength
from flexid.identification.full_model.fitting import Steps, fit_to, in_own_steps
from flexid.identification.full_model.model import Fitted
from flexid.identification.full_model.starting import least_squares_start
from flexid.identification.identify import identify
from flexid.identification.preparation.settings import Settings
from flexid.identification.structure.gap import as_wide_as_its_gap, half_gap, with_free_width
from flexid.identification.vocabulary.evidence import Estimate
from flexid.models.flexible_joint import BACKLASH_WIDTH, PAPER_TERMS

HALF_GAP = 4e-4  # rad


@cache
def with_gap(half_gap: float, *terms: str) -> Fitted:
    """Return the paper's model and more terms, fitted to 10 s of a drive with a gap."""
    return fitted(made(1, 10.0, half_gap=half_gap), *terms)


@pytest.mark.parametrize("true_gap", [HALF_GAP, 1.5e-3, 4e-3])
def test_a_gap_is_found_as_wide_as_it_is(true_gap):
    """Assert that gap and spring are exact with the adapted width, and not with the first one."""
    first = with_gap(true_gap, "backlash")
    found = as_wide_as_its_gap(first)
    assert found.data.refinement >= first.data.refinement
    assert in_own_steps(found) is found
    assert abs(half_gap(first) / true_gap - 1.0) > 0.01
    assert half_gap(found) == pytest.approx(true_gap, rel=1e-3)
    assert found.by_name["theta2"] == pytest.approx(COEFFICIENTS["theta2"], rel=1e-5)
    assert gap.width_of(found.structure) == pytest.approx(half_gap(found), rel=0.01)
    assert found.excess < 1.02
    assert first.excess > 1.05


@pytest.mark.parametrize(("play", "cubic"), [(2e-2, 0.0), (4e-2, 1e3), (0.0, 2e4)])
def test_play_and_hardening_are_distinguished(play: float, cubic: float):
    """Assert the stiffness by least squares, and the doubt without play: all that it hides."""
    structure, data = posed(made(1, 7.0, half_gap=play, cubic_stiffness=cubic), "cubic_stiffness")
    found = gap.likely_play(structure, data)
    if not play:
        assert found is None or found.doubt == 0.0
        return
    assert found is not None
    for name in ("theta2", "theta_cubic") if cubic else ("theta2",):
        assert found.start[name] == pytest.approx(
            {**COEFFICIENTS, "theta_cubic": cubic}[name], 0.01
        )
    without = min(least_squares_start(structure, data, rate)[0]["theta2"] for rate in gap.RATES)
    assert 0.05 < found.doubt == found.stiffer < 1.02 * found.start["theta2"] / without - 1.0


def test_play_is_compared_with_all_terms_of_the_model():
    """Assert that play does not get the credit of a transmission error in the model."""
    errors: dict[str, Any] = {"transmission_number": 10.0, "transmission_error": 3e-3}
    recording, widths = made(2, 10.0, size=0.3, **errors), {"error_number": 10.0}
    found = gap.likely_play(*posed(recording, "transmission_error", widths=widths))
    assert found is None or found.left > 0.99


def test_a_link_that_no_spring_moves_has_no_play():
    """Assert that play is not tried if something other than the spring moves the link."""
    structure, own = posed(made(1, 10.0))
    rng = np.random.default_rng(0)
    (samples,) = own.samples
    shaken = np.convolve(rng.standard_normal(len(samples)), np.hanning(600), "same")
    moved = np.column_stack((1e-3 * shaken / shaken.std(), samples.positions[:, 1]))
    rates = np.gradient(moved, samples.sample_time, axis=0)
    other = replace(own, samples=(replace(samples, positions=moved, velocities=rates),))
    assert gap.likely_play(structure, other) is None


def test_a_width_that_fits_worse_is_not_taken():
    """Assert that a bent spring without a gap keeps its first width."""
    bend = made(1, 7.0, bend=0.1, bend_stiffness=30.0)
    bent, _ = fit_to(with_gap(0.0, "backlash").structure, data(bend), COEFFICIENTS, 1.0)
    assert half_gap(bent) > 0.0
    assert abs(half_gap(bent) / gap.width_of(bent.structure) - 1.0) > 0.5
    assert as_wide_as_its_gap(bent) is bent


@pytest.mark.parametrize(
    ("true_gap", "given"),
    [
        (HALF_GAP, Settings(known={"alpha1": 1000 / 3})),
        (HALF_GAP, Settings(known={"motor_inertia": 0.3, "joint_stiffness": 100.0})),
        (0.01, Settings(bounds={"motor_viscous_friction": (0.0, 0.199)})),
    ],
    ids=["spring", "inertia and spring", "bound"],
)
def test_a_gap_beside_what_is_given(true_gap, given):
    """Assert that gap and width are found with a known spring, or with a value at a bound."""
    found = identify([log(made(1, 7.0, half_gap=true_gap))], given)
    assert found.parameters["half_backlash"].value == pytest.approx(true_gap, rel=0.05)
    assert found.parameters["half_backlash"].std > 0.0
    assert found.choices.shapes["backlash_width"] == pytest.approx(true_gap, rel=0.1)
    assert max(found.residual_excess.values()) < 1.05


@pytest.mark.parametrize("cubic", [1e3, -60.0])
def test_a_spring_hardens_from_the_contact_on(cubic: float):
    """Assert exact values for play with a spring that hardens or softens beyond its contact."""
    found = identify([log(made(1, 7.0, half_gap=0.04, cubic_stiffness=cubic, noise=1e-4))])
    assert found.choices.terms == (*PAPER_TERMS, "cubic_stiffness", "backlash")
    truth = {"joint_stiffness": 100.0, "cubic_joint_stiffness": cubic, "half_backlash": 0.04}
    for name, value in truth.items():
        assert found.parameters[name].value == pytest.approx(value, rel=2e-3)
    shapes = found.choices.shapes
    assert shapes["contact_deflection"] == shapes["backlash_width"]


@pytest.mark.parametrize("half_gap", [8e-4, 0.04])
@pytest.mark.parametrize("damping", ["joint_damping", "contact_damping"])
def test_damping_acts_in_the_gap_or_in_contact_alone(damping: str, half_gap: float):
    """Assert exact values for either, and the law that is found."""
    drive: dict[str, Any] = {"half_gap": half_gap, damping: 0.5}
    found = identify([log(made(1, 7.0, noise=1e-4, **drive))])
    assert found.choices.terms == (*PAPER_TERMS, "joint_damping", "backlash")
    assert found.disturbances is None
    for name, value in (TRUTH | {"joint_damping": 0.5, "half_backlash": half_gap}).items():
        assert found.parameters[name].value == pytest.approx(value, rel=1e-2)
    assert found.choices.shapes["contact_damping"] == (damping == "contact_damping")


def test_without_play_there_is_no_contact():
    """Assert that a spring whose play is removed hardens from its centre on."""
    played = gap.as_wide(with_gap(HALF_GAP, "backlash", "cubic_stiffness").structure, HALF_GAP, 0.1)
    removed = played.without(["alpha_backlash"])
    for structure, contact in (
        (played, HALF_GAP),
        (removed, 0.0),
        (gap.as_wide(removed, HALF_GAP), 0.0),
    ):
        constants = structure.joint.systems[1].constants
        assert (constants["contact_deflection"], constants["spring_centre"]) == (contact, 0.1)


@pytest.mark.parametrize("terms", [{"half_gap": HALF_GAP}, {"cubic_stiffness": 4e3}], ids=str)
def test_encoders_need_not_share_a_zero(terms: dict[str, Any]):
    """Assert that a curved spring or play is estimated alike for any zeros of the encoders."""
    recording = made(1, 7.0, **terms)
    apart = replace(recording, link_position=recording.needed_link_position + 0.7)
    found, other = (identify([log(own)]) for own in (recording, apart))
    for name in ("joint_stiffness", "link_inertia", "motor_inertia"):
        here, there = found.parameters[name], other.parameters[name]
        assert there.value == pytest.approx(here.value, abs=here.std + there.std)
        assert there.std < 3.0 * here.std
    assert "lopsided_spring" not in other.choices.terms  # as for a spring about another centre
    assert other.choices.shapes["spring_centre"] == pytest.approx(0.7, abs=2e-3)
    assert found.choices.shapes["spring_centre"] == 0.0


def test_half_the_way_may_lead_on(monkeypatch):
    """Assert that after the gap's own width the geometric mean is tried."""
    first = with_gap(HALF_GAP, "backlash")
    tried = []

    def nowhere(_fitted, structure, *, steps):
        tried.append(structure.joint.systems[1].constants[BACKLASH_WIDTH])

    monkeypatch.setattr(gap, "fit_from", nowhere)
    assert as_wide_as_its_gap(first) is first
    own = half_gap(first)
    assert tried == pytest.approx([own, np.sqrt(own * gap.width_of(first.structure))])


LARGE = 0.3  # rad, of deflections of 0.6


def with_large_gap(noise_of: int) -> Fitted:
    """Return a fit with play of half the deflection and its own width; the seed draws the noise."""
    recording = made(1, 7.0, half_gap=LARGE, noise=0.0)
    link, motor = 1e-4 * np.random.default_rng(noise_of).standard_normal((2, len(recording)))
    recording = seen(recording, link, motor)
    structure, log = posed(recording, "backlash", widths={BACKLASH_WIDTH: LARGE})
    log = replace(log, noise=np.full(2, 1e-4))
    start = {**COEFFICIENTS, "alpha_backlash": COEFFICIENTS["alpha1"] * LARGE}
    return as_wide_as_its_gap(fit_to(structure, log, start, 0.5)[0])


def test_an_interval_knows_that_the_width_follows():
    """Assert that the scatter over noise matches the deviation with a free width only."""
    fits = [with_large_gap(seed) for seed in range(16)]
    place = fits[0].names.index("alpha_backlash")
    scatter = float(np.std([found.values[place] for found in fits], ddof=1))
    found = fits[0]
    assert half_gap(found) == pytest.approx(LARGE, rel=1e-3)
    noise = Estimate(found.names, found.values, found.minimum.reduced.inverse, (50.0,) * 6)
    said = with_free_width(noise, found).deviations[place]
    assert 0.85 < said / scatter < 1.6  # 16 draws give the scatter to a sixth
    assert noise.deviations[place] < 0.75 * scatter


def test_a_gap_as_large_as_the_deflection(fits_seen: list[FinalFits]):
    """Assert that large play is found, and that intervals include the uncertainty of its width."""
    found = identify([log(made(1, 7.0, half_gap=LARGE, noise=1e-4))])
    assert found.choices.terms == (*PAPER_TERMS, "backlash")
    assert found.choices.hold == "cubic"
    gap, stiffness = found.parameters["half_backlash"], found.parameters["joint_stiffness"]
    assert gap.value == pytest.approx(LARGE, rel=1e-4)
    assert stiffness.value == pytest.approx(100.0, rel=1e-4)
    assert np.ptp(stiffness.interval) < 0.1
    (fits,) = fits_seen
    fixed = widened(fits.reported, fits.error)
    free = with_free_width(fixed, fits.reported)
    place = found.fit.names.index("alpha_backlash")
    assert free.deviations[place] > 1.02 * fixed.deviations[place]
    assert found.fit.deviations[place] >= 0.999 * free.deviations[place]


@pytest.mark.parametrize(("count", "promised"), [(4, 20.0), (8, np.inf)])
def test_a_start_with_play_must_promise_more_than_none(monkeypatch, count, promised):
    """Assert the variance that a first step must promise, if the segments are the same."""
    without = made_fit(20.0, segments=range(4))
    starts, asked = [("structure", {})], []

    def fit_by_length(*_: Any, steps: Steps) -> None:
        asked.append(steps.promised)
        raise ConvergenceError("prediction error", "far from the log")

    monkeypatch.setattr(gap, "short", lambda divisions: divisions)
    monkeypatch.setattr(gap, "_starts", lambda *_: starts)
    monkeypatch.setattr(gap, "fit_by_length", fit_by_length)
    by_length = FitsByLength((without,), cast(Any, (range(count),)), True, ("cubic",), "")
    assert gap.fit_with_play(by_length, (without,)) is None
    assert asked == [promised]


def test_the_deviation_of_a_centre() -> None:
    """Assert by hand the standard error of the spring's centre from offsets and stiffness."""
    values = {"theta2": 100.0, "theta_offset[0]": 2.0, "theta_offset[1]": 4.0, "beta1": 9.0}
    reduced = SimpleNamespace(inverse=np.diag([25.0, 4.0, 4.0, 1.0]))
    fitted: Any = SimpleNamespace(
        all_values=values,
        names=tuple(values),
        minimum=SimpleNamespace(reduced=reduced),
    )
    variance = (0.03**2 * 25.0 + 0.5**2 * (4.0 + 4.0)) / 100.0**2
    assert gap._centre_deviation(fitted) == pytest.approx(variance**0.5)
