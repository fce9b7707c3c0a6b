"""Torque balance Σ_k π_k φ_k(q, v, a, u) = 0: linear in π and affine in accelerations."""

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

from flexid.models.motion import JointType
from flexid.models.parametric_system import Row

Place = Literal["link", "motor", "spring", "input"]
"""Where a joint term acts: on one side, on both with opposite signs, or as the motor's torque."""


@dataclass(frozen=True)
class JointTerm:
    """Torque that every joint has."""

    name: str  # of its parameter, without the joint's number: joint 2 appends ``_2``
    place: Place  # where it acts. A spring acts on both sides
    # torque per unit of the parameter, opposed to the motion: a function of q, v and a of its side,
    # for a spring of their differences (motor minus link), for an input of u. A constant has the
    # joint's number in the balance: ``stribeck_velocity_2``
    expression: str
    unit: str  # of the parameter
    sign: int = 0  # 1 if it is never negative
    start: float = 0.0  # value if the log does not determine it
    usual: bool = True  # True: always estimated; False: only if it improves a fit


@dataclass(frozen=True)
class BodyTerm:
    """Parameter of the bodies that the links carry, declared by its energies."""

    name: str  # of the parameter
    joint: int  # number of the joint whose parameters include it
    # energies per unit of the parameter: functions of the links' angles q1 ... and speeds v1 ...,
    # the motors' speeds w1 ..., and the constants
    kinetic: str
    potential: str
    unit: str  # of the parameter
    sign: int = 0  # 1 if it is never negative


@dataclass(frozen=True)
class TorqueBalance:
    """Balances of n joints: of link 1, motor 1, link 2, motor 2, and so on."""

    name: str
    types: tuple[JointType, ...]  # type of each joint
    joint_terms: tuple[JointTerm, ...]  # terms of every joint
    body_terms: tuple[BodyTerm, ...]  # terms that couple the joints
    # lengths, gravity and Stribeck constants, by name. The equations do not contain the values
    constants: Mapping[str, float] = field(default_factory=dict)

    @property
    def joints(self) -> int:
        """Number of joints."""
        return len(self.types)

    def placed(self) -> Iterator[tuple[str, int, JointTerm | BodyTerm]]:
        """Yield each parameter's name, joint and declaration, joint by joint."""
        for joint in range(1, self.joints + 1):
            for term in self.joint_terms:
                yield f"{term.name}_{joint}", joint, term
            for term in self.body_terms:
                if term.joint == joint:
                    yield term.name, joint, term

    @cached_property
    def unusual(self) -> tuple[str, ...]:
        """Names of the parameters that are estimated only if they improve a fit."""
        return tuple(
            name
            for name, _, term in self.placed()
            if isinstance(term, JointTerm) and not term.usual
        )

    @cached_property
    def coefficients(self) -> tuple[str, ...]:
        """Names of all parameters."""
        return tuple(name for name, _, _ in self.placed())

    @cached_property
    def rows(self) -> tuple[Row, ...]:
        """Name, coordinate and velocity of each balance, in order."""
        return tuple(
            Row(f"{side}_{i}", f"{coordinate}{i}", f"{velocity}{i}", {})
            for i in range(1, self.joints + 1)
            for side, coordinate, velocity in (("link", "q", "v"), ("motor", "t", "w"))
        )

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the position and velocity of each row, row by row."""
        return tuple(name for row in self.rows for name in (row.coordinate, row.velocity))

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the motors' inputs."""
        return tuple(f"u{i}" for i in range(1, self.joints + 1))

    @property
    def digest(self) -> str:
        """Hash of the equations, without the values of the constants."""
        terms = [
            [name, joint, type(term).__name__, *_text(term)] for name, joint, term in self.placed()
        ]
        content = ["torque balance", self.joints, terms, sorted(self.constants)]
        return hashlib.sha256(json.dumps(content).encode()).hexdigest()


def _text(term: JointTerm | BodyTerm) -> list[str]:
    if isinstance(term, JointTerm):
        return [term.place, term.expression]
    return [term.kinetic, term.potential]
