"""Velocities from positions, by zero-phase smoothing with a window chosen from the data."""

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache, wraps
from math import comb, sqrt
from typing import TypeVar

import numpy as np

from flexid.arrays import FloatArray
from flexid.recording.recording import Draft, Rank, Recording

DEGREE = 5  # of the local polynomials
ORDER = 8  # of the differences that separate noise from motion
BLOCK = 64  # samples per local estimate of the noise
# Degrees of freedom of such an estimate. Differences of white noise are correlated; the sum of
# their squared autocorrelation is C(4n, 2n) / C(2n, n)² at the order n.
_FREEDOM = BLOCK * comb(2 * ORDER, ORDER) ** 2 / comb(4 * ORDER, 2 * ORDER)
# Median over mean of such estimates: Wilson and Hilferty, PNAS 17 (1931), on chi-squared.
_MEDIAN = (1.0 - 2.0 / (9.0 * _FREEDOM)) ** 3
WINDOW_RATIO = 1.25  # between one candidate half-window and the next
FEWEST_BLOCKS = 10  # blocks whose means distinguish motion from noise
LAGS = 10  # samples: lags at which a sampled resonance is correlated
_CACHED = 64  # channels whose results are cached
CHANCE = 6.0  # standard deviations: threshold of the tests for white noise
_AT_REST = 8.0  # standard deviations of a position's noise: two of 1e5 samples differ by 6
_FAINT = 0.05  # threshold of rest over a position's range, above which a slow start resembles rest
_HELD = 0.05  # least share of a log in which a brake holds the motor: friction may, for a moment
_RELEASED = 0.8  # largest input during a brake's hold over that when the motor begins to move
_DRIVEN = 0.5  # variation of an input while a brake holds the motor, over that in motion
_REST_KEPT = 0.1  # rest kept at either end, over the motion: longer rest only adds noise


R = TypeVar("R")


def once_per_channel(function: Callable[[FloatArray], R]) -> Callable[[FloatArray], R]:
    """Cache a function of a channel, since several steps of an identification need its results."""
    kept: dict[bytes, R] = {}

    @wraps(function)
    def wrapper(values: FloatArray) -> R:
        key = hashlib.sha256(values.tobytes()).digest()
        found = kept.get(key)  # a single access: another thread may clear the cache
        if found is None:
            found = function(values)
            if len(kept) >= _CACHED:
                kept.clear()
            kept[key] = found
        return found

    return wrapper


@once_per_channel
def position_noise(position: FloatArray) -> float:
    """Standard deviation of the measurement noise of a position, in its unit.

    The noise is assumed white, and estimated from differences of order eight. The median over
    blocks is robust to jumps. The resolution of an encoder counts as uniform noise, LSB / sqrt(12).
    Noise that a filter in the drive has smoothed is underestimated.
    """
    if len(position) <= ORDER:
        return 0.0
    squares = np.diff(position, ORDER) ** 2 / comb(2 * ORDER, ORDER)
    edges = np.linspace(0, len(squares), max(1, len(squares) // BLOCK) + 1).astype(np.int64)
    means = np.add.reduceat(squares, edges[:-1]) / np.diff(edges)
    return max(sqrt(float(np.median(means)) / _MEDIAN), encoder_step(position) / sqrt(12.0))


def while_moving(positions: Sequence[FloatArray]) -> slice:
    """Return the samples in which positions, each of shape (n,), move, with a little rest.

    Long rest before and after the motion adds only noise. If the motion is small compared with
    its noise, its beginning is uncertain, and all samples are returned.
    """
    count = len(positions[0])
    first, last = count, 0
    for position in positions:
        within = _AT_REST * position_noise(position)
        if 2.0 * within < np.ptp(position) < within / _FAINT:
            return slice(0, count)
        left = np.flatnonzero(np.abs(position - position[0]) > within)
        arrived = np.flatnonzero(np.abs(position - position[-1]) > within)
        if len(left) and len(arrived):
            first, last = min(first, int(left[0])), max(last, int(arrived[-1]) + 1)
    if first >= last:
        return slice(0, count)
    kept = int(_REST_KEPT * (last - first))
    return slice(max(first - kept, 0), min(last + kept, count))


def while_free(motor: FloatArray, acts: FloatArray) -> slice:
    """Return the samples of a motor without those at either end in which a brake holds it.

    The input acts there as in motion, but the motor rests. In a rest without a command the input is
    noise. The half of a rest next to the motion does not count, since a step of the input is part
    of it. Friction alone would have let the motor go at an input that later moves it.
    """
    count, within = len(motor), _AT_REST * position_noise(motor)
    if np.ptp(motor) * _FAINT < within:
        return slice(0, count)
    first = int(np.argmax(np.abs(motor - motor[0]) > within))
    last = count - int(np.argmax(np.abs(motor - motor[-1])[::-1] > within))
    if first >= last:
        return slice(0, count)
    least = _DRIVEN * float(np.std(acts[first:last]))
    before, after = acts[: first // 2], acts[(last + count) // 2 :]  # the outer halves
    is_held = [
        rest > _HELD * count and float(np.std(outer)) > least and not is_noise(outer)
        for rest, outer in ((first, before), (count - last, after))
    ]
    has_acted = np.abs(before).max(initial=0.0) >= _RELEASED * abs(acts[first])
    return slice(first if is_held[0] and has_acted else 0, last if is_held[1] else count)


def is_noise(values: FloatArray) -> bool:
    """Whether a signal is white noise about a constant.

    Its autocorrelation and the scatter of its means over blocks must not exceed chance. The
    autocorrelation reveals a resonance that is sampled only a few times per period.
    """
    count = len(values)
    if count < 4 * FEWEST_BLOCKS or np.var(np.diff(values)) < np.var(values):
        return False  # neighbouring samples are correlated, or there are too few
    about = values - values.mean()
    alike = np.array([about[lag:] @ about[:-lag] for lag in range(1, LAGS + 1)])
    # Box and Pierce, Journal of the American Statistical Association 65 (1970): chi-squared.
    by_chance = LAGS + CHANCE * sqrt(2.0 * LAGS)
    if count * float(alike @ alike) > by_chance * float(about @ about) ** 2:
        return False
    for length in (4, 16, 64):
        count = len(values) // length
        if count < FEWEST_BLOCKS:
            break
        means = values[: count * length].reshape(count, length).mean(axis=1)
        expected = float(np.var(values)) / length
        if np.var(means) > (1.0 + CHANCE * sqrt(2.0 / count)) * expected:
            return False
    return True


def encoder_step(position: FloatArray) -> float:
    """Return the resolution of the encoder, or zero if the position is not quantised."""
    changes = np.abs(np.diff(position))
    changes = changes[changes > 1e-9 * float(np.ptp(position))]
    if len(changes) == 0:
        return 0.0
    step = float(changes.min())
    multiples = changes / step
    # The tolerance allows for rounding of printed values.
    whole = np.rint(multiples)
    if np.abs(multiples - whole).max() >= 0.05:
        return 0.0
    return step if len(np.unique(whole)) < 0.5 * len(changes) else 0.0


def with_velocities(recording: Recording) -> Recording:
    """Return the recording with velocities: missing ones are derived from the positions."""
    dt = recording.sample_time
    link, motor = recording.link_velocity, recording.motor_velocity
    position = recording.link_position
    if link is None and position is not None:
        link = velocity(position, dt)
    if motor is None:
        motor = velocity(recording.motor_position, dt)
    return replace(recording, link_velocity=link, motor_velocity=motor)


def velocity(
    position: FloatArray, sample_time: float, half_window: int | None = None
) -> FloatArray:
    """Return the derivative of a noisy position, per s, shape (n,), without phase shift.

    Polynomials are fitted to a window centred on each sample (Savitzky and Golay, Analytical
    Chemistry 36, 1964). The window has the least expected squared error. Its variance follows from
    the noise of the position, its squared bias from the difference to a window of half the width,
    less noise. The next narrower window is used, since wider ones quickly increase the error.
    """
    half = best_half_window(position) if half_window is None else half_window
    fit, slopes = _polynomials(half, min(DEGREE, 2 * half))
    derivative = np.empty(len(position))
    inner = np.convolve(position, _at_middle(fit, slopes)[::-1], mode="valid")
    derivative[half : len(position) - half] = inner
    # The first and last samples use the polynomials of the outermost windows.
    derivative[:half] = slopes[:half] @ (fit @ position[: 2 * half + 1])
    derivative[-half:] = slopes[-half:] @ (fit @ position[-2 * half - 1 :])
    return derivative / sample_time


@lru_cache  # all channels of a log try the same windows
def _polynomials(half: int, degree: int) -> tuple[FloatArray, FloatArray]:
    """Matrices that fit Legendre polynomials to 2 half + 1 samples, and give their slopes."""
    # The product of slopes and fit, shape (2 half + 1, 2 half + 1), is the smoothed derivative, of
    # which few rows are needed. SciPy computes the middle row, but its import takes half a second.
    offsets = np.arange(-half, half + 1) / half
    legendre = np.polynomial.legendre  # a well conditioned basis
    fit = np.asarray(np.linalg.pinv(legendre.legvander(offsets, degree)), dtype=np.float64)
    slopes = legendre.legvander(offsets, degree - 1) @ legendre.legder(np.eye(degree + 1)) / half
    return fit, slopes


def _at_middle(fit: FloatArray, slopes: FloatArray) -> FloatArray:
    """Weights of the samples of a window in the slope at its middle."""
    return slopes[len(slopes) // 2] @ fit


@once_per_channel
def best_half_window(position: FloatArray) -> int:
    """Return half the width of the best window of `velocity`, in samples."""
    variance = position_noise(position) ** 2
    narrowest, widest = DEGREE // 2 + 1, max(1, (len(position) - 1) // 4)
    if narrowest >= widest:
        return max(1, min(narrowest, (len(position) - 1) // 2))
    count = int(np.log(widest / narrowest) / np.log(WINDOW_RATIO)) + 1
    halves = np.unique(np.rint(narrowest * WINDOW_RATIO ** np.arange(count)).astype(int))
    best, least = narrowest, np.inf
    for half in halves:
        coefficients = _at_middle(*_polynomials(int(half), DEGREE))
        risk = variance * float(coefficients @ coefficients)
        reference = max(narrowest, half // 2)
        if reference < half:
            change = -coefficients
            narrower = _at_middle(*_polynomials(int(reference), DEGREE))
            change[half - reference : half + reference + 1] += narrower
            off = np.convolve(position, change, mode="valid")
            risk += max(0.0, float(off @ off / len(off) - variance * (change @ change)))
        if risk < least:
            best, least = int(half), risk
        elif risk > 20.0 * least:
            break  # much wider windows lose the motion, and their differences are small
    return max(narrowest, round(best / WINDOW_RATIO))


_ACCURACY = 50.0  # motion within a window over the noise of its ends: 2 %
_FEWEST_MEANS = 40  # windows in a recording
_MOST_OFF = 0.1  # largest relative RMS error of a velocity that is used: noise and filters
_MOST_SCALED = 0.03  # largest error of its scale: a filter causes 1 %
_KNOWN_FACTORS = {  # factor of a velocity in another unit than its position, and the remedy
    "revolute": {
        180.0 / np.pi: "deg/s, so write the unit [deg/s]",
        np.pi / 180.0: "rad/s and the position in degrees, so write the units",
        30.0 / np.pi: "rpm, so write the unit [rpm]",
    },
    "prismatic": {
        1e3: "mm/s, so write the unit [mm/s]",
        1e-3: "m/s and the position in millimetres, so write the units",
    },
}


def integral(values: FloatArray, time: FloatArray) -> FloatArray:
    """Return the trapezoidal integral of a signal, shape (n,), zero at the first sample."""
    steps = 0.5 * (values[1:] + values[:-1]) * np.diff(time)
    return np.concatenate(([0.0], np.cumsum(steps)))


def is_used(log: Draft, name: str, recordings: Sequence[Recording]) -> bool:
    """Whether a measured velocity is the derivative of its position; warn if it is not."""
    means = [found for one in recordings if (found := _window_means(one, name)) is not None]
    if not means:
        return True  # the motion is too small for a comparison
    measured, own = (np.concatenate(parts) for parts in zip(*means, strict=True))
    size = float(np.sqrt(own @ own))
    slope = float(own @ measured) / size**2
    for factor, remedy in _KNOWN_FACTORS[log.joint].items():
        if abs(slope / factor - 1.0) < 0.1 and _share(measured - slope * own, measured) < 0.4:
            times = f"{float(f'{slope:.3g}'):g} times the position's derivative"
            raise log.refusal(name, f"{name} is {times}: it is {remedy}")
    off = _share(measured - own, own)
    if off <= _MOST_OFF and abs(slope - 1.0) <= _MOST_SCALED:
        return True
    log.warn(
        name,
        f"{name} differs from the derivative of its position by {100 * off:.0f} % RMS: it "
        f"is not used, and derived from the position instead; correct the column, or leave it out",
        Rank.SCALE,
    )
    return False


def _window_means(recording: Recording, name: str) -> tuple[FloatArray, FloatArray] | None:
    """Window means of a velocity and of its position's slope, less their averages; or None."""
    # The windows are the shortest that the noise allows.
    velocity = getattr(recording, name)
    position = getattr(recording, name.replace("velocity", "position"))
    least = _ACCURACY * (np.sqrt(2.0) * position_noise(position))
    window, longest = 1, len(position) // _FEWEST_MEANS
    while window <= longest and np.std(position[window:] - position[:-window]) < least:
        window *= 2
    if window > longest:
        return None
    total = integral(velocity, recording.time)
    span = window * recording.sample_time
    step = max(1, window // 2)
    measured, own = (
        ((values[window:] - values[:-window]) / span)[step:-step:step]
        for values in (total, position)
    )
    return measured - measured.mean(), own - own.mean()


def _share(part: FloatArray, whole: FloatArray) -> float:
    """Norm of a part over the norm of the whole."""
    return float(np.sqrt((part @ part) / (whole @ whole)))
