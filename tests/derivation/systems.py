"""Systems on which the derivation is tested."""

from flexid.models.flexible_joint import flexible_joint
from flexid.models.parametric_system import ParametricSystem, Row

PAPER = flexible_joint(known={"beta1": 1 / 0.3})

NO_CLOSED_FORM = ParametricSystem(
    "arm with Stribeck friction",
    (
        Row(
            "arm",
            "q",
            "v",
            {
                "gravity": "-sin(q)",
                "stribeck": "-exp(-(v/0.1)**2)*tanh(v/0.05)*(2 + cos(q))",
                "drag": "-v*abs(v)",
            },
            known="gain*u",
        ),
    ),
    constants={"gain": 2.0},
)

HARDENING = flexible_joint(
    ("gravity", "motor_viscous", "cubic_stiffness", "motor_coulomb", "link_coulomb"),
    known={"beta1": 3.0},
)

THREE_ROWS = ParametricSystem(
    "three inertias",
    (
        Row("first", "q1", "v1", {"a1": "q2 - q1", "a2": "-tanh(v1/width)"}, known="u1"),
        Row("second", "q2", "v2", {"b1": "q1 - q2", "b2": "q3 - q2", "b3": "-v2**3"}),
        Row("third", "q3", "v3", {"d1": "q2 - q3", "d2": "-sin(q3)*v3**2", "d3": "cos(q1)*u2"}),
    ),
    inputs=("u1", "u2"),
    constants={"width": 0.1},
)

UNKNOWN_GAIN = flexible_joint()

ALL = {
    "paper": PAPER,
    "no closed form": NO_CLOSED_FORM,
    "hardening": HARDENING,
    "three rows": THREE_ROWS,
    "unknown input gain": UNKNOWN_GAIN,
}
