"""PD control on the motor with gravity compensation for the flexible joint.

P. Tomei, "A simple PD controller for robots with elastic joints", IEEE Transactions on Automatic
Control 36 (1991) 1208: for a constant reference the equilibrium is the reference, globally so if
joint and motor-side stiffness exceed the gravity's. Along a moving reference the damping acts on
the motor's speed relative to that of its reference.
"""

from collections.abc import Mapping

from flexid.control.controller import Controller
from flexid.control.robust import NOMINAL

_DEFINITIONS = {
    "motor_reference": "qd + nominal_gravity_torque*sin(qd)/nominal_joint_stiffness",
    "motor_reference_speed": "qd_1 + nominal_gravity_torque*cos(qd)*qd_1/nominal_joint_stiffness",
    "gravity_compensation": "nominal_gravity_torque*sin(qd)",
}


def pd_gravity(
    proportional: float = 50.0,  # stiffness of the motor's position loop in N m/rad
    derivative: float = 10.0,  # its damping in N m s/rad
    nominal: Mapping[str, float] = NOMINAL,  # gravity_torque in N m, joint_stiffness in N m/rad
) -> Controller:
    """Declare the law for the flexible joint."""
    return Controller(
        "PD with gravity compensation",
        "x1",
        {
            "u": "gravity_compensation + proportional*(motor_reference - x3)"
            " + derivative*(motor_reference_speed - x4)"
        },
        {
            "nominal_gravity_torque": nominal["gravity_torque"],
            "nominal_joint_stiffness": nominal["joint_stiffness"],
            "proportional": proportional,
            "derivative": derivative,
        },
        _DEFINITIONS,
    )
