"""Fits of the full model from short to long segments, and choice of the hold.

The hold of an input and its delay have similar effects: a held input acts on average half a sample
later than an interpolated one. Over short segments one hold looks like another with another delay.
The longest segments decide; if they do not, the holds are tied.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import ConvergenceError
from flexid.estimators.channel_timing import INPUT
from flexid.estimators.prediction_error import Minimum
from flexid.estimators.samples import Segments, side_by_side
from flexid.identification.full_model.fitting import (
    EXPLORING,
    fit_by_length,
    fit_from,
    fit_like,
    in_own_steps,
    in_part,
    lengths,
    longer_fits,
    motion_at,
    with_steps_refined,
)
from flexid.identification.full_model.model import Data, Fitted, Structure
from flexid.identification.full_model.starting import first_fits, short
from flexid.identification.vocabulary import Progress, silent
from flexid.identification.vocabulary.thresholds import THRESHOLDS, Thresholds
from flexid.recording.recording import Hold

TURNING = 0.5
"""Length in s of segments in which most springs reverse; these show best what a model lacks."""

FOLLOWED = 2
"""Number of constants of a term that are tried: the most promising ones."""

# Largest mean square of a rigid joint's residuals over the sensors' noise. DFKI's pendulum has 2, a
# joint that is stiff for its load 16, and both fits are right. EMPS without its pulses has 10⁹, and
# its fit is wrong.
_RIGID_EXCESS = 100.0
_LONGER = 1.5  # ratio of durations: lengths double
_HARDLY_MORE = 1.5  # times the excess that noise explains, which all data may still reach
_WORDS: dict[Hold, str] = {"zero": "held", "linear": "on straight lines", "cubic": "smooth"}
_TIED = "the log does not distinguish the holds; this one needs the least delay"


@dataclass(frozen=True, eq=False)
class FitsByLength:
    """Fits of the full model without unusual terms, over segments of growing length."""

    found: tuple[Fitted, ...]  # fits from short segments to the longest that succeed
    divisions: tuple[Segments, ...]  # segments of all lengths
    free_length: bool  # whether the length of the segments is chosen
    holds: tuple[Hold, ...]  # holds to choose from
    hold_reason: str = ""  # reason for the hold
    tied: tuple[Hold, ...] = ()  # other holds that the log cannot distinguish from this one
    exact: bool = False  # whether an exact fit is required
    progress: Progress = silent
    thresholds: Thresholds = THRESHOLDS

    @property
    def floor(self) -> float:
        """Excess that counts as noise."""
        return self.thresholds.noise_floor(self.found[0].excess)

    def has_longer(self, fitted: Fitted) -> bool:
        """Whether the log has longer segments than those of a fit."""
        return self.divisions[-1].mean_duration > _LONGER * fitted.duration

    def onward(self, first: Fitted) -> list[Fitted]:
        """Return a fit, and fits over longer segments that begin from it."""
        # Unless an exact fit is required, the series ends after one that leaves too much for that.

        def should_continue(fitted: Fitted) -> bool:
            short = self.exact or fitted.duration < TURNING
            return short or is_acceptable(fitted, self.thresholds)

        return [first, *longer_fits(first, self.divisions, should_continue)]

    def with_term(self, found: list[Fitted]) -> "FitsByLength":
        """Return fits with another term, with the best hold."""
        least = len(found[0].problem.segments)
        divisions = tuple(s for s in self.divisions if len(s) <= least)
        return replace(self, divisions=divisions).with_best_hold(found)

    def with_best_hold(
        self, found: list[Fitted], known: tuple[Fitted, str, tuple[Hold, ...]] | None = None
    ) -> "FitsByLength":
        """Return fits with the best hold, over the same segments; `known` is their `best_hold`."""
        thresholds = self.thresholds
        if len(self.holds) == 1:
            known = found[-1], "as given", ()
        if not known and found[-1].excess > thresholds.sensor_excess:
            found = [*found[:-1], in_own_steps(found[-1])]  # errors of coarse steps may hide it
        best, reason, tied = known or best_hold(found[-1], self.holds, thresholds)
        # If a model explains the log, only its longest segments matter.
        explained = best.converged and best.excess <= thresholds.sensor_excess
        alone = explained and best is not found[-1]
        found = [best] if alone else ending_with(best, found, self.divisions)
        return replace(self, found=with_steps_refined(found), hold_reason=reason, tied=tied)


def is_acceptable(fitted: Fitted, thresholds: Thresholds) -> bool:
    """Whether an exact fit may be reported, so that it is fitted to all data."""
    explains = fitted.excess <= _HARDLY_MORE * thresholds.sensor_excess
    return explains or nearly_explains(fitted, thresholds) or bool(fitted.at_bound)


def nearly_explains(fitted: Fitted, thresholds: Thresholds) -> bool:
    """Whether the residuals of an exact fit are too small for a harmful model error."""
    if fitted.structure.joint.kind == "rigid":  # there is no deflection to compare with
        return fitted.excess <= _RIGID_EXCESS
    return fitted.unexplained_over(TURNING) <= thresholds.exact_share


def fit_full_model(
    base: Structure,
    data: Data,
    holds: Sequence[Hold],
    durations: tuple[float, ...],  # in s
    progress: Progress,
    thresholds: Thresholds = THRESHOLDS,
    *,
    exact: bool = False,
) -> FitsByLength:
    """Fit the full model over segments of growing length; see `first_fits`.

    If an exact fit is required, the best start's fit is taken even without convergence.
    """
    divisions = lengths(data, *durations)
    rest = {"exact": exact, "progress": progress, "thresholds": thresholds}
    by_length = FitsByLength((), tuple(divisions), not durations, tuple(holds), **rest)
    progress("the full model")
    found = first_fits(base.with_hold(holds[0]), data, divisions, insist=not exact)
    known = None  # comparison of the holds
    if found[-1].excess > thresholds.sensor_excess:
        known = best_hold(found[-1], holds, thresholds)
        found = ending_with(known[0], found, divisions)
    progress("the full model over longer segments")
    if len(found[-1].problem.segments) == len(short(divisions)[-1]):
        onward = by_length.onward(found[-1])
        known, found = (None if len(onward) > 1 else known), [*found[:-1], *onward]
    if len(holds) > 1:
        progress("how the input runs between its samples")
    return by_length.with_best_hold(found, known)


def turning(found: Sequence[Fitted], thresholds: Thresholds) -> Fitted | None:
    """Return the fit whose residuals show best what a model lacks; None if all are noise.

    Over the shortest segments any term fits; over the longest ones no start is good enough.
    """
    left = [fitted for fitted in found if fitted.excess > thresholds.sensor_excess]
    longer = (fitted for fitted in left if fitted.duration >= TURNING)
    return next(longer, left[-1] if left else None)


def sampled(fitted: Fitted) -> Fitted:
    """Return a fit restricted to evenly spread segments, if a log has very many samples.

    A missing term is sought there first, and must then explain the whole log.
    """
    segments = fitted.problem.segments
    some = in_part(segments)
    if some is segments:
        return fitted
    states = fitted.minimum.point.initial_states[np.isin(segments.starts, some.starts)]
    rest = (fitted.data, some, fitted.by_name, states, fitted.data.refinement)
    problem, point = motion_at(fitted.ended, *rest)
    equations = problem.equations(point)
    minimum = Minimum(point, equations, problem.solve(equations), 0, 0.0)
    return replace(fitted, problem=problem, minimum=minimum)


def explained_by(
    before: Fitted,
    structure: Structure,
    start: Mapping[str, float],
    floor: float,
    thresholds: Thresholds,
    accepted: Callable[[Fitted], bool],
) -> Fitted | None:
    """Return a wider fit if a few steps explain most of the residuals beyond noise, or None.

    The fit must be `accepted`. For a log with very many samples this is tested on a part first.
    """
    some = sampled(before)
    found = None
    for fitted in (before,) if some is before else (some, before):
        found = fit_from(fitted, structure, start, steps=EXPLORING)
        wanted = thresholds.shape_share * (fitted.excess - floor)
        if found is None or fitted.excess - found.excess < wanted:
            return None
        # With integration steps for the new values the motion may diverge.
        found = fit_from(found, found.structure, steps=EXPLORING)
        if found is None or not accepted(found):
            return None
        structure, start = found.structure, found.by_name
    return found


def explains(fitted: Fitted, thresholds: Thresholds) -> bool:
    """Whether residuals are noise over segments in which most springs reverse."""
    return fitted.excess <= thresholds.sensor_excess and fitted.duration >= TURNING


def leaves_more(fitted: Fitted, chosen: Sequence[Fitted], thresholds: Thresholds) -> bool:
    """Whether a fit leaves more than noise, and more than another over the same segments."""
    if fitted.excess <= thresholds.sensor_excess:
        return False
    length = len(fitted.problem.segments)
    return any(f.excess < fitted.excess for f in chosen if len(f.problem.segments) == length)


def promised(fitted: Fitted, structure: Structure, start: Mapping[str, float]) -> float:
    """Return the share of the residuals beyond noise that a first step with more terms removes."""
    states = fitted.minimum.point.initial_states
    problem, point = motion_at(structure, fitted.data, fitted.problem.segments, start, states)
    equations = problem.equations(point)
    beyond = equations.cost - problem.degrees_of_freedom
    return problem.solve(equations).decrement / beyond if np.isfinite(beyond) else 0.0


def with_other_hold(fitted: Fitted, hold: Hold) -> Fitted | None:
    """Fit the structure with another hold, from a fit's values; None on failure or equal hold."""
    structure = fitted.ended
    before = structure.timing.hold
    if hold == before:
        return None
    half = 0.5 * float(fitted.problem.segments.sample_times.mean())
    start = fitted.by_name
    if INPUT in start:
        start = {**start, INPUT: start[INPUT] + half * ((before == "zero") - (hold == "zero"))}
    found = fit_from(fitted, structure.with_hold(hold), start)
    # Use the fit's integration steps: a different step error would look like a worse hold.
    if found is None or fitted.data.refinement == 1:
        return found
    return fit_like(found.structure, found) or found


def ending_with(best: Fitted, found: list[Fitted], divisions: Sequence[Segments]) -> list[Fitted]:
    """Return fits over the segments of `found`, with the structure of `best`."""
    if best is found[-1]:
        return found
    states = found[0].minimum.point.initial_states
    most, least = len(found[0].problem.segments), len(best.problem.segments)
    segments = [s for s in divisions if most >= len(s) >= least]
    try:
        by_length = fit_by_length(best.structure, best.data, best.by_name, segments, states)
    except ConvergenceError:
        return [best]
    return by_length if len(by_length[-1].problem.segments) == least else [*by_length, best]


def best_hold(
    last: Fitted, holds: Sequence[Hold], thresholds: Thresholds
) -> tuple[Fitted, str, tuple[Hold, ...]]:
    """Return the fit with the best hold; of equally good holds, the one with the least delay.

    Also returns the reason, and the holds that the log cannot distinguish from it.
    """
    tried = side_by_side(lambda hold: with_other_hold(last, hold), holds)
    others = [fitted for fitted in tried if fitted is not None]
    # A fit that did not converge does not compete with one that did.
    found = [last, *(other for other in others if other.converged or not last.converged)]
    misfits = _misfits(found)
    order = np.argsort(misfits).tolist()
    ordered, falls = [found[i] for i in order], (misfits - misfits.min())[order].tolist()
    alike = [f for f, fall in zip(ordered, falls, strict=True) if fall <= thresholds.hold_fall]
    if len(alike) > 1:
        # If no hold explains the log, small differences mean nothing.
        stays = last in alike and ordered[0].excess > thresholds.sensor_excess
        best = last if stays else min(alike, key=lambda fitted: abs(fitted.delays[INPUT]))
        tied: tuple[Hold, ...] = tuple(f.structure.timing.hold for f in alike if f is not best)
        return best, _TIED, tied
    best = ordered[0]
    # A hold whose fit did not converge is not excluded: a leaner fit may converge.
    unsure = tuple(f.structure.timing.hold for f in ordered[1:] if not f.converged)
    words = _WORDS[best.structure.timing.hold]
    if len(ordered) == 1:
        return best, f"{words}; the fit fails with other holds", ()
    fall = (ordered[1].minimum.equations.cost - best.minimum.equations.cost) / residual_variance(
        found
    )
    if fall <= thresholds.hold_fall:
        return best, f"{words}; with other holds the delay would be half a sample by chance", unsure
    less = f"the residuals' weighted sum of squares is {fall:.3g} less than with other holds"
    return best, f"{words}, {less}", unsure


def _misfits(found: Sequence[Fitted]) -> FloatArray:
    """Return -2 log probability of each hold, up to a constant."""
    # A delay of zero is common in controllers. Any other delay has a uniform prior up to the margin
    # of the data, so a delay of just half a sample is an unlikely coincidence (Bayes factor).
    scale = residual_variance(found)
    misfits = np.array([fitted.minimum.equations.cost for fitted in found]) / scale
    for i, fitted in enumerate(found):
        if INPUT not in fitted.names:
            continue
        place = fitted.names.index(INPUT)
        white = float(fitted.unit_deviations[place]) * np.sqrt(max(1.0, fitted.excess))
        deviation = max(white, float(fitted.fit.deviations[place]))
        if np.isfinite(deviation) and deviation > 0.0:
            room = 2.0 * fitted.data.margin / (np.sqrt(2.0 * np.pi) * deviation)
            away = (fitted.delays[INPUT] / deviation) ** 2
            misfits[i] += min(away, 2.0 * np.log(max(room, 1.0)))
    return misfits


def residual_variance(found: Sequence[Fitted]) -> float:
    """Return the variance of the best fit's residuals over the sensors' noise, with correlation.

    An encoder's steps under a slow motion are correlated over many samples. By chance their sum of
    squares falls by as much as that of fewer independent samples.
    """
    return min(max(fitted.excess, _correlated(fitted)) for fitted in found)


def _correlated(fitted: Fitted) -> float:
    """Return the variance of the input's delay over its value for white noise, at least 1."""
    ratios = dict(zip(fitted.names, fitted.scatter.tolist(), strict=True))
    return float(np.fmax(ratios.get(INPUT, 1.0), 1.0)) ** 2


def hold_covariance(reported: Fitted, tied: Sequence[Hold]) -> FloatArray:
    """Return the covariance, shape (k, k), from holds that the log cannot distinguish."""
    added = np.zeros((len(reported.names), len(reported.names)))
    found = [other for hold in tied if (other := with_other_hold(reported, hold)) is not None]
    # Use the reported fit's integration steps: a different step error would count as a doubt.
    others = [fit_like(rough.structure, rough) or rough for rough in found]
    misfits = _misfits((reported, *others))
    weights = np.exp(-0.5 * (misfits - misfits.min()))
    for other, weight in zip(others, (weights / weights.sum())[1:].tolist(), strict=True):
        apart = other.values - reported.values
        added += weight * np.outer(apart, apart)
    return added
