"""Computed torque: feedback linearisation of the flexible joint."""

import numpy as np
import pytest
from scipy.linalg import expm

from flexid.control.computed_torque import computed_torque
from flexid.control.references import sinusoid
from flexid.errors import SettingError
from flexid.models.flexible_joint import flexible_joint
from flexid.simulation.closed_loop import simulate
from flexid.simulation.loop import ClosedLoop

TRUE = {"theta1": 5.0, "theta2": 100.0, "alpha1": 1000 / 3, "alpha2": 1 / 3, "beta1": 10 / 3}
JOINT = flexible_joint(known={"beta1": TRUE["beta1"]})


def test_error_follows_the_chosen_poles() -> None:
    """Assert that with true coefficients the tracking error solves the chosen linear system."""
    poles = (-2.0, -3.0, -4.0, -6.0)
    unknown = {name: TRUE[name] for name in JOINT.coefficients}
    start = (0.2, 0.0, 0.25, 0.0)
    loop = ClosedLoop(
        JOINT,
        unknown,
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


def test_unstable_poles_are_refused() -> None:
    """Assert that a pole on the right is an error."""
    with pytest.raises(SettingError, match="negative"):
        computed_torque(TRUE, (-1.0, -1.0, -1.0, 1.0))


def test_missing_coefficient_is_named() -> None:
    """Assert that a coefficient without a value is named."""
    with pytest.raises(SettingError, match="beta1"):
        computed_torque({name: TRUE[name] for name in JOINT.coefficients})
