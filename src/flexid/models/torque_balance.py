"""A torque balance Σ_k π_k φ_k(q, v, a, u) = 0: linear in π and affine in accelerations."""

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

from flexid.models.motion import JointType

Place = Literal["link", "motor", "spring", "input"]
"""Where a joint term acts: on one side, on both with opposite signs, or as the motor's torque."""


@dataclass(frozen=True)
class JointTerm:
    """A torque that every joint has."""

    name: str  # of its parameter; that of joint 2 is the name and ``_2``
    place: Place  # where it acts. A spring acts on both sides
    # torque per unit of the parameter, opposed to the motion: a function of q, v and a of its side,
    # of which the spring has differences, motor less link; of an input, of u
    expression: str
    unit: str  # of the parameter
    sign: int = 0  # 1 if no joint has it negative
    start: float = 0.0  # value where the log shows nothing of it
    usual: bool = True  # sought in any case, or where it makes a fit better alone
    meaning: str = ""  # what the parameter is, for the manual


@dataclass(frozen=True)
class BodyTerm:
    """A parameter of the bodies that the links carry, declared by its energies."""

    name: str  # of the parameter
    joint: int  # number of the joint in whose table it stands
    # energies per unit of the parameter: functions of the links' angles q1 ... and speeds v1 ...,
    # the motors' speeds w1 ..., and the constants
    kinetic: str
    potential: str
    unit: str  # of the parameter
    sign: int = 0  # 1 if it is never negative
    meaning: str = ""  # what the parameter is, for the manual


@dataclass(frozen=True)
class BalanceRow:
    """The balance of one coordinate."""

    name: str  # such as link_1
    coordinate: str
    velocity: str


@dataclass(frozen=True)
class TorqueBalance:
    """Balances of n joints: of link 1, motor 1, link 2, motor 2, and so on."""

    name: str
    types: tuple[JointType, ...]  # how each joint moves
    joint_terms: tuple[JointTerm, ...]  # what every joint has
    body_terms: tuple[BodyTerm, ...]  # what couples them
    # what is known, by name: lengths and gravity. The values are no part of the equations
    constants: Mapping[str, float] = field(default_factory=dict)

    @property
    def joints(self) -> int:
        """How many."""
        return len(self.types)

    def placed(self) -> Iterator[tuple[str, int, JointTerm | BodyTerm]]:
        """Each parameter with its joint and its declaration, joint by joint."""
        for joint in range(1, self.joints + 1):
            for term in self.joint_terms:
                yield f"{term.name}_{joint}", joint, term
            for term in self.body_terms:
                if term.joint == joint:
                    yield term.name, joint, term

    @cached_property
    def unusual(self) -> tuple[str, ...]:
        """Names of the parameters that are sought only where they make a fit better."""
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
    def rows(self) -> tuple[BalanceRow, ...]:
        """The balances, in order."""
        return tuple(
            row
            for i in range(1, self.joints + 1)
            for row in (
                BalanceRow(f"link_{i}", f"q{i}", f"v{i}"),
                BalanceRow(f"motor_{i}", f"t{i}", f"w{i}"),
            )
        )

    @property
    def states(self) -> tuple[str, ...]:
        """Position and velocity of each row in turn."""
        return tuple(name for row in self.rows for name in (row.coordinate, row.velocity))

    @property
    def inputs(self) -> tuple[str, ...]:
        """The motors' inputs."""
        return tuple(f"u{i}" for i in range(1, self.joints + 1))

    @property
    def digest(self) -> str:
        """Hash of the equations, which the values of the constants are no part of."""
        terms = [
            [name, joint, type(term).__name__, *_text(term)] for name, joint, term in self.placed()
        ]
        content = ["torque balance", self.joints, terms, sorted(self.constants)]
        return hashlib.sha256(json.dumps(content).encode()).hexdigest()


def _text(term: JointTerm | BodyTerm) -> list[str]:
    if isinstance(term, JointTerm):
        return [term.place, term.expression]
    return [term.kinetic, term.potential]
