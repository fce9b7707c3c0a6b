"""Budget of a search: work is counted alike in one thread and in several."""

import numpy as np
import pytest
from noisy_joint import VALUES, joint_samples

from flexid.estimators.budget import BudgetError, renewed, spend, within
from flexid.estimators.channel_timing import Timing
from flexid.estimators.samples import divide, side_by_side
from flexid.estimators.segmented_motion import Point, segmented_motion
from flexid.models.flexible_joint import flexible_joint


def left_over(steps: float, threads: int, *spent: float) -> float:
    """Return how much of 10 is left after a task for each amount, and `steps` before these."""
    with within(10.0):
        spend(steps)
        side_by_side(spend, spent, threads)
        for tenths in range(101):
            try:
                spend(0.1)
            except BudgetError:
                return 0.1 * tenths
    raise AssertionError("no limit")


@pytest.mark.parametrize("threads", [1, 2])
def test_tasks_share_what_is_left(threads: int):
    """Assert that tasks may each spend what was left, and count together once they have ended."""
    assert left_over(2.0, threads, 1.0, 3.5) == pytest.approx(3.5, abs=0.11)
    done = []

    def task(steps: float) -> None:
        spend(steps)
        done.append(steps)

    for spent in ((5.0, 4.0), (9.0, 0.0)):  # together, or alone
        with within(10.0):
            spend(2.0)
            with pytest.raises(BudgetError, match="more than 10 integration"):
                side_by_side(task, spent, threads)
    assert {*done} == {5.0, 4.0}  # each runs to its end though another has spent the rest


def test_a_budget_may_be_given_again():
    """Assert that a renewed budget is not spent of the one around it, nor anything outside one."""
    with within(10.0):
        spend(9.0)
        with renewed():
            spend(9.0)
            with pytest.raises(BudgetError):
                spend(2.0)
        spend(0.9)
        with pytest.raises(BudgetError):
            spend(0.2)
    spend(1e300)
    side_by_side(spend, (1e300, 1e300))


def test_runs_of_a_model_are_counted():
    """Assert the work of a run: samples times integration steps, less without derivatives."""
    segments = divide([joint_samples()], 1.0)
    problem = segmented_motion(flexible_joint(), segments, Timing("linear"))
    point = Point(np.array(VALUES), problem.start_states)
    one = float(problem.substeps * segments.lengths.sum())
    with within(2.35 * one):
        problem.equations(point)
        problem.equations(point)
        problem.equations(point, "nothing")
        with pytest.raises(BudgetError):
            problem.equations(point, "nothing")
