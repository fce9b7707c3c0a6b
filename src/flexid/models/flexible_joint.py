"""The single-link flexible joint of Huang (2003), eq. (4), with terms that can be switched on."""

import re
import tomllib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path
from typing import Any

from flexid.errors import SettingError, check_names
from flexid.models.motion import JointType
from flexid.models.parametric_system import Memory, ParametricSystem, Row

DECLARED: Mapping[str, Any] = tomllib.loads(
    Path(__file__).with_name("joint.toml").read_text("utf-8")
)
"""Declarations of joints and arms in ``joint.toml``."""

# Huang (2003) numbers theta1 before theta2, so gravity comes before the spring.
CONTENTS: Sequence[Mapping[str, Any]] = [
    DECLARED["terms"]["gravity"],
    DECLARED["spring"],
    *(content for name, content in DECLARED["terms"].items() if name != "gravity"),
    *DECLARED["shapes"].values(),
]
"""Declarations of all terms of the flexible joint, in the order of their coefficients."""

COULOMB_VELOCITY: Mapping[JointType, float] = {"revolute": 0.1, "prismatic": 0.005}
"""Velocity in rad/s or m/s over which the smoothed Coulomb friction, a tanh, changes sign."""

SMOOTHING = "coulomb_velocity"  # name of this velocity in the regressors of Coulomb friction


@dataclass(frozen=True)
class Term:
    """Term of the flexible joint: its coefficients in each row, with their regressors."""

    description: str
    link: Mapping[str, str]
    motor: Mapping[str, str]
    memory: Memory | None = None
    constant: str | None = None

    @staticmethod
    def declared(content: Mapping[str, Any]) -> "Term":
        """Make a term from its table in ``joint.toml``."""
        link, motor = (
            {name: regressor for name, (regressor, _) in content.get(side, {}).items()}
            for side in ("link", "motor")
        )
        memory = Memory(**content["memory"]) if "memory" in content else None
        return Term(content["description"], link, motor, memory, content.get("constant"))

    @property
    def nonlinear(self) -> str | None:
        """Name of the grip or constant in which the term is nonlinear, if there is one."""
        return self.memory.grip if self.memory else self.constant

    @property
    def coefficients(self) -> tuple[str, ...]:
        """Names of all coefficients that the term adds."""
        return (*self.link, *self.motor, *((self.nonlinear,) if self.nonlinear else ()))


def _declared(
    name: str,
    rows: Mapping[str, tuple[str, str, Mapping[str, str]]],  # coordinate, velocity, regressors
    known: Mapping[str, float],
    coulomb_velocity: float,
    memories: tuple[Memory, ...] = (),
) -> ParametricSystem:
    """Declare a joint; terms of known coefficients go to the known parts of their rows."""
    regressors = {c: r for _, _, own in rows.values() for c, r in own.items()}
    for coefficient in known:
        if coefficient not in regressors:
            raise SettingError(
                "known",
                f"{coefficient!r} is no coefficient of this model; it has {', '.join(regressors)}",
            )
    if not (isfinite(coulomb_velocity) and coulomb_velocity > 0):
        raise SettingError(SMOOTHING, f"{coulomb_velocity:g} is not positive: give a velocity")
    defaults = {SMOOTHING: coulomb_velocity}
    defaults |= {constant: value for constant, (value, _) in DECLARED["constants"].items()}
    used = " ".join(regressors.values())
    return ParametricSystem(
        name,
        tuple(
            Row(
                row,
                coordinate,
                velocity,
                {c: r for c, r in own.items() if c not in known},
                " + ".join(f"{c}*({r})" for c, r in own.items() if c in known) or "0",
            )
            for row, (coordinate, velocity, own) in rows.items()
        ),
        constants={**known, **{c: value for c, value in defaults.items() if c in used}},
        memories=memories,
    )


def with_dry_friction(system: ParametricSystem) -> ParametricSystem:
    """Return the system with set-valued Coulomb friction instead of tanh."""
    constants = {name: value for name, value in system.constants.items() if name != SMOOTHING}
    name, rows = f"{system.name}, dry friction", _rewritten(system, _SMOOTHED, "sign({v})")
    return replace(system, name=name, rows=rows, constants=constants)


def without_jumps(system: ParametricSystem, joint: JointType) -> ParametricSystem:
    """Return the system with the sign of each row's velocity smoothed like Coulomb friction."""
    rows = _rewritten(system, "sign({v})", _SMOOTHED)
    if rows == system.rows:
        return system
    constants = {SMOOTHING: COULOMB_VELOCITY[joint], **system.constants}
    return ParametricSystem(system.name, rows, system.inputs, constants)


_SMOOTHED = f"tanh({{v}}/{SMOOTHING})"


def _rewritten(system: ParametricSystem, old: str, new: str) -> tuple[Row, ...]:
    """Replace one function of a row's own velocity v by another, as text, in all rows."""

    def written(text: str, row: Row) -> str:
        return text.replace(old.format(v=row.velocity), new.format(v=row.velocity))

    return tuple(
        replace(
            row,
            regressors={c: written(text, row) for c, text in row.regressors.items()},
            known=written(row.known, row),
        )
        for row in system.rows
    )


_COMPLIANCE = Term.declared(DECLARED["spring"])

TERMS = {name: Term.declared(content) for name, content in DECLARED["terms"].items()}
"""Terms that can be switched on; the joint spring is always there."""

SHAPE_TERMS = {name: Term.declared(content) for name, content in DECLARED["shapes"].items()}
"""Less usual terms, which can be switched on too; each is a family of shapes."""

STRIBECK_VELOCITY = "stribeck_velocity"
STRIBECK_EXPONENT = "stribeck_exponent"  # friction falls as exp(-|v/velocity|^exponent)
BACKLASH_WIDTH = "backlash_width"
SPRING_CENTRE = "spring_centre"
CONTACT_DEFLECTION = "contact_deflection"
CONTACT_DAMPING = "contact_damping"  # 1 if the spring has no damping in its gap, otherwise 0
BEND_DEFLECTION = "bend_deflection"
RIPPLE_NUMBER = "ripple_number"
ERROR_NUMBER = "error_number"
ANGLE_ORIGIN = "angle_origin"
HYSTERESIS_GRIP = "hysteresis_grip"
PRESLIDING_GRIP = "presliding_grip"

GRIPS = tuple(term.memory.grip for term in SHAPE_TERMS.values() if term.memory)
"""Coefficients in which terms with memory are nonlinear: one over a path, in 1/rad."""

SHAPES = tuple(DECLARED["constants"])
"""Constants of these terms: widths of their shapes, centre or origin."""

SOUGHT_CONSTANTS = frozenset(term.constant for term in SHAPE_TERMS.values() if term.constant)
"""Constants that are estimated together with the coefficients of their terms."""

_USABLE = {SPRING_CENTRE, CONTACT_DEFLECTION, CONTACT_DAMPING, STRIBECK_EXPONENT}
WIDTHS = tuple(name for name in SHAPES if name not in _USABLE)
"""Constants without a usable default; the others are 0 unless they are given."""

CONSTANT_UNITS = {SMOOTHING: "rad/s"} | {
    name: unit for name, (_, unit) in DECLARED["constants"].items()
}
"""Unit of each constant that a term may have."""

_EVERY = DECLARED["terms"] | DECLARED["shapes"]

SQUARES: frozenset[str] = frozenset(
    name for one in _EVERY.values() for name in one.get("squares", ())
)
"""Coefficients that follow from others of their row, too small to be estimated separately."""

# A spring acts on both sides: a/Jl = (a/Jr) theta2/alpha1. An eccentricity has squares as well.
TIES: dict[str, tuple[str, str, str]] = {
    link: (motor, "theta2", "alpha1")
    for one in _EVERY.values()
    for link, motor in zip(one.get("link", ()), one.get("motor", ()), strict=False)
} | {
    name: (first, second, "alpha1")
    for one in _EVERY.values()
    for name, (first, second) in one.get("squares", {}).items()
}
"""Coefficients that follow from three others: the first times the second over the third."""

COEFFICIENT_UNITS: dict[str, str] = {
    **{
        name: unit
        for side in ("link", "motor")
        for content in CONTENTS
        for name, (_, unit) in content.get(side, {}).items()
    },
    "beta1": "rad/s^2/{input}",
    **dict.fromkeys(GRIPS, "1/rad"),
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
"""Coefficients of friction and damping, which are never negative."""

SPRING = _COMPLIANCE.coefficients  # coefficients of the joint spring, in the rows of link and motor

POSITIVE = frozenset({*SPRING, "beta1"})
"""Coefficients of stiffness and inertia, which are always positive."""

HARDENING = frozenset(TERMS["cubic_stiffness"].coefficients)
"""Coefficients of a spring that hardens or softens."""

PLAY = frozenset(SHAPE_TERMS["backlash"].coefficients)
"""Coefficients of play."""

DAMPING = frozenset(TERMS["joint_damping"].coefficients)
"""Coefficients of the damping of the spring."""

HYSTERESIS = frozenset(SHAPE_TERMS["spring_hysteresis"].coefficients)
"""Coefficients of the hysteresis of the spring."""

SATURATION = frozenset(SHAPE_TERMS["torque_saturation"].coefficients)
"""Coefficients of the saturation of the torque at large inputs."""


def resonance(coefficients: Mapping[str, float]) -> float:
    """Return the joint's resonance in rad/s; a missing stiffness coefficient counts as 0."""
    return float(sum(abs(coefficients.get(name, 0.0)) for name in SPRING)) ** 0.5


def coefficients_of(term: str) -> tuple[str, ...]:
    """Return the coefficients of a term, and of its counterpart in the rigid joint."""
    return (*TERMS[term].coefficients, *_RIGID.get(DECLARED["terms"][term].get("rigid"), ()))


DRY_FRICTIONS = frozenset(
    c for term in ("link_coulomb", "motor_coulomb") for c in coefficients_of(term)
)
"""Coefficients of Coulomb friction, which depends on the direction alone."""

ANGULAR_TERMS = frozenset(name for name, one in _EVERY.items() if one.get("angular"))
"""Terms that repeat with the angle of a link; a link that slides has none."""

PERIODIC_TERMS = frozenset(
    name
    for name, term in SHAPE_TERMS.items()
    if any(ANGLE_ORIGIN in regressor for regressor in (*term.link.values(), *term.motor.values()))
)
"""Terms that are periodic in the motor's position, with angles that count from `ANGLE_ORIGIN`."""

PAPER_TERMS = ("gravity", "motor_viscous")  # of Huang (2003), eq. (4)


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
        Velocity in rad/s over which Coulomb friction changes sign, if there is any. It is a
        constant of the model, so another value needs no other kernel.

    Returns
    -------
    ParametricSystem
        Rows ``link`` and ``motor``, states x1 to x4, input u. The model of the paper is
        ``flexible_joint(known={"beta1": 1 / motor_inertia})``:
        x2' = -theta1 sin x1 - theta2 (x1 - x3), x4' = alpha1 (x1 - x3) - alpha2 x4 + beta1 u.

    Raises
    ------
    SettingError
        If a term or a known coefficient does not exist, or the velocity is not positive.
    """
    every = TERMS | SHAPE_TERMS
    terms = (terms,) if isinstance(terms, str) else terms
    check_names("terms", terms, every)
    chosen = [TERMS["gravity"]] * ("gravity" in terms) + [_COMPLIANCE]
    chosen += [term for name, term in every.items() if name in terms and name != "gravity"]
    link = {c: r for term in chosen for c, r in term.link.items()}
    motor = {c: r for term in chosen for c, r in term.motor.items()} | {"beta1": "u"}
    if "backlash" in terms:
        link, motor = _with_contact(link), _with_contact(motor)
    rows = {"link": ("x1", "x2", link), "motor": ("x3", "x4", motor)}
    memories = tuple(term.memory for term in chosen if term.memory)
    return _declared("flexible joint", rows, known or {}, coulomb_velocity, memories)


def _with_contact(regressors: Mapping[str, str]) -> dict[str, str]:
    """Return a row's regressors, with hardening and perhaps damping only beyond the contact."""
    own, contact = f"x1 - x3 - {SPRING_CENTRE}", CONTACT_DEFLECTION
    beyond = f"{own} - (abs({own} + {contact}) - abs({own} - {contact}))/2"
    apart = f"(sign({own} + {contact}) - sign({own} - {contact}))/2"
    found = dict(regressors)
    for name in HARDENING & regressors.keys():
        found[name] = regressors[name].replace(own, beyond)
    for name in DAMPING & regressors.keys():
        found[name] = f"({regressors[name]})*(1 - {CONTACT_DAMPING}*{apart})"
    return found


RIGID_TERMS: dict[str, dict[str, str]] = {
    term: {name: regressor for name, (regressor, _) in content.items()}
    for term, content in DECLARED["rigid"].items()
}
"""Terms of the rigid joint that can be switched on, with regressors; the inertia always exists."""

RIGID_UNITS: dict[str, str] = {
    name: unit for content in DECLARED["rigid"].values() for name, (_, unit) in content.items()
} | {"beta1": "rad/s^2/{input}"}
"""Unit of every coefficient; ``{input}`` stands for the unit of the input."""


def rigid_joint(
    terms: Collection[str],
    known: Mapping[str, float] | None = None,
    coulomb_velocity: float = COULOMB_VELOCITY["revolute"],
) -> ParametricSystem:
    """Declare a rigid joint.

    Parameters
    ----------
    terms : collection of str
        Names out of `RIGID_TERMS`; their order does not matter.
    known : mapping of str to float, optional
        Coefficients whose value is known, for example ``{"beta1": 1 / total_inertia}``.
    coulomb_velocity : float, optional
        Velocity in rad/s over which Coulomb friction changes sign; a constant of the model.

    Returns
    -------
    ParametricSystem
        One row ``rigid``, states x1 and x2, input u; beta1 is the inverse of the inertia of motor
        and link together. With all terms x2' = -gamma1 sin x1 - gamma_viscous x2
        - gamma_coulomb tanh(x2/w) + gamma_offset + beta1 u - gamma_asymmetry abs(x2).

    Raises
    ------
    SettingError
        If a term or a known coefficient does not exist, or the velocity is not positive.
    """
    check_names("terms", terms, RIGID_TERMS)
    chosen = [regressors for name, regressors in RIGID_TERMS.items() if name in terms]
    regressors = {c: r for term in chosen for c, r in term.items()} | {"beta1": "u"}
    rows = {"rigid": ("x1", "x2", regressors)}
    return _declared("rigid joint", rows, known or {}, coulomb_velocity)


def joint_model(
    kind: str,  # "flexible", "link" or "rigid"
    terms: Collection[str],
    known: Mapping[str, float],
    coulomb_velocity: float,
    shapes: Mapping[str, float],  # constants of the shapes of unusual terms, by name
) -> ParametricSystem:
    """Declare a joint of some kind, or its link alone, with smoothed friction."""
    if kind == "rigid":
        return rigid_joint(terms, known, coulomb_velocity)
    whole = flexible_joint(terms, known, coulomb_velocity)
    whole = whole.with_constants({name: v for name, v in shapes.items() if name in whole.constants})
    return row_alone(whole, "link") if kind == "link" else whole


def rigid_terms(flexible_terms: Collection[str]) -> tuple[str, ...]:
    """Return the terms of the rigid joint that correspond to terms of a flexible joint."""
    found = {DECLARED["terms"].get(term, {}).get("rigid") for term in flexible_terms}
    return tuple(term for term in RIGID_TERMS if term in found)


def row_alone(system: ParametricSystem, name: str) -> ParametricSystem:
    """Return one row of a system, with the states of the other rows as inputs."""
    row = next(row for row in system.rows if row.name == name)
    others = [state for state in system.states if state not in (row.coordinate, row.velocity)]
    used = {*re.findall(r"[^\W\d]\w*", " ".join([*row.regressors.values(), row.known]))}
    return ParametricSystem(
        f"{system.name}, {name} alone",
        (row,),
        (*others, *(u for u in system.inputs if u in used)),
        {c: value for c, value in system.constants.items() if c in used},
        nonlinear=tuple(name for name in system.nonlinear if name in used),
    )
