"""Computed torque for the flexible joint: feedback linearisation of its fourth-order chain.

The link's position x1 is a flat output: differentiated four times, x1'''' meets the input, so

    u makes  x1'''' = q_d'''' - Σ stiffness_i (x1 - q_d)^(i),   i = 0 … 3,

exactly where the nominal coefficients are the true ones.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from flexid.control.controller import Controller
from flexid.errors import SettingError

COEFFICIENTS = ("theta1", "theta2", "alpha1", "alpha2", "beta1")

_DEFINITIONS = {
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
        _DEFINITIONS,
    )
