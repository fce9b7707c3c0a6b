"""When Gauss-Newton's steps end, on sums of squares that are made up."""

from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from flexid.errors import ConvergenceError
from flexid.estimators.gauss_newton import FLAT, ITERATIONS, minimise
from flexid.estimators.segmented_motion import By, Point

THREE_DEVIATIONS = round(9.0 / (0.5 * FLAT))  # degrees of freedom with which a flat step is so long


@dataclass
class _Rough:
    """A sum of squares that promises with each step what it does not hold.

    Every step is promised to save a share of the cost, and saves a part of that.
    """

    promised: float
    kept: float
    degrees_of_freedom: int = 10_000
    variance: float = 1.0
    counted: list[float] = field(default_factory=list)

    def equations(self, point: Point, by: By = "everything") -> Any:
        steps = point.values[0]
        if by == "everything":
            self.counted.append(steps)
        cost = self.variance * self.degrees_of_freedom * (1.0 - self.promised * self.kept) ** steps
        return SimpleNamespace(cost=cost)

    def solve(self, equations: Any, _damping: float = 0.0) -> Any:
        step = np.array([1.0])
        decrement = self.promised * equations.cost
        return SimpleNamespace(values_step=step, states_step=np.zeros((1, 2)), decrement=decrement)


def steps_of(problem: _Rough, tolerance: float = 1.0, **options: Any) -> int:
    """Steps that were taken."""
    point = Point(np.zeros(1), np.zeros((1, 2)))
    return minimise(cast("Any", problem), point, tolerance, **options).iterations


@pytest.mark.parametrize(
    ("problem", "options", "steps"),
    [
        # Two steps in turn that hold less than a quarter are the last, if all is flat.
        (_Rough(0.5 * FLAT, 0.24), {}, 2),
        (_Rough(0.5 * FLAT, 0.3), {}, ITERATIONS),
        # Three standard deviations are near enough on the way, and not at the end.
        (_Rough(0.5 * FLAT, 0.24, THREE_DEVIATIONS), {"tolerance": 1e-2}, ITERATIONS),
        (_Rough(0.5 * FLAT, 0.24, THREE_DEVIATIONS), {"tolerance": 1.0}, 2),
        # Four steps in turn that hold less than a hundredth are the last: a rough bottom.
        (_Rough(0.5 * FLAT, 1e-4, THREE_DEVIATIONS), {"tolerance": 1e-2}, 4),
        (_Rough(0.5, 1e-4), {"insist": False}, 4),
        (_Rough(0.5, 0.02), {"insist": False}, ITERATIONS),
        # Within the variance asked for, none of that is a failure.
        (_Rough(0.5, 1e-4), {"enough": 1.1}, 4),
        (_Rough(0.5, 0.24), {"enough": 1.1}, ITERATIONS),
    ],
)
def test_steps_end(problem: _Rough, options: dict[str, Any], steps: int):
    """Assert after how many steps a bottom, or what is good enough, is the end."""
    assert steps_of(problem, **options) == steps


@pytest.mark.parametrize(
    ("problem", "options", "reason"),
    [
        # Where more is promised than chance gives, poor steps are no bottom.
        (_Rough(2.0 * FLAT, 0.24), {}, f"within {ITERATIONS}"),
        (_Rough(0.5, 1e-4), {}, "4 steps in turn brought next to nothing"),
        # A plateau: there is more than noise to explain.
        (_Rough(0.5 * FLAT, 1e-4, THREE_DEVIATIONS, 1.6), {"tolerance": 1e-2}, "4 steps in turn"),
        (_Rough(0.5, 1e-4), {"enough": 0.9 * (1.0 - 0.5e-4) ** ITERATIONS}, "4 steps in turn"),
        (_Rough(0.5, 0.24), {"enough": 0.9 * (1.0 - 0.12) ** ITERATIONS}, "within"),
        (_Rough(0.5, 0.9), {"iterations": 3}, "within 3"),
    ],
)
def test_steps_that_lead_nowhere(problem: _Rough, options: dict[str, Any], reason: str):
    """Assert what is no end, that the error says why, and that no more steps are taken."""
    with pytest.raises(ConvergenceError, match=reason):
        steps_of(problem, **options)
    if reason.startswith("4 steps"):
        assert len(problem.counted) == 1 + 4
    if "iterations" in options:
        assert len(problem.counted) == 1 + 3


def test_a_fit_on_its_way_is_not_stopped():
    """Assert that steps that halve the sum of squares may be as many as it takes."""
    problem = _Rough(0.6, 0.9, degrees_of_freedom=10**9)
    assert steps_of(problem, tolerance=1e-3, iterations=3) > 10
