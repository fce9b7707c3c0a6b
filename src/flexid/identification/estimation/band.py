"""Fits with disturbances in the joint's band: a log low-passed and thinned out.

Above a joint's resonance a log contains sensor errors, further bending modes and encoder steps. A
likelihood of every sample would fit these instead of the joint. So a log that the model does not
explain is low-passed without phase shift, in all channels alike. It is then thinned to about 16
samples per period of the resonance, and a structure is fitted with disturbances
(`flexid.estimators.innovations`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Generic

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from flexid.arrays import FloatArray
from flexid.errors import ConvergenceError
from flexid.estimators.innovations import STEPS, first_cost, fit_innovations, predicting
from flexid.estimators.prediction_error import NEGLIGIBLE, Minimum, minimise
from flexid.estimators.samples import FEWEST_SAMPLES, Samples, Segments, divide, first_states
from flexid.estimators.segmented_motion import RESTING, Point, SegmentedMotion
from flexid.estimators.steady_gains import Sizes
from flexid.identification.full_model.fitting import USUAL, Steps, motion_at, within_bounds
from flexid.identification.full_model.model import Data, Fitted, M, Structure, sensor_noise
from flexid.identification.structure.shapes import reflected
from flexid.identification.structure.validation import Follower, from_fitted_states
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
SPRING_SHARE = 0.25  # least rate of a disturbance over the resonance
_FEWEST = 200  # least number of samples after thinning
_SAME_TIME = 1e-3  # of a sample, for equal times
# Coarser integration steps than usual. The phase error of 3e-5 is below any uncertainty of a
# stiffness. With 16 samples per period, no oscillation needs more than nine substeps.
_INTEGRATION = Steps(coarser=0.4, most_substeps=9)


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


def slowest_disturbance(data: Data, *, rigid: bool) -> float:
    """Return the least rate of a disturbance in 1/s; a slower one would act like friction."""
    sample_time = max(samples.sample_time for samples in data.samples)
    resonance = 2.0 * np.pi / (PER_PERIOD * sample_time)
    return resonance if rigid else SPRING_SHARE * resonance


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
        each = np.column_stack([_direction(*velocity) for velocity in moved])
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


def _direction(rate: FloatArray, deviation: float) -> FloatArray:
    """Return the expected sign of a velocity."""
    return erf(rate / np.sqrt(2.0) / max(deviation, np.finfo(float).tiny))


def _is_slow(rate: FloatArray, deviation: float) -> NDArray[np.bool_]:
    """Return where a row is nearly at rest, so that its friction follows no simple law.

    This is nowhere if noise hides whether the row is slow.
    """
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


@dataclass(frozen=True, eq=False)
class FitInBand(Generic[M]):
    """Fit with disturbances in the band."""

    fitted: Fitted[M]  # with innovations as residuals
    sizes: Sizes  # sizes of noise and disturbances
    cost: float  # -2 log likelihood, up to a constant


@dataclass(frozen=True, eq=False)
class InBand(Generic[M]):
    """Structure and low-passed log to be fitted with disturbances."""

    structure: Structure[M]
    data: Data  # low-passed and thinned out
    directions: FloatArray  # (n_samples, n_rows): of motion; empty for set-valued friction
    slowest: float  # least rate of a disturbance, in 1/s
    noise: FloatArray  # (n_rows,): first value of each sensor's standard deviation
    segment: float  # length of the segments in s, longer than an observer's memory
    integration: Steps = USUAL  # integration steps
    steps: tuple[int, int] = STEPS  # Gauss-Newton steps before each search of sizes, and at the end

    def fit(
        self,
        start: Mapping[str, float],
        sizes: Sizes | None = None,
        near: Fitted[M] | None = None,
    ) -> FitInBand[M]:
        """Fit values and sizes in turn from a start; `near` is a fit with a similar motion."""
        problem, point = self._problem(start, near)
        found = fit_innovations(problem, point, self.directions, self.slowest, sizes, self.steps)
        if not np.isfinite(found.cost):
            raise ConvergenceError("prediction error", "the disturbed motion diverges")
        fitted = self._fitted(found.problem, found.minimum)
        return FitInBand(fitted, found.sizes, found.cost)

    def misfit(self, start: Mapping[str, float]) -> float:
        """Return the cost of a start before any fit; see `first_cost`."""
        return first_cost(*self._problem(start, None), self.directions, self.slowest)

    def with_gains_of(
        self, near: Fitted[M], start: Mapping[str, float], iterations: int
    ) -> Fitted[M]:
        """Fit the values alone, with the observer of another fit."""
        problem, point = self._problem(start, near)
        observer, weights = near.problem.observer, near.problem.weights
        problem = replace(problem, observer=observer, weights=weights)
        found = minimise(problem, point, NEGLIGIBLE, insist=False, iterations=iterations)
        return self._fitted(problem, found)

    def _problem(
        self, start: Mapping[str, float], near: Fitted[M] | None
    ) -> tuple[SegmentedMotion, Point]:
        segments = divide(self.data.samples, self.segment, margin=self.data.margin)
        states = None if near is None else _states_near(segments, near)
        problem, point = motion_at(self.structure, self.data, segments, start, states)
        return replace(self.integration.taken_by(problem), weights=1.0 / self.noise), point

    def _fitted(self, problem: SegmentedMotion, minimum: Minimum) -> Fitted[M]:
        return Fitted(self.structure, self.data, problem, minimum, self.segment)


def fit_in_band(
    structure: Structure,
    data: Data,
    factor: int,
    start: Mapping[str, float],
    sizes: Sizes | None = None,
    *,
    of_band: bool = True,
) -> FitInBand:
    """Fit a structure to a log in its band, within bounds.

    `of_band` is whether the given sizes belong to this band.
    """
    own = thinned(data, factor, held=structure.timing.hold == "zero")
    noise = noise_in_band(own)
    if sizes is not None and not of_band:  # gains for less noise make the steps diverge
        sizes = replace(sizes, sensors=np.maximum(sizes.sensors, noise))
    in_band = InBand(
        structure,
        own,
        directions(data.samples, factor),
        slowest_disturbance(own, rigid=structure.joint.kind == "rigid"),
        noise,
        own.duration,
        _INTEGRATION,
    )
    last: list[FitInBand] = []

    def fitted_from(begun: Mapping[str, float]) -> Fitted:
        def fit(bounded: Structure) -> Fitted:
            held = bounded if factor == 1 else bounded.with_hold("cubic")
            last.append(replace(in_band, structure=held).fit(begun, sizes))
            return last[-1].fitted

        return within_bounds(structure, data, fit)

    fitted = fitted_from(start)
    if (positive := reflected(fitted.by_name)) != fitted.by_name:
        fitted = fitted_from(positive)
    return replace(
        last[-1], fitted=replace(fitted, structure=structure.beginning_at(fitted.by_name))
    )


def noise_in_band(data: Data) -> FloatArray:
    """Return the noise of each sensor; a deflection sensor's own noise where there is one."""
    return sensor_noise(data, [0] if "motor" in data.relative_to.values() else [])


def _states_near(segments: Segments, near: Fitted[M]) -> FloatArray:
    """Return initial states, shape (n_segments, n_states), from a near fit at equal start times."""
    found = near.problem.with_memories(first_states(segments))
    times, states = near.problem.segments.start_times, near.minimum.point.initial_states
    for s, time in enumerate(segments.start_times):
        place = int(np.argmin(np.abs(times - time)))
        if abs(time - times[place]) <= _SAME_TIME * segments.sample_times[s]:
            found[s] = states[place]
    return found


def observer_following(directions: FloatArray, sizes: Sizes, factor: int) -> Follower:
    """Return a follower that starts predictions from an observer's states.

    It applies to a log as recorded; `sizes` are those of the log thinned by `factor`. If the
    observer diverges, predictions begin from fitted states.
    """
    sizes = replace(sizes, sensors=sizes.sensors * np.sqrt(factor))

    def follow(
        model: SegmentedMotion, values: FloatArray, windows: Segments, warm: NDArray[np.int64]
    ) -> tuple[SegmentedMotion, FloatArray]:
        problem = replace(model, segments=windows)
        point = Point(values, problem.start_states)
        try:
            return predicting(problem, point, directions, sizes, warm), point.initial_states
        except ConvergenceError:
            return from_fitted_states(model, values, windows, warm)

    return follow
