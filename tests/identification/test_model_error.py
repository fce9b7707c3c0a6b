"""Widening of intervals by residuals, on simulated logs with unmodelled effects or more noise."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from made_joint import (
    COEFFICIENTS,
    PAPER,
    data,
    diverging,
    half_widths,
    log,
    made,
    made_fit,
    structure,
)

import flexid.identification.estimation.model_error as modelling
from flexid.identification.full_model.fitting import fit_to
from flexid.identification.full_model.model import Fitted
from flexid.identification.identify import identify
from flexid.identification.preparation.settings import Settings
from flexid.identification.vocabulary.evidence import ModelError
from flexid.identification.vocabulary.thresholds import THRESHOLDS
from flexid.models.flexible_joint import PAPER_TERMS

TRUTH = np.array([*COEFFICIENTS.values()])


@cache
def fitted(seed: int, **more: Any) -> tuple[Fitted, ModelError]:
    """Return the paper's model fitted to 10 s of a drive with more effects, and the model error."""
    found, lengths_fitted = fit_to(PAPER, data(made(seed, 10.0, **more)), COEFFICIENTS, 1.0)
    return found, modelling.model_error(found, lengths_fitted, THRESHOLDS)


def misses(found: Fitted, estimate: Any) -> np.ndarray:
    """Return errors over half widths of 95 % intervals; above 1 an interval misses the truth."""
    return np.abs(found.values - TRUTH) / half_widths(estimate)


@pytest.mark.parametrize("seed", [1, 2])
def test_right_model_is_not_widened(seed):
    """Assert that only white noise enters the intervals, unless residuals are larger."""
    found, error = fitted(seed)
    assert error.share == 0.0
    unit = found.unit_deviations
    alone = found.fit.deviations / unit
    drawn = modelling.widened(found, error).deviations / unit
    assert drawn == pytest.approx(1.0, rel=0.2)
    assert np.ptp(drawn) < 0.7 * np.ptp(alone)
    beyond = modelling.widened(found, ModelError(0.1, 3.0, 0.0)).deviations
    assert beyond == pytest.approx(np.maximum(found.fit.deviations, unit), rel=1e-9)


def test_what_widens():
    """Assert that an unconverged last step widens, and the model error by its squared share."""
    found, error = fitted(1)
    step = 3.0 * found.unit_deviations * np.array([1.0, 0.0, -1.0, 0.0, 0.0])
    reduced = replace(found.minimum.reduced, values_step=step)
    rough = replace(found, minimum=replace(found.minimum, reduced=reduced))
    more = modelling.widened(rough, error).covariance - modelling.widened(found, error).covariance
    assert more == pytest.approx(np.outer(step, step), rel=1e-3, abs=1e-6 * np.abs(more).max())
    none = modelling.widened(found, ModelError(9.0, 0.0, 0.0)).covariance
    shares = [
        modelling.widened(found, ModelError(9.0, 0.0, share)).covariance - none
        for share in (1.0, 0.5)
    ]
    whole = 9.0 * found.problem.degrees_of_freedom * found.minimum.reduced.inverse
    assert shares[0] == pytest.approx(whole, rel=1e-6)
    assert shares[1] == pytest.approx(0.25 * whole, rel=1e-6)


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize(
    ("more", "missed"),
    [({"half_gap": 0.003}, 2.0), ({"ripple_torque": 0.5, "ripple_number": 10.0}, 0)],
)
def test_what_no_term_describes_widens(more: dict[str, float], missed: float, seed: int):
    """Assert that a gap of 6 mrad and a ripple are detected, and that their bias is covered."""
    found, error = fitted(seed, **more)
    assert error.share > 0.5
    assert misses(found, found.fit).max() > missed
    assert misses(found, modelling.widened(found, error)).max() < 1.0


LIMITS = replace(
    THRESHOLDS, sensor_excess=1.1, white_growth=0.4, repeated_growth=0.8, noise_motion=0.1
)


def growing(power: float, unexplained: float = 0.0) -> list[tuple[float, ...]]:
    """Return excesses by duration: noise over 0.25 s, 50 times as much in 1 s, then a power law."""
    later = [(time, 1.0 + 50.0 * time**power, unexplained) for time in (1.0, 2.0, 4.0)]
    return [(0.25, 1.0), *later]


ONE_END = replace(LIMITS, white_growth=0.6, repeated_growth=0.6)


@pytest.mark.parametrize(
    ("found", "limits", "share"),
    [
        # Growth of residuals by its power of time; the noise of a torque has the third power.
        (growing(3.0), LIMITS, 0.0),
        (growing(2.61), LIMITS, 0.0),
        (growing(2.4), LIMITS, 0.5),
        (growing(2.19), LIMITS, 1.0),
        (growing(0.5), LIMITS, 1.0),
        (growing(3.39), LIMITS, 0.0),
        (growing(3.6), LIMITS, 0.5),
        (growing(4.0), LIMITS, 1.0),
        # Lower and upper limit of noise may coincide.
        (growing(2.5), ONE_END, 0.0),
        (growing(2.3), ONE_END, 1.0),
        # Residuals that grow like noise are an error if as large as the deflection.
        (growing(3.0, 0.09), LIMITS, 0.0),
        (growing(3.0, 0.11), LIMITS, 0.0111),
        (growing(3.0, 0.55), LIMITS, 0.5),
        (growing(3.0, 1.0), LIMITS, 1.0),
        # An excess of a tenth may be noise if short segments have it too.
        ([(0.25, 1.2), (1.0, 1.09), (2.0, 1.09)], LIMITS, 0.0),
        ([(0.25, 1.2), (1.0, 1.15), (2.0, 1.15)], LIMITS, 1.0),
        # Chance: three standard deviations, 3 √400 = 60, of a sum of squares of a million.
        ([(0.25, 1.0), (1.0, 1.0 + 55e-6), (2.0, 1.0 + 55e-6)], LIMITS, 0.0),
        ([(0.25, 1.0), (1.0, 1.0 + 65e-6), (2.0, 1.0 + 65e-6)], LIMITS, 1.0),
    ],
)
def test_what_of_the_residuals_is_an_error(found, limits, share):
    """Assert the model error's share for 10⁶ numbers and 200 initial states."""
    lengths_fitted = []
    for duration, excess, *unexplained in found:
        more = {"unexplained": sum(unexplained), "states": np.zeros((50, 4))}
        lengths_fitted.append(made_fit(excess, duration=duration, **more))
        lengths_fitted[-1].problem.degrees_of_freedom = 1_000_000
    error = modelling.model_error(lengths_fitted[1], lengths_fitted, limits)
    assert error.share == pytest.approx(share, abs=1e-3)
    assert (error.share > 0.0) == (share > 0.0)
    if len(found) == 4:
        assert error.growth == pytest.approx(np.log2((found[2][1] - 1) / 50.0), abs=0.01)
        assert error.excess == pytest.approx(50.0, rel=1e-3)


def test_what_is_unexplained_is_a_share_of_the_deflection():
    """Assert the unexplained share; it grows with a longer time and is kept for a shorter one."""
    right, _ = fitted(1)
    assert right.unexplained < 1e-3
    gapped, _ = fitted(1, half_gap=0.003)
    segments = gapped.problem.segments
    left = np.diff(gapped.minimum.equations.residuals[:, :2])
    ratio = np.sqrt(np.mean(left**2)) / np.std(np.diff(segments.outputs[:, :2]))
    assert gapped.unexplained == pytest.approx(ratio, rel=0.01)
    assert gapped.unexplained > 0.002
    assert gapped.unexplained_over(2.5 * gapped.duration) == pytest.approx(2.5 * ratio, rel=0.01)
    assert gapped.unexplained_over(0.5 * gapped.duration) == gapped.unexplained


def made_up(*names: str, excess: float = 1.0) -> Any:
    """Return a stand-in for a fit with these coefficients."""
    joint = SimpleNamespace(shapes=frozenset({"alpha_backlash"}), nonlinear={})
    return SimpleNamespace(structure=SimpleNamespace(joint=joint), names=names, excess=excess)


def test_each_stand_in_is_doubted_by_itself(monkeypatch):
    """Assert that a coefficient is widened by its largest change without one or all stand-ins."""
    moved = {
        frozenset({"alpha_cubic", "alpha_backlash"}): np.array([0.1, -2.0, 0.0]),
        frozenset({"alpha_cubic"}): np.array([-3.0, 1.0, 0.0]),
        frozenset({"alpha_backlash"}): np.array([1.0, 1.0, 0.0]),
    }
    monkeypatch.setattr(modelling, "_moved_without", lambda _, way: moved[frozenset(way)])
    monkeypatch.setattr(modelling, "is_dead_zone", lambda _: True)
    found = made_up("theta2", "alpha_cubic", "alpha_backlash")
    added = modelling.stand_in_covariance(found, ModelError(0.1, 0.0, 0.5), THRESHOLDS)
    assert added[0, 0] == pytest.approx(0.25 * 9.0)
    assert np.count_nonzero(added) == 1  # the stand-ins themselves are not widened


@pytest.mark.parametrize(
    ("excess", "dead_zone", "doubted"),
    [(1.09, True, False), (1.11, True, True), (1.0, False, True)],
)
def test_play_that_explains_is_no_stand_in(monkeypatch, excess, dead_zone, doubted):
    """Assert that play is doubted only if it is no dead zone or leaves more than noise."""
    monkeypatch.setattr(modelling, "_moved_without", lambda *_: np.array([2.0, 1.0]))
    monkeypatch.setattr(modelling, "is_dead_zone", lambda _: dead_zone)
    found = made_up("theta2", "alpha_backlash", excess=excess)
    added = modelling.stand_in_covariance(found, ModelError(0.1, 0.0, 1.0), THRESHOLDS)
    assert bool(added.any()) == doubted


def test_a_negative_friction_may_be_none(monkeypatch):
    """Assert that a negative friction is widened by its size, and other values by their change."""
    wider = structure(*PAPER_TERMS, "joint_damping", "link_viscous")
    driving, _ = fit_to(wider, data(made(3, 10.0, joint_damping=-0.05)), COEFFICIENTS, 1.0)
    names = modelling.driving_frictions(driving, THRESHOLDS)
    assert "alpha_damping" in names
    bare, _ = fit_to(driving.structure.without(names), driving.data, driving.by_name, 1.0)
    moved = [bare.by_name.get(name, 0.0) - driving.by_name[name] for name in driving.names]
    added = np.sqrt(np.diag(modelling.driving_covariance(driving, names)))
    assert added == pytest.approx(np.abs(moved), rel=0.1, abs=1e-6)
    place, spring = (driving.names.index(name) for name in ("alpha_damping", "alpha1"))
    assert abs(moved[spring]) > 1e-3
    monkeypatch.setattr(modelling, "fit_like", lambda *_: None)
    added = np.sqrt(np.diag(modelling.driving_covariance(driving, {"alpha_damping"})))
    assert added[[place, spring]] == pytest.approx([-driving.values[place], 0.0])


@pytest.mark.parametrize(
    ("name", "deviations", "driving"),
    [("alpha2", -3.9, False), ("alpha2", -4.1, True), ("alpha2", 5.0, False), ("theta2", -9.0, 0)],
)
def test_a_friction_drives_beyond_noise(name, deviations, driving):
    """Assert that a friction counts as driving below -4 standard deviations, and a spring never."""
    usual, _ = fitted(1)
    place, values = usual.names.index(name), usual.values.copy()
    values[place] = deviations * max(usual.fit.deviations[place], usual.unit_deviations[place])
    point = replace(usual.minimum.point, values=values)
    found = replace(usual, minimum=replace(usual.minimum, point=point))
    limits = replace(THRESHOLDS, friction_sign=4.0)
    assert modelling.driving_frictions(found, limits) == ({name} if driving else set())
    assert not modelling.driving_covariance(found, frozenset()).any()


def test_a_driving_friction_is_doubted_and_named():
    """Assert that a clearly negative friction has zero in its interval, and a warning."""
    settings = Settings(terms=(*PAPER_TERMS, "joint_damping"), hold="cubic", link_delay=0.0)
    found = identify([log(made(3, 10.0, joint_damping=-0.05))], settings)
    damping = found.parameters["joint_damping"]
    assert damping.interval[0] < -0.05 < 0.0 < damping.interval[1]
    assert any("alpha_damping came out negative" in warning for warning in found.warnings)
    assert not modelling.driving_frictions(fitted(1)[0], THRESHOLDS)


@pytest.mark.parametrize(
    ("rise", "excess", "freedom", "disturbed", "share"),
    [
        (8.0, 1.0, 0.0, False, 1.0),
        (36.0, 1.0, 100.0, False, 0.5),
        (36.0, 4.0, 0.0, False, 1.0),
        (1e6, 1.0, 100.0, False, 3e-3),
        (1e6, 1.0, 100.0, True, 1.0),
        # Beyond noise, residuals may hide a part as large as they are.
        (1e6, 1.1, 1e5, False, 3e-3 * 1.1**0.5),
        (1e6, 2.0, 1e5, False, (0.09 + 1.8e-5) ** 0.5),
    ],
)
def test_how_much_of_another_law_is_a_doubt(monkeypatch, rise, excess, freedom, disturbed, share):
    """Assert that an exact fit limits the change to what chance hides; disturbances do not."""

    def at(cost: float, values: list[float]) -> Any:
        return SimpleNamespace(
            equations=SimpleNamespace(cost=cost), point=SimpleNamespace(values=np.array(values))
        )

    problem = SimpleNamespace(
        observer=disturbed or None,
        timing=SimpleNamespace(hold="zero"),
        degrees_of_freedom=freedom,
    )
    own = at(100.0, [1.0, 2.0])
    found: Any = SimpleNamespace(
        names=("alpha1", "beta1"), values=own.point.values, excess=excess, minimum=own, ended=None,
        problem=problem,
    )  # fmt: skip
    other = SimpleNamespace(with_hold=lambda _: None)
    monkeypatch.setattr(modelling, "with_other_laws", lambda _: [other])
    monkeypatch.setattr(modelling, "expanded", lambda *_: found)
    monkeypatch.setattr(modelling, "minimise", lambda *_, **__: at(100.0 + rise, [2.0, 1.0]))
    assert modelling.by_other_laws(found) == pytest.approx(share * np.array([[1.0], [-1.0]]))

    monkeypatch.setattr(modelling, "minimise", diverging)
    assert modelling.by_other_laws(found).shape == (2, 0)
