"""Errors of a rig that are as likely as its log lets them be.

Errors of the rig have a size that good rigs keep to. About a fit residuals are linear in all of
them, so that the log tells which are there, and which are smaller than they might be.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import ConvergenceError
from flexid.estimators.segmented_motion import Equations, SegmentedMotion
from flexid.identification.full_model.model import Fitted, M

SHARE = 0.3  # of an error's size, at which it is tried: a larger one bends the motion elsewhere


def otherwise_shown(fitted: Fitted[M], row: int, error: FloatArray) -> SegmentedMotion:
    """The motion of a fit whose sensor of a row errs by `SHARE` of an error, shape (n_samples,)."""
    segments = fitted.problem.segments
    outputs = segments.outputs.copy()
    outputs[:, row] += SHARE * error
    return replace(fitted.problem, segments=replace(segments, outputs=outputs))


def likely_changes(
    fitted: Fitted[M], rigs: Sequence[SegmentedMotion], scatter: float = 1.0
) -> FloatArray:
    """Changes of the values by errors that are as likely as the log lets them be.

    Innovations are taken for `scatter` times as large, squared, as they are. Returns directions,
    shape (k, n_rigs + 1): of what the log leaves open, and what it tells.
    """
    size = np.sqrt(max(fitted.excess, 1.0) * scatter)
    before = _innovations(fitted.problem, fitted.minimum.equations) / size
    followed = [_followed(fitted, rig) for rig in rigs]
    steps = np.array([step for step, _ in followed]) / SHARE
    changes = np.array([after / size - before for _, after in followed]) / SHARE
    covariance = np.linalg.inv(changes @ changes.T + np.eye(len(rigs)))
    told = -covariance @ (changes @ before)
    return steps.T @ np.column_stack((np.linalg.cholesky(covariance), told))


def _followed(fitted: Fitted[M], rig: SegmentedMotion) -> tuple[FloatArray, FloatArray]:
    """The step of the values, shape (k,), that suits another rig, and its innovations, flat."""
    point, before = fitted.minimum.point, fitted.minimum.reduced
    reduced = rig.solve(rig.equations(point))
    step = reduced.values_step - before.values_step
    states = point.initial_states + reduced.states_step - before.states_step
    there = replace(point, values=point.values + step, initial_states=states)
    equations = rig.equations(there, "nothing")
    if not np.isfinite(equations.cost):
        raise ConvergenceError("rig", "the motion of a rig with small errors diverges")
    return step, _innovations(rig, equations)


def _innovations(problem: SegmentedMotion, equations: Equations) -> FloatArray:
    """All innovations in standard deviations, flat."""
    assert problem.observer is not None
    # The observer of a longer log has more segments, all alike.
    parts = zip(problem.segments.of(equations.residuals), problem.observer.whitening, strict=False)
    return np.concatenate([(part @ white.T).ravel() for part, white in parts])
