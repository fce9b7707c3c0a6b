"""Whether the steps that a motion is integrated in are short enough for what its data can tell.

The steps of `SegmentedMotion.at` follow from the model's poles alone. Long records of fine encoders
tell more: there the error of the integration moves the values by more than noise does, and no
residual shows it.
"""

from dataclasses import replace
from math import ceil

import numpy as np

from flexid.estimators.gauss_newton import Minimum
from flexid.estimators.segmented_motion import SegmentedMotion

NEGLIGIBLE = 0.1
"""Standard deviations by which the error may move values: a 95 % interval then holds 94.9 %."""

MOST = 4
"""Times as many steps, at most: they leave 1/256 of the error, and take four times as long."""

_ORDER = 4  # of Runge and Kutta's method


def integration_error(problem: SegmentedMotion, found: Minimum) -> float:
    """How far the integration moves the combination of values that it moves most, in deviations.

    Steps of half the length show it: they leave a sixteenth of the error.
    """
    halved = replace(problem, substeps=2 * problem.substeps)
    equations = halved.equations(found.point)
    variance = found.variance(problem)
    if not np.isfinite(equations.cost) or variance <= 0.0:
        return 0.0
    moved = halved.solve(equations).values_step - found.reduced.values_step
    square = float(moved @ found.reduced.information @ moved) / variance
    if not np.isfinite(square):
        return 0.0
    return float(np.sqrt(max(square, 0.0))) / (1.0 - 0.5**_ORDER)


def refinement(problem: SegmentedMotion, found: Minimum) -> int:
    """How many times as many steps, up to `MOST`, make that error negligible."""
    wanted = (integration_error(problem, found) / NEGLIGIBLE) ** (1.0 / _ORDER)
    return min(max(1, ceil(wanted)), MOST)
