"""Scenes of MuJoCo: bodies on hinges, springs between them, actuators and sensors, as XML."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from flexid.exports.request import rendered

NOTHING = 1e-9
"""Of the armature: the engine wants every body to have some inertia."""

_STEP = 1e-3  # s, the longest
_STEPS_PER_RADIAN = 40.0  # of the resonance; Runge-Kutta's phase error is then below 1e-8
# The engine does not look for the instant at which dry friction changes: it is up to a step late.
_DRY_STEP = 1.25e-4  # s, the longest
_DRY_STEPS_PER_RADIAN = 200.0


class Side(NamedTuple):
    """What acts on one side alone, in SI units."""

    inertia: float
    sine: float = 0.0
    cosine: float = 0.0
    viscous: float = 0.0
    drag: float = 0.0
    coulomb: float = 0.0
    offset: float = 0.0


class Spring(NamedTuple):
    """What acts between both sides, in SI units."""

    stiffness: float
    lopsided: float = 0.0
    cubic: float = 0.0
    damping: float = 0.0
    hysteresis: float = 0.0
    half_gap: float = 0.0
    rest: float = 0.0  # rad, of link less motor, where it has no torque


class Shape(NamedTuple):
    """What is there to be looked at, and touches nothing."""

    kind: str
    ends: tuple[float, ...]  # m, of its axis, two points
    size: float  # m, its radius


@dataclass(frozen=True)
class Body:
    """A body on a hinge."""

    name: str  # of the hinge as well
    side: Side  # what brakes the hinge
    mass: float
    inertia: float  # about its centre
    along: float = 0.0  # m, of its centre from the hinge, and across
    across: float = 0.0
    armature: float = 0.0
    reach: float = 0.0  # m, of the hinge along what carries it
    shape: Shape | None = None
    carried: list["Body"] = field(default_factory=list)


class Joint(NamedTuple):
    """What acts on the hinges ``link`` and ``motor``, whose names end with a number."""

    number: str
    spring: Spring | None  # None: there is a motor alone
    gain: float  # torque over input
    motor_offset: float  # constant torques
    link_offset: float = 0.0


@dataclass(frozen=True)
class Scene:
    """A joint or an arm as a MuJoCo scene."""

    xml: str  # MJCF
    # a sentence for each thing that moves otherwise than what was identified
    notes: tuple[str, ...]


def rotor(name: str, side: Side, turning: float = 0.0, **more: float | Shape | None) -> Body:
    """A motor: but for what turns with the body that carries it, it is the hinge's armature."""
    little = NOTHING * side.inertia
    armature = side.inertia - turning if turning else side.inertia
    return Body(name, side, little, turning or little, armature=armature, **more)  # pyright: ignore[reportArgumentType]


def timestep(fastest: float, *, dry: bool) -> float:
    """Step in s for a resonance in rad/s: a millisecond, halved until it is short enough."""
    most, steps = (_DRY_STEP, _DRY_STEPS_PER_RADIAN) if dry else (_STEP, _STEPS_PER_RADIAN)
    step = _STEP
    while step > most or step * fastest * steps > 1.0:
        step /= 2.0
    return step


def scene(
    title: str,
    comment: Sequence[str],
    notes: Sequence[str],
    bodies: Sequence[Body],
    joints: Sequence[Joint],
    *,
    gravity: tuple[float, float, float],
    axis: str,  # of all hinges
    delay: float,  # s, of the inputs
    step: float,  # s
) -> Scene:
    """Write a scene, with a comment at its head."""
    lines = (*comment, *(f"Note: {note}." for note in notes))
    xml = rendered(
        "mjcf/scene.xml",
        title=title,
        comment=[line.replace("--", "- -") for line in lines],
        bodies=bodies,
        joints=joints,
        gravity=gravity,
        axis=axis,
        # The engine draws straight lines between inputs that are held over a step: half a step.
        delay=delay + 0.5 * step if delay > 0.0 else 0.0,
        step=step,
        text=_text,
        polynomial=_polynomial,
    )
    return Scene(xml, tuple(notes))


def _polynomial(first: float, *higher: float) -> str:
    """Coefficients up to the last that is not zero: those beyond the first need MuJoCo 3.7."""
    count = max((i for i, value in enumerate(higher, 1) if value), default=0)
    return _text(first, *higher[:count])


def _text(*numbers: float) -> str:
    """Numbers as an attribute has them."""
    return " ".join(f"{number + 0.0:.10g}" for number in numbers)
