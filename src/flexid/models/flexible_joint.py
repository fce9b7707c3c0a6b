"""The single-link flexible joint of Huang (2003), eq. (4), with terms that can be switched on.

    x1' = x2
    x2' = -theta1 sin x1 - theta2 (x1 - x3)
    x3' = x4
    x4' = alpha1 (x1 - x3) - alpha2 x4 + beta1 u

x1, x2 are position and velocity of the link, x3, x4 those of the motor at the link side of the
gear, u is the motor torque (or the voltage or current that causes it).
"""

from collections.abc import Collection, Mapping

from flexid.models.parametric_system import Memory, ParametricSystem
from flexid.models.terms import (
    COULOMB_VELOCITY,
    SMOOTHING,
    Term,
    check_terms,
    declared_row,
    model_constants,
)

_COMPLIANCE = Term("joint spring", {"theta2": "-(x1 - x3)"}, {"alpha1": "x1 - x3"})

TERMS: dict[str, Term] = {
    "gravity": Term("gravity on the link", {"theta1": "-sin(x1)"}, {}),
    "gravity_cosine": Term(
        "gravity where the link encoder's zero is not straight down",
        {"theta_cosine": "-cos(x1)"},
        {},
    ),
    "motor_viscous": Term("viscous friction of the motor", {}, {"alpha2": "-x4"}),
    "link_viscous": Term("viscous friction of the link", {"theta_viscous": "-x2"}, {}),
    "joint_damping": Term(
        "damping of the joint spring",
        {"theta_damping": "-(x2 - x4)"},
        {"alpha_damping": "x2 - x4"},
    ),
    "motor_coulomb": Term(
        "Coulomb friction of the motor", {}, {"alpha_coulomb": f"-tanh(x4/{SMOOTHING})"}
    ),
    "link_coulomb": Term(
        "Coulomb friction of the link", {"theta_coulomb": f"-tanh(x2/{SMOOTHING})"}, {}
    ),
    "cubic_stiffness": Term(
        "cubic hardening of the joint spring",
        {"theta_cubic": "-(x1 - x3)**3"},
        {"alpha_cubic": "(x1 - x3)**3"},
    ),
    "link_offset": Term("constant torque or sensor offset, link", {"theta_offset": "1"}, {}),
    "motor_offset": Term("constant torque or sensor offset, motor", {}, {"alpha_offset": "1"}),
}
"""Terms that can be switched on besides the joint spring, which is always there."""

STRIBECK_VELOCITY = "stribeck_velocity"
BACKLASH_WIDTH = "backlash_width"
BEND_DEFLECTION = "bend_deflection"
RIPPLE_NUMBER = "ripple_number"
RIPPLE_ORIGIN = "ripple_origin"

_RIPPLING = f"{RIPPLE_NUMBER}*(x3 - {RIPPLE_ORIGIN})"

# Twice the deflection over the width, cut off at 2: a spring less its stiffness times half the gap
# times half of this is a dead zone, if the width is half the gap.
_BEYOND = f"abs((x1 - x3)/{BACKLASH_WIDTH} + 1) - abs((x1 - x3)/{BACKLASH_WIDTH} - 1)"

# The deflection beyond where the spring bends.
_BENT = f"(x1 - x3) - (abs((x1 - x3) + {BEND_DEFLECTION}) - abs((x1 - x3) - {BEND_DEFLECTION}))/2"

SHAPE_TERMS: dict[str, Term] = {
    "motor_stribeck": Term(
        "friction of the motor that falls off its static value",
        {},
        {"alpha_stribeck": f"-sign(x4)*exp(-(x4/{STRIBECK_VELOCITY})**2)"},
    ),
    "motor_drag": Term(
        "friction of the motor that grows with the square of its velocity",
        {},
        {"alpha_drag": "-x4*abs(x4)"},
    ),
    "link_drag": Term(
        "friction of the link that grows with the square of its velocity",
        {"theta_drag": "-x2*abs(x2)"},
        {},
    ),
    "torque_saturation": Term(
        "torque that falls behind the recorded input where that is large",
        {},
        {"alpha_saturation": "-u**3"},
    ),
    "torque_ripple": Term(
        "torque that repeats with the motor's position, many times in a turn",
        {},
        {
            "alpha_ripple_sine": f"sin({_RIPPLING})",
            "alpha_ripple_cosine": f"cos({_RIPPLING})",
        },
    ),
    "eccentricity": Term(
        "error of the transmission that repeats with each turn",
        {"theta_ecc_sine": "sin(x3)", "theta_ecc_cosine": "cos(x3)"},
        {  # the gear, which turns by e more, turns the torque by e' more: (x1 - x3 - e) (1 + e')
            "alpha_ecc_sine": "-sin(x3) + (x1 - x3)*cos(x3)",
            "alpha_ecc_cosine": "-cos(x3) - (x1 - x3)*sin(x3)",
            "alpha_ecc_sine_square": "-sin(x3)*cos(x3)",
            "alpha_ecc_cosine_square": "sin(x3)*cos(x3)",
            "alpha_ecc_product": "-cos(2*x3)",
        },
    ),
    "spring_hysteresis": Term(
        "friction within the joint spring",
        {"theta_hysteresis": "-hysteresis"},
        {"alpha_hysteresis": "hysteresis"},
        Memory("hysteresis", "x1 - x3", "hysteresis_grip"),
    ),
    "backlash": Term(
        "play of the joint about its rest",
        {"theta_backlash": f"({_BEYOND})/2"},
        {"alpha_backlash": f"-({_BEYOND})/2"},
    ),
    "bent_spring": Term(
        "joint spring with another stiffness beyond some deflection",
        {"theta_bend": f"-({_BENT})"},
        {"alpha_bend": _BENT},
    ),
    "lopsided_spring": Term(
        "joint spring that is stiffer to one side",
        {"theta_lopsided": "-(x1 - x3)**2"},
        {"alpha_lopsided": "(x1 - x3)**2"},
    ),
}
"""Terms for what a drive may have besides those of `TERMS`; each stands for a family of shapes."""

SHAPES = (STRIBECK_VELOCITY, BACKLASH_WIDTH, BEND_DEFLECTION, RIPPLE_NUMBER, RIPPLE_ORIGIN)
"""Constants of these terms: how wide their shapes are, and from where a ripple counts."""

_ANY_SHAPE = dict.fromkeys(SHAPES, 1.0) | {RIPPLE_ORIGIN: 0.0}  # until a log says which

CONSTANT_UNITS = {
    SMOOTHING: "rad/s",
    STRIBECK_VELOCITY: "rad/s",
    BACKLASH_WIDTH: "rad",
    BEND_DEFLECTION: "rad",
    RIPPLE_NUMBER: "1",
    RIPPLE_ORIGIN: "rad",
}
"""Unit of each constant that a term may bring."""

TIES: dict[str, tuple[str, str, str]] = {
    f"theta_{name}": (f"alpha_{name}", "theta2", "alpha1")
    for name in (
        *("damping", "cubic", "ecc_sine", "ecc_cosine", "hysteresis", "backlash", "bend"),
        "lopsided",
    )
} | {
    "alpha_ecc_sine_square": ("alpha_ecc_sine", "alpha_ecc_sine", "alpha1"),
    "alpha_ecc_cosine_square": ("alpha_ecc_cosine", "alpha_ecc_cosine", "alpha1"),
    "alpha_ecc_product": ("alpha_ecc_sine", "alpha_ecc_cosine", "alpha1"),
}
"""Coefficients that follow from others, the first times the second over the third.

Those of one spring, which acts on both sides: a/Jl = (a/Jr) theta2/alpha1. And the squares of an
eccentricity, per motor inertia.
"""

SQUARES = frozenset(name for name, (first, *_) in TIES.items() if name[:5] == first[:5])
"""Those that follow from others of their own row: too small to be sought each for itself."""

COEFFICIENT_UNITS: dict[str, str] = {
    "theta1": "1/s^2",
    "theta2": "1/s^2",
    "theta_cosine": "1/s^2",
    "theta_viscous": "1/s",
    "theta_damping": "1/s",
    "theta_coulomb": "rad/s^2",
    "theta_cubic": "1/(rad^2 s^2)",
    "theta_offset": "rad/s^2",
    "theta_drag": "1/rad",
    "theta_ecc_sine": "rad/s^2",
    "theta_ecc_cosine": "rad/s^2",
    "theta_hysteresis": "rad/s^2",
    "theta_backlash": "rad/s^2",
    "theta_bend": "1/s^2",
    "theta_lopsided": "1/(rad s^2)",
    "alpha1": "1/s^2",
    "alpha2": "1/s",
    "alpha_damping": "1/s",
    "alpha_coulomb": "rad/s^2",
    "alpha_cubic": "1/(rad^2 s^2)",
    "alpha_offset": "rad/s^2",
    "alpha_stribeck": "rad/s^2",
    "alpha_drag": "1/rad",
    "alpha_saturation": "rad/s^2/({input})^3",
    "alpha_ripple_sine": "rad/s^2",
    "alpha_ripple_cosine": "rad/s^2",
    "alpha_ecc_sine": "rad/s^2",
    "alpha_ecc_cosine": "rad/s^2",
    "alpha_ecc_sine_square": "rad/s^2",
    "alpha_ecc_cosine_square": "rad/s^2",
    "alpha_ecc_product": "rad/s^2",
    "alpha_hysteresis": "rad/s^2",
    "alpha_backlash": "rad/s^2",
    "alpha_bend": "1/s^2",
    "alpha_lopsided": "1/(rad s^2)",
    "beta1": "rad/s^2/{input}",
    "hysteresis_grip": "1/rad",
}
"""Unit of every coefficient; ``{input}`` stands for the unit of the input."""

DISSIPATIVE = frozenset(
    {"alpha2", "alpha_damping", "alpha_coulomb", "alpha_hysteresis", "alpha_drag"}
    | {"theta_viscous", "theta_damping", "theta_coulomb", "theta_hysteresis", "theta_drag"}
    | {"gamma_viscous", "gamma_coulomb"}
)
"""Frictions and dampings, which no drive has negative."""

PAPER_TERMS = ("gravity", "motor_viscous")
"""The terms of Huang (2003), eq. (4)."""


def flexible_joint(
    terms: Collection[str] = PAPER_TERMS,
    known: Mapping[str, float] | None = None,
    coulomb_velocity: float = COULOMB_VELOCITY,
) -> ParametricSystem:
    """Declare a flexible joint.

    Parameters
    ----------
    terms : collection of str, optional
        Names out of `TERMS` and `SHAPE_TERMS`; their order does not matter.
    known : mapping of str to float, optional
        Coefficients whose value is known, for example ``{"beta1": 1 / 0.3}``; they move from the
        unknown coefficients to the known part.
    coulomb_velocity : float, optional
        Velocity in rad/s over which Coulomb friction changes sign. Where there is any, it is a
        constant of the model: another value needs no other kernel.

    Returns
    -------
    ParametricSystem
        Rows ``link`` and ``motor``, states x1 to x4, input u. The model of the paper is
        ``flexible_joint(known={"beta1": 1 / motor_inertia})``.

    Raises
    ------
    SettingError
        If a term or a known coefficient does not exist, or the velocity is not positive.
    """
    known = dict(known or {})
    every = TERMS | SHAPE_TERMS
    check_terms(terms, every)
    # Huang (2003) numbers theta1 before theta2, so gravity comes before the spring.
    chosen = [TERMS["gravity"]] * ("gravity" in terms) + [_COMPLIANCE]
    chosen += [term for name, term in every.items() if name in terms and name != "gravity"]
    link = {c: r for term in chosen for c, r in term.link.items()}
    motor = {c: r for term in chosen for c, r in term.motor.items()} | {"beta1": "u"}
    return ParametricSystem(
        "flexible joint",
        (
            declared_row("link", "x1", "x2", link, known),
            declared_row("motor", "x3", "x4", motor, known),
        ),
        constants=model_constants(link | motor, known, coulomb_velocity)
        | {s: w for s, w in _ANY_SHAPE.items() if any(s in r for r in (link | motor).values())},
        memories=tuple(term.memory for term in chosen if term.memory),
    )
