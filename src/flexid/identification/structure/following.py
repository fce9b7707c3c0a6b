"""The state from which a model of given coefficients follows a stretch of data best."""

from dataclasses import replace

import numpy as np

from flexid.arrays import FloatArray
from flexid.estimators.segmented_motion import Point, SegmentedMotion
from flexid.estimators.segments import Segments
from flexid.symmetric import pseudo_inverse

_MOST_STEPS = 10
_NULL = 1e-9  # of the largest eigenvalue
_CONVERGED = 1e-6  # relative fall of the sum of squares that the last step promises


def following_states(
    model: SegmentedMotion,
    values: FloatArray,  # (k,)
    windows: Segments,
) -> FloatArray:
    """First states for which a model follows its windows best, its coefficients given.

    Returns shape (n_windows, n_states).
    """
    problem = replace(model, segments=windows)
    states = problem.start_states
    equations = problem.equations(Point(values, states), "states")
    for _ in range(_MOST_STEPS):
        firsts = problem.first_blocks[:-1]
        normal = np.add.reduceat(equations.normal, firsts, axis=0)
        gradient = np.add.reduceat(equations.gradient, firsts, axis=0)
        scale = np.sqrt(np.einsum("sii->si", normal))
        scale = np.where(scale > 0.0, scale, 1.0)
        inverse = pseudo_inverse(normal / (scale[:, :, None] * scale[:, None, :]), _NULL)
        step = np.einsum("sij,sj->si", inverse, gradient / scale) / scale
        if np.sum(step * gradient) <= _CONVERGED * equations.cost:
            return states + step
        trial = problem.equations(Point(values, states + step), "states")
        if not trial.cost < equations.cost:
            break
        states, equations = states + step, trial
    return states
