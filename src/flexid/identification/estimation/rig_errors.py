"""Changes of the values by errors of the rig, weighted by how well they fit the log.

Each error has a prior size, that of good rigs. Near a fit the residuals are linear in all errors.
So the log determines them in part: their posterior mean and covariance follow.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import ConvergenceError
from flexid.estimators.segmented_motion import Equations, SegmentedMotion
from flexid.identification.full_model.model import Fitted, M

SHARE = 0.3
"""Part of an error's size, for the trial: a larger one leaves the linear range."""

SMALL_SHARE = 0.03
"""Part of an error's size for a motion that diverges at `SHARE`, such as one with hysteresis."""


def with_sensor_error(
    fitted: Fitted[M], rows: int | slice, error: FloatArray | float, share: float = SHARE
) -> SegmentedMotion:
    """Return a fit's motion with a share of an error, shape (n_samples,), in a row's sensor.

    A constant error may be one of the sensors of several rows.
    """
    segments = fitted.problem.segments
    outputs = segments.outputs.copy()
    outputs[:, rows] += share * error
    return replace(fitted.problem, segments=replace(segments, outputs=outputs))


def likely_changes(
    fitted: Fitted[M],
    rigs: Sequence[SegmentedMotion],
    scatter: float = 1.0,
    share: float = SHARE,
) -> FloatArray:
    """Return changes of the values by errors of the rig, given the log.

    `rigs` are motions with a share of each error.
    `scatter` multiplies the variance of the innovations. Returns directions, shape (k, n_rigs + 1):
    the uncertainty that the log leaves, and the mean change in the last column.
    """
    if not rigs:
        return np.zeros((len(fitted.names), 0))
    size = np.sqrt(max(fitted.excess, 1.0) * scatter)
    before = _innovations(fitted.problem, fitted.minimum.equations) / size
    followed = [_step_and_innovations(fitted, rig) for rig in rigs]
    steps = np.array([step for step, _ in followed]) / share
    changes = np.array([after / size - before for _, after in followed]) / share
    covariance = np.linalg.inv(changes @ changes.T + np.eye(len(rigs)))
    mean = -covariance @ (changes @ before)
    return steps.T @ np.column_stack((np.linalg.cholesky(covariance), mean))


def _step_and_innovations(fitted: Fitted[M], rig: SegmentedMotion) -> tuple[FloatArray, FloatArray]:
    """Return the step of the values, shape (k,), for another rig, and its innovations, flat."""
    point, before = fitted.minimum.point, fitted.minimum.reduced
    error = rig.segments.outputs - fitted.problem.segments.outputs
    started = point.initial_states.copy()
    started[:, : 2 * error.shape[1] : 2] += error[rig.segments.starts]
    begun = replace(point, initial_states=started)
    reduced = rig.solve(rig.equations(begun))
    step = reduced.values_step - before.values_step
    states = started + reduced.states_step - before.states_step
    there = replace(point, values=point.values + step, initial_states=states)
    equations = rig.equations(there, "nothing")
    if not np.isfinite(equations.cost):
        raise ConvergenceError("rig", "the motion of a rig with small errors diverges")
    return step, _innovations(rig, equations)


def _innovations(problem: SegmentedMotion, equations: Equations) -> FloatArray:
    """Return all innovations in standard deviations, flat."""
    # The observer may have more segments than the log; all have the same whitening.
    parts = zip(problem.segments.of(equations.residuals), problem.whitening, strict=False)
    return np.concatenate([(part @ white.T).ravel() for part, white in parts])
