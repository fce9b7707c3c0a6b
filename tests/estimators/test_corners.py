"""Steps that end where the slope of the rates jumps: against SciPy, and for their order."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from flexid.estimators.channel_timing import Timing
from flexid.estimators.samples import Samples
from flexid.estimators.segmented_motion import Point, SegmentedMotion, segmented_motion
from flexid.estimators.segments import divide
from flexid.estimators.unknowns import Unknowns
from flexid.models.parametric_system import ParametricSystem, Row

FloatArray = np.ndarray

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
PLAIN = ParametricSystem(
    "oscillator", (Row("mass", "q", "v", {"spring": "-q", "gain": "u"}),), constants={"w": HALF_GAP}
)
H, COUNT = 0.02, 300
TIME = H * np.arange(COUNT)
FORCE = 3.0 * np.sin(2.1 * TIME) + 4.0 * np.sin(5.3 * TIME)
VALUES, STATE = [40.0, 40.0 * HALF_GAP, 1.0], [0.3, -0.5]
WITHOUT_PLAY = [40.0, 0.0, 1.0]


def problem_of(system: ParametricSystem, substeps: int = 1) -> SegmentedMotion:
    """One segment of the whole motion, with positions of zero."""
    samples = Samples(np.zeros((COUNT, 1)), None, FORCE[:, None], H)
    segments = divide([samples], 2.0 * H * COUNT)
    problem = segmented_motion(system, segments, Timing("linear"), Unknowns(system))
    return replace(problem, substeps=substeps)


def motion(problem: SegmentedMotion, values: list[float]) -> FloatArray:
    """Position in every sample."""
    point = Point(np.array(values), np.array([STATE]))
    return (problem.segments.outputs - problem.equations(point).residuals)[:, 0]


@pytest.fixture(scope="module")
def exact() -> FloatArray:
    """The motion by SciPy, in steps that end at the samples, where the force has corners too."""

    def rates(t, x):
        beyond = x[0] - np.clip(x[0], -HALF_GAP, HALF_GAP)
        return x[1], -VALUES[0] * beyond + np.interp(t, TIME, FORCE)

    found = solve_ivp(
        rates, (0.0, TIME[-1]), STATE, t_eval=TIME, rtol=1e-10, atol=1e-12, max_step=H / 20.0
    )
    return found.y[0]


def test_play_is_gone_through_often(exact):
    """Assert that the motion goes from one side to the other, mostly within two samples."""
    beyond = np.abs(exact) > HALF_GAP
    assert np.count_nonzero(np.diff(np.sign(exact[beyond]))) > 5
    assert np.count_nonzero(~beyond) < 0.5 * COUNT


def test_order_of_the_steps(exact):
    """Assert that the error falls with the fourth power of the step, corners or not."""
    errors = [
        np.abs(motion(problem_of(PLAY, substeps), VALUES) - exact).max() for substeps in (1, 2, 4)
    ]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert errors[0] < 2e-4
    assert orders == pytest.approx(4.0, abs=0.5)


def test_gradient_is_that_of_the_sum_of_squares():
    """Assert that the derivatives go through corners unchanged, as differences say."""
    problem = problem_of(PLAY, 4)
    measured = motion(problem, VALUES) + 0.01 * np.cos(3.0 * TIME)
    problem = replace(problem, segments=replace(problem.segments, outputs=measured[:, None]))
    point = np.array(STATE + VALUES)

    def cost(moved: FloatArray) -> float:
        return problem.equations(Point(moved[2:], moved[None, :2])).cost

    gradient = problem.equations(Point(point[2:], point[None, :2])).gradient.sum(axis=0)
    for place, step in enumerate(1e-5 * np.eye(len(point))):
        slope = (cost(point + step) - cost(point - step)) / 2e-5
        assert gradient[place] == pytest.approx(-0.5 * slope, rel=2e-3)


def test_a_term_that_is_off_has_no_corners():
    """Assert that steps are those of a model without the term where its coefficient is zero."""
    without = motion(problem_of(PLAIN), [WITHOUT_PLAY[0], WITHOUT_PLAY[2]])
    assert motion(problem_of(PLAY), WITHOUT_PLAY) == pytest.approx(without, abs=1e-13)


def test_a_mass_may_rest_at_a_corner():
    """Assert that a mass which lies where the spring begins to act stays there."""
    samples = Samples(np.zeros((COUNT, 1)), None, np.zeros((COUNT, 1)), H)
    problem = replace(problem_of(PLAY), segments=divide([samples], 2.0 * H * COUNT))
    point = Point(np.array(VALUES), np.array([[HALF_GAP, 0.0]]))
    assert -problem.equations(point).residuals == pytest.approx(HALF_GAP, abs=1e-12)
