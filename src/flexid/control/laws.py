"""Control laws for the flexible joint: robust backstepping, PD with gravity, computed torque.

Robust backstepping is Huang (2003), eq. (11). The feedback gains are ambiguous as printed. Here
gain1 = k^a JlM/kem, gain2 = k^b, gain3 = k^c JrM with exponents (a, b, c); M marks the largest, m
the smallest admissible value. Exponents (1, 2, 3) make each inner loop k times faster than the next
outer one, which is what lets the tracking error become arbitrarily small for large k.

PD control on the motor with gravity compensation: P. Tomei, "A simple PD controller for robots with
elastic joints", IEEE Transactions on Automatic Control 36 (1991) 1208. For a constant reference the
equilibrium is the reference, globally so if joint and motor-side stiffness exceed the gravity's.
Along a moving reference the damping acts on the motor's speed relative to that of its reference.

Computed torque is feedback linearisation of the joint's fourth-order chain. The link's position x1
is a flat output: differentiated four times, x1'''' meets the input, so

    u makes  x1'''' = q_d'''' - Σ stiffness_i (x1 - q_d)^(i),   i = 0 … 3,

exactly where the nominal coefficients are the true ones.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from flexid.control.controller import Controller
from flexid.errors import SettingError

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

_ROBUST = {
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
        _ROBUST,
        _COORDINATES,
        {
            "gain1": f"k**{a!r}*largest_link_inertia/smallest_joint_stiffness",
            "gain2": f"k**{b!r}",
            "gain3": f"k**{c!r}*largest_motor_inertia",
        },
    )


_PD_GRAVITY = {
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
        _PD_GRAVITY,
    )


COEFFICIENTS = ("theta1", "theta2", "alpha1", "alpha2", "beta1")

_COMPUTED_TORQUE = {
    # Acceleration and jerk of the link, as the nominal model has them.
    "acceleration": "-nominal_theta1*sin(x1) - nominal_theta2*(x1 - x3)",
    "jerk": "-nominal_theta1*cos(x1)*x2 - nominal_theta2*(x2 - x4)",
    "demand": "qd_4 - stiffness3*(jerk - qd_3) - stiffness2*(acceleration - qd_2)"
    " - stiffness1*(x2 - qd_1) - stiffness0*(x1 - qd)",
    # x1'''' = theta1 (sin(x1) x2² - cos(x1) x1'') - theta2 (x1'' - x3''), solved for x3''.
    "motor_acceleration": "acceleration + (demand - nominal_theta1*(sin(x1)*x2**2"
    " - cos(x1)*acceleration))/nominal_theta2",
}


def computed_torque(
    nominal: Mapping[str, float],  # values of `COEFFICIENTS` in SI units
    poles: Sequence[float] = (-10.0, -10.0, -10.0, -10.0),  # of the tracking error, real, in 1/s
) -> Controller:
    """Declare the law for the flexible joint of Huang (2003), eq. (4)."""
    missing = [name for name in COEFFICIENTS if name not in nominal]
    if missing:
        raise SettingError("nominal", f"{', '.join(missing)} missing: give a value for each")
    if len(poles) != 4 or max(poles) >= 0.0:
        raise SettingError("poles", f"{tuple(poles)} are not four negative numbers")
    stiffness = np.poly(np.asarray(poles, dtype=float))[:0:-1]
    return Controller(
        "computed torque",
        "x1",
        {"u": "(motor_acceleration - nominal_alpha1*(x1 - x3) + nominal_alpha2*x4)/nominal_beta1"},
        {f"nominal_{name}": nominal[name] for name in COEFFICIENTS}
        | {f"stiffness{i}": float(value) for i, value in enumerate(stiffness)},
        _COMPUTED_TORQUE,
    )
