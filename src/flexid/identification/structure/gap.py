"""Play of the joint: a dead zone of the spring whose width is found by iteration.

A spring of stiffness k with play of half-width g has the torque k (δ - g sat(δ/g)), a dead zone.
The term `backlash` is linear in its coefficient a, a sat(δ/w), as least squares needs it. The width
w is a constant of the model. The term is a dead zone if w equals the fitted half-gap a/k, so the
width is set to the gap until both agree. Play as large as the deflection cannot be found from a fit
without play. It has its own start by least squares, from positions alone.

The encoders of a rig seldom share a zero, so the play is about another deflection than zero. The
constant torque of the link's balance shows which: without torque the spring is in the middle of its
gap. So the centre is set to the torque-free deflection, as the width is set to the gap.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import ConvergenceError
from flexid.estimators.state_variable_filter import LeastSquaresFit
from flexid.identification.full_model.fits_by_length import (
    FitsByLength,
    leaves_more,
)
from flexid.identification.full_model.fitting import (
    EXPLORING,
    FIRST_STEPS,
    fit_by_length,
    fit_from,
    fit_like,
    in_own_steps,
    motion_at,
)
from flexid.identification.full_model.model import Data, Fitted, Structure
from flexid.identification.full_model.starting import (
    RATES,
    least_squares_start,
    short,
    unexplained_link,
)
from flexid.identification.vocabulary.evidence import Estimate
from flexid.models.flexible_joint import (
    BACKLASH_WIDTH,
    CONTACT_DAMPING,
    CONTACT_DEFLECTION,
    DAMPING,
    HARDENING,
    PLAY,
    SHAPE_TERMS,
    SPRING,
    SPRING_CENTRE,
)

# Pairs of play and spring coefficients, the motor's first.
_GAPS = (*zip(SHAPE_TERMS["backlash"].coefficients, SPRING, strict=True),)[::-1]
LIKELIER = 0.9
"""Largest ratio of a link's unexplained squared acceleration with play or hysteresis to without."""

CHANCE = 9.0
"""Change of a weighted sum of squares, or of a cost, by chance: three standard deviations."""

# Terms without play that count the deflection from the centre.
_CENTRED = HARDENING.union(
    *(SHAPE_TERMS[name].coefficients for name in ("progressive_spring", "load_friction"))
)
_MOST_FITS = 8
_SETTLED = 0.1  # largest difference of gap and width, in standard deviations of the gap
_STEEPEST = 0.9  # derivative of the gap by the width above which the iteration does not converge
_MOST_WIDTHS = 15  # in least squares; eight suffice from a tenth of the width to within 1 %
_NEAR = 0.01  # largest relative difference of width and gap in a dead zone
_NEARER = 0.5  # ratio by which the difference of width and gap must fall
_PROMISED = 0.5  # largest ratio of a row's squared residuals with play to those without
# Largest unexplained share of the link's squared acceleration with play. If no spring moves the
# link, as in a clamped or pushed link, any play is equally likely.
_MOST_UNEXPLAINED = 0.5


def as_wide_as_its_gap(fitted: Fitted) -> Fitted:
    """Return a fit with the width of its play equal to its gap; unchanged if that is worse.

    A sharper shape may need shorter integration steps; the returned fit's data record them.
    """
    trail: list[tuple[float, float]] = []
    for _ in range(_MOST_FITS):
        gap, width = half_gap(fitted), width_of(fitted.structure)
        apart = max(abs(gap - width), abs(_off_centre(fitted)))
        if gap <= 0.0 or apart <= _SETTLED * _deviation(fitted):
            return fitted
        trail.append((width, gap))
        # From a distant width, half the step may succeed where the whole step fails.
        tries = dict.fromkeys((met(trail), gap, (gap * width) ** 0.5))
        fits = (_with_width(fitted, own) for own in tries)
        better = next((found for found in fits if found is not None), None)
        if better is None:
            return fitted
        fitted = in_own_steps(better)
    return fitted


def about_its_own_centre(fitted: Fitted) -> Fitted:
    """Return a fit with its terms centred on the torque-free deflection, if that is sought."""
    for _ in range(_MOST_FITS):
        off = _off_centre(fitted)
        if _CENTRED.isdisjoint(fitted.names) or abs(off) <= _SETTLED * _centre_deviation(fitted):
            return fitted
        structure = following(fitted, width_of(fitted.structure))
        found = fit_like(structure, fitted)
        if found is None or not _no_worse(found, fitted):
            return fitted
        fitted = found
    return fitted


def settled(fitted: Fitted) -> Fitted:
    """Return a fit with the width of play equal to its gap, and a centred spring."""
    return as_wide_as_its_gap(about_its_own_centre(fitted))


def met(trail: list[tuple[float, float]]) -> float:
    """Return the width at which width and gap are equal, by the secant through the last two."""
    (_, gap), *before = trail[:-3:-1]
    if not before:
        return gap
    width = trail[-1][0]
    slope = (gap - before[0][1]) / (width - before[0][0])
    met = (gap - slope * width) / (1.0 - slope) if 0.0 < slope < _STEEPEST else gap
    return met if met > 0.0 else gap


def _with_width(fitted: Fitted, width: float) -> Fitted | None:
    """Return a fit with another width; None if its first steps do not improve the fit."""
    structure = following(fitted, width)
    first = fit_from(fitted, structure, steps=EXPLORING)
    if first is None or not _no_worse(first, fitted):
        return None
    found = fit_like(structure, first)
    return found if found is not None and _no_worse(found, fitted) else None


def _no_worse(found: Fitted, fitted: Fitted) -> bool:
    """Whether a fit explains more than another, or as much with a width nearer to its gap."""
    # For a spring without play, the centre must be nearer to the torque-free deflection. Width and
    # gap are equal near the least sum of squares, not exactly at it.
    fall = fitted.minimum.equations.cost - found.minimum.equations.cost
    nearer = abs(_off_centre(found)) < _NEARER * abs(_off_centre(fitted))
    if half_gap(fitted) > 0.0:
        nearer = abs(_mismatch(found)) < _NEARER * abs(_mismatch(fitted))
    return fall > 0.0 or (nearer and fall > -CHANCE * max(fitted.excess, 1.0))


def _mismatch(fitted: Fitted) -> float:
    return half_gap(fitted) / width_of(fitted.structure) - 1.0


def with_other_damping(structure: Structure) -> Iterator[Structure]:
    """Yield the structure with play whose spring has damping in contact alone, or in its gap too.

    It yields nothing without play, or without damping.
    """
    joint, absent = structure.joint, structure.absent
    play, damping = PLAY & joint.shapes, DAMPING & joint.optional
    if play and absent.isdisjoint(play) and not damping <= absent:
        other = 1.0 - joint.constants[CONTACT_DAMPING]
        yield replace(structure, joint=joint.with_widths({CONTACT_DAMPING: other}))


def is_dead_zone(fitted: Fitted) -> bool:
    """Whether a fit has play with a width equal to its gap."""
    return half_gap(fitted) > 0.0 and abs(_mismatch(fitted)) <= _NEAR


def following(fitted: Fitted, width: float) -> Structure:
    """Return a fit's structure with another width of play, in rad, and an updated centre."""
    structure = fitted.structure
    return as_wide(structure, width, _centre_of(structure) + _off_centre(fitted))


def as_wide(structure: Structure, width: float, centre: float | None = None) -> Structure:
    """Return the structure with another width of play and, if given, another centre, in rad."""
    has_play = not PLAY & structure.joint.shapes <= structure.absent
    shape = {BACKLASH_WIDTH: width, CONTACT_DEFLECTION: width if has_play else 0.0}
    if centre is not None:
        shape[SPRING_CENTRE] = centre
    return replace(structure, joint=structure.joint.with_widths(shape))


def width_of(structure: Structure) -> float:
    """Return the width of play's shape in rad; zero if the joint has no such term."""
    return structure.joint.constants.get(BACKLASH_WIDTH, 0.0)


def about_its_centre(structure: Structure, data: Data) -> Structure:
    """Return the structure centred on the torque-free deflection, if that is far from zero.

    Otherwise, with encoders of different zeros, the cube of the deflection would be nearly linear.
    """
    every = structure.joint.deflections(data.samples)
    if not abs(np.mean(every)) > np.std(every):
        return structure
    values, _ = least_squares_start(structure.without(HARDENING), data, RATES[0])
    centre = _torque_free(values)
    if abs(centre) <= np.std(every):  # a load bends it to one side
        return structure
    return as_wide(structure, width_of(structure), float(np.clip(centre, every.min(), every.max())))


def _centre_of(structure: Structure) -> float:
    """Return the deflection in rad in the middle of the play; zero if encoders share a zero."""
    return structure.joint.constants.get(SPRING_CENTRE, 0.0)


def _off_centre(fitted: Fitted) -> float:
    """Return the torque-free deflection less the centre, in rad; zero if no centre is sought."""
    centre = _centre_of(fitted.structure)
    return _torque_free(fitted.all_values) - centre if centre else 0.0


def _torque_free(values: Mapping[str, float]) -> float:
    """Return the deflection in rad at which the spring has no torque, as a mean of all logs."""
    stiffness = values.get("theta2", 0.0)
    offsets = [v for name, v in values.items() if name.partition("[")[0] == "theta_offset"]
    return float(np.mean(offsets)) / stiffness if offsets and stiffness > 0.0 else 0.0


def half_gap(fitted: Fitted) -> float:
    """Return half the gap in rad; zero without play."""
    values = fitted.all_values
    for play, spring in _GAPS:
        if play in values and values.get(spring, 0.0) > 0.0:
            return values[play] / values[spring]
    return 0.0


def _gradient(fitted: Fitted) -> FloatArray:
    """Return derivatives of half the gap with respect to the values, shape (k,), width fixed."""
    values = fitted.all_values
    for play, spring in _GAPS:
        if play in values and values.get(spring, 0.0) > 0.0:
            slopes = {play: 1.0 / values[spring], spring: -values[play] / values[spring] ** 2}
            return np.array([slopes.get(name, 0.0) for name in fitted.names])
    return np.zeros(len(fitted.names))


def _deviation(fitted: Fitted) -> float:
    """Return the standard deviation of half the gap from sensor noise, with the width given."""
    return _spread(fitted, _gradient(fitted))


def _centre_deviation(fitted: Fitted) -> float:
    """Return the standard deviation of the torque-free deflection from sensor noise."""
    values = fitted.all_values
    free, stiffness = _torque_free(values), values["theta2"]
    offsets = [name.partition("[")[0] == "theta_offset" for name in fitted.names]
    gradient = np.array(offsets, dtype=np.float64) / max(sum(offsets), 1)
    gradient[[name == "theta2" for name in fitted.names]] = -free
    return _spread(fitted, gradient / stiffness)


def _spread(fitted: Fitted, gradient: FloatArray) -> float:
    """Return the standard deviation, from sensor noise, of a function with this gradient."""
    return float(np.sqrt(max(gradient @ fitted.minimum.reduced.inverse @ gradient, 0.0)))


def with_free_width(estimate: Estimate, fitted: Fitted) -> Estimate:
    """Return the estimate with the uncertainty of the play's width in its covariance.

    The width follows the gap. Let e be the errors of the values at a fixed width, d their
    derivatives by the width, and g the derivatives of the gap. Then the width has the error
    g·e / (1 - g·d), and the values have the errors (I + d gᵀ / (1 - g·d)) e.
    """
    deviation = _deviation(fitted)
    if not is_dead_zone(fitted) or not 0.0 < deviation < half_gap(fitted):
        return estimate
    wider = as_wide(fitted.ended, width_of(fitted.structure) + deviation)
    segments, states = fitted.problem.segments, fitted.minimum.point.initial_states
    rest = (segments, fitted.by_name, states, fitted.data.refinement)
    problem, point = motion_at(wider, fitted.data, *rest)
    own = fitted.problem
    problem = replace(problem, observer=own.observer, weights=own.weights, substeps=own.substeps)
    step = problem.solve(problem.equations(point)).values_step
    moved = (step - fitted.minimum.reduced.values_step) / deviation
    gradient = _gradient(fitted)
    left = 1.0 - min(float(gradient @ moved), _STEEPEST)
    return estimate.turned(np.eye(len(moved)) + np.outer(moved, gradient) / left)


def fit_with_play(by_length: FitsByLength, chosen: Sequence[Fitted]) -> FitsByLength | None:
    """Fit a joint with play if the fit without play leaves more than noise.

    Returns None if the model without play explains the log, if no start with play is far better, or
    if another term explains more.
    """
    full, data = by_length.found[-1].structure, by_length.found[-1].data
    play, thresholds = PLAY & full.joint.shapes, by_length.thresholds
    if not play or all(f.excess <= thresholds.sensor_excess for f in by_length.found):
        return None
    by_length.progress("play of the joint")
    structure, floor = replace(full, absent=full.absent - play), by_length.floor
    divisions, without = short(by_length.divisions), by_length.found[0]
    # A first step that promises less than the fit without play leads nowhere.
    is_alike = len(without.problem.segments) == len(divisions[0])
    steps = replace(FIRST_STEPS, promised=without.excess if is_alike else np.inf)
    best: list[Fitted] = []
    for own, start in _starts(structure, full, data):
        try:
            found = fit_by_length(own, data, start, divisions, steps=steps)
        except ConvergenceError:
            continue
        if not best or (len(found), -found[-1].excess) > (len(best), -best[-1].excess):
            best = found
    if not best:
        return None
    last = as_wide_as_its_gap(best[-1])
    laws = [fit_like(law, last) for law in with_other_damping(last.structure)]
    every = [last, *(as_wide_as_its_gap(other) for other in laws if other is not None)]
    last = min(every, key=lambda own: own.excess)
    as_long = [f for f in by_length.found if f.duration <= last.duration] or by_length.found[:1]
    before = as_long[-1].excess
    if half_gap(last) <= 0.0 or before - last.excess < thresholds.shape_share * (before - floor):
        return None
    if leaves_more(last, chosen, thresholds):
        return None
    return by_length.with_term(by_length.onward(last))


class LikelyPlay(NamedTuple):
    """Play found by least squares of the link's row, independent of the motor."""

    structure: Structure  # structure with play of this width, with or without hardening
    start: dict[str, float]  # start values of a fit
    stiffer: float  # relative increase of the stiffness with play
    left: float  # ratio of the link's unexplained acceleration, squared, with and without play

    @property
    def doubt(self) -> float:
        """Increase of the stiffness, if play alone explains clearly more; otherwise zero."""
        return self.stiffer if self.left < LIKELIER else 0.0


def likely_play(structure: Structure, data: Data) -> LikelyPlay | None:
    """Return the play that leaves the least of the link's balance; None if play does not help."""
    play = PLAY & structure.joint.shapes
    found, least = None, 1.0
    for spring in (structure.without(HARDENING), structure):
        wide = replace(spring, absent=spring.absent - play)
        for (own, start, fit), (other, its_fit) in _by_rate(wide, structure, data):
            left, its = (unexplained_link(each) for each in (fit, its_fit))
            if left < min(least * its, _MOST_UNEXPLAINED) and other["theta2"] > 0.0:
                stiffer = abs(start["theta2"] / other["theta2"] - 1.0)
                found, least = LikelyPlay(own, start, stiffer, left / its), left / its
        least *= LIKELIER if found else 1.0  # any play leaves slightly less, also with hardening
    return found


def _starts(
    structure: Structure, without: Structure, data: Data
) -> Iterator[tuple[Structure, dict[str, float]]]:
    """Yield structures with play of the width found by least squares, and their start values."""
    for (own, start, fit), (_, other) in _by_rate(structure, without, data):
        rows = zip(fit.rows, other.rows, strict=True)
        if any(row.residual_sum < _PROMISED * bare.residual_sum for row, bare in rows):
            yield own, start


_PlayStart = tuple[Structure, dict[str, float], LeastSquaresFit]


def _by_rate(
    structure: Structure, without: Structure, data: Data
) -> Iterator[tuple[_PlayStart, tuple[dict[str, float], LeastSquaresFit]]]:
    """Yield least squares with play, for each filter that finds play, and without play."""
    middle = float(np.mean(structure.joint.deflections(data.samples)))
    without = _with_all_terms(without)
    for rate in RATES:
        rival = least_squares_start(without, data, rate)
        for centre in dict.fromkeys((_centre_of(structure), middle)):
            played = _with_consistent_width(structure, data, rate, centre)
            if _gap_of(played[1]) > 0.0:
                yield played, rival


def _with_all_terms(structure: Structure) -> Structure:
    """Return the structure whose least squares also covers its less usual terms."""
    return replace(structure, joint=structure.joint.with_shapes_in_least_squares)


def _with_consistent_width(
    structure: Structure, data: Data, rate: float, centre: float
) -> tuple[Structure, dict[str, float], LeastSquaresFit]:
    """Iterate least squares until the width of play equals its gap."""
    # A nonzero centre is updated too. The iteration ends if there is no gap.
    own, tried = as_wide(structure, width_of(structure), centre), 0
    while True:
        start, fit = least_squares_start(_with_all_terms(own), data, rate)
        gap, width, tried = _gap_of(start), width_of(own), tried + 1
        off = _torque_free(start) - _centre_of(own) if centre else 0.0
        apart = max(abs(gap - width), abs(off))
        if gap <= 0.0 or apart <= _NEAR * width or tried == _MOST_WIDTHS:
            return own, start, fit
        own = as_wide(own, gap, _centre_of(own) + off)


def _gap_of(values: Mapping[str, float]) -> float:
    """Return half the gap from the link's row, which does not contain the input."""
    stiffness = values.get("theta2", 0.0)
    return values.get("theta_backlash", 0.0) / stiffness if stiffness > 0.0 else 0.0
