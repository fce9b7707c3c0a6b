"""The robust backstepping law of Huang (2003), eq. (11).

The feedback gains are ambiguous as printed. Here gain1 = k^a JlM/kem, gain2 = k^b, gain3 = k^c JrM
with exponents (a, b, c); M marks the largest, m the smallest admissible value. Exponents (1, 2, 3)
make each inner loop k times faster than the next outer one, which is what lets the tracking error
become arbitrarily small for large k.
"""

from collections.abc import Mapping

from flexid.control.controller import Controller

NOMINAL = {
    "gravity_torque": 4.5,
    "link_inertia": 0.8,
    "joint_stiffness": 75.0,
    "motor_inertia": 0.18,
    "motor_viscous_friction": 0.07,
}
"""Nominal values of Huang (2003), Table I: N m, kg m², N m/rad, kg m², N m s/rad."""

LARGEST_LINK_INERTIA = 1.4
LARGEST_MOTOR_INERTIA = 0.42
SMALLEST_JOINT_STIFFNESS = 60.0

_DEFINITIONS = {
    # Motor position and velocity that hold the nominal link on the reference, and their torque.
    "w1N": "qd + (nominal_gravity_torque*sin(qd) + nominal_link_inertia*qd_2)"
    "/nominal_joint_stiffness",
    "w2N": "qd_1 + (nominal_gravity_torque*cos(qd)*qd_1 + nominal_link_inertia*qd_3)"
    "/nominal_joint_stiffness",
    "uN": "nominal_motor_inertia*qd_2 + nominal_motor_inertia/nominal_joint_stiffness"
    "*(nominal_gravity_torque*qd_2*cos(qd) - nominal_gravity_torque*qd_1**2*sin(qd)"
    " + nominal_link_inertia*qd_4) + nominal_motor_viscous_friction*w2N"
    " + nominal_gravity_torque*sin(qd) + nominal_link_inertia*qd_2",
    "filtered_error": "x2 - qd_1 + k*(x1 - qd)",
    "w1F": "-gain1*filtered_error",
    "w2F": "-gain2*(x3 - w1F - w1N)",
    "w2": "w2N + w2F",
    "uF": "-gain3*(x4 - w2)",
}

_COORDINATES = {
    "e1": "x1 - qd",
    "e2": "filtered_error",
    "e3": "x3 - w1N - w1F",
    "e4": "x4 - w2",
}


def robust_law(
    k: float = 50.0,  # gain in 1/s
    exponents: tuple[float, float, float] = (1.0, 2.0, 3.0),  # of k in the three feedback gains
    nominal: Mapping[str, float] = NOMINAL,
    largest_link_inertia: float = LARGEST_LINK_INERTIA,  # kg m²
    largest_motor_inertia: float = LARGEST_MOTOR_INERTIA,  # kg m²
    smallest_joint_stiffness: float = SMALLEST_JOINT_STIFFNESS,  # N m/rad
) -> Controller:
    """Declare the law (11) for the flexible joint, by default with the values of Table I."""
    a, b, c = map(float, exponents)
    return Controller(
        "robust law",
        "x1",
        {"u": "uN + uF"},
        {f"nominal_{name}": nominal[name] for name in NOMINAL}
        | {
            "k": k,
            "largest_link_inertia": largest_link_inertia,
            "largest_motor_inertia": largest_motor_inertia,
            "smallest_joint_stiffness": smallest_joint_stiffness,
        },
        _DEFINITIONS,
        _COORDINATES,
        {
            "gain1": f"k**{a!r}*largest_link_inertia/smallest_joint_stiffness",
            "gain2": f"k**{b!r}",
            "gain3": f"k**{c!r}*largest_motor_inertia",
        },
    )
