"""Dry friction, play and hysteresis, against closed forms, another integrator and SciPy."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import product
from typing import Any

import numpy as np
import pytest
from benchmarks.trials.integrator import Drive, Law, Smooth, simulate
from made_motion import FloatArray, fall, measured, motion, point_of, problem_of
from scipy.integrate import solve_ivp

from flexid.estimators.channel_timing import Timing
from flexid.estimators.segmented_motion import Point, SegmentedMotion
from flexid.estimators.unknowns import Unknowns
from flexid.identification.preparation.joint import flexible
from flexid.models.parametric_system import Memory, ParametricSystem, Row

OSCILLATOR = ParametricSystem(
    "oscillator", (Row("mass", "q", "v", {"spring": "-q", "coulomb": "-sign(v)", "gain": "u"}),)
)
BLOCK = Unknowns(OSCILLATOR, {"spring": 0.0})


def off_at(
    problem: SegmentedMotion, point: Point, sample: int, output: int = 0
) -> tuple[SegmentedMotion, FloatArray]:
    """Return the problem with one measured value shifted by one, and derivatives of that value.

    The derivatives are by the initial state, then by the unknowns. With a single residual of one,
    the right-hand side is the row of that residual.
    """
    outputs = motion(problem, point).copy()
    outputs[sample, output] += 1.0
    other = measured(problem, outputs)
    return other, other.equations(point).gradient.sum(axis=0)


def reversed_motion(t: FloatArray, x0: complex, v0: complex, c: complex, g: complex) -> FloatArray:
    """Return a block that a constant pull of 3 g, greater than friction, reverses."""
    turn = v0 / (3.0 * g + c)
    after = x0 + 0.5 * v0 * turn - 0.5 * (3.0 * g - c) * (t - turn) ** 2
    return np.where(t < turn.real, x0 + v0 * t - 0.5 * (3.0 * g + c) * t**2, after)


TIME = 0.01 * np.arange(100)
SLIDING = np.minimum(TIME, 1.0 / 2.1)  # until friction stops it
LET_GO = np.maximum(TIME - 0.707 / 2.0, 0.0)  # after a growing force exceeds friction


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(
    ("force", "friction", "speed", "expected"),
    [
        (0.0 * TIME, 2.1, 1.0, SLIDING - 0.5 * 2.1 * SLIDING**2),
        (0.0 * TIME - 3.0, 1.0, 1.0, reversed_motion(TIME, 0.0, 1.0, 1.0, 1.0)),
        (2.0 * TIME, 0.707, 0.0, LET_GO**3 / 3.0),
        (0.0 * TIME + 3.0, 1.0, 0.0, TIME**2),
    ],
    ids=["slides to rest", "turns back", "is let go at the instant", "moves at once"],
)
def test_a_block_moves_as_its_closed_form(side, force, friction, speed, expected):
    """Assert parabolas and cubics between instants of stick and slip, in both directions."""
    problem = problem_of(BLOCK, side * force, 0.01)
    found = motion(problem, point_of([friction, 1.0], 0.3, side * speed))[:, 0]
    assert found == pytest.approx(0.3 + side * expected, abs=1e-10)
    if not force.any():
        assert np.ptp(found[50:]) == 0.0


@pytest.mark.parametrize("force", [0.99 * np.sin(20.0 * TIME), np.full(100, -0.99)])
def test_block_sticks_for_ever(force):
    """Assert that a force below friction moves nothing, to the bit."""
    found = motion(problem_of(BLOCK, force, 0.01), point_of([1.0, 1.0], 0.2, 0.0))
    assert np.all(found == 0.2)


@pytest.mark.parametrize(("samples", "slides"), [(2.9, False), (3.1, True)])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_block_that_stops_at_once_sticks(side, samples, slides):
    """Assert that an initial speed lost within three samples counts as rest, with no derivative."""
    problem = problem_of(BLOCK, 0.0 * TIME, 0.01)
    point = point_of([2.0, 1.0], 0.3, side * 2.0 * 0.01 * samples)
    travelled = motion(problem, point)[-1, 0] - 0.3
    expected = side * (0.01 * samples) ** 2 if slides else 0.0
    assert travelled == pytest.approx(expected, abs=1e-10)
    assert (off_at(problem, point, 50)[1][1] != 0.0) == slides


@pytest.mark.parametrize(("pull", "grazes"), [(0.65, False), (0.5005, True)])
def test_derivatives_stay_bounded_where_a_friction_that_drives_is_hardly_overcome(pull, grazes):
    """Assert exact derivatives down to a tenth of the jump of acceleration, bounded ones below."""
    problem = problem_of(BLOCK, np.full(100, -pull), 0.01)
    _, found = off_at(problem, point_of([-0.5, 1.0], 0.0, 1e-4), 99)
    values = np.array([0.0, 1e-4, -0.5, pull / 3.0])
    exact = reversed_motion(TIME[99:], *(values + 1e-30j * np.eye(4)[1]))[0].imag / 1e-30
    assert abs(exact) > 5.0
    if grazes:
        assert abs(exact) > 500.0
        assert abs(found[1]) < 11.0  # (jump + a tenth) / (a tenth), for one second
    else:
        assert found[1] == pytest.approx(exact, rel=1e-6)


KNOTS = 0.4  # s between knots of the torque on the joint
CORNERS = np.array([0.0, 14.0, -9.0, -9.0, 17.0, 3.0, -16.0, 0.0, 0.0])  # N m
VALUES = {
    "theta1": 5.0,
    "theta2": 100.0,
    "theta_coulomb": 0.8,
    "alpha1": 1000.0 / 3.0,
    "alpha2": 1.0 / 3.0,
    "alpha_coulomb": 9.0,
    "beta1": 10.0 / 3.0,
}
JOINT = flexible().systems[0]  # with all usual terms: its kernel is compiled anyway
SOUGHT = Unknowns(JOINT, dict.fromkeys({*JOINT.coefficients} - VALUES.keys(), 0.0))
TRUTH = [VALUES[name] for name in SOUGHT.names]
DURATION = KNOTS * (len(CORNERS) - 1)


@pytest.fixture(scope="module")
def stick_slip():
    """Return times and states under a piecewise linear torque, by the integrator of the trials."""
    times = 0.002 * np.arange(round(DURATION / 0.002) + 1)
    fine = 1e-5 * np.arange(round(DURATION / 1e-5) + 1)
    torque = Smooth(np.interp(fine, KNOTS * np.arange(len(CORNERS)), CORNERS), 0.0, 1e-5)
    nothing, course = np.zeros(len(times)), np.zeros((len(times), 3))
    drive = Drive(
        link_inertia=1.0,
        motor_inertia=0.3,
        joint_stiffness=100.0,
        gravity_torque=5.0,
        motor_viscous=0.1,
        motor_coulomb_up=2.7,
        motor_coulomb_down=2.7,
        link_coulomb=0.8,
    )
    run = (drive, times, times, times, nothing, nothing, torque, Law(), course, 0.0, 1e-4)
    return times, simulate(*run)[0]


def joint_problem(times: FloatArray, substeps: int) -> SegmentedMotion:
    """Return the joint under that torque, linear between samples."""
    torque = np.interp(times, KNOTS * np.arange(len(CORNERS)), CORNERS)
    return problem_of(SOUGHT, torque, float(times[1]), substeps=substeps)


def test_joint_has_right_derivatives(stick_slip):
    """Assert the derivatives of both positions late in the motion, by finite differences."""
    times = stick_slip[0]
    problem = joint_problem(times, 2)
    point = point_of(TRUTH, 0.01, 0.02, 0.015, -0.03)
    for sample, output in product((900, 1500), range(2)):
        off, found = off_at(problem, point, sample, output)
        row = [fall(off, point, place, 1e-6) for place in range(len(found))]
        assert found == pytest.approx(row, rel=1e-4, abs=1e-5 * np.abs(row).max())


def test_joint_sticks_and_slips(stick_slip):
    """Assert that two dry frictions agree with another integrator, to fourth order in the step."""
    times, states = stick_slip
    modes = np.sign(states[:, [1, 3]])
    before, after = (side[modes[:-1] != modes[1:]] != 0.0 for side in (modes[:-1], modes[1:]))
    seen = {*zip(before.tolist(), after.tolist(), strict=True)}
    assert seen == {(True, True), (True, False), (False, True)}  # reversal, sticking, release
    coarse = slice(None, None, 10)
    errors = []
    for substeps in (1, 2, 4):
        problem = joint_problem(times[coarse], substeps)
        found = motion(problem, point_of(TRUTH, *np.zeros(4)))
        errors.append(np.abs(found - states[coarse][:, [0, 2]]).max())
    slope = np.polyfit(np.log([1.0, 0.5, 0.25]), np.log(errors), 1)[0]
    assert 3.6 < slope < 4.6
    assert errors[-1] < 1e-4 < np.abs(states).max()


def test_a_held_input_lets_go_between_its_samples():
    """Assert that a side slips if its load exceeds friction only just after a jump of the input.

    The link relaxes the spring within every interval, so that friction holds again at its end.
    Steps forty times as short give the same, and the side has moved by then.
    """
    values = {"theta2": 1.0, "alpha1": 12000.0, "alpha_coulomb": 10.0}
    h, speed = 6e-4, -0.15
    loads = 9.5 + np.minimum(0.05 * np.arange(40), 0.9)  # at the start of each interval
    force = loads - 12000.0 * speed * h * np.arange(40)
    sought = Unknowns(JOINT, {n: values.get(n, 0.0) for n in JOINT.coefficients if n != "beta1"})
    problem = problem_of(sought, force, h, Timing("zero"))
    start = point_of([1.0], 0.0, speed, 0.0, 0.0)
    coarse = motion(replace(problem, substeps=1), start)
    fine = motion(replace(problem, substeps=40), start)
    assert fine[-1, 1] > 1e-8
    assert coarse == pytest.approx(fine, abs=1e-2 * fine[-1, 1])


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
TICKS = H * np.arange(COUNT)
FORCE = 3.0 * np.sin(2.1 * TICKS) + 4.0 * np.sin(5.3 * TICKS)
SPRUNG, STATE = [40.0, 40.0 * HALF_GAP, 1.0], [0.3, -0.5]
AT = point_of(SPRUNG, *STATE)


@pytest.fixture(scope="module")
def exact() -> np.ndarray:
    """Return SciPy's motion, in steps that end at the samples, where the force has corners."""

    def rates(t, x):
        beyond = x[0] - np.clip(x[0], -HALF_GAP, HALF_GAP)
        return x[1], -SPRUNG[0] * beyond + np.interp(t, TICKS, FORCE)

    found = solve_ivp(
        rates, (0.0, TICKS[-1]), STATE, t_eval=TICKS, rtol=1e-10, atol=1e-12, max_step=H / 20.0
    )
    return found.y[0]


def test_order_of_the_steps(exact):
    """Assert that the error falls with the fourth power of the step, with or without corners."""
    beyond = np.abs(exact) > HALF_GAP  # moves back and forth, mostly within two samples
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
    """Assert that the motion obeys h' = s (v - |v| h) and the mass's own equation."""
    spring, friction, gain, grip = GRIPPED.values

    def rates(t, x):
        q, v, h = x
        force = np.interp(t, LONG, LASTING)
        return v, -spring * q - friction * h + gain * force, grip * (v - abs(v) * h)

    tight: Any = {"rtol": 1e-9, "atol": 1e-11, "max_step": FINE}
    exact = solve_ivp(rates, (0.0, LONG[-1]), GRIPPED.initial_states[0], t_eval=LONG, **tight)
    found = motion(problem_of(REMEMBERING, LASTING, FINE), GRIPPED)[:, 0]
    # A step with a reversal uses its ends only: an error of order h².
    assert found == pytest.approx(exact.y[0], abs=3e-4)


@pytest.mark.parametrize(
    ("posed", "at", "accuracy"),
    [
        (partial(problem_of, PLAY, FORCE, H, substeps=4), AT, 2e-3),
        (partial(problem_of, REMEMBERING, LASTING, FINE), GRIPPED, 1e-4),
    ],
    ids=["play", "memory"],
)
def test_gradient_is_that_of_the_sum_of_squares(
    posed: Callable[[], SegmentedMotion], at: Point, accuracy: float
):
    """Assert derivatives across corners by differences."""
    problem = posed()
    moved = motion(problem, at)
    bent = 0.01 * np.cos(3.0 * problem.segments.sample_times[0] * np.arange(len(moved)))
    problem = measured(problem, moved + bent[:, None])
    gradient = problem.equations(at).gradient.sum(axis=0)
    for place in range(len(gradient)):
        slope = fall(problem, at, place, 1e-5)
        assert gradient[place] == pytest.approx(slope, rel=accuracy, abs=1e-4)


def test_a_mass_may_rest_at_a_corner():
    """Assert that a mass at rest where the spring begins to act stays there."""
    found = motion(problem_of(PLAY, 0.0 * FORCE, H), point_of(SPRUNG, HALF_GAP, 0.0))
    assert found == pytest.approx(HALF_GAP, abs=1e-12)
