"""What the residuals say about the model, and what that adds to every interval.

The spread of the scores from block to block knows nothing of an error that repeats itself in each
block. Of such an error the part across the coefficients shows in the residuals; the part along a
coefficient does not show at all, and is its bias. If both are alike in size, the bias of a
coefficient is its standard deviation for noise of unit size, times the root of the residuals'
weighted sum of squares beyond noise.

Noise of the torque makes residuals large, too, without any bias. How they grow distinguishes it:
the variance of a motion under white noise grows with the cube of the time since its known start,
that of an error which turns round with the motion more slowly, that of a slow one faster. Whatever
they grow like, noise does not move the joint as the torque does: of residuals as large as the
deflection all may be an error.

What an encoder or a current sensor adds to a measured input moves the model, though it never moved
the drive. What that does to residuals and values follows from the model itself: it runs once more
under an input with some more of that noise. The residuals then grow, and the values move, hardly
otherwise than if the recorded input had been without it.
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from flexid.arrays import FloatArray
from flexid.estimators.channel_timing import INPUT, before_a_lag
from flexid.identification.full_model.fitting import beyond_noise, fit_like
from flexid.identification.full_model.model import ROUGH, Fitted, once_per_fit
from flexid.identification.structure.gap import CHANCE, PLAY, is_dead_zone
from flexid.identification.structure.shapes import SOUGHT_COEFFICIENTS
from flexid.identification.vocabulary.evidence import Estimate, ModelError
from flexid.identification.vocabulary.thresholds import Thresholds
from flexid.models.flexible_joint import DISSIPATIVE, HARDENING
from flexid.recording.velocities import position_noise

_WHITE = 3.0  # power of time with which the variance of a motion under white noise grows


def _nothing(_: Fitted) -> float:
    return 0.0


def model_error(
    fitted: Fitted,
    lengths_fitted: Sequence[Fitted],
    thresholds: Thresholds,
    explained: Callable[[Fitted], float] = _nothing,
) -> ModelError:
    """Look for a model error in the residuals of a fit."""
    floor = thresholds.noise_floor(lengths_fitted[0].excess)
    own = beyond_noise(fitted, floor + explained(fitted), lengths_fitted[0])
    if own <= 0.0:
        return ModelError(0.0, 0.0, 0.0)
    growth = _growth(fitted, lengths_fitted, floor, explained)
    between = (thresholds.white_growth, thresholds.repeated_growth)
    off = abs(growth - _WHITE)
    share = float(np.interp(off, between, (0.0, 1.0))) if np.isfinite(growth) else 1.0
    moved_as_much = float(np.interp(fitted.unexplained, (thresholds.noise_motion, 1.0), (0.0, 1.0)))
    share = max(share, moved_as_much)
    return ModelError(own / fitted.problem.degrees_of_freedom, growth, share)


def widened(
    fitted: Fitted,
    error: ModelError,
    least: FloatArray | float = 0.0,  # (k,)
) -> Estimate:
    """The estimate of a fit with the model's error in its covariance.

    Where residuals are what noise explains, their covariance is drawn towards that of white noise;
    otherwise it is that of the blocks alone, but no less than what the sensors' noise makes it.
    Where friction makes the bottom rough and the steps end without arriving, the one that was not
    taken any more is added; along open directions there is none.
    """
    estimate, reduced = fitted.fit, fitted.minimum.reduced
    if error.excess == 0.0:
        estimate = estimate.drawn_to(reduced.inverse)
    else:
        least = np.maximum(least, fitted.unit_deviations)
    estimate = estimate.at_least(least)
    beyond = error.excess * fitted.problem.degrees_of_freedom if error.share > 0.0 else 0.0
    untaken = np.outer(reduced.values_step, reduced.values_step)
    return estimate.widened(error.share**2 * beyond * reduced.inverse + untaken)


def stand_in_covariance(fitted: Fitted, error: ModelError, thresholds: Thresholds) -> FloatArray:
    """Covariance, shape (k, k), from terms that may stand for something else.

    A curved spring, a gap or an eccentric gear that leaves a model error behind is hardly what the
    drive has, and another stand-in would leave other values: they are as uncertain as they move
    without any, or without one of them. A dead zone, or what has a constant that was sought, that
    explains the log alone is none.
    """
    joint = fitted.structure.joint
    stand_ins = {*joint.shapes, *HARDENING} & {*fitted.names} - {*joint.nonlinear.values()}
    exact = SOUGHT_COEFFICIENTS | (PLAY if is_dead_zone(fitted) else frozenset())
    explains = stand_ins <= exact and fitted.excess <= thresholds.sensor_excess
    if error.share == 0.0 or not stand_ins or explains:
        return np.zeros((len(fitted.names), len(fitted.names)))
    own = np.array([name in stand_ins for name in fitted.names])
    ways = [stand_ins, *({name} for name in sorted(stand_ins) if len(stand_ins) > 1)]
    moves = np.array([np.where(own, 0.0, _moved_without(fitted, way)) for way in ways])
    moved = moves[np.argmax(np.abs(moves), axis=0), np.arange(len(own))]
    return error.share**2 * np.outer(moved, moved)


def driving_frictions(fitted: Fitted, thresholds: Thresholds) -> frozenset[str]:
    """Frictions that came out farther below zero than noise explains."""
    deviations = np.maximum(fitted.fit.deviations, fitted.unit_deviations)
    below = fitted.values < -thresholds.friction_sign * deviations
    return DISSIPATIVE & {name for name, low in zip(fitted.names, below, strict=True) if low}


def driving_covariance(fitted: Fitted, driving: Collection[str]) -> FloatArray:
    """Covariance, shape (k, k), from frictions that came out negative.

    A friction that drives is none: it has the part of something that the model lacks, whatever the
    residuals say. It may be zero as well, and the others what they are then.
    """
    if not driving:
        return np.zeros((len(fitted.names), len(fitted.names)))
    moved = _moved_without(fitted, driving)
    return np.outer(moved, moved)


def _moved_without(fitted: Fitted, terms: Collection[str]) -> FloatArray:
    """By how much values move, shape (k,), where some are zero; these alone if that has no fit."""
    bare = fit_like(fitted.structure.without(terms), fitted, ROUGH)
    found = {**fitted.by_name, **dict.fromkeys(terms, 0.0), **(bare.by_name if bare else {})}
    return np.array([found[name] for name in fitted.names]) - fitted.values


def _growth(
    fitted: Fitted,
    lengths_fitted: Sequence[Fitted],
    floor: float,
    explained: Callable[[Fitted], float],
) -> float:
    """Power of the segments' length with which the excess grows from the reported one on."""
    near = [r for r in lengths_fitted if r.duration >= 0.75 * fitted.duration]
    if len(near) < 2:
        near = list(lengths_fitted[-2:])
    first, last = near[0], near[min(2, len(near) - 1)]
    if first is last:
        return 0.0
    before, after = (
        one_length.excess - floor - explained(one_length) for one_length in (first, last)
    )
    if before <= 0.0 or after <= before:
        return 0.0
    return float(np.log(after / before) / np.log(last.duration / first.duration))


_DRAWS = 16
_SPREAD = 3.0  # standard deviations of what the noise of one log may do
SEED = 20031
_TIME_CONSTANTS = 8.0  # over which a lag forgets


@dataclass(frozen=True, eq=False)
class InputNoise:
    """What the noise of a measured input does to a fit."""

    # mean square of residuals, over that of the sensors' noise, that it makes in hardly any log
    # more of
    excess: float
    deviations: FloatArray  # (k,): standard deviation of each value from it


@once_per_fit
def input_noise(fitted: Fitted) -> InputNoise:
    """What the noise of the first input does to a fit."""
    longest = max(fitted.data.samples, key=len)
    noise = position_noise(longest.inputs[:, 0])
    rng = np.random.default_rng(SEED)
    count = len(fitted.problem.segments.inputs)
    every = [with_more(fitted, noise * rng.standard_normal(count)) for _ in range(_DRAWS)]
    costs, steps = zip(*every, strict=True)
    most = float(np.mean(costs) + _SPREAD * np.std(costs))
    return InputNoise(
        max(0.0, most / fitted.problem.degrees_of_freedom),
        np.sqrt(np.mean(np.square(steps), axis=0)),
    )


def with_more(fitted: Fitted, noise: FloatArray) -> tuple[float, FloatArray]:
    """How the cost of the best values, and these, shape (k,), change with an input's noise."""
    return _under(fitted, fitted.problem.segments.inputs[:, 0] + noise, fitted.values)


def _under(fitted: Fitted, signal: FloatArray, values: FloatArray) -> tuple[float, FloatArray]:
    """How the best cost and a step's values, shape (k,), differ under another first input.

    The step is that from some values.
    """
    problem, minimum = fitted.problem, fitted.minimum
    inputs = problem.segments.inputs.copy()
    inputs[:, 0] = signal
    driven = replace(problem, segments=replace(problem.segments, inputs=inputs))
    equations = driven.equations(replace(minimum.point, values=values))
    if not np.isfinite(equations.cost):
        return np.inf, np.zeros(len(values))
    step = driven.solve(equations)
    cost = equations.cost - step.decrement - minimum.equations.cost
    return cost, step.values_step - minimum.reduced.values_step


def lagged(fitted: Fitted) -> FloatArray:
    """Error of each value, shape (k,), where the input's delay may be a first-order lag.

    An input that acts before it was logged may have been low-passed on its way into the log. There
    is no error where the log says that it is a delay, or has none.
    """
    delay = fitted.by_name.get(INPUT, 0.0)
    if delay == 0.0:
        return np.zeros(len(fitted.names))
    signal = fitted.problem.segments.inputs[:, 0].copy()
    bounds = fitted.problem.segments.recording_starts
    for samples, first, last in zip(fitted.data.samples, bounds[:-1], bounds[1:], strict=True):
        other = _low_passed if delay > 0.0 else before_a_lag
        signal[first:last] = other(signal[first:last], abs(delay) / samples.sample_time)
    own = np.array([name == INPUT for name in fitted.names])
    more, change = _under(fitted, signal, np.where(own, 0.0, fitted.values))
    chance = CHANCE * max(fitted.excess, 1.0)
    if more > chance:
        return np.zeros(len(own))
    # Where the log does not say, anything between none and all of it is a lag.
    share = 1.0 if more < -chance else 1.0 / np.sqrt(3.0)
    return share * np.where(own, 0.0, change)


def _low_passed(signal: FloatArray, time_constant: float) -> FloatArray:
    """A signal behind a first-order lag, of a time constant in samples; it rested before."""
    count = min(len(signal), int(_TIME_CONSTANTS * time_constant) + 2)
    kernel = np.exp(-np.arange(count) / time_constant)
    return signal[0] + np.convolve(signal - signal[0], kernel / kernel.sum())[: len(signal)]


def error_of(
    fitted: Fitted, lengths_fitted: Sequence[Fitted], thresholds: Thresholds
) -> ModelError:
    """What the residuals say about the model; of the link alone, beside the noise of its input."""
    if fitted.structure.joint.kind == "link":
        return model_error(
            fitted, lengths_fitted, thresholds, lambda one_length: input_noise(one_length).excess
        )
    return model_error(fitted, lengths_fitted, thresholds)


def widened_by(fitted: Fitted, error: ModelError) -> Estimate:
    """The estimate with the model's error; of the link alone, with the noise of its input too."""
    if fitted.structure.joint.kind == "link":
        noise = input_noise(fitted).deviations
        return widened(fitted, error, np.hypot(fitted.unit_deviations, noise))
    return widened(fitted, error)
