"""Springs with play and with memory: against SciPy, and for the order of the steps."""

from typing import Any

import numpy as np
import pytest
from made_motion import fall, measured, motion, point_of, problem_of
from scipy.integrate import solve_ivp

from flexid.estimators.segmented_motion import Point, SegmentedMotion
from flexid.models.parametric_system import Memory, ParametricSystem, Row

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


REMEMBERING = ParametricSystem(
    "remembering oscillator",
    (Row("mass", "q", "v", {"spring": "-q", "friction": "-h", "gain": "u"}),),
    memories=(Memory("h", "q", "grip"),),
)
FINE = 0.005  # s
LONG = FINE * np.arange(800)
LASTING = 3.0 * np.sin(2.1 * LONG) + 2.0 * np.sin(5.3 * LONG)
GRIPPED = point_of([4.0, 0.8, 1.0, 12.0], 0.3, -0.5, 0.2)


def test_a_spring_remembers_as_scipy_says():
    """Assert that the motion obeys h' = s (v - |v| h) beside the mass's own equation."""
    spring, friction, gain, grip = GRIPPED.values

    def rates(t, x):
        q, v, h = x
        force = np.interp(t, LONG, LASTING)
        return v, -spring * q - friction * h + gain * force, grip * (v - abs(v) * h)

    tight: Any = {"rtol": 1e-9, "atol": 1e-11, "max_step": FINE}
    exact = solve_ivp(rates, (0.0, LONG[-1]), GRIPPED.initial_states[0], t_eval=LONG, **tight)
    found = motion(problem_of(REMEMBERING, LASTING, FINE), GRIPPED)[:, 0]
    # A step in which the path turns sees its ends alone: an error of the order of h² there.
    assert found == pytest.approx(exact.y[0], abs=3e-4)


@pytest.mark.parametrize(
    ("problem", "at", "accuracy"),
    [
        (problem_of(PLAY, FORCE, H, substeps=4), AT, 2e-3),
        (problem_of(REMEMBERING, LASTING, FINE), GRIPPED, 1e-4),
    ],
    ids=["play", "memory"],
)
def test_gradient_is_that_of_the_sum_of_squares(
    problem: SegmentedMotion, at: Point, accuracy: float
):
    """Assert that the derivatives go through corners unchanged, as differences say."""
    moved = motion(problem, at)
    bent = 0.01 * np.cos(3.0 * problem.segments.sample_times[0] * np.arange(len(moved)))
    problem = measured(problem, moved + bent[:, None])
    gradient = problem.equations(at).gradient.sum(axis=0)
    for place in range(len(gradient)):
        slope = fall(problem, at, place, 1e-5)
        assert gradient[place] == pytest.approx(slope, rel=accuracy, abs=1e-4)


def test_a_mass_may_rest_at_a_corner():
    """Assert that a mass which lies where the spring begins to act stays there."""
    found = motion(problem_of(PLAY, 0.0 * FORCE, H), point_of(VALUES, HALF_GAP, 0.0))
    assert found == pytest.approx(HALF_GAP, abs=1e-12)
