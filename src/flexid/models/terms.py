"""Terms that are switched on by name, and how they become the row of a system."""

import tomllib
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path
from typing import Any

from flexid.errors import SettingError, did_you_mean
from flexid.models.motion import JointType
from flexid.models.parametric_system import Memory, ParametricSystem, Row

DECLARED: Mapping[str, Any] = tomllib.loads(
    Path(__file__).with_name("joint.toml").read_text("utf-8")
)
"""What ``joint.toml`` declares of joints and arms."""

# Huang (2003) numbers theta1 before theta2, so gravity comes before the spring.
CONTENTS: Sequence[Mapping[str, Any]] = [
    DECLARED["terms"]["gravity"],
    DECLARED["spring"],
    *(content for name, content in DECLARED["terms"].items() if name != "gravity"),
    *DECLARED["shapes"].values(),
]
"""The same of all terms of the flexible joint, in the order of their coefficients."""

COULOMB_VELOCITY: Mapping[JointType, float] = {"revolute": 0.1, "prismatic": 0.005}
"""Velocity in rad/s or m/s over which the smoothed Coulomb friction, a tanh, changes sign."""

SMOOTHING = "coulomb_velocity"
"""The constant of that name in the regressors of Coulomb friction."""


@dataclass(frozen=True)
class Term:
    """A term of the flexible joint: the coefficients it adds to each row, with their regressors.

    A regressor may use the state of a memory, which the term then brings with it, or a constant
    that is sought with them.
    """

    description: str
    link: Mapping[str, str]
    motor: Mapping[str, str]
    memory: Memory | None = None
    constant: str | None = None

    @staticmethod
    def declared(content: Mapping[str, Any]) -> "Term":
        """A term as ``joint.toml`` has it."""
        link, motor = (
            {name: regressor for name, (regressor, _) in content.get(side, {}).items()}
            for side in ("link", "motor")
        )
        memory = Memory(**content["memory"]) if "memory" in content else None
        return Term(content["description"], link, motor, memory, content.get("constant"))

    @property
    def nonlinear(self) -> str | None:
        """The coefficient in which it is not linear, if there is one."""
        return self.memory.grip if self.memory else self.constant

    @property
    def coefficients(self) -> tuple[str, ...]:
        """All that it adds."""
        return (*self.link, *self.motor, *((self.nonlinear,) if self.nonlinear else ()))


def check_terms(terms: Iterable[str], known_terms: Collection[str]) -> None:
    """Raise `SettingError` for a term that does not exist."""
    for term in terms:
        if term not in known_terms:
            raise SettingError("terms", f"{term!r} is unknown{did_you_mean(term, known_terms)}")


def declared_row(
    name: str,
    coordinate: str,
    velocity: str,
    regressors: Mapping[str, str],
    known: Collection[str],
) -> Row:
    """Declare a row, with the terms of known coefficients in its known part."""
    unknown = {c: r for c, r in regressors.items() if c not in known}
    known_part = " + ".join(f"{c}*({r})" for c, r in regressors.items() if c in known)
    return Row(name, coordinate, velocity, unknown, known_part or "0")


def model_constants(
    regressors: Mapping[str, str], known: Mapping[str, float], coulomb_velocity: float
) -> dict[str, float]:
    """Values of the constants that a model's expressions use: what is known, and the smoothing."""
    for coefficient in known:
        if coefficient not in regressors:
            raise SettingError(
                "known",
                f"{coefficient!r} is no coefficient of this model; it has {', '.join(regressors)}",
            )
    if not (isfinite(coulomb_velocity) and coulomb_velocity > 0):
        raise SettingError(SMOOTHING, f"{coulomb_velocity:g} is not positive: give a velocity")
    smoothed = any(SMOOTHING in regressor for regressor in regressors.values())
    return dict(known) | ({SMOOTHING: coulomb_velocity} if smoothed else {})


def with_dry_friction(system: ParametricSystem) -> ParametricSystem:
    """The same system with Coulomb friction that is set-valued instead of smoothed.

    The sign of a velocity takes the place of its hyperbolic tangent. The prediction error locates
    the instants at which such a friction reverses, sticks and lets go; nothing is left to choose.
    """
    constants = {name: value for name, value in system.constants.items() if name != SMOOTHING}
    name, rows = f"{system.name}, dry friction", _rewritten(system, _SMOOTHED, "sign({v})")
    return replace(system, name=name, rows=rows, constants=constants)


def without_jumps(system: ParametricSystem, joint: JointType) -> ParametricSystem:
    """The same with the sign of a row's own velocity smoothed as Coulomb friction is."""
    rows = _rewritten(system, "sign({v})", _SMOOTHED)
    if rows == system.rows:
        return system
    constants = {SMOOTHING: COULOMB_VELOCITY[joint], **system.constants}
    return ParametricSystem(system.name, rows, system.inputs, constants)


_SMOOTHED = f"tanh({{v}}/{SMOOTHING})"


def _rewritten(system: ParametricSystem, old: str, new: str) -> tuple[Row, ...]:
    """Rows with other text for some function of their own velocity v."""

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
