"""Terms whose shape is not known: a constant of the model that is sought besides the coefficients.

How many times a ripple repeats in a turn, or where a spring bends, is no coefficient of a linear
term. A term of that kind joins the model where the usual terms leave more than noise, with the
constant that promises to explain most of it; from there the constant goes to where the sum of
squares is least, all else following. Its uncertainty goes into the covariance of all else.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from operator import itemgetter

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import ConvergenceError
from flexid.identification.full_model.fits_by_length import (
    FitsByLength,
    ending_with,
    explained_by,
    leaves_more,
    promised,
    sampled,
    turning,
)
from flexid.identification.full_model.fitting import fit_by_length, fit_like, motion_at
from flexid.identification.full_model.model import Data, Fitted, Structure, once_per_fit
from flexid.identification.preparation.joint import Joint
from flexid.identification.vocabulary.estimate import Estimate
from flexid.identification.vocabulary.progress import Progress
from flexid.identification.vocabulary.thresholds import Thresholds

_FOLLOWED = 2  # constants that promise most
_AROUND = np.linspace(-0.4, 0.4, 5)  # of the resolution
_STEP = 0.02  # of the resolution, for a derivative
_NEAR = 5.0  # standard deviations, for a derivative where that is less
_LARGEST = 0.5  # of the resolution, that one step may go
_SETTLED = 0.1  # standard deviations of the constant
_MOST_FITS = 8
_FARTHEST = 0.5  # of a constant, over which values are taken to move in proportion


@dataclass(frozen=True)
class SoughtShape:
    """A term with a constant that is sought."""

    words: str  # what it describes
    coefficients: frozenset[str]  # of the term, those that follow from others among them
    constant: str  # the constant's name in the model
    # constants that a structure and its data speak for; none where nothing moves
    candidates: Callable[[Structure, Data], list[float]]
    # how far apart two constants are, near that of a joint, which its data distinguish at a glance
    resolution: Callable[[Joint, Data], float]
    # what a constant has to exceed, to be seen beside a fit
    least: Callable[[Fitted], float] = lambda _: 0.0

    def of(self, structure: Structure) -> float:
        """The constant of a structure."""
        return structure.joint.extended.constants[self.constant]

    def put(self, structure: Structure, value: float) -> Structure:
        """The structure with another constant."""
        return replace(structure, joint=structure.joint.with_widths({self.constant: value}))

    def is_in(self, fitted: Fitted) -> bool:
        """Whether a fit has the term, its coefficients sought or given.

        One at a bound is none of these: the constant would take up what the bound forbids.
        """
        joint = fitted.structure.joint
        leading = (self.coefficients & joint.shapes) - joint.ties.keys()
        return bool(leading - fitted.structure.absent - fitted.at_bound.keys())


def fit_with_shape(
    shape: SoughtShape,
    by_length: FitsByLength,
    before: Fitted,
    chosen: Sequence[Fitted],
    progress: Progress,
    thresholds: Thresholds,
) -> FitsByLength | None:
    """Fit a joint with a term more where one without leaves more than noise.

    Returns none where the term hardly helps, or something else does so better.
    """
    full = by_length.found[-1].structure
    if shape.coefficients.isdisjoint(full.joint.shapes):
        return None
    progress(shape.words)
    floor = thresholds.noise_floor(by_length.found[0].excess)
    settled = partial(at_its_constant, shape)
    for promise, structure in _promising(shape, sampled(before), full):
        if promise < thresholds.shape_promise:
            continue
        first = explained_by(before, structure, before.by_name, floor, thresholds, settled)
        if first is not None:
            worse = leaves_more(first, chosen, thresholds)
            return None if worse else _fit_longer(shape, first, by_length, thresholds)
    return None


def fit_requested_shape(
    shape: SoughtShape, by_length: FitsByLength, progress: Progress, thresholds: Thresholds
) -> FitsByLength:
    """Fit a joint with a term more whatever it explains, since somebody asked for it."""
    progress(shape.words)
    before = turning(by_length.found, thresholds) or by_length.found[-1]
    promising = [*_promising(shape, before, by_length.found[-1].structure)]
    if not promising:
        raise ConvergenceError(
            "prediction error", f"nothing moves that would show {shape.words}: drop the term"
        )
    _, structure = max(promising, key=itemgetter(0))
    (first,) = fit_by_length(structure, before.data, before.by_name, [before.problem.segments])
    return _fit_longer(shape, at_its_constant(shape, first), by_length, thresholds)


def _fit_longer(
    shape: SoughtShape, first: Fitted, by_length: FitsByLength, thresholds: Thresholds
) -> FitsByLength:
    """Fits over longer segments, with the constant and the hold that suit the log."""
    found = [first, *by_length.longer(first, thresholds)]
    if found[-1] is not first:  # which has the constant that suits it
        found = ending_with(at_its_constant(shape, found[-1]), found, by_length.divisions)
    held = by_length.with_term(found, thresholds)
    if held.found[-1].structure.timing.hold == first.structure.timing.hold:
        return held
    # With another hold another constant may suit it.
    found = ending_with(at_its_constant(shape, held.found[-1]), [*held.found], held.divisions)
    return replace(held, found=tuple(found))


def _promising(
    shape: SoughtShape, before: Fitted, full: Structure
) -> Iterator[tuple[float, Structure]]:
    """Structures with the term and the constants that promise most, the most promising first."""
    structure = replace(full, absent=full.absent - shape.coefficients)
    structure = structure.with_hold(before.structure.timing.hold)
    constants = shape.candidates(before.structure, before.data)
    constants = [value for value in constants if value > shape.least(before)]
    promising = [(_promised(before, shape.put(structure, value)), value) for value in constants]
    most = sorted(promising, key=itemgetter(0), reverse=True)[:_FOLLOWED]
    for _, value in most:
        yield max(_near(shape, before, structure, value), key=itemgetter(0))


def _promised(before: Fitted, structure: Structure) -> float:
    return promised(before, structure, before.by_name)


def _near(
    shape: SoughtShape, before: Fitted, structure: Structure, value: float
) -> Iterator[tuple[float, Structure]]:
    """What constants within the resolution promise, and structures with them."""
    resolution = shape.resolution(shape.put(structure, value).joint, before.data)
    for away in value + _AROUND * resolution:
        if away > shape.least(before):
            own = shape.put(structure, float(away))
            yield _promised(before, own), own


def at_its_constant(shape: SoughtShape, fitted: Fitted) -> Fitted:
    """A fit with the constant of the least sum of squares; the same where that is worse."""
    for _ in range(_MOST_FITS):
        if not shape.is_in(fitted):
            return fitted
        step, deviation = _profile(fitted, shape)
        value = shape.of(fitted.structure) + step
        near = _SETTLED * deviation * np.sqrt(max(fitted.excess, 1.0))  # of all that is left
        if not abs(step) > near or value <= shape.least(fitted):
            return fitted
        better = fit_like(shape.put(fitted.structure, value), fitted)
        if better is None or better.minimum.equations.cost >= fitted.minimum.equations.cost:
            return fitted
        fitted = better
    return fitted


@once_per_fit  # a fit that is settled is asked again
def _profile(fitted: Fitted, shape: SoughtShape) -> tuple[float, float]:
    """How far the constant is from where the sum of squares is least, and its standard deviation.

    Both from the parabola through three sums of squares, all else following; nan where it opens
    downwards. The deviation is that of the sensors' noise.
    """
    resolution = shape.resolution(fitted.structure.joint, fitted.data)
    here, _ = _following(shape, fitted, 0.0)
    step, deviation = _parabola(shape, fitted, here, _STEP * resolution)
    near = _NEAR * deviation
    if near < _STEP * resolution and abs(step) < _STEP * resolution:
        step, deviation = _parabola(shape, fitted, here, near)
    largest = _LARGEST * resolution
    return float(np.clip(step, -largest, largest)), deviation


def _parabola(shape: SoughtShape, fitted: Fitted, here: float, small: float) -> tuple[float, float]:
    """As `_profile`, from sums of squares here and with constants so little apart."""
    below, above = (_following(shape, fitted, way * small)[0] for way in (-1.0, 1.0))
    if not np.isfinite([below, here, above]).all():
        return np.nan, np.nan
    curvature = (below - 2.0 * here + above) / small**2
    if curvature <= 0.0:
        return np.nan, np.nan
    return -(above - below) / (2.0 * small) / curvature, float(np.sqrt(2.0 / curvature))


def _following(shape: SoughtShape, fitted: Fitted, change: float) -> tuple[float, FloatArray]:
    """Sum of squares with another constant, and by how much values move, to first order."""
    structure = shape.put(fitted.ended, shape.of(fitted.structure) + change)
    states = fitted.minimum.point.initial_states
    rest = (fitted.problem.segments, fitted.by_name, states, fitted.data.refinement)
    problem, point = motion_at(structure, fitted.data, *rest)
    equations = problem.equations(point)
    step = problem.solve(equations)
    return equations.cost - step.decrement, step.values_step


def moved_by_constant(shape: SoughtShape, fitted: Fitted) -> FloatArray:
    """By how much values move as the constant moves by its standard deviation, shape (k,).

    Zero where the fit has not the term, or the log does not show its constant.
    """
    return _moved(fitted, shape) if shape.is_in(fitted) else np.zeros(len(fitted.names))


@once_per_fit  # every way of taking terms away asks for it
def _moved(fitted: Fitted, shape: SoughtShape) -> FloatArray:
    _, deviation = _profile(fitted, shape)
    if not deviation > 0.0:
        return np.zeros(len(fitted.names))
    change = min(deviation, _FARTHEST * shape.of(fitted.structure))  # and no constant below zero
    moved = _following(shape, fitted, change)[1] - fitted.minimum.reduced.values_step
    return moved * (deviation / change)


def with_free_constant(shape: SoughtShape, estimate: Estimate, fitted: Fitted) -> Estimate:
    """The estimate with the uncertainty of the constant in its covariance."""
    moved = moved_by_constant(shape, fitted)
    if not moved.any():
        return estimate
    return estimate.widened(_wider(shape, estimate, fitted) ** 2 * np.outer(moved, moved))


def constant_of(
    shape: SoughtShape, estimate: Estimate, fitted: Fitted
) -> tuple[float, float, float]:
    """The constant that was sought, its standard deviation and its degrees of freedom."""
    _, deviation = _profile(fitted, shape)
    std = deviation * _wider(shape, estimate, fitted) if deviation > 0.0 else np.inf
    freedom = min(estimate.degrees_of_freedom[place] for place in _own(shape, fitted))
    return shape.of(fitted.structure), std, freedom


def _wider(shape: SoughtShape, estimate: Estimate, fitted: Fitted) -> float:
    """How much wider the term's intervals are than the sensors' noise makes them."""
    own = _own(shape, fitted)
    return float(np.max(estimate.deviations[own] / fitted.unit_deviations[own], initial=1.0))


def _own(shape: SoughtShape, fitted: Fitted) -> list[int]:
    """Places of the term's values; of all where they are given."""
    own = [place for place, name in enumerate(fitted.names) if name in shape.coefficients]
    return own or [*range(len(fitted.names))]
