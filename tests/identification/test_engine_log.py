"""`identify` on logs of MuJoCo, whose friction is not flexid's: a constraint, not a function."""

import numpy as np
import pytest
from benchmarks.arms.arm import Arm, Link
from benchmarks.arms.log import Motion, simulate
from made_joint import log, recording

from flexid.identification.identify import identify

LINK = Link(0.5, 2.0, 0.25, 0.0, 0.875, 100.0, 0.4, 0.3, 0.2, 0.5, 0.0, 0.0)
TRUTH = {
    "gravity_torque": 2.0 * 0.25 * 9.81,
    "link_inertia": 0.875 + 2.0 * 0.25**2,
    "joint_stiffness": 100.0,
    "joint_damping": 0.4,
    "motor_inertia": 0.3,
    "motor_viscous_friction": 0.2,
    "motor_coulomb_friction": 0.5,
}


def identified(seed):
    """Thirty seconds with 14-bit encoders and a held torque."""
    made = simulate(
        Arm((LINK,), (9.81, 0.0)), Motion(30.0, bits=14, noise=0.0), np.random.default_rng(seed)
    )
    columns = (column[:, 0].copy() for column in (made.link, made.motor, made.torque))
    return identify([log(recording(made.time, *columns))])


@pytest.mark.parametrize("seed", [0, pytest.param(10, marks=pytest.mark.thorough)])
def test_every_parameter_is_determined(seed):
    """Assert that all, dry friction too, is within three thousandths, and the truth inside.

    Friction needs no velocity, and a held torque without delay is seen.
    """
    result = identified(seed)
    for name, value in TRUTH.items():
        assert result.parameters[name].value == pytest.approx(value, rel=0.003), name
        lower, upper = result.parameters[name].interval
        assert result.parameters[name].verdict == "determined"
        assert lower <= value <= upper, name
    assert result.choices.coulomb_velocity is None
    assert result.choices.hold == "zero"
    assert abs(result.choices.alignment.input_delay.value) < 1e-5
