"""Planar serial arm with elastic joints that turn or slide."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from flexid.models.flexible_joint import DECLARED, STRIBECK_EXPONENT, STRIBECK_VELOCITY
from flexid.models.motion import JointType
from flexid.models.torque_balance import BodyTerm, JointTerm, TorqueBalance

STRIBECK_CONSTANTS = (STRIBECK_VELOCITY, STRIBECK_EXPONENT)
"""Constants of each joint's Stribeck friction, without the joint's number."""

JOINT_TERMS = tuple(JointTerm(name, **content) for name, content in DECLARED["arm"].items())
"""Terms that every joint of an arm may have; each torque but the input opposes the motion."""


@dataclass(frozen=True)
class PlanarArm:
    """Known geometry of a planar serial arm."""

    lengths: tuple[float, ...]  # distance in m from each joint to the next; any for the last link
    # acceleration in m/s² along link 1 at q1 = 0, and across it towards positive angles
    gravity: tuple[float, float] = (0.0, 0.0)
    source: str = "arm"  # file that declares the arm, for messages
    # direction of each joint that slides: angle in rad from the link before; None: the joint turns.
    # Empty if all joints turn
    slides: tuple[float | None, ...] = ()
    # velocity, in rad/s or m/s, and exponent of each motor's Stribeck friction; empty before a fit
    stribeck: tuple[tuple[float, float], ...] = ()

    @property
    def joints(self) -> int:
        """Number of joints."""
        return len(self.lengths)

    @property
    def has_gravity(self) -> bool:
        """Whether gravity acts in the arm's plane."""
        return self.gravity != (0.0, 0.0)

    @property
    def types(self) -> tuple[JointType, ...]:
        """Type of each joint."""
        angles = self.slides or (None,) * self.joints
        return tuple("revolute" if angle is None else "prismatic" for angle in angles)


# A link has mass m, distance c from joint to centre of mass, inertia I about its joint, and carries
# the mass m' at its end: link_inertia is I + m' l², link_moment is m c + m' l. A link that slides
# turns with the link before: that link's inertia includes its inertia, and link_mass is its mass.
def planar_arm(arm: PlanarArm) -> TorqueBalance:
    """Declare the torque balance of an arm in base parameters."""
    constants = {f"l{i}": length for i, length in enumerate(arm.lengths, 1)}
    constants |= {"gx": arm.gravity[0], "gy": arm.gravity[1]}
    constants |= {f"d{i}": angle for i, angle in enumerate(arm.slides, 1) if angle is not None}
    links = _Links(arm.types)
    for i, law in enumerate(arm.stribeck or ((1.0, 2.0),) * arm.joints, 1):
        names = (f"{name}_{i}" for name in STRIBECK_CONSTANTS)
        constants |= dict(zip(names, law, strict=True))
    body = tuple(term for k in range(1, arm.joints + 1) for term in links.terms(k))
    return TorqueBalance(f"planar arm of {arm.joints}", arm.types, JOINT_TERMS, body, constants)


def carried_links(balance: TorqueBalance, joint: int) -> list[str]:
    """Return the names of the inertias, or masses, that a joint moves, its own link's first."""
    kind = "mass" if balance.types[joint - 1] == "prismatic" else "inertia"
    names = (f"link_{kind}_{k}" for k in range(joint, balance.joints + 1))
    return [name for name in names if name in balance.coefficients]


class _Part(NamedTuple):
    """Part of a velocity: an amount, and its direction along and across a link."""

    amount: str
    along: str
    across: str


class _Links(NamedTuple):
    """Energies of the links of an arm."""

    types: Sequence[JointType]

    def terms(self, k: int) -> Iterator[BodyTerm]:
        """Yield the parameters of link k."""
        speed = self._sum("v", 1, k)
        parts = [*self._velocity(k)]
        if self.types[k - 1] == "revolute":
            yield BodyTerm(f"link_inertia_{k}", k, f"({speed})**2/2", "0", "kg m^2", 1)
        else:
            along = " + ".join(f"{p.amount}*{p.along}" for p in parts)
            across = " + ".join(f"{p.amount}*{p.across}" for p in parts)
            kinetic = f"(({along})**2 + ({across})**2)/2"
            yield BodyTerm(f"link_mass_{k}", k, kinetic, self._height(k), "kg", 1)
        if speed == "0":
            return
        angle = self._sum("q", 1, k)
        energies = {
            "along": (
                [f"{p.amount}*({speed})*{p.across}" for p in parts],
                f"-gx*cos({angle}) - gy*sin({angle})",
            ),
            "across": (
                [f"-{p.amount}*({speed})*{p.along}" for p in parts],
                f"gx*sin({angle}) - gy*cos({angle})",
            ),
        }
        for name, (kinetic, weight) in energies.items():
            total = " + ".join(["0", *kinetic])
            yield BodyTerm(f"link_moment_{name}_{k}", k, total, weight, "kg m")
        carrying = self._sum("v", 1, k - 1)
        # The rotor of a joint that slides has its axis in the plane, like a screw: no coupling.
        if self.types[k - 1] == "revolute" and carrying != "0":
            coupling = f"w{k}*({carrying})"
            yield BodyTerm(f"rotor_coupling_{k}", k, coupling, "0", "kg m^2", 1)

    def _sum(self, letter: str, first: int, last: int) -> str:
        """Sum over the joints that turn: the angle or speed of a link."""
        joints = range(first, last + 1)
        return " + ".join(f"{letter}{i}" for i in joints if self.types[i - 1] == "revolute") or "0"

    def _sliding(self, k: int) -> list[int]:
        return [j for j in range(1, k + 1) if self.types[j - 1] == "prismatic"]

    def _velocity(self, k: int) -> Iterator[_Part]:
        """Yield the parts of the velocity of joint k, along and across link k."""
        for i in range(1, k):
            if (speed := self._sum("v", 1, i)) != "0":
                apart = self._sum("q", i + 1, k)
                yield _Part(f"l{i}*({speed})", f"sin({apart})", f"cos({apart})")
        for j in self._sliding(k):
            apart = f"d{j} - ({self._sum('q', j + 1, k)})"
            yield _Part(f"v{j}", f"cos({apart})", f"sin({apart})")
            if (speed := self._sum("v", 1, j)) != "0":
                yield _Part(f"q{j}*({speed})", f"(-sin({apart}))", f"cos({apart})")

    def _height(self, k: int) -> str:
        """Potential energy of a unit mass at joint k."""
        lengths = [(f"l{i}", self._sum("q", 1, i)) for i in range(1, k)]
        lengths += [(f"q{j}", f"{self._sum('q', 1, j)} + d{j}") for j in self._sliding(k)]
        return " + ".join(
            f"{length}*(-gx*cos({angle}) - gy*sin({angle}))" for length, angle in lengths
        )
