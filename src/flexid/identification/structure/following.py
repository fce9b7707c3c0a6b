"""The state from which a model of given coefficients follows a stretch of data best."""

from dataclasses import replace

import numpy as np

from flexid.arrays import FloatArray
from flexid.estimators.segmented_motion import Point, SegmentedMotion
from flexid.estimators.segments import Segments

_MOST_STEPS = 10
_CONVERGED = 1e-6  # relative fall of the sum of squares that the last step promises


def following_states(model: SegmentedMotion, values: FloatArray, windows: Segments) -> FloatArray:
    """First states for which a model follows its windows best, its coefficients given.

    Parameters
    ----------
    model : SegmentedMotion
        The model; its own segments do not matter.
    values : array, shape (k,)
        Of what it seeks.
    windows : Segments
        Stretches to follow.

    Returns
    -------
    array, shape (n_windows, n_states)
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
        inverse = np.linalg.pinv(normal / (scale[:, :, None] * scale[:, None, :]), rcond=1e-9)
        step = np.einsum("sij,sj->si", inverse, gradient / scale) / scale
        if np.sum(step * gradient) <= _CONVERGED * equations.cost:
            return states + step
        trial = problem.equations(Point(values, states + step), "states")
        if not trial.cost < equations.cost:
            break
        states, equations = states + step, trial
    return states
