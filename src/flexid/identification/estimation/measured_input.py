"""Noise of an input that was measured: the motor's position where it drives the link.

A torque is commanded; a position that stands in its place was read by an encoder, whose noise moves
the model's link though it never moved the drive's. What that does to the residuals follows from the
model itself: it runs once more under an input with some more of that noise. The residuals then
grow, and hardly otherwise than if the recorded input had been without it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from flexid.arrays import FloatArray
from flexid.identification.estimation.model_error import model_error, widened
from flexid.identification.full_model.model import Fitted, once_per_fit
from flexid.identification.vocabulary.estimate import Estimate
from flexid.identification.vocabulary.evidence import ModelError
from flexid.identification.vocabulary.thresholds import Thresholds
from flexid.recording.velocities import position_noise

_DRAWS = 16
_SPREAD = 3.0  # standard deviations of what the noise of one log may do
_SEED = 20031


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
    problem, minimum = fitted.problem, fitted.minimum
    rng = np.random.default_rng(_SEED)
    costs, steps = [], []
    for _ in range(_DRAWS):
        inputs = problem.segments.inputs.copy()
        inputs[:, 0] += noise * rng.standard_normal(len(inputs))
        disturbed = replace(problem, segments=replace(problem.segments, inputs=inputs))
        equations = disturbed.equations(minimum.point)
        step = disturbed.solve(equations)
        costs.append(equations.cost - step.decrement - minimum.equations.cost)
        steps.append(step.values_step - minimum.reduced.values_step)
    most = float(np.mean(costs) + _SPREAD * np.std(costs))
    return InputNoise(
        max(0.0, most / problem.degrees_of_freedom), np.sqrt(np.mean(np.square(steps), axis=0))
    )


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
