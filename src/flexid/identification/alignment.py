"""How a log's channels lie in time: hold and delay of the input, delay of the link's encoder.

The motor encoder's clock is the clock. What is estimated is small and matters much: an encoder that
is read 3 ms late shows a deflection wherever the joint moves, and a torque that acts half a sample
later than it stands in the log turns into friction. A delay is claimed, and corrected, only if its
interval excludes zero; the interval counts every friction that could stand for the delay.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import ceil, floor, isfinite
from typing import Literal, TypeAlias

import numpy as np

from flexid.errors import SettingError
from flexid.estimators.samples import FloatArray, Samples
from flexid.identification.delay_equations import (
    DEFLECTION_UNKNOWNS,
    TORQUE_UNKNOWNS,
    DelayEquations,
    channels,
    delay_equations,
)
from flexid.identification.delay_search import DelayEstimate, DelaySearch
from flexid.recording.recording import Hold, Recording
from flexid.recording.shift import later, spoilt

DelayStatus: TypeAlias = Literal["given", "found", "none", "unknown"]

_LARGEST = 0.05  # s, delay that is looked for
_LARGEST_SAMPLES = 3.0  # and at least so many samples
_LARGEST_SHARE = 0.1  # of a piece, that the search may cost at either end
_TIME_CONSTANTS = 200.0  # of the filter in the log: twenty blocks of ten
_SLOWEST, _FASTEST = 8.0, 40.0  # 1/s, rates of the filter
_FASTEST_SAMPLED = 0.2  # over the sampling rate
_CLAIMED = 3.0  # standard deviations that a delay has to have
_HOLDS: tuple[Hold, ...] = ("linear", "zero")
_INPUT_ACTS, _LINK_IS = "input acts", "link's encoder is"


@dataclass(frozen=True)
class Delay:
    """A delay of one channel against the motor's encoder.

    Parameters
    ----------
    value : float
        In s, the delay to correct: zero unless one was given or found.
    estimate : float
        In s, the delay that explains the log best; where a friction can stand for a part of it, the
        one without that friction. The given value, if one was given.
    std : float
        In s; half the interval over Student's quantile, so with what frictions could hide.
    interval : tuple of float
        In s, all delays that explain the log as well, at 95 %, frictions having whatever part.
    status : {"given", "found", "none", "unknown"}
        ``none``: no delay is needed. ``unknown``: the log cannot tell, and none is corrected.
    reason : str
        One sentence.
    """

    value: float
    estimate: float
    std: float
    interval: tuple[float, float]
    status: DelayStatus
    reason: str


@dataclass(frozen=True)
class Alignment:
    """Hold of the input, and delays of the channels against the motor's encoder.

    Parameters
    ----------
    hold : {"zero", "linear"}
        How the input behaves between samples.
    input_delay : Delay
        Positive if the input acts later than it stands in the log.
    link_delay : Delay
        Positive if the link's encoder shows where the link was so much earlier.
    hold_reason : str
        Why this hold, in one sentence.
    hold_misfits : mapping of Hold to float
        Part of the torque that its balance leaves unexplained (ratio of mean squares), at the best
        input delay for each hold that was tried.
    deflection_doubt : float
        Root mean square of the deflection that another delay out of `link_delay.interval` would
        make, over that of the aligned deflection. Near 1, the deflection says nothing; zero for a
        log with one encoder or with a given delay.
    filter_rate : float
        Rate in 1/s of the filter behind which the channels were compared.
    """

    hold: Hold
    input_delay: Delay
    link_delay: Delay
    hold_reason: str
    hold_misfits: Mapping[Hold, float]
    deflection_doubt: float
    filter_rate: float


def estimate_alignment(
    pieces: Sequence[Recording],
    hold: Hold | Literal["auto"] = "auto",
    input_delay: float | Literal["auto"] = "auto",
    link_delay: float | Literal["auto"] = "auto",
    filter_rate: float | None = None,
) -> Alignment:
    """Estimate how the channels lie in time.

    Parameters
    ----------
    pieces : sequence of Recording
        Of one drive, with the same encoders; as they were logged.
    hold : {"auto", "zero", "linear"}, optional
        Hold of the input, if it is known.
    input_delay, link_delay : float or "auto", optional
        Delays in s, where they are known; signs as in `Alignment`.
    filter_rate : float, optional
        Rate of the filter in 1/s; 200 over the duration, from 8 to 40, if not given.

    Returns
    -------
    Alignment

    Raises
    ------
    SettingError
        If a given delay is no number or longer than what the log allows.
    """
    limit = _limit(pieces)
    for name, value in (("input-delay", input_delay), ("link-delay", link_delay)):
        if not isinstance(value, str) and not (isfinite(value) and abs(value) < limit):
            raise SettingError(name, f"give seconds between -{limit:g} and {limit:g}, or auto")
    task = _Task(
        pieces, [channels(piece) for piece in pieces], hold, input_delay, link_delay, limit
    )
    return task.at(filter_rate or _filter_rate(pieces))


def aligned(piece: Recording, alignment: Alignment) -> Recording:
    """Return the recording with all channels on the motor encoder's clock.

    Parameters
    ----------
    piece : Recording
        As it was logged.
    alignment : Alignment
        Its delays.

    Returns
    -------
    Recording
        Shorter by the samples at both ends that not all channels cover. The link's position, and
        its velocity if it was logged, pass an all-pass filter, which leaves white noise white
        (`flexid.recording.shift`). The input becomes its mean over each sample's hold, or its value
        on the straight line between two samples.

    Raises
    ------
    RecordingError
        If nothing is left.
    """
    drive = alignment.input_delay.value / piece.sample_time
    link = -alignment.link_delay.value / piece.sample_time
    shifted = replace(piece, input=_later_input(piece.input, drive))
    first, last = max(ceil(drive), 0), max(ceil(-drive), 0)
    if piece.link_position is not None and link != 0.0:
        speed = piece.link_velocity
        shifted = replace(
            shifted,
            link_position=later(piece.link_position, link),
            link_velocity=None if speed is None else later(speed, link),
        )
        before, after = spoilt(link)
        first, last = max(first, before), max(last, after)
    return shifted.window(first, len(piece) - last) if first or last else piece


def _later_input(values: FloatArray, samples: float) -> FloatArray:
    """An input, held or on straight lines, moved to later times by any part of a sample."""
    whole = floor(samples)
    part = samples - whole
    places = np.arange(len(values)) - whole
    last = len(values) - 1
    return (1.0 - part) * values[np.clip(places, 0, last)] + part * values[
        np.clip(places - 1, 0, last)
    ]


def _limit(pieces: Sequence[Recording]) -> float:
    sample_time = max(piece.sample_time for piece in pieces)
    shortest = min(len(piece) * piece.sample_time for piece in pieces)
    return min(max(_LARGEST, _LARGEST_SAMPLES * sample_time), _LARGEST_SHARE * shortest)


def _given(delay: float | Literal["auto"]) -> float:
    return 0.0 if delay == "auto" else delay


def _filter_rate(pieces: Sequence[Recording]) -> float:
    """Slow enough to leave the noise behind, fast enough for many independent blocks."""
    duration = sum(len(piece) * piece.sample_time for piece in pieces)
    rate = min(max(_TIME_CONSTANTS / duration, _SLOWEST), _FASTEST)
    return min(rate, _FASTEST_SAMPLED / max(piece.sample_time for piece in pieces))


@dataclass(frozen=True)
class _Task:
    """What is to be estimated, for any rate of the filter."""

    pieces: Sequence[Recording]
    samples: Sequence[Samples]
    hold: Hold | Literal["auto"]
    input_delay: float | Literal["auto"]
    link_delay: float | Literal["auto"]
    limit: float

    def at(self, rate: float) -> Alignment:
        """Estimate behind a filter of this rate."""
        holds: tuple[Hold, ...] = _HOLDS if self.hold == "auto" else (self.hold,)
        equations = {h: delay_equations(self.samples, rate, h, self.limit) for h in holds}
        link = self._link(equations[holds[0]], _given(self.input_delay))
        found: dict[Hold, DelayEstimate] = {
            h: _torque_search(equations[h], link.value).best() for h in holds
        }
        misfits: dict[Hold, float] = {h: estimate.misfit for h, estimate in found.items()}
        hold, why = _hold(found, self.input_delay == "auto")
        drive = (
            _delay(found[hold], self.limit, _INPUT_ACTS)
            if self.input_delay == "auto"
            else _given_delay(self.input_delay, _INPUT_ACTS)
        )
        # What is not known of the input's delay is not known of the link's either.
        link = self._link(equations[hold], drive.value, *drive.interval)
        return Alignment(
            hold=hold,
            input_delay=drive,
            link_delay=link,
            hold_reason=why if self.hold == "auto" else "the hold was given",
            hold_misfits=misfits,
            deflection_doubt=_deflection_doubt(self.pieces, link),
            filter_rate=rate,
        )

    def _link(self, equations: DelayEquations, *input_delays: float) -> Delay:
        """Delay of the link's encoder at the first of some input delays, no surer than at all."""
        if self.pieces[0].link_position is None:
            return Delay(0.0, 0.0, 0.0, (0.0, 0.0), "none", "there is no encoder on the link")
        if self.link_delay != "auto":
            return _given_delay(self.link_delay, _LINK_IS)
        found = [_deflection_search(equations, d).best() for d in dict.fromkeys(input_delays)]
        low = min(estimate.interval[0] for estimate in found)
        high = max(estimate.interval[1] for estimate in found)
        widening = (high - low) - (found[0].interval[1] - found[0].interval[0])
        estimate = replace(
            found[0],
            std=found[0].std + 0.25 * widening,  # two deviations to either side
            interval=(low, high),
            contains_zero=any(estimate.contains_zero for estimate in found),
        )
        return _delay(estimate, self.limit, _LINK_IS)


def _torque_search(equations: DelayEquations, link_delay: float) -> DelaySearch:
    return DelaySearch(equations.torque(link_delay), TORQUE_UNKNOWNS, equations)


def _deflection_search(equations: DelayEquations, input_delay: float) -> DelaySearch:
    return DelaySearch(equations.deflection(input_delay), DEFLECTION_UNKNOWNS, equations)


def _given_delay(value: float, what: str) -> Delay:
    reason = f"the {what} {1e3 * value:.3g} ms late, as given"
    return Delay(value, value, 0.0, (value, value), "given", reason)


def _delay(estimate: DelayEstimate, limit: float, what: str) -> Delay:
    low, high = (1e3 * end for end in estimate.interval)
    within = f"{low:.3g} to {high:.3g} ms"
    if abs(estimate.value) >= limit or low <= -1e3 * limit or high >= 1e3 * limit:
        status: DelayStatus = "unknown"
        reason = f"the log cannot tell how late the {what}, so nothing is corrected"
    elif _is_none(estimate):
        status = "none"
        reason = f"nothing shows for sure that the {what} late; {within} could hide"
    else:
        status = "found"
        ratio = estimate.misfit_without / estimate.misfit
        reason = (
            f"the {what} {1e3 * estimate.value:.3g} ms late ({within}): without that "
            f"the misfit is {ratio:.3g} times as large"
        )
    value = estimate.value if status == "found" else 0.0
    return Delay(value, estimate.value, estimate.std, estimate.interval, status, reason)


def _is_none(estimate: DelayEstimate) -> bool:
    """Whether no delay is claimed: 95 % would claim one in a log of twenty that have none."""
    return estimate.contains_zero or abs(estimate.value) < _CLAIMED * estimate.std


def _hold(found: Mapping[Hold, DelayEstimate], free_delay: bool) -> tuple[Hold, str]:
    """The hold that needs no delay, if only one does not; else the one that explains more."""
    simple: list[Hold] = [
        name for name, estimate in found.items() if _is_none(estimate) and free_delay
    ]
    candidates: list[Hold] = simple or list(found)

    def misfit(name: Hold) -> float:
        return found[name].misfit_without if simple else found[name].misfit

    chosen: Hold = min(candidates, key=misfit)
    ceiling = found[chosen].misfit_ceiling
    as_good: list[Hold] = [name for name in candidates if misfit(name) <= ceiling]
    names: dict[Hold, str] = {
        "linear": "on straight lines between samples",
        "zero": "held over each sample",
    }
    if len(as_good) > 1:
        return as_good[0], f"the log cannot tell the holds apart; {names[as_good[0]]} is assumed"
    if len(simple) == 1 and len(found) > 1:
        return chosen, f"only an input {names[chosen]} explains the log without a delay"
    return chosen, f"an input {names[chosen]} explains the log better than the other hold"


def _deflection_doubt(pieces: Sequence[Recording], link: Delay) -> float:
    """Root mean square of the deflection that is open for want of a sharper delay, over all."""
    error = max(abs(end - link.value) for end in link.interval)
    if pieces[0].link_position is None or error == 0.0:
        return 0.0
    speed, total, count = 0.0, 0.0, 0
    for piece in pieces:
        h = piece.sample_time
        position = later(piece.needed_link_position, -link.value / h)
        first, last = spoilt(-link.value / h)
        deflection = (position - piece.motor_position)[first : len(piece) - last]
        total += float(np.sum((deflection - deflection.mean()) ** 2))
        speed += float(np.sum(np.gradient(piece.motor_position, h) ** 2))
        count += len(deflection)
    return error * float(np.sqrt(speed / max(total, np.finfo(float).tiny)))
