"""Random planar arms with elastic joints: parameters and MuJoCo model."""

from dataclasses import dataclass

import numpy as np

from flexid.models.planar_arm import PlanarArm


@dataclass(frozen=True)
class Link:
    """Parameters of a joint and its link; the centre of mass is given along and across the link."""

    length: float
    mass: float
    along: float
    across: float
    inertia: float  # about the centre of mass
    stiffness: float
    damping: float
    motor_inertia: float
    motor_viscous: float
    motor_coulomb: float
    link_viscous: float
    link_coulomb: float
    cubic: float = 0.0  # N m/rad^3, of a hardening spring
    slide: float | None = None  # rad, direction of a sliding joint from the previous link

    @property
    def spring(self) -> str:
        """Stiffness in MuJoCo's format."""
        return f"{self.stiffness!r} 0 {self.cubic!r}" if self.cubic else repr(self.stiffness)

    @property
    def motion(self) -> str:
        """Type and axis of the joint in MuJoCo's format."""
        if self.slide is None:
            return 'axis="0 -1 0"'
        return f'type="slide" axis="{float(np.cos(self.slide))!r} 0 {float(np.sin(self.slide))!r}"'


@dataclass(frozen=True)
class Arm:
    """Links from the base on; with `carried`, rotors sit on the previous link, without a gear.

    Rotors of sliding joints never do.
    """

    links: tuple[Link, ...]
    gravity: tuple[float, float]
    carried: bool = False

    @property
    def joints(self) -> int:
        """Number of joints."""
        return len(self.links)

    @property
    def spun(self) -> list[bool]:
        """Joints whose rotor sits on the previous link."""
        return [self.carried and link.slide is None for link in self.links]

    @property
    def known(self) -> PlanarArm:
        """Known values of the arm that the identification gets."""
        slides = tuple(link.slide for link in self.links)
        return PlanarArm(
            tuple(link.length for link in self.links),
            (float(self.gravity[0]), float(self.gravity[1])),
            slides=slides if any(slide is not None for slide in slides) else (),
        )

    def truth(self) -> dict[str, float]:
        """True parameters by the names of the fit."""
        found: dict[str, float] = {}
        beyond, inertia = 0.0, 0.0  # mass and inertia beyond the link
        for i, link in reversed([*enumerate(self.links, 1)]):
            turns, spun = link.slide is None, self.spun[i - 1]
            size = link.along**2 + link.across**2
            inertia += link.inertia + link.mass * size + beyond * link.length**2
            found |= {
                f"joint_stiffness_{i}": link.stiffness,
                f"cubic_joint_stiffness_{i}": link.cubic,
                f"joint_damping_{i}": link.damping,
                f"joint_offset_{i}": 0.0,
                f"motor_inertia_{i}": link.motor_inertia,
                f"motor_viscous_friction_{i}": link.motor_viscous,
                f"motor_coulomb_friction_{i}": link.motor_coulomb,
                f"motor_stribeck_friction_{i}": 0.0,
                f"motor_offset_{i}": 0.0,
                f"link_viscous_friction_{i}": 0.0 if spun else link.link_viscous,
                f"link_coulomb_friction_{i}": 0.0 if spun else link.link_coulomb,
                f"link_moment_along_{i}": link.mass * link.along + beyond * link.length,
                f"link_moment_across_{i}": link.mass * link.across,
            }
            beyond += link.mass + (ROTOR_MASS if spun else 0.0)
            if turns:
                found[f"link_inertia_{i}"] = inertia
                if i > 1:
                    found[f"rotor_coupling_{i}"] = link.motor_inertia if spun else 0.0
                inertia = link.motor_inertia if spun else 0.0
            else:  # a sliding link turns with the previous one, which does not carry its mass
                found[f"link_mass_{i}"] = beyond
                beyond = 0.0
        return found


ROTOR_MASS = 0.5  # kg, if rotors are carried


def mjcf(arm: Arm, step: float) -> str:
    """Return MuJoCo's model; angles are positive from x, along link 1 at zero, towards z.

    Dry friction is a constraint of MuJoCo. It is tight here, with a time constant of two short
    steps and an impedance of nearly 1.
    """
    gx, gz = arm.gravity
    tight = f'solreffriction="{2.0 * step!r} 1" solimpfriction="0.9999 0.9999 0.001"'
    chain, closing, motors, tendons = "", "", "", ""
    before = 0.0
    for i, link in enumerate(arm.links, 1):
        inertial = (
            f'<inertial pos="{link.along!r} 0 {link.across!r}" mass="{link.mass!r}" '
            f'diaginertia="{link.inertia!r} {link.inertia!r} {link.inertia!r}"/>'
        )
        motor = (
            f'axis="0 -1 0" damping="{link.motor_viscous!r}" '
            f'frictionloss="{link.motor_coulomb!r}" {tight}'
        )
        j = link.motor_inertia
        if arm.spun[i - 1]:
            chain += (
                f'<body pos="{before!r} 0 0"><joint name="motor_{i}" {motor}/>'
                f'<inertial pos="0 0 0" mass="{ROTOR_MASS}" diaginertia="{j!r} {j!r} {j!r}"/>'
                f'<body><joint name="link_{i}" axis="0 -1 0" stiffness="{link.spring}" '
                f'damping="{link.damping!r}"/>{inertial}'
            )
            closing += "</body></body>"
        else:
            chain += (
                f'<body pos="{before!r} 0 0"><joint name="link_{i}" {link.motion} '
                f'damping="{link.link_viscous!r}" frictionloss="{link.link_coulomb!r}" {tight}/>'
                f"{inertial}"
            )
            closing += "</body>"
            motors += (
                f'<body><joint name="motor_{i}" {motor}/><inertial pos="0 0 0" mass="1" '
                f'diaginertia="{j!r} {j!r} {j!r}"/></body>'
            )
            tendons += (
                f'<fixed stiffness="{link.spring}" damping="{link.damping!r}" '
                f'springlength="0"><joint joint="motor_{i}" coef="1"/>'
                f'<joint joint="link_{i}" coef="-1"/></fixed>'
            )
        before = link.length
    return (
        f'<mujoco><compiler angle="radian"/><option timestep="{step!r}" '
        f'gravity="{gx!r} 0 {gz!r}" integrator="RK4"/>'
        f"<worldbody>{chain}{closing}{motors}</worldbody><tendon>{tendons}</tendon></mujoco>"
    )


def random_arm(
    rng: np.random.Generator, joints: int = 2, harsh: bool = False, slides: bool = False
) -> Arm:
    """Draw an arm; harsh ones have inertia ratios up to 5 and springs of 50 to 20 000 N m/rad.

    With `slides`, at least one joint slides, in any direction.
    """
    carried = bool(rng.random() < 0.25)
    masses = 3.0 * 0.6 ** np.arange(joints) * np.exp(rng.uniform(-0.5, 0.5, joints))
    lengths = rng.uniform(0.2, 0.5, joints)
    centres = lengths * rng.uniform(0.35, 0.7, joints)
    reach = [
        sum(masses[k] * (np.sum(lengths[i:k]) + centres[k]) ** 2 for k in range(i, joints))
        for i in range(joints)
    ]
    angles = _slides(rng, joints) if slides else [None] * joints
    links = []
    for i in range(joints):
        inertia = float(masses[i] * lengths[i] ** 2 / 12.0)
        carries = float(np.sum(masses[i:])) if angles[i] is not None else float(reach[i] + inertia)
        spread = 5.0 if harsh else 2.0
        motor = carries * float(spread ** rng.uniform(-1.0, 1.0)) * 0.6
        frequency = float(np.exp(rng.uniform(np.log(4.0), np.log(12.0))))
        stiffness = min(motor, carries) * (2.0 * np.pi * frequency) ** 2
        if harsh:
            stiffness = float(np.exp(rng.uniform(np.log(50.0), np.log(20000.0))))
        rate = np.sqrt(stiffness * carries)
        size = np.sqrt(carries * motor)
        links.append(
            Link(
                float(lengths[i]),
                float(masses[i]),
                float(centres[i]),
                float(rng.choice([0.0, 0.1]) * centres[i] * rng.uniform(-1.0, 1.0)),
                inertia,
                float(stiffness),
                float(rate * rng.uniform(0.002, 0.03)),
                float(motor),
                float(size * rng.uniform(0.3, 3.0)),
                float(size * rng.choice([0.0, 1.0]) * rng.uniform(0.5, 4.0)),
                float(size * rng.uniform(0.0, 0.5)),
                float(size * rng.choice([0.0, 0.0, 1.0]) * rng.uniform(0.2, 1.0)),
                slide=angles[i],
            )
        )
    gravity = [(0.0, 0.0), (9.81, 0.0), (0.0, -9.81)][rng.integers(3)]
    return Arm(tuple(links), gravity, carried)


def _slides(rng: np.random.Generator, joints: int) -> list[float | None]:
    """Draw the directions of the sliding joints."""
    pattern = int(rng.integers(1, 2**joints))
    sliding = [pattern >> joint & 1 for joint in range(joints)]
    angles = rng.choice([0.0, 0.5 * np.pi, 0.6], joints)
    return [float(a) if slide else None for a, slide in zip(angles, sliding, strict=True)]
