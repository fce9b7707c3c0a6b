"""Fit of an arm: least squares, then output error over segments of growing length.

Unusual terms and delays are chosen on the way.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from flexid.arms.starts import filtered, starts
from flexid.arms.unusual import (
    LINES,
    UNUSUAL_FALL,
    FittedArm,
    Unusual,
    likeliest,
    not_in,
    promises,
    unusual_parts,
)
from flexid.arrays import FloatArray
from flexid.errors import ConvergenceError, SettingError
from flexid.estimators.channel_timing import INPUT, before_a_lag
from flexid.estimators.prediction_error import Steps
from flexid.estimators.samples import Samples, Segments, divide
from flexid.identification.full_model.fitting import (
    LONGEST,
    fit_segments,
    lengths,
    over_longer,
)
from flexid.identification.full_model.model import Data, Structure
from flexid.identification.full_model.starting import by_misfit
from flexid.identification.preparation.joint import ElasticArm
from flexid.identification.structure.validation import validate
from flexid.identification.vocabulary.evidence import Estimate, Validation
from flexid.identification.vocabulary.thresholds import THRESHOLDS
from flexid.models.torque_balance import TorqueBalance

COARSER = 0.3
"""Number of integration steps over the usual number, where their error matters little.

The error is 1e-4 of the phase. Either another fit follows, or an observer corrects each sample.
"""

# The substeps are limited: while the fitted joint is much faster than the sampling, its values are
# still far from right.
_ROUGH = Steps(0.1, insist=False, iterations=8, coarser=COARSER, most_substeps=8)
_INTERMEDIATE = replace(_ROUGH, iterations=5)  # between the first and the longest segments
_FIRST_SEGMENTS = 40  # on which each start is tried
_FINE = Steps(1e-3, insist=False, iterations=8, most_substeps=30)
_REFIT = replace(
    _FINE, tolerance=0.1, iterations=6
)  # from the values for the whole log to those for a part
_USUAL = 1.7  # s: length of segments up to which their residuals are not compared
_LARGEST_RATIO = 1.01  # of the residuals' variance, at most, over longer segments
_UNCONVERGED = 1.0  # standard deviations: a next step beyond it is not converged
_TIMED_FROM = 0.35  # s: length of segments that show timing and cubic springs
_UNUSUAL_SHARE = 0.1  # least fall of the weighted squares if the model explains little
_UNEXPLAINED = 1.5  # variance of the residuals over the encoders', beyond repair

_FINEST, _LAGS = 1e-3, 6  # relative tolerance of a lag, and iterations
_HELD_OUT = 1 / 3  # part at the end of each recording that is predicted

EFFECT_BAND = 20.0
"""Frequency in Hz up to which the torque of a parameter is computed."""


@dataclass(frozen=True, eq=False)
class ExactFits:
    """Fits without disturbances over segments of growing length."""

    asked: Structure[ElasticArm]
    ranked_starts: tuple[dict[str, float], ...]  # starts by name; `found` is from the first
    found: tuple[FittedArm, ...]  # empty if the fit failed from each start
    log_lag: float = 0.0  # s, of a filter of the logged inputs, undone in `found`

    @property
    def failure(self) -> str:
        """Reason why fits without disturbances failed; empty if they may be good."""
        return _failure(self.found[-1]) if self.found else "the fit fails from every start"

    @property
    def structure(self) -> Structure[ElasticArm]:
        """Structure of the last fit, with the unusual terms that it needs."""
        return self.found[-1].structure if self.found else self.asked

    @property
    def starts(self) -> tuple[dict[str, float], ...]:
        """Starting values and the values of the last fit, by name."""
        return (*self.ranked_starts, *(end.by_name for end in self.found[-1:]))

    def best(self) -> tuple[FittedArm, Estimate]:
        """Return the fit over the longest segments with small residuals, and its estimate."""
        ends = _final_fits(self.found)
        best = next(ends, None)
        if best is None:  # no fit converged: the intervals are infinite
            return self.found[-1], estimate_of(self.found[-1])
        estimate = estimate_of(best)
        shorter = next(ends, None) if explains(best) else None
        if shorter is None or shorter.names != best.names:
            return best, estimate
        apart = shorter.values - best.values  # change with the length of the segments
        return best, estimate.widened(0.5 * np.outer(apart, apart))


def exact_fits(
    structure: Structure[ElasticArm], data: Data, progress: Callable[[str], None]
) -> ExactFits:
    """Fit an arm over segments of growing length until its residuals show a model error."""
    divisions = _divisions(data)
    progress("least squares")
    likely, first = fit_from_starts(structure, data, divisions[0])
    found = [first] if first else []
    timed, lag = False, 0.0
    for place in range(1, len(divisions)) if found else ():
        duration = divisions[place].mean_duration
        progress(f"segments of {duration:.2g} s")
        try:
            longer = over_longer(found[-1], divisions[place], _INTERMEDIATE)
        except ConvergenceError:
            break
        late = duration >= _TIMED_FROM and longer.minimum.last_step <= _UNCONVERGED
        is_timed = not timed and (late or not _near_noise(longer))
        if is_timed:
            longer, timed = _with_unusual_terms(longer), True
        if is_timed or lag:
            longer, lag = _with_filter_undone(longer, data, lag)
            divisions = _divisions(without_log_lag(data, lag))
        found.append(longer)
        if _failure(longer) or (duration > _USUAL and not _has_small_residuals(longer, found)):
            break
    return ExactFits(structure, likely, tuple(found), lag)


def _divisions(data: Data) -> list[Segments]:
    """Return divisions of the data into segments, the shortest first."""
    return lengths(data, min(LONGEST, 0.5 * data.shortest))


def residual_excess(fitted: FittedArm) -> FloatArray:
    """Return the RMS residual of each encoder over its noise, shape (n_rows,)."""
    residuals = fitted.minimum.equations.residuals[fitted.problem.segments.within]
    return np.sqrt(np.mean(residuals**2, axis=0)) / fitted.data.noise


def explains(fitted: FittedArm) -> bool:
    """Whether a fit has converged to residuals close to the encoders' noise."""
    left = float(np.mean(residual_excess(fitted) ** 2))
    return has_ended(fitted) and left <= THRESHOLDS.sensor_excess


def has_ended(fitted: FittedArm) -> bool:
    """Whether a fit has converged, with at least one parameter that is determined."""
    return fitted.minimum.last_step <= _UNCONVERGED and not fitted.minimum.reduced.free.all()


def _failure(fitted: FittedArm) -> str:
    """Return why fits over longer segments would fail too; empty if they may succeed."""
    if fitted.duration > _USUAL:
        return ""
    if not _near_noise(fitted):
        return f"residuals exceed the encoders' noise within {fitted.duration:.2g} s"
    if fitted.duration >= _TIMED_FROM and fitted.minimum.last_step > _UNCONVERGED:
        return f"the fit does not converge over segments of {fitted.duration:.2g} s"
    return ""


def _near_noise(fitted: FittedArm) -> bool:
    return fitted.excess <= _UNEXPLAINED


def _with_unusual_terms(fitted: FittedArm) -> FittedArm:
    """Return the fit with each unusual term, delay or hold of the inputs that is clearly better.

    Delays are tried before another hold, which looks similar.
    """
    return _with_better(_with_better(fitted, unusual_parts(fitted.structure)), [LINES])


def _with_filter_undone(best: FittedArm, logged: Data, lag: float) -> tuple[FittedArm, float]:
    """Return the fit with the inputs' filter undone, and the lag of the filter in s.

    An input with a negative delay may have been logged after a filter. The delay that is still
    fitted corrects `lag`. The fit is unchanged if a filter is not clearly better.
    """
    is_first = lag == 0.0
    for _ in range(_LAGS):
        early = -best.by_name.get(INPUT, 0.0)
        if abs(early) <= _FINEST * lag or lag + early <= 0.0:
            break
        data = without_log_lag(logged, lag + early)
        count = len(best.problem.segments)
        segments = next(own for own in _divisions(data) if len(own) == count)
        states, start = best.minimum.point.initial_states, {**best.by_name, INPUT: 0.0}
        try:
            other = fit_segments(best.structure, data, segments, start, states, _ROUGH)
        except ConvergenceError:
            break
        cost = other.minimum.equations.cost
        if not (_is_clearly_better(best, cost) if is_first else cost < best.minimum.equations.cost):
            break
        best, lag, is_first = other, lag + early, False
    return best, lag


def without_log_lag(data: Data, lag: float) -> Data:
    """Return the data with a first-order filter of the inputs undone; its lag is in s."""
    if lag == 0.0:
        return data
    samples = []
    for own in data.samples:
        inputs = [before_a_lag(values, lag / own.sample_time) for values in own.inputs.T]
        samples.append(replace(own, inputs=np.column_stack(inputs)))
    return replace(data, samples=tuple(samples))


def _with_better(best: FittedArm, parts: list[Unusual]) -> FittedArm:
    """Return the fit with each part that makes it clearly better, the best predicted first."""
    while parts:
        promised, part = likeliest(promises(best, parts))
        if not _is_clearly_better(best, promised, part.least):
            break
        parts.remove(part)
        structure, states = part.added(best.structure), best.minimum.point.initial_states
        segments = best.problem.segments
        with suppress(ConvergenceError):
            other = fit_segments(structure, best.data, segments, best.by_name, states, _ROUGH)
            better = _is_clearly_better(best, other.minimum.equations.cost, part.least)
            if better and part.is_possible(other.by_name):
                best, parts = other, not_in(structure, parts)
    return best


def _is_clearly_better(before: FittedArm, cost: float, least: float = UNUSUAL_FALL) -> bool:
    """Whether the weighted squares fall enough to accept an unusual term."""
    least = least * before.excess
    if not _near_noise(before):
        least = max(least, _UNUSUAL_SHARE * before.minimum.equations.cost)
    return cost < before.minimum.equations.cost - least


def _final_fits(found: Sequence[FittedArm]) -> Iterator[FittedArm]:
    """Yield converged fits, the longest segments with small residuals first.

    Long segments determine slow motion better. With a model error, however, residuals grow with
    the length and values are biased. Each output is weighted by the inverse of its residuals.
    """
    for fitted in reversed(found):
        if fitted.duration > _USUAL and not _has_small_residuals(fitted, found):
            continue
        noise = np.maximum(fitted.minimum.noise(fitted.problem), 0.3 * fitted.data.noise)
        weighted = replace(fitted, data=replace(fitted.data, noise=noise))
        with suppress(ConvergenceError):
            end = over_longer(weighted, fitted.problem.segments, _FINE)
            if has_ended(end):
                yield replace(end, data=fitted.data)


def _has_small_residuals(one: FittedArm, found: Sequence[FittedArm]) -> bool:
    """Whether residuals are hardly larger than over the shortest segments with a good fit."""
    return one.excess <= _LARGEST_RATIO * next(filter(_near_noise, found), found[0]).excess


def fit_from_starts(
    structure: Structure[ElasticArm], data: Data, segments: Segments
) -> tuple[tuple[dict[str, float], ...], FittedArm | None]:
    """Return starting values, the best first, and the fit from the first of them.

    Starts from which the fit fails are left out. If it fails from all, no fit is returned.
    """
    arm = structure.joint
    resting = [joint - 1 for joint in arm.resting]
    ways = starts(arm.balance, data.samples, dict(structure.fixed), resting)
    few = segments.some(_FIRST_SEGMENTS)  # over all segments some may diverge from least squares
    likely = tuple(by_misfit(structure, data, segments, ways, _INTERMEDIATE))
    if not likely:
        raise no_start()
    for place, start in enumerate(likely):
        with suppress(ConvergenceError):
            near = fit_segments(structure, data, few, start, None, _INTERMEDIATE)
            first = fit_segments(structure, data, segments, near.by_name, None, _INTERMEDIATE)
            return likely[place:], first
    return likely, None


def no_start() -> ConvergenceError:
    """Return the error for a log that the model cannot follow from any start."""
    return ConvergenceError(
        "arm",
        "the model cannot follow the log from any start: check the signs and units of the torques "
        "and angles, the order of the joints, and the lengths",
    )


def before_the_end(data: Data) -> tuple[Data, list[int]]:
    """Return the first two thirds of each recording, and their numbers of samples."""
    starts = [round((1.0 - _HELD_OUT) * len(recording)) for recording in data.samples]
    own = zip(data.samples, starts, strict=True)
    return replace(data, samples=tuple(r.window(0, start) for r, start in own)), starts


def predicted(fitted: FittedArm) -> Validation:
    """Predict the last third of each recording with a fit to the first two thirds."""
    first, starts = before_the_end(fitted.data)
    first = replace(first, noise=1.0 / fitted.problem.weights)
    try:
        segments = divide(first.samples, fitted.problem.segments.mean_duration)
        begun = fit_segments(fitted.structure, first, segments, fitted.by_name, None, _REFIT)
        return validate(begun, fitted.data, starts)
    except (ConvergenceError, SettingError):
        return Validation({})


def estimate_of(fitted: FittedArm) -> Estimate:
    """Return the estimate, with its covariance shrunk towards the one for white noise."""
    return fitted.fit.drawn_to(fitted.minimum.reduced.inverse * max(fitted.excess, 1e-300))


def effect_sizes(balance: TorqueBalance, recordings: Sequence[Samples]) -> FloatArray:
    """Return the RMS torque of one unit of each parameter, shape (n_rows, n_parameters)."""
    rate = 0.1 / max(recording.sample_time for recording in recordings)
    columns = filtered(balance, recordings, min(EFFECT_BAND, rate)).columns
    return np.sqrt(np.mean(columns**2, axis=0))
