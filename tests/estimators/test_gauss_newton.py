"""When Gauss-Newton's steps end, on sums of squares that are made up."""

from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from flexid.errors import ConvergenceError
from flexid.estimators.gauss_newton import FLAT, ITERATIONS, minimise
from flexid.estimators.segmented_motion import Point


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

    def equations(self, point: Point) -> Any:
        steps = point.values[0]
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


def test_a_rough_bottom_ends_the_steps():
    """Assert that two steps in turn that hold less than a quarter are the last, if all is flat."""
    assert steps_of(_Rough(0.5 * FLAT, 0.24)) == 2


def test_steps_that_hold_enough_go_on():
    """Assert that a quarter of what was promised is worth a further step."""
    assert steps_of(_Rough(0.5 * FLAT, 0.3)) == ITERATIONS


def test_a_slope_is_no_bottom():
    """Assert that where more is promised than chance gives, poor steps go on, and do not end."""
    with pytest.raises(ConvergenceError, match=f"within {ITERATIONS}"):
        steps_of(_Rough(2.0 * FLAT, 0.24))


@pytest.mark.parametrize(("tolerance", "steps"), [(1e-2, ITERATIONS), (1.0, 2)])
def test_fine_steps_end_nearer_to_the_bottom(tolerance, steps):
    """Assert that three standard deviations are near enough on the way, and not at the end."""
    problem = _Rough(0.5 * FLAT, 0.24)
    problem.degrees_of_freedom = round(9.0 / (0.5 * FLAT))
    assert steps_of(problem, tolerance) == steps


def test_what_nothing_gets_over_is_given_up():
    """Assert that four steps in turn that hold less than a hundredth are the last."""
    problem = _Rough(0.5, 1e-4)
    with pytest.raises(ConvergenceError, match="4 steps in turn brought next to nothing"):
        steps_of(problem)
    assert len(problem.counted) == 5
    assert steps_of(_Rough(0.5, 1e-4), insist=False) == 4
    assert steps_of(_Rough(0.5, 0.02), insist=False) == ITERATIONS


def test_a_flat_bottom_that_nothing_gets_over_is_the_end():
    """Assert that steps that bring nothing are no failure where they promise next to nothing.

    Each step promises to be three standard deviations long: a rough bottom, but a bottom.
    """
    problem = _Rough(0.5 * FLAT, 1e-4)
    problem.degrees_of_freedom = round(9.0 / (0.5 * FLAT))
    assert steps_of(problem, 1e-2) == 4
    problem.variance = 1.6  # a plateau: there is more than noise to explain
    with pytest.raises(ConvergenceError, match="4 steps in turn"):
        steps_of(problem, 1e-2)


@pytest.mark.parametrize("kept", [1e-4, 0.24])
def test_what_is_good_enough_need_not_end(kept):
    """Assert that stuck steps and too many of them are no failure within the variance asked for.

    All of these problems begin with a variance of one, and the second falls by a ninth each step.
    """
    with pytest.raises(ConvergenceError):
        steps_of(_Rough(0.5, kept), enough=0.0)
    assert steps_of(_Rough(0.5, kept), enough=1.1) == (4 if kept < 0.01 else ITERATIONS)
    with pytest.raises(ConvergenceError):
        steps_of(_Rough(0.5, kept), enough=0.9 * (1.0 - 0.5 * kept) ** ITERATIONS)


def test_steps_are_counted():
    """Assert that no more are taken than are allowed."""
    problem = _Rough(0.5, 0.9)
    with pytest.raises(ConvergenceError, match="within 3"):
        steps_of(problem, iterations=3)
    assert len(problem.counted) == 1 + 3


def test_a_fit_on_its_way_is_not_stopped():
    """Assert that steps that halve the sum of squares may be as many as it takes."""
    problem = _Rough(0.6, 0.9, degrees_of_freedom=10**9)
    assert steps_of(problem, tolerance=1e-3, iterations=3) > 10
