"""Terms whose shape is not known: a constant of the model that is sought besides the coefficients.

How many times a ripple repeats in a turn, or where a spring bends, is no coefficient of a linear
term. A term of that kind joins the model where the usual terms leave more than noise, with the
constant that promises to explain most of it; from there the fit finds both.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from operator import itemgetter

import numpy as np

from flexid.errors import ConvergenceError
from flexid.identification.full_model.fits_by_length import (
    FitsByLength,
    explained_by,
    leaves_more,
    promised,
    sampled,
    turning,
)
from flexid.identification.full_model.fitting import fit_by_length
from flexid.identification.full_model.model import Data, Fitted, Structure
from flexid.identification.preparation.joint import Joint
from flexid.identification.vocabulary.progress import Progress
from flexid.identification.vocabulary.thresholds import Thresholds

_FOLLOWED = 2  # constants that promise most
_AROUND = np.linspace(-0.4, 0.4, 5)  # of the resolution


@dataclass(frozen=True)
class SoughtShape:
    """A term with a constant that is sought."""

    words: str  # what it describes
    coefficients: frozenset[str]  # of the term, those that follow from others and the constant too
    constant: str  # the constant's name in the model
    # constants that a structure and its data speak for; none where nothing moves
    candidates: Callable[[Structure, Data], list[float]]
    # how far apart two constants are, near that of a joint, which its data distinguish at a glance
    resolution: Callable[[Joint, Data], float]
    # what a constant has to exceed, to be seen beside a fit
    least: Callable[[Fitted], float] = lambda _: 0.0

    def of(self, structure: Structure) -> float:
        """The constant of a structure."""
        return structure.joint.first[self.constant]

    def put(self, structure: Structure, value: float) -> Structure:
        """The structure with another constant."""
        return replace(structure, joint=structure.joint.with_widths({self.constant: value}))

    def is_in(self, fitted: Fitted) -> bool:
        """Whether a fit has the term, its coefficients sought or given."""
        structure = fitted.structure
        leading = (self.coefficients & structure.joint.shapes) - structure.joint.ties.keys()
        return bool(leading - structure.absent)


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
    for promise, structure in _promising(shape, sampled(before), full):
        if promise < thresholds.shape_promise:
            continue
        first = explained_by(before, structure, before.by_name, floor, thresholds)
        if first is not None and shape.of(first.structure) > shape.least(first):
            worse = leaves_more(first, chosen, thresholds)
            return None if worse else _fit_longer(first, by_length, thresholds)
    return None


def fit_requested_shape(
    shape: SoughtShape, by_length: FitsByLength, progress: Progress, thresholds: Thresholds
) -> FitsByLength:
    """Fit a joint with a term more whatever it explains, since somebody asked for it.

    A log that hardly shows the term says nothing of its constant, which then stays: from where the
    motion does not reach, it would let the coefficients be anything.
    """
    progress(shape.words)
    before = turning(by_length.found, thresholds) or by_length.found[-1]
    promising = [*_promising(shape, before, by_length.found[-1].structure)]
    if not promising:
        raise ConvergenceError(
            "prediction error", f"nothing moves that would show {shape.words}: drop the term"
        )
    promise, structure = max(promising, key=itemgetter(0))
    if promise < thresholds.shape_promise:
        held = {shape.constant: shape.of(structure)}
        structure = replace(structure, fixed={**structure.fixed, **held})
    (first,) = fit_by_length(structure, before.data, before.by_name, [before.problem.segments])
    return _fit_longer(first, by_length, thresholds)


def _fit_longer(first: Fitted, by_length: FitsByLength, thresholds: Thresholds) -> FitsByLength:
    """Fits over longer segments, with the hold that suits the log."""
    return by_length.with_term([first, *by_length.longer(first, thresholds)], thresholds)


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
