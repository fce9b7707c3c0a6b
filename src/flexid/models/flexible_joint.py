"""The single-link flexible joint of Huang (2003), eq. (4), with terms that can be switched on.

    x1' = x2
    x2' = -theta1 sin x1 - theta2 (x1 - x3)
    x3' = x4
    x4' = alpha1 (x1 - x3) - alpha2 x4 + beta1 u

x1, x2 are position and velocity of the link, x3, x4 those of the motor at the link side of the
gear, u is the motor torque (or the voltage or current that causes it).
"""

from collections.abc import Collection, Mapping

from flexid.models.parametric_system import ParametricSystem
from flexid.models.terms import (
    CONTENTS,
    COULOMB_VELOCITY,
    DECLARED,
    SMOOTHING,
    Term,
    check_terms,
    declared_row,
    model_constants,
)

_COMPLIANCE = Term.declared(DECLARED["spring"])

TERMS = {name: Term.declared(content) for name, content in DECLARED["terms"].items()}
"""Terms that can be switched on besides the joint spring, which is always there."""

SHAPE_TERMS = {name: Term.declared(content) for name, content in DECLARED["shapes"].items()}
"""Terms for what a drive may have besides those of `TERMS`; each stands for a family of shapes."""

STRIBECK_VELOCITY = "stribeck_velocity"
BACKLASH_WIDTH = "backlash_width"
SPRING_CENTRE = "spring_centre"
BEND_DEFLECTION = "bend_deflection"
RIPPLE_NUMBER = "ripple_number"
RIPPLE_ORIGIN = "ripple_origin"
HYSTERESIS_GRIP = "hysteresis_grip"

SHAPES = tuple(DECLARED["constants"])
"""Constants of these terms: how wide their shapes are, and where they are or count from."""

SOUGHT_CONSTANTS = frozenset(term.constant for term in SHAPE_TERMS.values() if term.constant)
"""Those that are sought together with the coefficients of their terms."""

WIDTHS = tuple(name for name in SHAPES if name != SPRING_CENTRE)
"""Those without which a term says nothing; a spring is about no deflection unless one is given."""

CONSTANT_UNITS = {SMOOTHING: "rad/s"} | {
    name: unit for name, (_, unit) in DECLARED["constants"].items()
}
"""Unit of each constant that a term may bring."""

_EVERY = DECLARED["terms"] | DECLARED["shapes"]

SQUARES: frozenset[str] = frozenset(
    name for one in _EVERY.values() for name in one.get("squares", ())
)
"""Those that follow from others of their own row: too small to be sought each for itself."""

TIES: dict[str, tuple[str, str, str]] = {
    link: (motor, "theta2", "alpha1")
    for one in _EVERY.values()
    for link, motor in zip(one.get("link", ()), one.get("motor", ()), strict=False)
} | {
    name: (first, second, "alpha1")
    for one in _EVERY.values()
    for name, (first, second) in one.get("squares", {}).items()
}
"""Coefficients that follow from others, the first times the second over the third.

Those of one spring, which acts on both sides: a/Jl = (a/Jr) theta2/alpha1. And the squares of an
eccentricity, per motor inertia.
"""

COEFFICIENT_UNITS: dict[str, str] = {
    **{
        name: unit
        for side in ("link", "motor")
        for content in CONTENTS
        for name, (_, unit) in content.get(side, {}).items()
    },
    "beta1": "rad/s^2/{input}",
    HYSTERESIS_GRIP: "1/rad",
}
"""Unit of every coefficient; ``{input}`` stands for the unit of the input."""

_RIGID: Mapping[str | None, Mapping[str, object]] = DECLARED["rigid"]

DISSIPATIVE = frozenset(
    name
    for one in _EVERY.values()
    if one.get("sign") == 1
    for row in (one.get("link", ()), one.get("motor", ()), _RIGID.get(one.get("rigid"), ()))
    for name in row
)
"""Frictions and dampings, which no drive has negative."""

SPRING = _COMPLIANCE.coefficients
"""Coefficients of the joint spring, in the rows of link and motor."""

POSITIVE = frozenset({*SPRING, "beta1"})
"""Coefficients that no spring and no inertia has negative or zero."""

HARDENING = frozenset(TERMS["cubic_stiffness"].coefficients)
"""Coefficients of a spring that hardens or softens."""

DAMPING = frozenset(TERMS["joint_damping"].coefficients)
"""Coefficients of the damping of the spring."""


def resonance(coefficients: Mapping[str, float]) -> float:
    """Angular frequency in rad/s of the joint on its spring, as far as coefficients say."""
    return float(sum(abs(coefficients.get(name, 0.0)) for name in SPRING)) ** 0.5


def coefficients_of(term: str) -> tuple[str, ...]:
    """Coefficients of a term, and of the one that it becomes in the rigid joint."""
    return (*TERMS[term].coefficients, *_RIGID.get(DECLARED["terms"][term].get("rigid"), ()))


DRY_FRICTIONS = frozenset(
    c for term in ("link_coulomb", "motor_coulomb") for c in coefficients_of(term)
)
"""Coefficients of Coulomb frictions, which depend on the direction alone."""

ANGULAR_TERMS = frozenset(name for name, one in _EVERY.items() if one.get("angular"))
"""Terms that repeat with the angle of a link, which one that slides does not have."""

PAPER_TERMS = ("gravity", "motor_viscous")
"""The terms of Huang (2003), eq. (4)."""


def flexible_joint(
    terms: Collection[str] = PAPER_TERMS,
    known: Mapping[str, float] | None = None,
    coulomb_velocity: float = COULOMB_VELOCITY["revolute"],
) -> ParametricSystem:
    """Declare a flexible joint.

    Parameters
    ----------
    terms : str or collection of str, optional
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
    terms = (terms,) if isinstance(terms, str) else terms
    check_terms(terms, every)
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
        | {
            name: value
            for name, (value, _) in DECLARED["constants"].items()
            if any(name in regressor for regressor in (link | motor).values())
        },
        memories=tuple(term.memory for term in chosen if term.memory),
    )
