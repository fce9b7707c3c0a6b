"""The full model's way from least squares to long segments, with the hold that suits the log.

How an input runs between its samples, and how late it acts, look alike: what is held acts half a
sample later, on the average, than what runs on. Over short segments one hold passes for another
with another delay; the longest segments decide, and where these do not, the holds are tied.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from operator import itemgetter

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import ConvergenceError
from flexid.estimators.channel_timing import INPUT
from flexid.estimators.prediction_error import Minimum
from flexid.estimators.samples import Segments, side_by_side
from flexid.identification.full_model.fitting import (
    EXPLORING,
    fit_by_length,
    fit_like,
    in_part,
    led_from,
    lengths,
    longer_fits,
    motion_at,
    with_steps_refined,
)
from flexid.identification.full_model.model import Data, Fitted, Structure
from flexid.identification.full_model.starting import first_fits, short
from flexid.identification.vocabulary import Progress
from flexid.identification.vocabulary.thresholds import THRESHOLDS, Thresholds
from flexid.models.flexible_joint import HYSTERESIS_GRIP
from flexid.recording.recording import Hold

TURNING = 0.5
"""Seconds of segments in which most springs turn round: these show best what a model lacks."""

FOLLOWED = 2
"""Constants of a term that are followed up: those that promise most."""

# Mean square of a rigid joint's residuals over the sensors' noise: DFKI's pendulum has 2, a joint
# that is stiff for its load 16, and both are right; EMPS without its pulses has 10⁹, and is not.
_RIGID_EXCESS = 100.0
_HARDLY_MORE = 1.5  # times what noise explains: the held-out end may bring it below that
# Of the grip that suits the motion, to begin with.
_GRIPS = (4.0, 2.0, 1.0, 0.5, 0.25)
_WORDS: dict[Hold, str] = {"zero": "held", "linear": "on straight lines", "cubic": "smooth"}
_TIED = "the log does not distinguish the holds; of these, the one that needs the least delay"


@dataclass(frozen=True, eq=False)
class FitsByLength:
    """The full model without unusual terms, over segments of growing length."""

    found: tuple[Fitted, ...]  # from short segments to the longest that it follows
    divisions: tuple[Segments, ...]  # all lengths
    free_length: bool  # whether the length of the segments is to be chosen
    holds: tuple[Hold, ...]  # behaviours of the input that there were to choose from
    hold_reason: str  # why the input was taken to behave as it does
    tied: tuple[Hold, ...] = ()  # other behaviours that the log cannot tell from this one
    exact: bool = False  # whether an exact fit is asked for, whatever it leaves

    def longer(self, first: Fitted, thresholds: Thresholds) -> list[Fitted]:
        """Fits over segments that are longer than those of a first one, as far as they matter."""
        return _longer(first, self.divisions, thresholds, exact=self.exact)

    def with_term(self, found: list[Fitted], thresholds: Thresholds) -> "FitsByLength":
        """Fits with another term, with the hold that suits it best."""
        least = len(found[0].problem.segments)
        divisions = [s for s in self.divisions if len(s) <= least]
        held = with_best_hold(found, divisions, self.holds, self.free_length, thresholds)
        return replace(held, exact=self.exact)


def may_stand(fitted: Fitted, thresholds: Thresholds) -> bool:
    """Whether an exact fit may be reported, so that it is worth fitting to all data."""
    explains = fitted.excess <= _HARDLY_MORE * thresholds.sensor_excess
    return explains or nearly_explains(fitted, thresholds) or bool(fitted.at_bound)


def nearly_explains(fitted: Fitted, thresholds: Thresholds) -> bool:
    """Whether what an exact fit leaves is too little to be a model error that misleads it."""
    if fitted.structure.joint.kind == "rigid":  # which has no deflection to compare with
        return fitted.excess <= _RIGID_EXCESS
    return fitted.unexplained <= thresholds.exact_share


def _longer(
    first: Fitted, divisions: Sequence[Segments], thresholds: Thresholds, *, exact: bool
) -> list[Fitted]:
    """Fits over longer segments, over which an error of the model leaves more.

    Unless exact ones are asked for, there is none beyond one that cannot stand.
    """

    def leads_on(fitted: Fitted) -> bool:
        return exact or fitted.duration < TURNING or may_stand(fitted, thresholds)

    return longer_fits(first, divisions, leads_on)


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

    Where an exact fit is asked for, whatever it leaves, the best start's is taken at any rate.
    """
    divisions = lengths(data, *durations)
    progress("the full model")
    found = first_fits(base.with_hold(holds[0]), data, divisions, insist=not exact)
    if found[-1].excess > thresholds.sensor_excess:
        best, *_ = best_hold(found[-1], holds, thresholds)
        found = ending_with(best, found, divisions)
    progress("the full model over longer segments")
    if len(found[-1].problem.segments) == len(short(divisions)[-1]):
        found = found + _longer(found[-1], divisions, thresholds, exact=exact)
    if len(holds) > 1:
        progress("how the input runs between its samples")
    held = with_best_hold(found, divisions, holds, not durations, thresholds)
    return replace(held, exact=exact)


def fit_with_hysteresis(
    by_length: FitsByLength,
    before: Fitted,
    progress: Progress,
    thresholds: Thresholds = THRESHOLDS,
) -> FitsByLength | None:
    """Fit a joint with memory where one without leaves more than noise; None if it hardly helps."""
    full = by_length.found[-1].structure
    joint = full.joint
    if not joint.remembered:
        return None
    structure = replace(full, absent=full.absent - joint.remembered)
    structure = structure.with_hold(before.structure.timing.hold)
    progress("hysteresis of the spring")
    ways = [
        {**before.by_name, HYSTERESIS_GRIP: share * joint.first[HYSTERESIS_GRIP]}
        for share in _GRIPS
    ]
    some = sampled(before)
    promising = [(promised(some, structure, way), way) for way in ways]
    floor = thresholds.noise_floor(by_length.found[0].excess)
    for promise, way in sorted(promising, key=itemgetter(0), reverse=True)[:FOLLOWED]:
        if promise < thresholds.shape_promise:
            break
        first = explained_by(before, structure, way, floor, thresholds, _only_brakes)
        if first is not None:
            found = [first, *by_length.longer(first, thresholds)]
            return by_length.with_term(found, thresholds)
    return None


def _only_brakes(fitted: Fitted) -> bool:
    """Whether no friction of a spring with memory drives: that is none, and stands for a gap."""
    remembered = fitted.structure.joint.remembered
    return all(fitted.by_name.get(name, 0.0) >= 0.0 for name in remembered)


def turning(found: Sequence[Fitted], thresholds: Thresholds) -> Fitted | None:
    """The fit whose residuals show best what a model lacks; None where none leaves more than noise.

    Over the shortest segments anything is a curve; over the longest ones no start is good.
    """
    left = [fitted for fitted in found if fitted.excess > thresholds.sensor_excess]
    longer = (fitted for fitted in left if fitted.duration >= TURNING)
    return next(longer, left[-1] if left else None)


def sampled(fitted: Fitted) -> Fitted:
    """A fit as it is over some of its segments, spread evenly, where a log has very many samples.

    What the whole log lacks is sought there, and has to explain all of it then.
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
    way: Mapping[str, float],
    floor: float,
    thresholds: Thresholds,
    stands: Callable[[Fitted], bool],
) -> Fitted | None:
    """A wider fit that stands, if a few steps take most of what one without leaves beyond noise.

    Of a log with very many samples it has to do so in part of it first.
    """
    some = sampled(before)
    found = None
    for fitted in (before,) if some is before else (some, before):
        found = led_from(fitted, structure, way, steps=EXPLORING)
        wanted = thresholds.shape_share * (fitted.excess - floor)
        if found is None or fitted.excess - found.excess < wanted:
            return None
        # In steps that suit where it is now it may diverge.
        found = led_from(found, found.structure, data=fitted.data, steps=EXPLORING)
        if found is None or not stands(found):
            return None
        structure, way = found.structure, found.by_name
    return found


def explains(fitted: Fitted, thresholds: Thresholds) -> bool:
    """Whether nothing is left to explain over segments in which most springs turn round."""
    return fitted.excess <= thresholds.sensor_excess and fitted.duration >= TURNING


def leaves_more(fitted: Fitted, chosen: Sequence[Fitted], thresholds: Thresholds) -> bool:
    """Whether a fit leaves more than noise, and more than others over the same segments."""
    if fitted.excess <= thresholds.sensor_excess:
        return False
    length = len(fitted.problem.segments)
    return any(f.excess < fitted.excess for f in chosen if len(f.problem.segments) == length)


def promised(fitted: Fitted, structure: Structure, way: Mapping[str, float]) -> float:
    """Share of the residuals beyond noise that the first step with more terms promises to take."""
    states = fitted.minimum.point.initial_states
    problem, point = motion_at(structure, fitted.data, fitted.problem.segments, way, states)
    equations = problem.equations(point)
    beyond = equations.cost - problem.degrees_of_freedom
    return problem.solve(equations).decrement / beyond if np.isfinite(beyond) else 0.0


def with_best_hold(
    found: list[Fitted],
    divisions: Sequence[Segments],
    holds: Sequence[Hold],
    free_length: bool,
    thresholds: Thresholds,
) -> FitsByLength:
    """Fits with the hold that suits the log best, over the same segments."""
    if len(holds) == 1:
        refined = with_steps_refined(found)
        return FitsByLength(refined, tuple(divisions), free_length, tuple(holds), "as given")
    best, reason, tied = best_hold(found[-1], holds, thresholds)
    # A model that explains the log is best over its longest segments; the others do not matter.
    explained = best.excess <= thresholds.sensor_excess
    found = [best] if explained and best is not found[-1] else ending_with(best, found, divisions)
    refined = with_steps_refined(found)
    return FitsByLength(refined, tuple(divisions), free_length, tuple(holds), reason, tied)


def held_otherwise(fitted: Fitted, hold: Hold) -> Fitted | None:
    """The same structure with another hold, from where a fit ended; None if there is none."""
    structure = fitted.ended
    before = structure.timing.hold
    if hold == before:
        return None
    half = 0.5 * float(fitted.problem.segments.sample_times.mean())
    start = fitted.by_name
    if INPUT in start:
        start = {**start, INPUT: start[INPUT] + half * ((before == "zero") - (hold == "zero"))}
    found = led_from(fitted, structure.with_hold(hold), start)
    # In as short steps as the fit, if it took any: their error would pass for a worse hold.
    if found is None or fitted.data.refinement == 1:
        return found
    return fit_like(found.structure, found) or found


def ending_with(best: Fitted, found: list[Fitted], divisions: Sequence[Segments]) -> list[Fitted]:
    """Fits over the same segments as others, with the structure of a fit to the last of them."""
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
    """The fit whose hold explains the log best; of those that are alike, that of least delay.

    With the reason why it is, and the holds that the log cannot tell from it.
    """
    tried = side_by_side(lambda hold: held_otherwise(last, hold), holds)
    others = [fitted for fitted in tried if fitted is not None]
    # One whose steps did not end is no rival of one whose steps did.
    found = [last, *(other for other in others if other.converged or not last.converged)]
    misfits = _misfits(found)
    order = np.argsort(misfits).tolist()
    ordered, falls = [found[i] for i in order], (misfits - misfits.min())[order].tolist()
    alike = [f for f, fall in zip(ordered, falls, strict=True) if fall <= thresholds.hold_fall]
    if len(alike) > 1:
        # Where no hold explains the log, which of them fails like the others says nothing.
        stays = last in alike and ordered[0].excess > thresholds.sensor_excess
        best = last if stays else min(alike, key=lambda fitted: abs(fitted.delays[INPUT]))
        tied: tuple[Hold, ...] = tuple(f.structure.timing.hold for f in alike if f is not best)
        return best, _TIED, tied
    best = ordered[0]
    # Nothing is decided against one whose steps did not end: leaner, they may.
    unsure = tuple(f.structure.timing.hold for f in ordered[1:] if not f.converged)
    words = _WORDS[best.structure.timing.hold]
    if len(ordered) == 1:
        return best, f"{words}; otherwise the model does not follow", ()
    fall = (ordered[1].minimum.equations.cost - best.minimum.equations.cost) / residual_variance(
        found
    )
    if fall <= thresholds.hold_fall:
        return best, f"{words}; otherwise a delay would be just half a sample by chance", unsure
    less = f"the residuals' weighted sum of squares is {fall:.3g} less than otherwise"
    return best, f"{words}, {less}", unsure


def _misfits(found: Sequence[Fitted]) -> FloatArray:
    """Twice the negative logarithm of each hold's probability, up to a constant.

    A delay that is none is one that controllers have; one that is there might have been any up to
    the margin of the data, and that it came out at just half a sample is a coincidence to pay for
    (Bayes' factor of a uniform prior).
    """
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
    """Variance of the best fit's residuals over the sensors', as it acts on the input's delay.

    An encoder's steps under a slow motion are correlated for many samples; their sum of squares
    falls by chance as much as if there were fewer of them.
    """
    return max(1.0, min(max(fitted.excess, _correlated(fitted)) for fitted in found))


def _correlated(fitted: Fitted) -> float:
    """Variance of the input's delay over what white noise of the sensors would make it."""
    if INPUT not in fitted.names:
        return 1.0
    place = fitted.names.index(INPUT)
    ratio = float(fitted.fit.deviations[place] / fitted.unit_deviations[place])
    return ratio**2 if np.isfinite(ratio) else 1.0


def hold_covariance(reported: Fitted, tied: Sequence[Hold]) -> FloatArray:
    """Covariance, shape (k, k), of what was reported, from holds that the log cannot tell apart."""
    added = np.zeros((len(reported.names), len(reported.names)))
    found = [other for hold in tied if (other := held_otherwise(reported, hold)) is not None]
    # In as short steps as what is reported, or their error would pass for a doubt.
    others = [fit_like(rough.structure, rough) or rough for rough in found]
    misfits = _misfits((reported, *others))
    weights = np.exp(-0.5 * (misfits - misfits.min()))
    for other, weight in zip(others, (weights / weights.sum())[1:].tolist(), strict=True):
        apart = other.values - reported.values
        added += weight * np.outer(apart, apart)
    return added
