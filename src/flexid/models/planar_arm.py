"""The planar serial arm with elastic joints: its terms, each declared once."""

from dataclasses import dataclass

from flexid.models.flexible_joint import DECLARED
from flexid.models.torque_balance import BodyTerm, JointTerm, TorqueBalance

JOINT_TERMS = tuple(JointTerm(name, **content) for name, content in DECLARED["arm"].items())
"""What every joint of an arm may have: each torque opposes the motion, but for the input."""


@dataclass(frozen=True)
class PlanarArm:
    """A planar serial arm: what is known of it before the log is read."""

    lengths: tuple[float, ...]  # distance in m from each joint to the next; of the last link, any
    # acceleration in m/s² along link 1 at q1 = 0, and across it towards positive angles
    gravity: tuple[float, float] = (0.0, 0.0)
    source: str = "arm"  # where this was read, for messages

    @property
    def joints(self) -> int:
        """Number of joints."""
        return len(self.lengths)

    @property
    def has_gravity(self) -> bool:
        """Whether gravity acts in the arm's plane."""
        return self.gravity != (0.0, 0.0)


def planar_arm(arm: PlanarArm) -> TorqueBalance:
    """The torque balance of an arm in base parameters."""
    n = arm.joints
    body: list[BodyTerm] = []
    for k in range(1, n + 1):
        speed, angle = _sum("v", 1, k), _sum("q", 1, k)
        body.append(
            BodyTerm(f"link_inertia_{k}", k, f"({speed})**2/2", "0", "kg m^2", 1, "see below")
        )
        along, across = ["0"], ["0"]
        for i in range(1, k):
            product = f"l{i}*({_sum('v', 1, i)})*({speed})"
            along.append(f"{product}*cos({_sum('q', i + 1, k)})")
            across.append(f"-{product}*sin({_sum('q', i + 1, k)})")
        weights = (
            f"-gx*cos({angle}) - gy*sin({angle})",
            f"gx*sin({angle}) - gy*cos({angle})",
        )
        for name, kinetic, weight in zip(
            ("along", "across"), (along, across), weights, strict=True
        ):
            body.append(BodyTerm(f"link_moment_{name}_{k}", k, " + ".join(kinetic), weight, "kg m"))
        if k > 1:
            coupling = f"w{k}*({_sum('v', 1, k - 1)})"
            body.append(BodyTerm(f"rotor_coupling_{k}", k, coupling, "0", "kg m^2", 1))
    constants = {f"l{i}": length for i, length in enumerate(arm.lengths, 1)}
    constants |= {"gx": arm.gravity[0], "gy": arm.gravity[1]}
    # With m a link's mass, c the distance from joint to centre of mass, I its inertia about
    # its joint and m' the mass of all beyond it: link_inertia I + m' l², link_moment m c + m' l.
    return TorqueBalance(f"planar arm of {n}", n, JOINT_TERMS, tuple(body), constants)


def _sum(letter: str, first: int, last: int) -> str:
    return " + ".join(f"{letter}{i}" for i in range(first, last + 1))
