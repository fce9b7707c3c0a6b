"""Timing of channels: inputs between samples, and delays of inputs and positions."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from math import ceil
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexid.arrays import FloatArray
from flexid.estimators.samples import Segments
from flexid.models.parametric_system import ParametricSystem
from flexid.recording.recording import Hold

_SIZES = (8, 9, 10, 12, 15)  # times a power of two: lengths with a fast Fourier transform
_TIME_CONSTANTS = 8.0  # length of a lag's impulse response
_EDGE = 16  # samples at either end that the reflection distorts


# A phase shift delays without attenuation, so white noise stays white. Interpolation half-way
# between two samples would attenuate the upper half of its frequencies.
def later(values: FloatArray, samples: float) -> FloatArray:
    """Delay a channel, shape (n,), by a number of samples of either sign; see `invalid_ends`."""
    if samples == 0.0 or len(values) < 2:
        return values.copy()
    own = _reflected(values)
    moved = np.fft.irfft(own.spectrum * np.exp(-1j * samples * own.turns), own.period)
    places = np.arange(len(values)) - samples
    return moved[: len(values)] + own.first + own.slope * places


def before_a_lag(values: FloatArray, samples: float) -> FloatArray:
    """Invert a first-order lag of so many samples: return its input, shape (n,), from its output.

    The channel was constant before.
    """
    return values + samples * np.diff(values, prepend=values[:1])


def after_a_lag(values: FloatArray, samples: float) -> FloatArray:
    """Return a channel, shape (n,), after a first-order lag of so many samples.

    The channel was constant before. The response decays geometrically. It has the variance of the
    lag's, so it attenuates alike; its delay is shorter by half a sample or less.
    """
    count = min(len(values), int(_TIME_CONSTANTS * samples) + 2)
    # The variance of a geometric distribution is kept / (1 - kept)**2.
    kept = 1.0 - 2.0 / (1.0 + np.sqrt(1.0 + 4.0 * samples**2))
    kernel = kept ** np.arange(count)
    return values[0] + np.convolve(values - values[0], kernel / kernel.sum())[: len(values)]


def rate_of_later(values: FloatArray, samples: float) -> FloatArray:
    """Return the derivative of `later` by the number of samples, shape (n,)."""
    if len(values) < 2:
        return np.zeros_like(values)
    own = _reflected(values)
    turned = -1j * own.turns * np.exp(-1j * samples * own.turns)
    return np.fft.irfft(own.spectrum * turned, own.period)[: len(values)] - own.slope


class _Reflected(NamedTuple):
    """Channel minus the line between its ends, continued periodically by odd reflection."""

    spectrum: NDArray[np.complex128]  # (period / 2 + 1,)
    turns: FloatArray  # (period / 2 + 1,): rad per sample
    period: int
    first: float  # value of the line at its beginning
    slope: float  # of the line, per sample


def _reflected(values: FloatArray) -> _Reflected:
    more = _fast_length(len(values) - 1) - (len(values) - 1)
    whole = np.concatenate((values, 2.0 * values[-1] - values[-2 : -2 - more : -1]))
    half = len(whole) - 1
    slope = float(whole[-1] - whole[0]) / half
    left = whole - (whole[0] + slope * np.arange(half + 1))
    spectrum = np.fft.rfft(np.concatenate((left, -left[-2:0:-1])))
    turns = np.pi * np.arange(half + 1) / half
    return _Reflected(spectrum, turns, 2 * half, float(whole[0]), slope)


def _fast_length(length: int) -> int:
    """Next length with a fast Fourier transform."""
    power = max(0, length.bit_length() - 4)
    return min(s << p for s in _SIZES for p in (power, power + 1) if s << p >= length)


def invalid_ends(samples: float) -> tuple[int, int]:
    """Return how many entries of `later` are invalid at the beginning and at the end."""
    edge = 0 if samples == round(samples) else _EDGE
    return max(ceil(samples), 0) + edge, max(ceil(-samples), 0) + edge


_OFFSETS: FloatArray = np.arange(-2.0, 4.0)  # samples that a spline uses around an interval
_NODES = (0.5 * (1.0 - 0.6**0.5), 0.5, 0.5 * (1.0 + 0.6**0.5))  # Gauss-Legendre, degree five
_WEIGHTS = (5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0)
_INSIDE = 1e-9  # smallest distance, in intervals, from an interval's ends: held inputs jump there


# Within an interval the motion depends on the input's mean and first moment; the rest has an effect
# below (ωh)². So each interval gets the line with both values, which is smooth in the delay.
def held_input(
    inputs: FloatArray,  # (n, n_inputs)
    sample_time: float,  # in s
    hold: Hold,
    delay: float,
) -> FloatArray:
    """Return a line per interval, (n, n_inputs, 4): value, change, derivatives by the delay."""
    # A diverging fit may ask for any delay; beyond the samples the input is constant.
    reach = sample_time * (len(inputs) + len(_OFFSETS))
    delay = float(np.fmax(np.fmin(delay, reach), -reach))
    whole = int(np.floor(delay / sample_time))
    fraction = min(max(delay / sample_time - whole, _INSIDE), 1.0 - _INSIDE)
    # The samples around an interval are in order of time; the earliest has the largest offset.
    earliest = int(_OFFSETS[-1]) + whole
    room = abs(earliest) + len(_OFFSETS)
    ahead, behind = inputs[:1].repeat(room, axis=0), inputs[-1:].repeat(room, axis=0)
    padded = np.concatenate((ahead, inputs, behind))
    if hold == "cubic":
        from scipy.ndimage import spline_filter1d  # late: it takes a third of a second to import

        # Coefficients of the cubic B-spline through the samples, with mirrored ends.
        padded = spline_filter1d(padded, axis=0, mode="mirror")
    taps = _taps(hold, fraction, sample_time)
    firsts = range(room - earliest, room - earliest + len(taps))
    around = np.concatenate([padded[i : i + len(inputs), :, None] for i in firsts], axis=2)
    return (around.reshape(-1, len(taps)) @ taps).reshape(*inputs.shape, 4)


@lru_cache(maxsize=64)  # successive passes over a log mostly use the same delay
def _taps(hold: Hold, fraction: float, sample_time: float) -> FloatArray:
    """Contribution of each sample around an interval to the line, (6, 4), earliest first."""
    mean, moment = _moments(hold, fraction)
    before, after = _kernel(hold, _OFFSETS - fraction), _kernel(hold, 1.0 + _OFFSETS - fraction)
    mean_slope = (before - after) / sample_time
    moment_slope = (mean - after) / sample_time
    return np.column_stack((*_line(mean, moment), *_line(mean_slope, moment_slope)))[::-1]


def _line(mean: FloatArray, moment: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Start and change of the line over [0, 1] with a given mean and first moment."""
    return 4.0 * mean - 6.0 * moment, 12.0 * moment - 6.0 * mean


def _moments(hold: Hold, fraction: float) -> tuple[FloatArray, FloatArray]:
    """Contribution of each sample to the mean and the first moment over an interval."""
    mean, moment = np.zeros(len(_OFFSETS)), np.zeros(len(_OFFSETS))
    for start, stop in ((0.0, fraction), (fraction, 1.0)):
        for node, weight in zip(_NODES, _WEIGHTS, strict=True):
            place = start + node * (stop - start)
            share = weight * (stop - start) * _kernel(hold, place + _OFFSETS - fraction)
            mean += share
            moment += place * share
    return mean, moment


def _kernel(hold: Hold, at: FloatArray) -> FloatArray:
    """Contribution of a sample, or of a spline's coefficient, at a distance in samples."""
    if hold == "zero":
        return ((at >= 0.0) & (at < 1.0)).astype(np.float64)
    far = np.abs(at)
    if hold == "linear":
        return np.maximum(1.0 - far, 0.0)
    near = (0.5 * far - 1.0) * far**2 + 2.0 / 3.0
    outer = (2.0 - far) ** 3 / 6.0
    return np.where(far <= 1.0, near, np.where(far < 2.0, outer, 0.0))


INPUT = "input_delay"
"""Name of the inputs' delay. The delay of a row's position has the row's name and ``_delay``."""

DELAY = "_delay"  # suffix of the name of a row's delay

_ABSOLUTE, _FIRST_INPUT = -1, -2  # codes of an output's reference: none, the first input


@dataclass(frozen=True)
class Timing:
    """Hold of the inputs and delays of the channels."""

    hold: Hold  # behaviour of the inputs between samples
    # in s, by name: `INPUT`, by which inputs act later than recorded, and ``link_delay``, by which
    # the position of the row ``link`` is recorded too late; missing delays are 0
    delays: Mapping[str, float] = field(default_factory=dict)
    sought: tuple[str, ...] = ()  # unknown delays; `delays` has their starting values
    # reference of a row whose position was measured as a difference (a deflection): another row, or
    # an input that is a position and is followed by its velocity as the next input. Only the
    # difference is late
    relative_to: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class ChannelTiming:
    """Inputs and outputs of segments, with the hold and the delays applied."""

    segments: Segments  # measured samples
    system: ParametricSystem  # model with the rows and inputs of the channels
    timing: Timing  # hold and delays

    @cached_property
    def output_delays(self) -> tuple[str, ...]:
        """Name of each output's delay."""
        return tuple(f"{row.name}{DELAY}" for row in self.system.rows)

    def drives(self, delay: float) -> FloatArray:
        """Return the inputs between samples, shape (n_samples, n_inputs, 4); see `held_input`."""
        segments = self.segments
        drives = np.empty((*segments.inputs.shape, 4))
        for part, sample_time in segments.by_recording():
            drives[part] = held_input(segments.inputs[part], sample_time, self.timing.hold, delay)
        return drives

    def on_time(self, delays: Mapping[str, float]) -> FloatArray:
        """Return the outputs without their delays; white noise stays white."""
        outputs = self.segments.outputs.copy()
        for a, name in enumerate(self.output_delays):
            if delays[name] == 0.0:
                continue
            still = self._reference_of(a)
            for part, sample_time in self.segments.by_recording():
                column = later(outputs[part, a] - still[part], -delays[name] / sample_time)
                outputs[part, a] = column + still[part]
        return outputs

    def rates_on_time(self, delays: Mapping[str, float]) -> FloatArray:
        """Return derivatives of `on_time` by each output's own delay; 0 if the delay is known."""
        rates = np.zeros_like(self.segments.outputs)
        for a, name in enumerate(self.output_delays):
            if name not in self.timing.sought:
                continue
            moving = self.segments.outputs[:, a] - self._reference_of(a)
            for part, sample_time in self.segments.by_recording():
                rate = rate_of_later(moving[part], -delays[name] / sample_time)
                rates[part, a] = -rate / sample_time
        return rates

    def _reference_of(self, output: int) -> FloatArray:
        """Signal that an output was measured relative to, shape (n_samples,); 0 without one."""
        place = int(self.reference[output])
        if place == _ABSOLUTE:
            return np.zeros(len(self.segments.outputs))
        if place < _ABSOLUTE:
            return self.segments.inputs[:, _FIRST_INPUT - place]
        return self.segments.outputs[:, place // 2]  # outputs are positions in the rows' order

    @cached_property
    def reference(self) -> NDArray[np.int64]:
        """Code of each output's reference for the kernel: index of a state or input, or none."""
        system = self.system
        rows = [row.name for row in system.rows]
        places = {name: 2 * place for place, name in enumerate(rows)}
        places |= {name: _FIRST_INPUT - place for place, name in enumerate(system.inputs)}
        relative_to = self.timing.relative_to
        found = [places[relative_to[row]] if row in relative_to else _ABSOLUTE for row in rows]
        return np.array(found, dtype=np.int64)
