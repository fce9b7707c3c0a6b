"""The fit of an arm: from least squares over short segments to long ones, then what is unusual.

One pass over the log tells what all unusual terms and late channels promise: a quadratic form about
the fit so far.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from flexid.arms.starts import filtered, starts
from flexid.arrays import FloatArray
from flexid.errors import ConvergenceError, SettingError
from flexid.estimators.channel_timing import DELAY, INPUT, before_a_lag
from flexid.estimators.normal_equations import scaled_inverse
from flexid.estimators.samples import Samples, Segments, divide
from flexid.identification.full_model.fitting import (
    LONGEST,
    Steps,
    expanded,
    fit_segments,
    lengths,
    over_longer,
)
from flexid.identification.full_model.model import Data, Fitted, Structure
from flexid.identification.full_model.starting import by_misfit
from flexid.identification.preparation.joint import ElasticArm
from flexid.identification.structure.validation import validate
from flexid.identification.vocabulary.evidence import Estimate, Validation
from flexid.identification.vocabulary.thresholds import THRESHOLDS
from flexid.models.torque_balance import TorqueBalance
from flexid.recording.recording import Hold

UNUSUAL_FALL = 25.0
"""Of the weighted squares, over their variance, that what is unusual brings at least."""

FittedArm = Fitted[ElasticArm]
ArmStructure = Structure[ElasticArm]


@dataclass(frozen=True)
class Unusual:
    """One parameter more that may be sought: that of a term, or the delay of a channel."""

    name: str
    hold: Hold | None = None  # how the inputs behave; None where that stays as it was

    def added(self, structure: ArmStructure) -> ArmStructure:
        """The structure with it."""
        fixed = {name: value for name, value in structure.fixed.items() if name != self.name}
        timing = replace(structure.timing, hold=self.hold or structure.timing.hold)
        if self.name not in structure.joint.balance.coefficients:
            timing = replace(timing, sought=tuple(dict.fromkeys((*timing.sought, self.name))))
        return replace(structure, fixed=fixed, timing=timing)


LINES = Unusual(INPUT, "linear")
"""Inputs on straight lines between samples, and late: much like held ones with another delay."""


def unusual_parts(structure: ArmStructure) -> list[Unusual]:
    """Terms that a structure does not have yet, and delays of the inputs and of each link."""
    balance = structure.joint.balance
    terms = [name for name in balance.unusual if name in structure.fixed]
    return [*map(Unusual, terms), Unusual(INPUT), *map(Unusual, link_delays(balance))]


def link_delays(balance: TorqueBalance) -> tuple[str, ...]:
    """Name of the delay of each link's encoder, of which that of the motor is on time."""
    return tuple(f"{row.name}{DELAY}" for row in balance.rows[::2])


def promises(fitted: FittedArm, parts: Sequence[Unusual]) -> Iterator[tuple[float, Unusual]]:
    """The weighted squares that one step from a fit promises with each part, and the part.

    A fit that has not ended would go on as it is as well: that is no merit of a part.
    """
    holds = [part.hold or fitted.structure.timing.hold for part in parts]
    for hold in dict.fromkeys(holds):
        own = [part for part, other in zip(parts, holds, strict=True) if other == hold]
        wide = fitted.structure
        for part in own:
            wide = part.added(wide)
        seen = expanded(wide, fitted)
        reduced, score = seen.minimum.reduced, seen.minimum.reduced.scores.sum(axis=1)
        squares = seen.minimum.equations.cost - float(reduced.by_states.sum())
        for part in own:
            sought = np.array([name in {*fitted.names, part.name} for name in seen.names])
            information = reduced.information[np.ix_(sought, sought)]
            scale = np.sqrt(np.maximum(np.diag(information), 0.0))
            inverse, _ = scaled_inverse(information, scale)
            fall = float(score[sought] @ inverse @ score[sought])
            yield squares - fall + fitted.minimum.reduced.decrement, part


COARSER = 0.3
"""Steps of integration over the usual ones, where little depends on their error.

It is 1e-4 of the phase: another fit follows, or an observer corrects the motion at each sample.
"""

# Those of a stiff joint are limited there: a model that is much faster than the samples is not yet
# the right one.
_ROUGHLY = Steps(0.1, insist=False, iterations=8, coarser=COARSER, most_substeps=8)
_BETWEEN = replace(_ROUGHLY, iterations=5)  # between the first segments and those that count
_FIRST_SEGMENTS = 40  # over which each start is tried
_FINE = Steps(1e-3, insist=False, iterations=8, most_substeps=30)
_FEW = replace(
    _FINE, tolerance=0.1, iterations=6
)  # from values of the whole log to those of a part
_USUAL = 1.7  # s: segments that a fit goes up to in any case
_GROWTH = 1.01  # of the residuals' variance with the segments' length, up to which it goes on
_UNFINISHED = 1.0  # standard deviations, of the step that would come next
_TIMED_FROM = 0.35  # s: length of segments from which on the inputs' timing shows, and bent springs
_UNUSUAL_SHARE = 0.1  # of the weighted squares, that it brings where the model explains little
_UNEXPLAINED = 1.5  # variance of the residuals over the encoders', that no exact fit mends

_FINEST, _LAGS = 1e-3, 6  # of a lag, to which it is sought, in so many steps at most
_HELD_OUT = 1 / 3  # of each recording, at its end, that is predicted

EFFECT_BAND = 20.0
"""Frequency in Hz up to which a parameter's torque is taken."""


@dataclass(frozen=True, eq=False)
class ExactFits:
    """Fits without disturbances over segments of growing length, as far as they are of use."""

    asked: Structure[ElasticArm]
    begun: tuple[dict[str, float], ...]  # least squares by name, the first one led to `found`
    found: tuple[FittedArm, ...]  # none where no motion leads from there
    log_lag: float = 0.0  # s, of a filter of the inputs into the log, undone in `found`

    @property
    def hopeless(self) -> str:
        """Why there is no fit without disturbances; empty where there may be one."""
        return (
            _hopeless(self.found[-1]) if self.found else "the motion leads nowhere from any start"
        )

    @property
    def structure(self) -> Structure[ElasticArm]:
        """What was fitted in the end, with the unusual terms that it needs."""
        return self.found[-1].structure if self.found else self.asked

    @property
    def starts(self) -> tuple[dict[str, float], ...]:
        """Values of least squares, and those over the longest segments, by name."""
        return (*self.begun, *(end.by_name for end in self.found[-1:]))

    def best(self) -> tuple[FittedArm, Estimate]:
        """The fit over the longest segments that can be trusted, with its covariance."""
        ends = _ends(self.found)
        best = next(ends, None)
        if best is None:  # the last one is shown for what it is: its intervals are infinite
            return self.found[-1], estimate_of(self.found[-1])
        estimate = estimate_of(best)
        shorter = next(ends, None) if explains(best) else None
        if shorter is None or shorter.names != best.names:
            return best, estimate
        apart = shorter.values - best.values  # what another length of the segments makes of the log
        return best, estimate.widened(0.5 * np.outer(apart, apart))


def exact_fits(
    structure: Structure[ElasticArm], data: Data, progress: Callable[[str], None]
) -> ExactFits:
    """Fit an arm to recordings, until its residuals say that it lacks something."""
    divisions = _divisions(data)
    progress("least squares")
    likely, first = begun(structure, data, divisions[0])
    found = [first] if first else []
    timed, lag = False, 0.0
    for place in range(1, len(divisions)) if found else ():
        duration = divisions[place].mean_duration
        progress(f"segments of {duration:.2g} s")
        try:
            longer = over_longer(found[-1], divisions[place], _BETWEEN)
        except ConvergenceError:
            break
        late = duration >= _TIMED_FROM and longer.minimum.last_step <= _UNFINISHED
        is_timed = not timed and (late or not _near_noise(longer))
        if is_timed:
            longer, timed = _suited(longer), True
        if is_timed or lag:
            longer, lag = _sharpened(longer, data, lag)
            divisions = _divisions(before_the_log(data, lag))
        found.append(longer)
        if _hopeless(longer) or (duration > _USUAL and not _holds(longer, found)):
            break
    return ExactFits(structure, likely, tuple(found), lag)


def _divisions(data: Data) -> list[Segments]:
    """Segments of growing length."""
    return lengths(data, min(LONGEST, 0.5 * data.shortest))


def residual_excess(fitted: FittedArm) -> FloatArray:
    """Residual of each encoder over its noise, root mean squares."""
    residuals = fitted.minimum.equations.residuals[fitted.problem.segments.within]
    return np.sqrt(np.mean(residuals**2, axis=0)) / fitted.data.noise


def explains(fitted: FittedArm) -> bool:
    """Whether a fit has ended and leaves hardly more than the encoders' noise."""
    left = float(np.mean(residual_excess(fitted) ** 2))
    return has_ended(fitted) and left <= THRESHOLDS.sensor_excess


def has_ended(fitted: FittedArm) -> bool:
    """Whether steps ended, and not because sensitivities beyond all bounds left nothing known."""
    return fitted.minimum.last_step <= _UNFINISHED and not fitted.minimum.reduced.free.all()


def _hopeless(fitted: FittedArm) -> str:
    """Why no exact fit over longer segments will do; empty where one may."""
    if fitted.duration > _USUAL:
        return ""
    if not _near_noise(fitted):
        return f"residuals exceed the encoders' noise within {fitted.duration:.2g} s"
    if fitted.duration >= _TIMED_FROM and fitted.minimum.last_step > _UNFINISHED:
        return f"steps do not end over segments of {fitted.duration:.2g} s"
    return ""


def _near_noise(fitted: FittedArm) -> bool:
    return fitted.excess <= _UNEXPLAINED


def _suited(fitted: FittedArm) -> FittedArm:
    """The same fit, with each unusual term or timing of the inputs that is clearly better.

    Another behaviour of the inputs looks much like a delay, which is tried first.
    """
    return _with_better(_with_better(fitted, unusual_parts(fitted.structure)), [LINES])


def _sharpened(best: FittedArm, logged: Data, lag: float) -> tuple[FittedArm, float]:
    """The fit of inputs before they were low-passed into the log, and the lag of that filter in s.

    An input that acts early may have been logged behind a filter: a delay beside that is what its
    `lag` so far lacks. The fit as it is where a filter is not clearly better.
    """
    is_first = lag == 0.0
    for _ in range(_LAGS):
        early = -best.by_name.get(INPUT, 0.0)
        if abs(early) <= _FINEST * lag or lag + early <= 0.0:
            break
        data = before_the_log(logged, lag + early)
        count = len(best.problem.segments)
        segments = next(own for own in _divisions(data) if len(own) == count)
        states, start = best.minimum.point.initial_states, {**best.by_name, INPUT: 0.0}
        try:
            other = fit_segments(best.structure, data, segments, start, states, _ROUGHLY)
        except ConvergenceError:
            break
        cost = other.minimum.equations.cost
        if not (_falls(best, cost) if is_first else cost < best.minimum.equations.cost):
            break
        best, lag, is_first = other, lag + early, False
    return best, lag


def before_the_log(data: Data, lag: float) -> Data:
    """Data with their inputs in front of a filter with a lag in s."""
    if lag == 0.0:
        return data
    samples = []
    for own in data.samples:
        inputs = [before_a_lag(values, lag / own.sample_time) for values in own.inputs.T]
        samples.append(replace(own, inputs=np.column_stack(inputs)))
    return replace(data, samples=tuple(samples))


def _with_better(best: FittedArm, parts: list[Unusual]) -> FittedArm:
    """The fit with each part that is clearly better, the most promising ones first."""
    while parts:
        promised, part = min(promises(best, parts), key=lambda each: each[0])
        if not _falls(best, promised):
            break
        parts.remove(part)
        structure, states = part.added(best.structure), best.minimum.point.initial_states
        segments = best.problem.segments
        with suppress(ConvergenceError):
            other = fit_segments(structure, best.data, segments, best.by_name, states, _ROUGHLY)
            if _falls(best, other.minimum.equations.cost):
                best = other
    return best


def _falls(before: FittedArm, cost: float) -> bool:
    """Whether weighted squares fall enough for something unusual."""
    least = UNUSUAL_FALL * before.excess
    if not _near_noise(before):
        least = max(least, _UNUSUAL_SHARE * before.minimum.equations.cost)
    return cost < before.minimum.equations.cost - least


def _ends(found: Sequence[FittedArm]) -> Iterator[FittedArm]:
    """The fit over the longest segments that can be trusted, and those before it.

    Long segments say more of what is slow, if the model is right. Where it is not, residuals grow
    with the length, and what the model lacks biases the values. Each output's weight is from what
    it leaves over.
    """
    for fitted in reversed(found):
        if fitted.duration > _USUAL and not _holds(fitted, found):
            continue
        noise = np.maximum(fitted.minimum.noise(fitted.problem), 0.3 * fitted.data.noise)
        weighted = replace(fitted, data=replace(fitted.data, noise=noise))
        with suppress(ConvergenceError):
            end = over_longer(weighted, fitted.problem.segments, _FINE)
            if has_ended(end):
                yield replace(end, data=fitted.data)


def _holds(one: FittedArm, found: Sequence[FittedArm]) -> bool:
    """Whether the residuals are hardly larger than those of the shortest segments that fit."""
    return one.excess <= _GROWTH * next(filter(_near_noise, found), found[0]).excess


def begun(
    structure: Structure[ElasticArm], data: Data, segments: Segments
) -> tuple[tuple[dict[str, float], ...], FittedArm | None]:
    """Starts, those first that get closest to the log, and where the first one leads.

    Those that lead nowhere are left out, unless all do.
    """
    arm = structure.joint
    resting = [joint - 1 for joint in arm.resting]
    ways = starts(arm.balance, data.samples, dict(structure.fixed), resting)
    few = segments.some(_FIRST_SEGMENTS)  # of all some may diverge from where least squares is
    likely = tuple(by_misfit(structure, data, segments, ways, _BETWEEN))
    if not likely:
        raise no_start()
    for place, start in enumerate(likely):
        with suppress(ConvergenceError):
            near = fit_segments(structure, data, few, start, None, _BETWEEN)
            first = fit_segments(structure, data, segments, near.by_name, None, _BETWEEN)
            return likely[place:], first
    return likely, None


def no_start() -> ConvergenceError:
    """The error of a log that the model follows from nowhere."""
    return ConvergenceError(
        "arm",
        "the model cannot follow the log from any start: check the signs and units of the torques "
        "and angles, the order of the joints, and the lengths",
    )


def before_the_end(data: Data) -> tuple[Data, list[int]]:
    """The first two thirds of each recording, and how many samples these have."""
    starts = [round((1.0 - _HELD_OUT) * len(recording)) for recording in data.samples]
    own = zip(data.samples, starts, strict=True)
    return replace(data, samples=tuple(r.window(0, start) for r, start in own)), starts


def predicted(fitted: FittedArm) -> Validation:
    """How a fit to the first two thirds of each recording predicts the last."""
    first, starts = before_the_end(fitted.data)
    first = replace(first, noise=1.0 / fitted.problem.weights)
    try:
        segments = divide(first.samples, fitted.problem.segments.mean_duration)
        begun = fit_segments(fitted.structure, first, segments, fitted.by_name, None, _FEW)
        return validate(begun, fitted.data, starts)
    except (ConvergenceError, SettingError):
        return Validation({})


def estimate_of(fitted: FittedArm) -> Estimate:
    """The estimate, its covariance drawn towards that of white noise."""
    return fitted.fit.drawn_to(fitted.minimum.reduced.inverse * max(fitted.excess, 1e-300))


def effect_sizes(balance: TorqueBalance, recordings: Sequence[Samples]) -> FloatArray:
    """Root mean square torque of one unit of each parameter in each balance.

    Returns shape (n_rows, n_parameters).
    """
    rate = 0.1 / max(recording.sample_time for recording in recordings)
    columns = filtered(balance, recordings, min(EFFECT_BAND, rate)).columns
    return np.sqrt(np.mean(columns**2, axis=0))
