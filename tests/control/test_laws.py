"""Laws that hold the flexible joint: computed torque, PD control with gravity compensation."""

import numpy as np
import pytest
from scipy.linalg import expm

from flexid.control.laws import computed_torque, pd_gravity
from flexid.control.references import constant, sinusoid
from flexid.errors import SettingError
from flexid.models.flexible_joint import flexible_joint
from flexid.simulation.closed_loop import simulate
from flexid.simulation.loop import ClosedLoop

TRUE = {"theta1": 5.0, "theta2": 100.0, "alpha1": 1000 / 3, "alpha2": 1 / 3, "beta1": 10 / 3}
JOINT = flexible_joint(known={"beta1": TRUE["beta1"]})
UNKNOWN = {name: TRUE[name] for name in JOINT.coefficients}


def test_error_follows_the_chosen_poles() -> None:
    """Assert that with true coefficients the tracking error solves the chosen linear system."""
    poles = (-2.0, -3.0, -4.0, -6.0)
    start = (0.2, 0.0, 0.25, 0.0)
    loop = ClosedLoop(
        JOINT,
        UNKNOWN,
        computed_torque(TRUE, poles),
        sinusoid(0.5, 3.0),
        {"link": 0.0, "motor": 0.0},
        initial_state=start,
    )
    run = simulate(loop, 3.0, 0.01, 1e-10)
    # Error, rate, acceleration and jerk at the start, from the joint's equations of motion.
    x1, x2, x3, x4 = start
    acceleration = -5.0 * np.sin(x1) - 100.0 * (x1 - x3)
    jerk = -5.0 * np.cos(x1) * x2 - 100.0 * (x2 - x4)
    error = np.array([x1, x2, acceleration, jerk]) - run.reference[0, :4]
    companion = np.diag(np.ones(3), 1)
    companion[3] = -np.poly(poles)[:0:-1]
    expected = [(expm(companion * t) @ error)[0] for t in run.time]
    assert np.max(np.abs(run.tracking_error - expected)) < 1e-7 * np.max(np.abs(expected))


@pytest.mark.parametrize(
    ("coefficients", "poles", "words"),
    [(TRUE, (-1.0, -1.0, -1.0, 1.0), "negative"), (UNKNOWN, (-1.0,) * 4, "beta1")],
)
def test_what_is_wrong_is_named(coefficients, poles, words) -> None:
    """Assert that a pole on the right, and a coefficient without a value, are named."""
    with pytest.raises(SettingError, match=words):
        computed_torque(coefficients, poles)


@pytest.mark.parametrize("target", [-2.5, 1.0, 3.0])
def test_settles_at_the_reference(target: float) -> None:
    """Assert that with the true gravity the joint comes to rest where it shall, held by gravity."""
    law = pd_gravity(40.0, 8.0, {"gravity_torque": 5.0, "joint_stiffness": 100.0})
    loop = ClosedLoop(JOINT, UNKNOWN, law, constant(target), {"link": 1.0, "motor": 1.0})
    run = simulate(loop, 60.0, 0.1)
    deflection = 5.0 * np.sin(target) / 100.0
    assert run.states[-1] == pytest.approx([target, 0.0, target + deflection, 0.0], abs=1e-6)
    assert run.inputs[-1, 0] == pytest.approx(5.0 * np.sin(target), abs=1e-4)
