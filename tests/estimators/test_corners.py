"""Steps that end where the slope of the rates jumps: against SciPy, and for their order."""

import numpy as np
import pytest
from made_motion import fall, measured, motion, point_of, problem_of
from scipy.integrate import solve_ivp

from flexid.models.parametric_system import ParametricSystem, Row

HALF_GAP = 0.1
PLAY = ParametricSystem(
    "oscillator with play",
    (
        Row(
            "mass",
            "q",
            "v",
            {"spring": "-q", "play": "abs(q/(2*w) + 0.5) - abs(q/(2*w) - 0.5)", "gain": "u"},
        ),
    ),
    constants={"w": HALF_GAP},
)
H, COUNT = 0.02, 300
TIME = H * np.arange(COUNT)
FORCE = 3.0 * np.sin(2.1 * TIME) + 4.0 * np.sin(5.3 * TIME)
VALUES, STATE = [40.0, 40.0 * HALF_GAP, 1.0], [0.3, -0.5]
AT = point_of(VALUES, *STATE)


@pytest.fixture(scope="module")
def exact() -> np.ndarray:
    """The motion by SciPy, in steps that end at the samples, where the force has corners too."""

    def rates(t, x):
        beyond = x[0] - np.clip(x[0], -HALF_GAP, HALF_GAP)
        return x[1], -VALUES[0] * beyond + np.interp(t, TIME, FORCE)

    found = solve_ivp(
        rates, (0.0, TIME[-1]), STATE, t_eval=TIME, rtol=1e-10, atol=1e-12, max_step=H / 20.0
    )
    return found.y[0]


def test_order_of_the_steps(exact):
    """Assert that the error falls with the fourth power of the step, corners or not."""
    beyond = np.abs(exact) > HALF_GAP  # it goes to and fro, mostly within two samples
    assert np.count_nonzero(np.diff(np.sign(exact[beyond]))) > 5
    errors = [
        np.abs(motion(problem_of(PLAY, FORCE, H, substeps=n), AT)[:, 0] - exact).max()
        for n in (1, 2, 4)
    ]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert errors[0] < 2e-4
    assert orders == pytest.approx(4.0, abs=0.5)


def test_gradient_is_that_of_the_sum_of_squares():
    """Assert that the derivatives go through corners unchanged, as differences say."""
    problem = problem_of(PLAY, FORCE, H, substeps=4)
    problem = measured(problem, motion(problem, AT) + 0.01 * np.cos(3.0 * TIME)[:, None])
    gradient = problem.equations(AT).gradient.sum(axis=0)
    for place in range(len(gradient)):
        assert gradient[place] == pytest.approx(fall(problem, AT, place, 1e-5), rel=2e-3)


def test_a_mass_may_rest_at_a_corner():
    """Assert that a mass which lies where the spring begins to act stays there."""
    found = motion(problem_of(PLAY, 0.0 * FORCE, H), point_of(VALUES, HALF_GAP, 0.0))
    assert found == pytest.approx(HALF_GAP, abs=1e-12)
