"""Search for terms one by one, mostly with a constant that is sought; see `sought_terms`.

Such a term is tried if the usual terms leave more than noise. It starts with the constant that is
predicted to explain the most. Then the fit finds coefficients and constant together.
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from operator import itemgetter

import numpy as np

from flexid.errors import ConvergenceError
from flexid.estimators.prediction_error import ROUGH
from flexid.estimators.samples import side_by_side
from flexid.identification.full_model.fits_by_length import (
    FOLLOWED,
    FitsByLength,
    explained_by,
    leaves_more,
    promised,
    sampled,
    turning,
)
from flexid.identification.full_model.fitting import (
    EXPLORING,
    ON_THE_WAY,
    fit_by_length,
    fit_from,
    fit_like,
)
from flexid.identification.full_model.model import Data, Fitted, Structure
from flexid.identification.preparation.joint import Joint
from flexid.identification.vocabulary.thresholds import Thresholds

ANY = 1.0  # stands for the constant of a linear term, which has none
_APART = 2.0  # distance of the followed candidates, over the resolution
_AROUND = np.linspace(-0.4, 0.4, 5)  # distances of constants from a candidate, over the resolution


@dataclass(frozen=True)
class SoughtShape:
    """Term that is sought by itself, mostly with a constant."""

    words: str  # description of the term
    coefficients: frozenset[str]  # of the term, including tied ones and the constant
    constant: str = ""  # the constant's name in the model; empty for a linear term
    # returns candidate values of the constant; none if nothing moves
    candidates: Callable[[Structure, Data], list[float]] = lambda *_: [ANY]
    # returns the difference of two constants that the data clearly distinguish
    resolution: Callable[[Joint, Data], float] = lambda *_: 0.0
    # returns the lower limit of a visible constant
    least: Callable[[Fitted], float] = lambda _: 0.0
    in_place_of: frozenset[str] = frozenset()  # coefficients of a similar usual term
    looks_like: frozenset[str] = frozenset()  # coefficients of an unusual term that may hide it
    laws: tuple[Mapping[str, float], ...] = ({},)  # values of further constants that are tried
    rare_laws: tuple[Mapping[str, float], ...] = ()  # values tried from a fit with another law
    is_possible: Callable[[Fitted], bool] = lambda _: True  # whether a fit has possible values
    # balances of which one must show the term among disturbances
    shown_in: frozenset[str] = frozenset({"link", "motor"})
    # whether a fit with disturbances may have the term: there much looks like it in part
    is_plausible: Callable[[Fitted], bool] = lambda _: True

    def of(self, structure: Structure) -> float:
        """Return the constant of a structure."""
        return structure.joint.first.get(self.constant, ANY)

    def put(self, structure: Structure, value: float) -> Structure:
        """Return the structure with another constant."""
        return structure.beginning_at({self.constant: value})

    def held_in(self, structure: Structure) -> Structure:
        """Return the structure with the constant fixed: without the term nothing determines it."""
        given = {self.constant: self.of(structure)} if self.constant else {}
        return replace(structure, fixed={**structure.fixed, **given})

    def extensions(self, structure: Structure, kept: Collection[str] = ()) -> Iterator[Structure]:
        """Yield the structure with each law of the term, and with the term for a similar one.

        The similar term stays if it is `kept`. If it explains most of what the term describes,
        steps with both may end in a wrong minimum.
        """
        wider = replace(structure, absent=structure.absent - self.coefficients)
        for law in self.laws:
            yield replace(wider, joint=wider.joint.with_widths(law))
        similar = self.in_place_of & structure.joint.optional
        if similar.isdisjoint(kept) and not similar <= structure.absent:
            yield wider.without(similar)

    def with_other_laws(self, structure: Structure, *, rare: bool) -> Iterator[Structure]:
        """Yield the structure with each other law of the term, with or without rare ones."""
        for law in (*self.laws, *(self.rare_laws if rare else ())):
            joint = structure.joint.with_widths(law)
            if joint.constants != structure.joint.constants:
                yield replace(structure, joint=joint)

    def visible_candidates(self, fitted: Fitted) -> list[float]:
        """Return the candidates of the constant that would be visible next to a fit without it."""
        every, least = self.candidates(fitted.structure, fitted.data), self.least(fitted)
        return [value for value in every if value > least]

    def is_seen_in(self, fitted: Fitted) -> bool:
        """Whether the constant of a fit is large enough to be visible, and its values possible."""
        return self.of(fitted.structure) > self.least(fitted) and self.is_possible(fitted)

    def is_in(self, fitted: Fitted) -> bool:
        """Whether a fit has the term, with fitted or given coefficients."""
        structure = fitted.structure
        leading = (self.coefficients & structure.joint.shapes) - structure.joint.ties.keys()
        return bool(leading - structure.absent)


def fit_with_shape(
    shape: SoughtShape,
    by_length: FitsByLength,
    before: Fitted,
    chosen: Sequence[Fitted],
    kept: Collection[str] = (),
) -> FitsByLength | None:
    """Fit a joint with one more term if the fit without it leaves more than noise.

    Returns None if the term hardly helps, or if another term explains more.
    """
    full = by_length.found[-1].structure
    if shape.coefficients.isdisjoint(full.joint.shapes):
        return None
    by_length.progress(shape.words)
    firsts: list[Fitted] = []
    for first in _explaining(shape, before, shape.extensions(full, kept), by_length):
        firsts.append(first)
        if first.excess <= by_length.thresholds.sensor_excess:
            break
    else:
        if len(firsts) > 1:  # they are compared when they have converged
            firsts = [fit_from(first, first.structure) or first for first in firsts]
    best = min(firsts, key=lambda first: first.excess, default=None)
    if best is None or leaves_more(best, chosen, by_length.thresholds):
        return None
    return _with_best_law(shape, best, by_length)


def _with_best_law(shape: SoughtShape, first: Fitted, by_length: FitsByLength) -> FitsByLength:
    """Return fits over all lengths from the first one, with the likeliest law of the term."""
    found = by_length.onward(first)
    likelier = _with_likelier_law(shape, found[-1], by_length.thresholds)
    # Fits of shorter segments would lead back to another minimum.
    found = found if likelier is found[-1] else by_length.onward(likelier)
    return by_length.with_term(found)


def _with_likelier_law(shape: SoughtShape, fitted: Fitted, thresholds: Thresholds) -> Fitted:
    """Return the fit with the likeliest law of the term; the given one if it leaves only noise."""
    if fitted.excess <= thresholds.sensor_excess:
        return fitted
    best = fitted
    for law in shape.with_other_laws(fitted.structure, rare=True):
        other = fit_like(law, best)
        if other is None or not shape.is_possible(other):
            continue
        # A velocity counts by its size.
        visible = abs(shape.of(other.structure)) > shape.least(other)
        best = other if visible and other.excess < best.excess else best
    return best


def _explaining(
    shape: SoughtShape,
    before: Fitted,
    extensions: Iterable[Structure],
    by_length: FitsByLength,
) -> Iterator[Fitted]:
    """Yield for each extended structure the first fit that explains most of the residuals."""
    some, thresholds = sampled(before), by_length.thresholds
    for wider in extensions:
        gone = wider.absent & {*some.names}
        start = fit_like(some.structure.without(gone), some, ROUGH) if gone else some
        if start is None:
            continue
        for promise, structure in _promising(shape, start, wider):
            if promise < thresholds.shape_promise:
                continue
            rest = by_length.floor, thresholds, shape.is_seen_in
            held = fit_from(start, shape.held_in(structure), steps=EXPLORING) or start
            first = explained_by(before, structure, held.by_name, *rest)
            if first is not None:
                yield first
                break


def fit_requested_shapes(shapes: Iterable[SoughtShape], by_length: FitsByLength) -> FitsByLength:
    """Fit a joint with further terms that the settings require.

    The term that explains the most comes first, since only then the log shows the constants of the
    others. With all of them the laws are compared again.
    """
    left, done = [*shapes], []
    while left:
        firsts: list[tuple[float, Fitted, SoughtShape]] = []
        for shape in left:
            by_length.progress(shape.words)
            firsts += [(share, first, shape) for share, first in _requested(shape, by_length)]
        if not firsts:
            raise ConvergenceError(
                "prediction error", f"the fit with {left[0].words} fails: drop the term"
            )
        _, first, shape = min(firsts, key=itemgetter(0))
        by_length = _with_best_law(shape, first, by_length)
        left.remove(shape)
        done.append(shape)
    for shape in done[:-1]:
        before = by_length.found[-1]
        likelier = _with_likelier_law(shape, before, by_length.thresholds)
        if likelier is not before:
            by_length = by_length.with_term(by_length.onward(likelier))
    return by_length


def _requested(shape: SoughtShape, by_length: FitsByLength) -> list[tuple[float, Fitted]]:
    """Return fits with a required term, each with the share of the residuals that it leaves.

    If the constant stays fixed though the log shows it, shorter segments are tried.
    """
    thresholds = by_length.thresholds
    usual = turning(by_length.found, thresholds) or by_length.found[-1]
    shorter = [each for each in by_length.found if each.duration < usual.duration]
    wider = [*shape.extensions(by_length.found[-1].structure, shape.in_place_of)]
    found: list[tuple[float, Fitted]] = []
    for before in (usual, *reversed(shorter)):
        tried = [_from_constants(shape, before, own, thresholds) for own in wider]
        cost = before.minimum.equations.cost
        found += [(fit.minimum.equations.cost / cost, fit) for fits, _ in tried for fit in fits]
        if any(final for _, final in tried):
            break
    return found


def _from_constants(
    shape: SoughtShape, before: Fitted, wider: Structure, thresholds: Thresholds
) -> tuple[list[Fitted], bool]:
    """Return fits with a required term from its most promising constants, and if they are final.

    The first fit of each has the constant fixed. If the log hardly shows the term, it stays fixed:
    outside the range of the motion it would leave the coefficients undetermined.
    """
    promising = sorted(_promising(shape, before, wider), key=itemgetter(0), reverse=True)
    if not promising:
        raise ConvergenceError(
            "prediction error",
            f"the motion is too small for {shape.words}: log more motion or drop the term",
        )
    shown = [structure for promise, structure in promising if promise >= thresholds.shape_promise]
    data, segments = before.data, [before.problem.segments]
    held: list[Fitted] = []
    freed: list[Fitted] = []
    for structure in shown or [promising[0][1]]:
        steps = EXPLORING if shown else ON_THE_WAY
        with suppress(ConvergenceError):
            start = before.by_name
            held += fit_by_length(shape.held_in(structure), data, start, segments, steps=steps)
            if shown:
                freed += fit_by_length(structure, data, held[-1].by_name, segments)
    converged = [fit for fit in held if fit.converged]
    return [*converged, *freed], bool(freed or (converged and not shown))


def _promising(
    shape: SoughtShape, before: Fitted, wider: Structure
) -> Iterator[tuple[float, Structure]]:
    """Yield structures with the most promising constants, each with its predicted share."""
    structure = wider.with_hold(before.structure.timing.hold)
    if (given := structure.fixed.get(shape.constant)) is not None:
        known = shape.put(structure, given)
        yield _promised(before, known), known
        return
    constants = shape.visible_candidates(before)
    promises = side_by_side(lambda value: _promised(before, shape.put(structure, value)), constants)
    promising = sorted(zip(promises, constants, strict=True), key=itemgetter(0), reverse=True)
    followed: dict[float, float] = {}  # with the distance within which others lead to the same fit
    for _, value in promising:
        apart = _APART * shape.resolution(shape.put(structure, value).joint, before.data)
        # Of constants on a scale, the smaller one says how far another fit is.
        if all(abs(value - other) > min(apart, own) for other, own in followed.items()):
            followed[value] = apart
            yield max(_near(shape, before, structure, value), key=itemgetter(0))
        if len(followed) == FOLLOWED:
            break


def _promised(before: Fitted, structure: Structure) -> float:
    return promised(before, structure, before.by_name)


def _near(
    shape: SoughtShape, before: Fitted, structure: Structure, value: float
) -> list[tuple[float, Structure]]:
    """Return predicted shares and structures for constants within the resolution."""
    resolution = shape.resolution(shape.put(structure, value).joint, before.data)
    constants = np.unique(value + _AROUND * resolution).tolist()
    near = [shape.put(structure, away) for away in constants if away > shape.least(before)]
    return side_by_side(lambda own: (_promised(before, own), own), near)
