"""PD control with gravity compensation."""

import numpy as np
import pytest

from flexid.control.pd_gravity import pd_gravity
from flexid.control.references import constant
from flexid.models.flexible_joint import flexible_joint
from flexid.simulation.closed_loop import simulate
from flexid.simulation.loop import ClosedLoop

COEFFICIENTS = {"theta1": 5.0, "theta2": 100.0, "alpha1": 1000 / 3, "alpha2": 1 / 3}


@pytest.mark.parametrize("target", [-2.5, 1.0, 3.0])
def test_settles_at_the_reference(target: float) -> None:
    """Assert that with the true gravity the joint comes to rest where it shall, held by gravity."""
    law = pd_gravity(40.0, 8.0, {"gravity_torque": 5.0, "joint_stiffness": 100.0})
    loop = ClosedLoop(
        flexible_joint(known={"beta1": 10 / 3}),
        COEFFICIENTS,
        law,
        constant(target),
        {"link": 1.0, "motor": 1.0},
    )
    run = simulate(loop, 60.0, 0.1)
    deflection = 5.0 * np.sin(target) / 100.0
    assert run.states[-1] == pytest.approx([target, 0.0, target + deflection, 0.0], abs=1e-6)
    assert run.inputs[-1, 0] == pytest.approx(5.0 * np.sin(target), abs=1e-4)
