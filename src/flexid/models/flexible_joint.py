"""The single-link flexible joint of Huang (2003), eq. (4), with terms that can be switched on.

    x1' = x2
    x2' = -theta1 sin x1 - theta2 (x1 - x3)
    x3' = x4
    x4' = alpha1 (x1 - x3) - alpha2 x4 + beta1 u

x1, x2 are position and velocity of the link, x3, x4 those of the motor at the link side of the
gear, u is the motor torque (or the voltage or current that causes it).
"""

from collections.abc import Collection, Mapping
from dataclasses import replace

from flexid.models.parametric_system import ParametricSystem
from flexid.models.terms import (
    COULOMB_VELOCITY,
    SMOOTHING,
    Term,
    check_terms,
    declared_row,
    model_constants,
)

STOPPING = "stopping_time"
"""The constant of that name in the friction of the term ``motor_stiction``, in s."""

_HOLDING = {
    "alpha1": "x1 - x3",
    "alpha2": "-x4",
    "alpha_damping": "x2 - x4",
    "alpha_cubic": "(x1 - x3)**3",
    "alpha_offset": "1",
    "beta1": "u",
}  # what accelerates the motor beside Coulomb friction

_NO_HOLDING = {STOPPING: 0.0, **{f"nominal_{coefficient}": 0.0 for coefficient in _HOLDING}}
_LOAD = " + ".join(f"nominal_{coefficient}*({r})" for coefficient, r in _HOLDING.items())
_ARGUMENT = f"(x4 + {STOPPING}*({_LOAD}))/{SMOOTHING}"
# Minus the derivative of the tanh by the logarithm of the stopping time; its width goes along.
_SPREAD = f"(1 - tanh({_ARGUMENT})**2)*x4/{SMOOTHING}"

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
        "Coulomb friction of the motor, smoothed", {}, {"alpha_coulomb": f"-tanh(x4/{SMOOTHING})"}
    ),
    "motor_stiction": Term(
        "Coulomb friction of the motor that holds it at rest; takes the place of motor_coulomb",
        {},
        {"alpha_coulomb": f"-tanh({_ARGUMENT})", "alpha_holding": _SPREAD},
    ),
    "link_coulomb": Term(
        "Coulomb friction of the link, smoothed", {"theta_coulomb": f"-tanh(x2/{SMOOTHING})"}, {}
    ),
    "cubic_stiffness": Term(
        "cubic hardening of the joint spring",
        {"theta_cubic": "-(x1 - x3)**3"},
        {"alpha_cubic": "(x1 - x3)**3"},
    ),
    "link_offset": Term("constant torque or sensor offset, link", {"theta_offset": "1"}, {}),
    "motor_offset": Term("constant torque or sensor offset, motor", {}, {"alpha_offset": "1"}),
}
"""Terms that can be switched on beside the joint spring, which is always there."""

COEFFICIENT_UNITS: dict[str, str] = {
    "theta1": "1/s^2",
    "theta2": "1/s^2",
    "theta_cosine": "1/s^2",
    "theta_viscous": "1/s",
    "theta_damping": "1/s",
    "theta_coulomb": "rad/s^2",
    "theta_cubic": "1/(rad^2 s^2)",
    "theta_offset": "rad/s^2",
    "alpha1": "1/s^2",
    "alpha2": "1/s",
    "alpha_damping": "1/s",
    "alpha_coulomb": "rad/s^2",
    "alpha_holding": "rad/s^2",
    "alpha_cubic": "1/(rad^2 s^2)",
    "alpha_offset": "rad/s^2",
    "beta1": "rad/s^2/{input}",
}
"""Unit of every coefficient; ``{input}`` stands for the unit of the input."""

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
        Names out of `TERMS`; their order does not matter.
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
    check_terms(terms, TERMS)
    # Huang (2003) numbers theta1 before theta2, so gravity comes before the spring.
    chosen = [TERMS["gravity"]] * ("gravity" in terms) + [_COMPLIANCE]
    chosen += [term for name, term in TERMS.items() if name in terms and name != "gravity"]
    link = {c: r for term in chosen for c, r in term.link.items()}
    motor = {c: r for term in chosen for c, r in term.motor.items()} | {"beta1": "u"}
    return ParametricSystem(
        "flexible joint",
        (
            declared_row("link", "x1", "x2", link, known),
            declared_row("motor", "x3", "x4", motor, known),
        ),
        constants=model_constants(link | motor, known, coulomb_velocity)
        | (_NO_HOLDING if "motor_stiction" in terms else {}),
    )


def with_stopping_time(
    system: ParametricSystem, stopping_time: float, values: Mapping[str, float]
) -> ParametricSystem:
    """Give the friction of the term ``motor_stiction`` the time in which it stops the motor.

    Coulomb friction that depends on the velocity alone lets a joint creep under a load that it
    should hold. Here it is the torque that would bring the motor to rest within the stopping time
    T, whatever else accelerates the motor, up to the Coulomb friction: at rest it opposes the load,
    as in Karnopp (1985), and at speed it is Coulomb's,

        alpha_coulomb tanh((x4 + T a) / (alpha_coulomb T)),

    where a is the motor's acceleration without it, computed from the values of an earlier fit.
    The coefficient alpha_holding is alpha_coulomb times a small change of ln T: zero if T is right,
    and sought to have the uncertainty of T in that of the other coefficients.

    Parameters
    ----------
    system : ParametricSystem
        A flexible joint with that term.
    stopping_time : float
        In s.
    values : mapping of str to float
        Coefficients of the motor's row; alpha_coulomb among them, others that are missing are 0.

    Returns
    -------
    ParametricSystem
        With the same equations and other constants, so that no kernel is made anew.
    """
    nominal = {f"nominal_{c}": values.get(c, system.constants.get(c, 0.0)) for c in _HOLDING}
    width = {SMOOTHING: stopping_time * abs(values["alpha_coulomb"])}
    return replace(
        system, constants={**system.constants, STOPPING: stopping_time, **width, **nominal}
    )
