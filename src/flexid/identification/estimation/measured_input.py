"""Noise of a measured input: of a torque, or of the motor's position where that drives the link.

What an encoder or a current sensor adds to an input moves the model, though it never moved the
drive. What that does to residuals and values follows from the model itself: it runs once more under
an input with some more of that noise. The residuals then grow, and the values move, hardly
otherwise than if the recorded input had been without it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from flexid.arrays import FloatArray
from flexid.estimators.channel_timing import INPUT
from flexid.identification.estimation.model_error import model_error, widened
from flexid.identification.full_model.model import Fitted, once_per_fit
from flexid.identification.structure.gap import CHANCE
from flexid.identification.vocabulary.estimate import Estimate
from flexid.identification.vocabulary.evidence import ModelError
from flexid.identification.vocabulary.thresholds import Thresholds
from flexid.recording.velocities import position_noise

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

    There is none where the log says that it is a delay, or has none.
    """
    delay = fitted.by_name.get(INPUT, 0.0)
    if delay <= 0.0:
        return np.zeros(len(fitted.names))
    signal = fitted.problem.segments.inputs[:, 0].copy()
    bounds = fitted.problem.segments.recording_starts
    for samples, first, last in zip(fitted.data.samples, bounds[:-1], bounds[1:], strict=True):
        signal[first:last] = _low_passed(signal[first:last], delay / samples.sample_time)
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
