"""Choice of a structure: its terms, and the length of the segments.

The fit of all terms is made leaner (`flexid.identification.structure.elimination`), fitted again
over longer segments, and settled. Held-out data choose between it and its rivals later.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from flexid.arrays import FloatArray
from flexid.estimators.channel_timing import INPUT
from flexid.estimators.prediction_error import ROUGH
from flexid.identification.full_model.amplifier import shows_saturation
from flexid.identification.full_model.fits_by_length import (
    FitsByLength,
    best_hold,
    explains,
    is_acceptable,
)
from flexid.identification.full_model.fitting import ON_THE_WAY, fit_from, fit_like
from flexid.identification.full_model.model import Fitted, Structure
from flexid.identification.structure.elimination import eliminate, latest
from flexid.identification.structure.gap import settled
from flexid.identification.structure.sought_terms import SOUGHT_COEFFICIENTS
from flexid.identification.vocabulary.evidence import Estimate, SegmentEvidence, TermEvidence
from flexid.identification.vocabulary.thresholds import Thresholds
from flexid.models.flexible_joint import DISSIPATIVE, POSITIVE, SATURATION, coefficients_of

_LEAST_EXPLAINED = 0.5  # least share of the residuals beyond noise that unusual terms must explain
_NO_WORSE = 1.01  # largest ratio of excesses for a fit with more terms, whose steps are rough
_ROUNDS = 2  # of removing terms and fitting over longer segments
CORE = POSITIVE.union(coefficients_of("gravity"))
"""Inertias, stiffness and gravity."""


@dataclass(frozen=True, eq=False)
class Choice:
    """Chosen structure of a log, with the evidence."""

    full: Structure  # structure with all terms that were considered
    structure: Structure  # structure with the terms that the log shows
    fitted: Fitted  # fit of `structure` to the data before the held-out ends
    terms: tuple[TermEvidence, ...]  # evidence on each term
    found: tuple[Fitted, ...]  # fits of the leaner structure, over segments of growing length
    by_length: FitsByLength  # fits of the full model
    # other fits that held-out data may prefer: with less certain terms, without negative frictions,
    # and, if the model leaves more than noise, over segments of other lengths
    rivals: tuple[Fitted, ...] = ()

    @property
    def duration(self) -> float:
        """Length of the segments in s."""
        return self.fitted.duration

    @property
    def lengths(self) -> tuple[SegmentEvidence, ...]:
        """Evidence on each length of segments that was tried."""
        return tuple(
            SegmentEvidence(f.duration, f.excess, relative_deviation(f)) for f in self.found
        )


def choose_structure(
    by_length: FitsByLength, kept: Collection[str], *, with_shapes: bool
) -> Choice:
    """Remove terms of the full model that a log does not show.

    If the fit of all terms leaves too much to be reported, no term is removed, unless an exact fit
    is required: fewer terms would leave even more.
    """
    found, exact, thresholds = list(by_length.found), by_length.exact, by_length.thresholds
    best = best_length(found) if by_length.free_length else found[-1]
    by_length.progress("removing terms that the log does not show")
    wider, asked = _wider(best, by_length) if with_shapes else (best, by_length)
    if not exact and not is_acceptable(wider, thresholds):
        return Choice(wider.structure, wider.structure, wider, (), tuple(found), asked)
    explained = explains(best, thresholds) and by_length.free_length
    if asked.tied:  # the delay may replace another hold
        kept = {*kept, INPUT}
    structure, evidence = eliminate(wider, kept, thresholds)
    fitted_as = best.structure  # a fit's structure has its values as start values
    for _ in range(_ROUNDS):
        # A leaner structure may fit longer segments, which show more. Small steps may fail on the
        # rough sum of squares of dry friction.
        leaner = fit_like(structure, wider) or fit_like(structure, wider, ROUGH)
        if leaner is None:
            break
        found = by_length.onward(leaner)
        longer = best_length(found) if by_length.free_length else found[-1]
        if longer is leaner:
            best, fitted_as = leaner, structure
            break
        wider = fit_like(wider.structure, longer, ROUGH) or wider
        best, fitted_as = longer, structure
        if len(wider.problem.segments) != len(longer.problem.segments):
            break  # the wider model fails there; its evidence from shorter segments is kept
        structure, evidence = eliminate(wider, kept, thresholds)
    fitted = best if fitted_as is structure else fit_like(structure, best)
    fitted, gone = _until_stable(fitted, structure, kept, thresholds)
    fitted, evidence = fitted or best, latest(evidence, gone)
    if explained and fitted.excess > thresholds.sensor_excess:
        # A needed term was lost: with few independent blocks, chance may give any value.
        asked_for = by_length.found[-1].structure
        lost = (asked_for.joint.shapes - asked_for.absent) & fitted.structure.absent - {*kept}
        if lost:
            return choose_structure(by_length, {*kept, *lost}, with_shapes=with_shapes)
    if fitted.structure.timing.hold != wider.structure.timing.hold:
        asked = by_length
    as_settled = settled(fitted)
    if as_settled is not fitted:  # terms that made up for the wrong width are not needed any more
        fitted, gone = _until_stable(as_settled, as_settled.structure, kept, thresholds)
        fitted, evidence = (fitted, latest(evidence, gone)) if fitted else (as_settled, evidence)
    if asked.tied:  # a leaner model may distinguish the holds
        fitted, reason, tied = best_hold(fitted, asked.holds, thresholds)
        asked = replace(asked, hold_reason=reason, tied=tied)
    structure = fitted.structure
    full = replace(wider.structure, joint=structure.joint)
    more, _ = eliminate(wider, kept, replace(thresholds, term_chance=thresholds.generous_chance))
    others = [f for f in found if exact or is_acceptable(f, thresholds)]
    others = others if by_length.free_length else []
    rivals = _rivals(fitted, replace(more, joint=structure.joint), others, kept, thresholds)
    return Choice(full, structure, fitted, evidence, tuple(found), asked, rivals)


def _until_stable(
    fitted: Fitted | None, structure: Structure, kept: Collection[str], thresholds: Thresholds
) -> tuple[Fitted | None, tuple[TermEvidence, ...]]:
    """Remove terms and fit again until no term is removed; None if a fit fails."""
    # A quadratic form is valid only near its fit, so each leaner fit is expanded again.
    evidence: tuple[TermEvidence, ...] = ()
    while fitted is not None:
        leaner, own = eliminate(fitted, kept, thresholds)
        evidence = latest(evidence, own)
        if len(leaner.absent) == len(structure.absent) and leaner.timing == structure.timing:
            break
        structure, fitted = leaner, fit_like(leaner, fitted)
    return fitted, evidence


def _rivals(
    fitted: Fitted,
    generous: Structure,
    found: Sequence[Fitted],
    kept: Collection[str],
    thresholds: Thresholds,
) -> tuple[Fitted, ...]:
    """Return fits that held-out data may prefer; see `Choice`."""
    with_more = None
    if not generous.absent >= fitted.structure.absent:
        with_more = fit_like(generous, fitted)
    rivals = [f for f in (with_more, _without_negative_friction(fitted, kept)) if f is not None]
    # Fits over other lengths have no bounds.
    if fitted.excess > thresholds.sensor_excess and not fitted.structure.bounds:
        rivals += [other for other in found if other.duration != fitted.duration]
    return tuple(rivals)


def _without_negative_friction(fitted: Fitted, kept: Collection[str]) -> Fitted | None:
    """Return a fit without the frictions that came out negative."""
    # If the model leaves more than noise, the standard deviation hardly shows a friction's sign.
    # Returns None if there is no such friction, or if the fit fails.
    base = [name.partition("[")[0] for name in fitted.names]
    negative = {
        name
        for name, value in zip(base, fitted.values.tolist(), strict=True)
        if name in DISSIPATIVE and value < 0.0 and name not in kept
    }
    return fit_like(fitted.structure.without(negative), fitted) if negative else None


def _wider(best: Fitted, by_length: FitsByLength) -> tuple[Fitted, FitsByLength]:
    """Return a fit with unusual terms too, and its lengths; unchanged if that fit fails."""
    # If unusual terms explain most of the residuals beyond noise, the hold was chosen among fits
    # that did not explain the log. Then it is chosen again.
    joint, thresholds = best.structure.joint, by_length.thresholds
    shapes = joint.shapes - joint.remembered - SOUGHT_COEFFICIENTS
    if shapes & SATURATION and not shows_saturation(best.data):
        shapes -= SATURATION
    if not shapes:
        return best, by_length
    extended = replace(best.structure, absent=best.structure.absent - shapes)
    # If the fit fails over long segments, shorter ones may show the terms.
    shorter = [other for other in by_length.found if other.duration < best.duration]
    for narrow in (best, *reversed(shorter)):
        wider = fit_like(extended, narrow, ROUGH)
        if wider is None and narrow.excess <= thresholds.sensor_excess:
            steps = replace(ON_THE_WAY, insist=False)  # the log may not distinguish the terms
            wider = fit_from(narrow, extended, steps=steps)
        # A worse fit has ended at a bound.
        if wider is not None and wider.excess <= _NO_WORSE * narrow.excess:
            break
    else:
        return best, by_length
    if narrow.excess - wider.excess < _LEAST_EXPLAINED * (narrow.excess - 1.0):
        return wider, by_length
    wider = settled(wider)
    if best.excess <= thresholds.sensor_excess or len(by_length.holds) == 1:
        return wider, by_length
    held, reason, tied = best_hold(wider, by_length.holds, thresholds)
    if held is not wider:
        held = settled(held)
    return held, replace(by_length, hold_reason=reason, tied=tied)


def relative_deviation(fitted: Fitted) -> float:
    """Return the geometric mean of the core's relative standard deviations (see `CORE`)."""
    found = core_deviations(fitted.fit)
    usable = found[np.isfinite(found) & (found > 0.0)]
    return float(np.exp(np.mean(np.log(usable)))) if len(usable) else np.inf


def core_deviations(estimate: Estimate) -> FloatArray:
    """Return relative standard deviations of the fitted core coefficients (see `CORE`)."""
    core = np.array([name in CORE for name in estimate.names], dtype=np.bool_)
    sizes = np.maximum(np.abs(estimate.values), np.finfo(float).tiny)
    return (estimate.deviations / sizes)[core]


def best_length(found: Sequence[Fitted]) -> Fitted:
    """Return the fit with the narrowest intervals; of two similar ones, the longer segments."""
    found = [fitted for fitted in found if fitted.converged] or found
    best, narrowest = found[0], np.inf
    for fitted in found:
        width = relative_deviation(fitted)
        if width <= _ALIKE * narrowest:
            best, narrowest = fitted, width
    return best


_ALIKE = 1.05  # ratio of widths of two similar lengths


def hardly_known(fitted: Fitted, thresholds: Thresholds) -> bool:
    """Whether a core coefficient is not determined, or any coefficient is entirely free."""
    wide = core_deviations(fitted.fit) > thresholds.determined_width
    return bool(np.any(wide) or np.any(fitted.minimum.reduced.free))
