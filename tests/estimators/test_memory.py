"""A spring that remembers its path, in the prediction error: against SciPy and differences."""

import numpy as np
import pytest
from made_motion import fall, measured, motion, point_of, problem_of
from scipy.integrate import solve_ivp

from flexid.estimators.segmented_motion import SegmentedMotion
from flexid.models.parametric_system import Memory, ParametricSystem, Row

REMEMBERING = ParametricSystem(
    "remembering oscillator",
    (Row("mass", "q", "v", {"spring": "-q", "friction": "-h", "gain": "u"}),),
    memories=(Memory("h", "q", "grip"),),
)
H, COUNT = 0.005, 800
TIME = H * np.arange(COUNT)
FORCE = 3.0 * np.sin(2.1 * TIME) + 2.0 * np.sin(5.3 * TIME)
VALUES, STATE = [4.0, 0.8, 1.0, 12.0], [0.3, -0.5, 0.2]
AT = point_of(VALUES, *STATE)


@pytest.fixture(scope="module")
def problem() -> SegmentedMotion:
    """The motion with memory, before anything is measured."""
    return problem_of(REMEMBERING, FORCE, H)


def test_motion_is_that_of_scipy(problem):
    """Assert that the motion obeys h' = s (v - |v| h) beside the mass's own equation."""
    spring, friction, gain, grip = VALUES

    def rates(t, x):
        q, v, h = x
        force = np.interp(t, TIME, FORCE)
        return v, -spring * q - friction * h + gain * force, grip * (v - abs(v) * h)

    exact = solve_ivp(rates, (0.0, TIME[-1]), STATE, t_eval=TIME, rtol=1e-9, atol=1e-11, max_step=H)
    # A step in which the path turns sees its ends alone: an error of the order of h² there.
    assert motion(problem, AT)[:, 0] == pytest.approx(exact.y[0], abs=3e-4)


def test_gradient_is_that_of_the_sum_of_squares(problem):
    """Assert that differences of the sum of squares give the right-hand side, grip and all."""
    problem = measured(problem, motion(problem, AT) + 0.01 * np.cos(3.0 * TIME)[:, None])
    gradient = problem.equations(AT).gradient.sum(axis=0)
    for place in range(len(gradient)):
        slope = fall(problem, AT, place, 1e-5)
        assert gradient[place] == pytest.approx(slope, rel=1e-4, abs=1e-4)
