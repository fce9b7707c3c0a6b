"""What a motion tells about the coefficients: Fisher information of positions in white noise.

The record is cut into segments as segmented prediction error does, each with an unknown initial
state. Of the derivatives of the positions by the coefficients, only the part counts that no change
of those initial states explains; the inverse of what is left is the Cramér-Rao bound, which that
estimator reaches. Short segments also keep the bound honest where a motion is chaotic: over a long
one the derivatives grow without bound, and no estimator could use them.
"""

from dataclasses import dataclass

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import SimulationError
from flexid.estimators.segmented_motion import Point, SegmentedMotion


@dataclass(frozen=True, eq=False)
class Information:
    """What positions tell about k coefficients."""

    names: tuple[str, ...]  # the coefficients, then delays that are sought
    values: FloatArray  # where it was computed
    matrix: FloatArray  # Fisher information, the initial states unknown
    covariance: FloatArray  # its inverse; infinite variance marks what the motion leaves free

    @property
    def standard_deviations(self) -> FloatArray:
        """Least standard deviation of each coefficient, shape (k,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def relative_deviations(self) -> FloatArray:
        """The same over the coefficients' values; infinite for one that is zero."""
        with np.errstate(divide="ignore"):
            return self.standard_deviations / np.abs(self.values)

    @property
    def relative(self) -> FloatArray:
        """Information about the coefficients' logarithms, shape (k, k).

        Its inverse is the covariance of relative errors, so that coefficients of different units
        compare.
        """
        return self.matrix * np.outer(self.values, self.values)


def information_at(problem: SegmentedMotion, point: Point) -> Information:
    """Information of the model's own motion from the states of a point under the inputs."""
    equations = problem.equations(point)
    if not np.isfinite(equations.cost):
        raise SimulationError(
            "the model's motion diverges within a segment: check its coefficients",
            float(problem.segments.start_times[0]),
        )
    reduced = problem.solve(equations)
    covariance = reduced.inverse.copy()
    covariance[reduced.free, :] = covariance[:, reduced.free] = 0.0
    covariance[reduced.free, reduced.free] = np.inf
    return Information(problem.names, point.values, reduced.information, covariance)
