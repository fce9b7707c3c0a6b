"""A log low-passed and thinned out to its joint's band.

Above a joint's resonance a log contains sensor errors, further bending modes and encoder steps. A
likelihood of every sample would fit these instead of the joint. So the log is low-passed without
phase shift, in all channels alike, and thinned to about 16 samples per period of the resonance.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from flexid.arrays import FloatArray
from flexid.estimators.samples import FEWEST_SAMPLES, Samples
from flexid.estimators.segmented_motion import RESTING
from flexid.identification.full_model.model import Data
from flexid.models.flexible_joint import SPRING, resonance
from flexid.recording.velocities import position_noise

PER_PERIOD = 16.0
"""Samples per period of the resonance."""

_EDGE = 0.8  # cut-off of the low-pass over the new Nyquist frequency
_REACH = 10  # half-length of the low-pass in new samples
_WINDOW = 2  # thinned samples over which a velocity is measured: an eighth of a period
_LONGEST_WINDOW = 0.03  # s
_SLOW = 0.1  # of a row's usual speed; below it the friction law does not apply
_BY_NOISE = 2.0  # standard deviations of a velocity
_POWER = 0.99  # share of a rigid joint's squared acceleration that lies in its band
_RIGID_PER_PERIOD = 8.0  # samples per period of the highest frequency in that band
_FEWEST = 200  # least number of samples after thinning
_TINY = np.finfo(float).tiny


def thinning(data: Data, start: Mapping[str, float], per_period: float = PER_PERIOD) -> int:
    """Return the thinning factor of a log: one of so many samples is kept."""
    sample_time = max(samples.sample_time for samples in data.samples)
    fastest = resonance(start)
    if start.keys().isdisjoint(SPRING):
        fastest = _fastest(data) * _RIGID_PER_PERIOD / PER_PERIOD
    if fastest <= 0.0:
        return 1
    return factor_of(fastest, sample_time, [*map(len, data.samples)], per_period)


def factor_of(
    fastest: float,  # in rad/s
    sample_time: float,
    recorded: Sequence[int],
    per_period: float = PER_PERIOD,
) -> int:
    """Return the thinning factor for an angular frequency, within what the recordings allow.

    At least `_FEWEST` samples of all recordings together remain, and enough of the shortest one
    for a segment in each half.
    """
    wanted = int(2.0 * np.pi / (fastest * per_period * sample_time))
    return max(1, min(wanted, sum(recorded) // _FEWEST, min(recorded) // (2 * FEWEST_SAMPLES)))


def _fastest(data: Data) -> float:
    """Return the angular frequency in rad/s below which 99 % of the acceleration's power lies."""
    longest = max(data.samples, key=len)
    assert longest.velocities is not None
    rates = longest.velocities[:, -1]
    spectrum = np.abs(np.fft.rfft((rates - rates.mean()) * np.hanning(len(rates)))) ** 2
    frequency = 2.0 * np.pi * np.fft.rfftfreq(len(rates), longest.sample_time)
    power = np.cumsum(spectrum * frequency**2)
    return float(frequency[np.searchsorted(power, _POWER * power[-1])]) if power[-1] > 0.0 else 0.0


def thinned(data: Data, factor: int, *, held: bool) -> Data:
    """Return the log low-passed and thinned by a factor."""
    if factor == 1:
        return data
    found = [thinned_samples(samples, factor, held=held) for samples in data.samples]
    noise = [position_noise(column) for column in max(found, key=len).positions.T]
    return replace(
        data,
        samples=tuple(found),
        noise=np.maximum(noise, data.noise / np.sqrt(factor)),
        refinement=1,
    )


def thinned_samples(samples: Samples, factor: int, *, held: bool) -> Samples:
    """Return a recording low-passed and thinned; a held input is first averaged by pairs."""
    if factor == 1:
        return samples
    inputs, velocities = samples.inputs, samples.velocities
    if held:
        inputs = 0.5 * (inputs + np.vstack((inputs[:1], inputs[:-1])))
    return replace(
        samples,
        positions=_low_passed(samples.positions, factor),
        velocities=None if velocities is None else _low_passed(velocities, factor),
        inputs=_low_passed(inputs, factor),
        sample_time=factor * samples.sample_time,
    )


def directions(
    recordings: Sequence[Samples], factor: int, in_band: int | None = None
) -> FloatArray:
    """Return the mean direction of each row's motion over the interval after each thinned sample.

    The direction of a noisy velocity is its expected sign: the probability that it is positive less
    the probability that it is negative. The velocity is measured over an eighth of the resonance's
    period, since a longer window would blur reversals. `in_band` is the fit's thinning factor if it
    differs from `factor`.

    Returns shape (n_samples, n_rows) for all recordings together, from -1 to 1. It is `RESTING`
    where a row is slow over the whole interval.
    """
    parts = []
    for samples in recordings:
        window = round(min(_LONGEST_WINDOW / samples.sample_time, _WINDOW * (in_band or factor)))
        moved = [_velocity(column, samples.sample_time, window) for column in samples.positions.T]
        expected = [erf(rate / np.sqrt(2.0) / max(noise, _TINY)) for rate, noise in moved]
        each = np.column_stack(expected)
        slow = np.column_stack([_is_slow(*velocity) for velocity in moved])
        smooth = _convolved(each, factor) if factor > 1 else each
        total = np.cumsum(0.5 * (smooth[1:] + smooth[:-1]), axis=0)
        total = np.vstack((np.zeros((1, each.shape[1])), total))[::factor]
        means = np.diff(total, axis=0) / factor
        missing = len(each[::factor]) - len(means)
        means = np.vstack((means, np.repeat(smooth[-1:], missing, axis=0)))
        firsts = np.arange(len(means)) * factor
        fast = np.vstack((np.zeros((1, each.shape[1])), np.cumsum(~slow, axis=0)))
        rests = fast[np.minimum(firsts + factor + 1, len(each))] == fast[firsts]
        parts.append(np.where(rests, RESTING, means))
    return np.ascontiguousarray(np.concatenate(parts))


def _velocity(position: FloatArray, sample_time: float, window: int) -> tuple[FloatArray, float]:
    """Return the velocity at each sample, shape (n,), and its standard deviation from noise."""
    window = min(max(5, window | 1), (len(position) - 1) | 1)
    rate = _slope(position, window // 2) / sample_time
    # Standard error of a line's slope through the window, for white noise of the position.
    return rate, position_noise(position) / sample_time * np.sqrt(12.0 / window**3)


def _is_slow(rate: FloatArray, deviation: float) -> NDArray[np.bool_]:
    """Return where a row is nearly at rest, so that its friction follows no simple law."""
    # This is nowhere if noise hides whether the row is slow.
    slow = _SLOW * np.sqrt(np.mean(rate**2))
    return (np.abs(rate) <= slow) & (_BY_NOISE * deviation <= slow)


def _slope(values: FloatArray, half: int) -> FloatArray:
    """Return the slope per sample by a Savitzky-Golay filter of second order, 2 half + 1 long."""
    from scipy.ndimage import correlate1d  # imported late: it takes 0.2 s, and few logs need it

    places = np.arange(-half, half + 1.0)
    slopes = correlate1d(values, places / (places @ places), mode="nearest")
    for ends, window in (
        (slice(0, half), values[: len(places)]),
        (slice(-half, None), values[-len(places) :]),
    ):
        square, line, _ = np.polyfit(places, window, 2)
        slopes[ends] = 2.0 * square * places[ends] + line
    return slopes


def _low_passed(columns: FloatArray, factor: int) -> FloatArray:
    return np.ascontiguousarray(_convolved(columns, factor)[::factor])


def _convolved(columns: FloatArray, factor: int) -> FloatArray:
    """Return low-passed columns, shape (n, k), extended by point reflection about their ends."""
    half = min(_REACH * factor, len(columns) - 1)
    places = np.arange(-half, half + 1.0)
    kernel = np.sinc(places * _EDGE / factor) * np.hamming(len(places))
    before = 2.0 * columns[:1] - columns[half:0:-1]
    after = 2.0 * columns[-1:] - columns[-2 : -half - 2 : -1]
    whole = np.vstack((before, columns, after))
    size = 1 << (len(whole) + len(kernel) - 2).bit_length()
    spectrum = np.fft.rfft(kernel / kernel.sum(), size)[:, None] * np.fft.rfft(whole, size, axis=0)
    return np.fft.irfft(spectrum, size, axis=0)[len(kernel) - 1 : len(whole)]
