"""Play of the joint: a dead zone of the spring, whose width follows from what it finds.

Of a spring of stiffness k with play of half-width g acts k (δ - g sat(δ/g)), a dead zone. The term
`backlash` is linear, a sat(δ/w), as least squares needs it, with a width w that is a constant of
the model; it is that dead zone where w is the gap that it finds, a/k. So the width follows the gap.
Play as large as the deflection cannot be added to a fit without it, which leads nowhere near: it
has a start of its own, by least squares, whose width settles on positions alone.

The encoders of a rig seldom share a zero, so that its play is about another deflection than none.
A constant torque of the link's balance tells by how much: where the spring carries none, it is in
the middle of its gap. So a centre that is sought follows that torque, as the width follows the gap.
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
    fit_like,
    in_own_steps,
    led_from,
    motion_at,
)
from flexid.identification.full_model.model import Data, Fitted, Structure
from flexid.identification.full_model.starting import (
    RATES,
    least_squares_start,
    short,
    unexplained_link,
)
from flexid.identification.vocabulary import Progress
from flexid.identification.vocabulary.evidence import Estimate
from flexid.identification.vocabulary.thresholds import Thresholds
from flexid.models.flexible_joint import (
    BACKLASH_WIDTH,
    HARDENING,
    SHAPE_TERMS,
    SPRING,
    SPRING_CENTRE,
)

# And the spring's stiffness, the motor's first.
_GAPS = (*zip(SHAPE_TERMS["backlash"].coefficients, SPRING, strict=True),)[::-1]
PLAY = frozenset(SHAPE_TERMS["backlash"].coefficients)
"""Coefficients of play."""

LIKELIER = 0.9
"""Of what a spring without play leaves of a link's balance, what one with play leaves at most."""

CHANCE = 9.0
"""Change of a weighted sum of squares, or of a cost, that is chance: three standard deviations."""

_MOST_FITS = 8
_SETTLED = 0.1  # standard deviations of the gap, by which its width may differ
_STEEPEST = 0.9  # change of the gap with the width, beyond which it settles nowhere
_MOST_WIDTHS = 15  # in least squares: from a tenth to within a hundredth takes up to eight
_NEAR = 0.01  # of the width, up to which it is that of its gap
_NEARER = 0.5  # of what was between width and gap
_PROMISED = 0.5  # of a row's residuals in least squares that play has to explain, to be tried
# Of the link's acceleration, that one with play leaves at most: where no spring moves the link, as
# in a clamped or a pushed one, any play is as likely.
_A_SPRING = 0.5


def as_wide_as_its_gap(fitted: Fitted) -> Fitted:
    """A fit whose play has the width of its own gap; the same fit where that is worse.

    A sharper shape may want shorter steps, which the data of what is returned then have.
    """
    trail: list[tuple[float, float]] = []
    for _ in range(_MOST_FITS):
        gap, width = half_gap(fitted), width_of(fitted.structure)
        apart = max(abs(gap - width), abs(_off_centre(fitted)))
        if gap <= 0.0 or apart <= _SETTLED * _deviation(fitted):
            return fitted
        trail.append((width, gap))
        # From a width that is far away half the step may lead on where the whole does not.
        tries = dict.fromkeys((met(trail), gap, (gap * width) ** 0.5))
        fits = (_narrowed(fitted, own) for own in tries)
        better = next((found for found in fits if found is not None), None)
        if better is None:
            return fitted
        fitted = in_own_steps(better)
    return fitted


def about_its_own_centre(fitted: Fitted) -> Fitted:
    """A fit whose spring curves about where it carries no torque, if that is sought."""
    for _ in range(_MOST_FITS):
        off = _off_centre(fitted)
        if HARDENING.isdisjoint(fitted.names) or abs(off) <= _SETTLED * _centre_deviation(fitted):
            return fitted
        structure = following(fitted, width_of(fitted.structure))
        found = fit_like(structure, fitted)
        if found is None or not _no_worse(found, fitted):
            return fitted
        fitted = found
    return fitted


def met(trail: list[tuple[float, float]]) -> float:
    """Where width and gap meet, along the line through the last two of them."""
    (_, gap), *before = trail[:-3:-1]
    if not before:
        return gap
    width = trail[-1][0]
    slope = (gap - before[0][1]) / (width - before[0][0])
    met = (gap - slope * width) / (1.0 - slope) if 0.0 < slope < _STEEPEST else gap
    return met if met > 0.0 else gap


def _narrowed(fitted: Fitted, width: float) -> Fitted | None:
    """A fit with another width; None if its first steps do not lead below the sum of squares."""
    structure = following(fitted, width)
    first = led_from(fitted, structure, steps=EXPLORING)
    if first is None or not _no_worse(first, fitted):
        return None
    found = fit_like(structure, first)
    return found if found is not None and _no_worse(found, fitted) else None


def _no_worse(found: Fitted, fitted: Fitted) -> bool:
    """Whether a fit explains more than another, or as much with a width nearer to its gap.

    Of a spring without play it is the centre that has to be nearer to where it carries no torque.

    Width and gap meet near the least sum of squares, not at it.
    """
    fall = fitted.minimum.equations.cost - found.minimum.equations.cost
    nearer = abs(_off_centre(found)) < _NEARER * abs(_off_centre(fitted))
    if half_gap(fitted) > 0.0:
        nearer = abs(_apart(found)) < _NEARER * abs(_apart(fitted))
    return fall > 0.0 or (nearer and fall > -CHANCE * max(fitted.excess, 1.0))


def _apart(fitted: Fitted) -> float:
    return half_gap(fitted) / width_of(fitted.structure) - 1.0


def is_dead_zone(fitted: Fitted) -> bool:
    """Whether a fit has play, as wide as its own gap."""
    return half_gap(fitted) > 0.0 and abs(_apart(fitted)) <= _NEAR


def following(fitted: Fitted, width: float) -> Structure:
    """A fit's structure with another width of its play, about a centre that follows, in rad."""
    structure = fitted.structure
    return as_wide(structure, width, _centre_of(structure) + _off_centre(fitted))


def as_wide(structure: Structure, width: float, centre: float | None = None) -> Structure:
    """The same with another width of its play's shape, in rad, and another centre, if given."""
    shape = {BACKLASH_WIDTH: width}
    if centre is not None:
        shape[SPRING_CENTRE] = centre
    return replace(structure, joint=structure.joint.with_widths(shape))


def width_of(structure: Structure) -> float:
    """Width of its play's shape in rad, with or without play; zero of a joint that has none."""
    return structure.joint.extended.constants.get(BACKLASH_WIDTH, 0.0)


def about_its_centre(structure: Structure, data: Data) -> Structure:
    """The same with a spring about where it carries no torque, if that is far from no deflection.

    Of encoders that do not share their zero the cube of the deflection would be nearly a line.
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
    """Deflection in rad in the middle of its play: none where encoders share their zero."""
    return structure.joint.extended.constants.get(SPRING_CENTRE, 0.0)


def _off_centre(fitted: Fitted) -> float:
    """By how much the link's constant torque has a centre elsewhere, if that is sought."""
    centre = _centre_of(fitted.structure)
    return _torque_free(fitted.by_name) - centre if centre else 0.0


def _torque_free(values: Mapping[str, float]) -> float:
    """Deflection in rad at which the spring carries no torque, as a mean of all logs."""
    stiffness = values.get("theta2", 0.0)
    offsets = [v for name, v in values.items() if name.partition("[")[0] == "theta_offset"]
    return float(np.mean(offsets)) / stiffness if offsets and stiffness > 0.0 else 0.0


def half_gap(fitted: Fitted) -> float:
    """Half the gap in rad; zero without one."""
    values = {**fitted.structure.fixed, **fitted.by_name}
    for play, spring in _GAPS:
        if play in values and values.get(spring, 0.0) > 0.0:
            return values[play] / values[spring]
    return 0.0


def _gradient(fitted: Fitted) -> FloatArray:
    """Derivatives of half the gap by what was sought, shape (k,); the width stays."""
    values = {**fitted.structure.fixed, **fitted.by_name}
    for play, spring in _GAPS:
        if play in values and values.get(spring, 0.0) > 0.0:
            slopes = {play: 1.0 / values[spring], spring: -values[play] / values[spring] ** 2}
            return np.array([slopes.get(name, 0.0) for name in fitted.names])
    return np.zeros(len(fitted.names))


def _deviation(fitted: Fitted) -> float:
    """Standard deviation of half the gap from the sensors' noise, the width given."""
    return _spread(fitted, _gradient(fitted))


def _centre_deviation(fitted: Fitted) -> float:
    """The same of the deflection without torque."""
    values = fitted.by_name
    free, stiffness = _torque_free(values), values["theta2"]
    offsets = [name.partition("[")[0] == "theta_offset" for name in fitted.names]
    gradient = np.array(offsets, dtype=np.float64) / max(sum(offsets), 1)
    gradient[[name == "theta2" for name in fitted.names]] = -free
    return _spread(fitted, gradient / stiffness)


def _spread(fitted: Fitted, gradient: FloatArray) -> float:
    """Standard deviation from the sensors' noise of what has derivatives by what was sought."""
    return float(np.sqrt(max(gradient @ fitted.minimum.reduced.inverse @ gradient, 0.0)))


def with_free_width(estimate: Estimate, fitted: Fitted) -> Estimate:
    """The estimate with the uncertainty of the width, which follows the gap, in its covariance.

    With e the errors of the values while the width stays, d their change with it, and g the
    derivatives of the gap, the width is off by g·e / (1 - g·d), and the values by
    (I + d gᵀ / (1 - g·d)) e.
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


def fit_with_play(
    by_length: FitsByLength, chosen: Sequence[Fitted], progress: Progress, thresholds: Thresholds
) -> FitsByLength | None:
    """Fit a joint with play where one without leaves more than noise.

    Returns none where the model without explains the log, no start with play does so far
    better, or something else does so better.
    """
    full, data = by_length.found[-1].structure, by_length.found[-1].data
    play = PLAY & full.joint.shapes
    if not play or all(f.excess <= thresholds.sensor_excess for f in by_length.found):
        return None
    progress("play of the joint")
    structure = replace(full, absent=full.absent - play)
    floor = thresholds.noise_floor(by_length.found[0].excess)
    best: list[Fitted] = []
    for own, start in _starts(structure, full, data):
        try:
            divisions = short(by_length.divisions)
            found = fit_by_length(own, data, start, divisions, steps=FIRST_STEPS)
        except ConvergenceError:
            continue
        if not best or (len(found), -found[-1].excess) > (len(best), -best[-1].excess):
            best = found
    if not best:
        return None
    last = as_wide_as_its_gap(best[-1])
    as_long = [f for f in by_length.found if f.duration <= last.duration] or by_length.found[:1]
    before = as_long[-1].excess
    if half_gap(last) <= 0.0 or before - last.excess < thresholds.shape_share * (before - floor):
        return None
    if leaves_more(last, chosen, thresholds):
        return None
    found = [last, *by_length.longer(last, thresholds)]
    return by_length.with_term(found, thresholds)


class LikelyPlay(NamedTuple):
    """Play as least squares of the link's row finds it, whatever moves the motor."""

    structure: Structure  # with play of its width, beside a spring that hardens or instead
    start: dict[str, float]  # where a fit of it may begin
    stiffer: float  # share by which its spring is stiffer than one without play
    left: float  # of what a spring without play leaves of the link's balance

    @property
    def doubt(self) -> float:
        """The same share, if play leaves so much less that nothing else need speak for it."""
        return self.stiffer if self.left < LIKELIER else 0.0


def likely_play(structure: Structure, data: Data) -> LikelyPlay | None:
    """The play that leaves least of the link's balance; None if none leaves less than without."""
    play = PLAY & structure.joint.shapes
    found, least = None, 1.0
    for spring in (structure.without(HARDENING), structure):
        wide = replace(spring, absent=spring.absent - play)
        for (own, start, fit), (other, its_fit) in _by_rate(wide, structure, data):
            left, its = (unexplained_link(each) for each in (fit, its_fit))
            if left < min(least * its, _A_SPRING) and other["theta2"] > 0.0:
                stiffer = abs(start["theta2"] / other["theta2"] - 1.0)
                found, least = LikelyPlay(own, start, stiffer, left / its), left / its
        least *= LIKELIER if found else 1.0  # with hardening, too, any play leaves a little less
    return found


def _starts(
    structure: Structure, without: Structure, data: Data
) -> Iterator[tuple[Structure, dict[str, float]]]:
    """Structures with play as wide as least squares finds it, and where they begin."""
    for (own, start, fit), (_, other) in _by_rate(structure, without, data):
        rows = zip(fit.rows, other.rows, strict=True)
        if any(row.residual_sum < _PROMISED * bare.residual_sum for row, bare in rows):
            yield own, start


_Played = tuple[Structure, dict[str, float], LeastSquaresFit]


def _by_rate(
    structure: Structure, without: Structure, data: Data
) -> Iterator[tuple[_Played, tuple[dict[str, float], LeastSquaresFit]]]:
    """Least squares with play, by every filter with which it finds some, and of a rival."""
    middle = float(np.mean(structure.joint.deflections(data.samples)))
    for rate in RATES:
        rival = least_squares_start(without, data, rate)
        for centre in dict.fromkeys((_centre_of(structure), middle)):
            played = _settled(structure, data, rate, centre)
            if _gap_of(played[1]) > 0.0:
                yield played, rival


def _settled(
    structure: Structure, data: Data, rate: float, centre: float
) -> tuple[Structure, dict[str, float], LeastSquaresFit]:
    """A structure whose play is as wide as least squares finds it, if it finds some.

    Its centre follows if it is anywhere but at no deflection.
    """
    own, tried = as_wide(structure, width_of(structure), centre), 0
    while True:
        sought = replace(own, joint=own.joint.with_shapes_in_least_squares)
        start, fit = least_squares_start(sought, data, rate)
        gap, width, tried = _gap_of(start), width_of(own), tried + 1
        off = _torque_free(start) - _centre_of(own) if centre else 0.0
        apart = max(abs(gap - width), abs(off))
        if gap <= 0.0 or apart <= _NEAR * width or tried == _MOST_WIDTHS:
            return own, start, fit
        own = as_wide(own, gap, _centre_of(own) + off)


def _gap_of(values: Mapping[str, float]) -> float:
    """Half the gap, from the link's row, which has no torque in it."""
    stiffness = values.get("theta2", 0.0)
    return values.get("theta_backlash", 0.0) / stiffness if stiffness > 0.0 else 0.0
