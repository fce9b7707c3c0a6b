"""Model error that the residuals show, and the covariance that it adds to every interval.

The spread of the scores between blocks does not contain an error that repeats itself in each block.
The part of such an error across the coefficients shows in the residuals. The part along a
coefficient does not show, and is a bias. Let E be the weighted sum of squares beyond noise. If both
parts are equally large, the bias of a coefficient is its standard deviation for noise of unit size,
times the root of E.

Noise of the torque also makes residuals large, but causes no bias. The growth of the residuals
distinguishes it. The variance of a motion under white noise grows with the cube of the time since a
known start. The variance of an error that reverses with the motion grows more slowly, that of a
slow error faster. Independent of the growth, residuals as large as the deflection count as an
error, since noise does not move the joint as much as the torque does.

Noise of a measured input, from an encoder or a current sensor, moves the model but did not move the
drive. Its effect on residuals and values is computed from the model: it runs again with more of
that noise in the input. The change is about the same as from no noise to the recorded noise.
"""

from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from flexid.arrays import FloatArray
from flexid.errors import ConvergenceError
from flexid.estimators.channel_timing import INPUT, after_a_lag, before_a_lag
from flexid.estimators.prediction_error import ROUGH, Steps, minimise
from flexid.identification.full_model.fitting import beyond_noise, expanded, fit_like
from flexid.identification.full_model.model import Fitted
from flexid.identification.preparation.recordings import Amplifier
from flexid.identification.structure.gap import CHANCE, is_dead_zone
from flexid.identification.structure.sought_terms import (
    SOUGHT,
    SOUGHT_COEFFICIENTS,
    with_other_laws,
)
from flexid.identification.vocabulary.evidence import Estimate, ModelError
from flexid.identification.vocabulary.thresholds import THRESHOLDS, Thresholds
from flexid.models.flexible_joint import DISSIPATIVE, HARDENING, PLAY
from flexid.recording.velocities import position_noise

_WHITE = 3.0  # power of time of the variance of a motion under white noise


def model_error(
    fitted: Fitted, lengths_fitted: Sequence[Fitted], thresholds: Thresholds
) -> ModelError:
    """Look for a model error in a fit's residuals; of a link alone, beyond its input's noise."""

    def explained(one_length: Fitted) -> float:
        return input_noise(one_length).excess if _is_driven(one_length) else 0.0

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


def _is_driven(fitted: Fitted) -> bool:
    """Whether a fit is of a link alone, driven by the motor's measured motion."""
    return fitted.structure.joint.kind == "link"


def widened(fitted: Fitted, error: ModelError) -> Estimate:
    """Return the estimate of a fit with the model error in its covariance.

    If noise explains the residuals, the covariance is shrunk towards that of white noise. Otherwise
    it comes from the blocks, but no deviation is below that of the sensors' noise. For a link
    alone, none is below that of the sensors' and the input's noise. Dry friction may make the sum
    of squares rough, so the last step that was not taken is added as an error.
    """
    estimate, reduced = fitted.fit, fitted.minimum.reduced
    if error.excess == 0.0:
        estimate = estimate.drawn_to(reduced.inverse)
    if _is_driven(fitted):
        noise = input_noise(fitted).deviations
        estimate = estimate.at_least(np.hypot(fitted.unit_deviations, noise))
    elif error.excess > 0.0:
        estimate = estimate.at_least(fitted.unit_deviations)
    beyond = error.excess * fitted.problem.degrees_of_freedom if error.share > 0.0 else 0.0
    untaken = np.outer(reduced.values_step, reduced.values_step)
    return estimate.widened(error.share**2 * beyond * reduced.inverse + untaken)


def stand_in_covariance(fitted: Fitted, error: ModelError, thresholds: Thresholds) -> FloatArray:
    """Return the covariance, shape (k, k), from terms that may stand in for another effect.

    If a curved spring, a gap or an eccentric gear leaves a model error, the drive probably has
    another effect, and another stand-in would give other values. The added error is the largest
    change of the values without all or one of these terms. It is zero if a dead zone or terms with
    sought constants explain the log. Terms with several laws have a doubt of their own.
    """
    joint = fitted.structure.joint
    stand_ins = {*joint.shapes, *HARDENING} & {*fitted.names} - {*joint.nonlinear.values()}
    stand_ins -= {name for shape in SOUGHT if len(shape.laws) > 1 for name in shape.coefficients}
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
    """Return the frictions that came out farther below zero than noise explains."""
    deviations = np.maximum(fitted.fit.deviations, fitted.unit_deviations)
    below = fitted.values < -thresholds.friction_sign * deviations
    return DISSIPATIVE & {name for name, low in zip(fitted.names, below, strict=True) if low}


def driving_covariance(fitted: Fitted, driving: Collection[str]) -> FloatArray:
    """Return the covariance, shape (k, k), from frictions that came out negative.

    A negative friction takes the place of an effect that the model lacks. The added error is the
    change of all values when these frictions are zero.
    """
    if not driving:
        return np.zeros((len(fitted.names), len(fitted.names)))
    moved = _moved_without(fitted, driving)
    return np.outer(moved, moved)


def _moved_without(fitted: Fitted, terms: Collection[str]) -> FloatArray:
    """Return the change of values, shape (k,), without some terms; only theirs if the fit fails."""
    bare = fit_like(fitted.structure.without(terms), fitted, ROUGH)
    found = {**fitted.by_name, **dict.fromkeys(terms, 0.0), **(bare.by_name if bare else {})}
    return np.array([found[name] for name in fitted.names]) - fitted.values


def _growth(
    fitted: Fitted,
    lengths_fitted: Sequence[Fitted],
    floor: float,
    explained: Callable[[Fitted], float],
) -> float:
    """Return the power of the segments' length with which the excess grows from `fitted` on."""
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
_FEW = Steps(ROUGH, insist=False, iterations=6)  # to another law
_SPREAD = 3.0  # standard deviations of the effect of one log's noise
SEED = 20031
_DEAD_ZONE = 0.02  # standard deviation over the largest input: amplifiers have up to 4 %
_LINEAR = 0.1  # of the dead zone, for the trial: the effect of a larger one is not linear


@dataclass(frozen=True, eq=False)
class InputNoise:
    """Effect of the noise of a measured input on a fit."""

    # upper limit of the residuals' mean square from this noise, over the sensors' noise
    excess: float
    deviations: FloatArray  # (k,): standard deviation of each value from this noise


# The effect is needed several times. The keys are weak, since a fit refers to all data of its log.
_KNOWN: WeakKeyDictionary[Fitted, InputNoise] = WeakKeyDictionary()


def input_noise(fitted: Fitted) -> InputNoise:
    """Return the effect of the first input's noise on a fit."""
    if fitted not in _KNOWN:
        _KNOWN[fitted] = _input_noise(fitted)
    return _KNOWN[fitted]


def _input_noise(fitted: Fitted) -> InputNoise:
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
    """Return the changes of the least cost and of the values, shape (k,), by noise of the input."""
    return _change(fitted, fitted.problem.segments.inputs[:, 0] + noise, fitted.values)


def _change(fitted: Fitted, signal: FloatArray, values: FloatArray) -> tuple[float, FloatArray]:
    """Return the changes of the least cost and of the values, shape (k,), under another input."""
    # They come from one step from the given values.
    driven, minimum = fitted.problem.driven_by(signal), fitted.minimum
    equations = driven.equations(replace(minimum.point, values=values))
    if not np.isfinite(equations.cost):
        return np.inf, np.zeros(len(values))
    step = driven.solve(equations)
    cost = equations.cost - step.decrement - minimum.equations.cost
    return cost, step.values_step - minimum.reduced.values_step


def lagged(fitted: Fitted) -> FloatArray:
    """Return the error of each value, shape (k,), if the input's delay may be a first-order lag.

    If the input acts before it was logged, the log may have been low-passed. The error is zero if
    the log shows a pure delay, or if there is no delay.
    """
    delay = fitted.by_name.get(INPUT, 0.0)
    if delay == 0.0:
        return np.zeros(len(fitted.names))
    signal = filtered_input(fitted, after_a_lag if delay > 0.0 else before_a_lag, abs(delay))
    own = is_input_delay(fitted)
    more, change = _change(fitted, signal, np.where(own, 0.0, fitted.values))
    chance = CHANCE * max(fitted.excess, 1.0)
    if more > chance:
        return np.zeros(len(own))
    # If the log does not decide, the lag is uniform between zero and the whole delay.
    share = 1.0 if more < -chance else 1.0 / np.sqrt(3.0)
    return share * np.where(own, 0.0, change)


def is_input_delay(fitted: Fitted) -> NDArray[np.bool_]:
    """Return a mask of the value that is the input's delay, shape (k,)."""
    return np.array([name == INPUT for name in fitted.names])


def by_other_laws(fitted: Fitted) -> FloatArray:
    """Return the change of each value, shape (k, m), if a term follows another of its laws.

    If an exact fit contradicts the other law, the change is that by the part of the law that chance
    and the residuals beyond noise may hide. Disturbances may hide any law.
    """
    beyond = max(fitted.excess - THRESHOLDS.sensor_excess, 0.0) * fitted.problem.degrees_of_freedom
    hidden, changes = CHANCE * max(fitted.excess, 1.0) + beyond, []
    for structure in with_other_laws(fitted.ended):
        seen = expanded(structure.with_hold(fitted.problem.timing.hold), fitted)
        with suppress(ConvergenceError):
            other = minimise(seen.problem, seen.minimum.point, _FEW)
            rise = other.equations.cost - fitted.minimum.equations.cost
            is_exact = fitted.problem.observer is None
            share = _hidden_share(rise, hidden) if is_exact else 1.0
            changes.append(share * (other.point.values - fitted.values))
    return np.array(changes).reshape(-1, len(fitted.names)).T


def filtered_input(
    fitted: Fitted, filtered: Callable[[FloatArray, float], FloatArray], lag: float
) -> FloatArray:
    """Return the first input, shape (n_samples,), with each recording filtered by a lag in s."""
    signal = fitted.problem.segments.inputs[:, 0].copy()
    for part, sample_time in fitted.problem.segments.by_recording():
        signal[part] = filtered(signal[part], lag / sample_time)
    return signal


def behind_a_dead_zone(fitted: Fitted) -> FloatArray:
    """Return the change of each value, shape (k,), if a dead zone reduced the input.

    Of a square wave a dead zone only reduces the gain, and hardly any log shows a small one. If the
    log contradicts this one, the change is reduced to that of a dead zone that chance may hide.
    """
    signal = fitted.problem.segments.inputs[:, 0]
    small = Amplifier(dead_zone=_LINEAR * _DEAD_ZONE * float(np.abs(signal).max()))
    more, change = _change(fitted, small.passed(signal), fitted.values)
    whole, rise = change / _LINEAR, more / _LINEAR**2
    return whole * _hidden_share(rise, CHANCE * max(fitted.excess, 1.0))


def _hidden_share(rise: float, hidden: float) -> float:
    """Return the share of a change that may stay hidden, if the whole raises the cost by `rise`."""
    return float(np.sqrt(hidden / rise)) if rise > hidden else 1.0
