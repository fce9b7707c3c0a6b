"""Export of a joint to MuJoCo: two hinges or slides, and a fixed tendon as the spring."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import atan2, cos, hypot, sin, sqrt
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

from flexid.errors import SettingError
from flexid.estimators.channel_timing import INPUT as INPUT_DELAY
from flexid.exports.request import check_known, check_possible, doubts_of, rendered
from flexid.identification.full_model.model import LINK as LINK_DELAY
from flexid.identification.preparation.joint import Kind
from flexid.identification.result import Identification
from flexid.models.flexible_joint import GRIPS, SHAPE_TERMS, TERMS, TIES
from flexid.models.motion import FORCES, JointType, unit_of
from flexid.stored_estimates.structure import delays_of, values_of

NOTHING = 1e-9  # inertia over the armature, since MuJoCo needs some in every body

_STEP = 1e-3  # s, at most
_STEPS_PER_RADIAN = 40.0  # of the resonance; keeps the phase error below 1e-8
# MuJoCo does not locate the instant at which dry friction changes: it is up to a step late.
_DRY_STEP = 1.25e-4  # s, at most
_DRY_STEPS_PER_RADIAN = 200.0


class Side(NamedTuple):
    """Inertia, gravity, friction and constant torque of link or motor, in SI units."""

    inertia: float
    sine: float = 0.0
    cosine: float = 0.0
    viscous: float = 0.0
    drag: float = 0.0
    coulomb: float = 0.0
    offset: float = 0.0


class Spring(NamedTuple):
    """Spring between link and motor, with damping, hysteresis and play, in SI units."""

    stiffness: float
    lopsided: float = 0.0
    cubic: float = 0.0
    damping: float = 0.0
    hysteresis: float = 0.0
    half_gap: float = 0.0
    rest: float = 0.0  # link minus motor where the torque is zero


class Shape(NamedTuple):
    """Visible geometry without contacts."""

    kind: str
    ends: tuple[float, ...]  # m: two points on its axis
    size: float  # m, its radius


class Axis(NamedTuple):
    """Type and direction of a body's axis."""

    type: str  # MuJoCo's "hinge" or "slide"
    direction: str


@dataclass(frozen=True)
class Body:
    """Body that turns or slides on an axis."""

    name: str  # also of the axis
    axis: Axis
    side: Side  # friction of the axis
    mass: float
    inertia: float  # about its centre
    along: float = 0.0  # m: centre of mass from the axis, along and across
    across: float = 0.0
    armature: float = 0.0
    reach: float = 0.0  # m: distance of the axis along the carrier
    shape: Shape | None = None
    carried: list["Body"] = field(default_factory=list)


class Joint(NamedTuple):
    """Spring and inputs of the axes ``link`` and ``motor``, whose names end with `number`."""

    number: str
    spring: Spring | None  # None: only a motor
    gain: float  # torque over input
    motor_offset: float  # constant torque
    link_offset: float = 0.0


_TURNING = Axis("hinge", "0 1 0")


@dataclass(frozen=True)
class Scene:
    """MuJoCo scene of a joint or an arm."""

    xml: str  # MJCF
    # one sentence for each difference from the identified model
    notes: tuple[str, ...]


def rotor(
    name: str, axis: Axis, side: Side, turning: float = 0.0, **more: float | Shape | None
) -> Body:
    """Return a motor, with its inertia as armature, except what turns with its carrier."""
    little = NOTHING * side.inertia
    armature = side.inertia - turning if turning else side.inertia
    return Body(name, axis, side, little, turning or little, armature=armature, **more)  # pyright: ignore[reportArgumentType]


def possible(value: float, name: str, notes: list[str], owner: str = "hinge") -> float:
    """Return the value, or zero with a note if it is negative."""
    if value < 0.0:
        notes.append(f"{name} is negative, which no {owner} has: it is left out")
    return max(value, 0.0)


def timestep(fastest: float, *, dry: bool) -> float:
    """Return a step in s for a resonance in rad/s: 1 ms, halved until it is short enough."""
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
    delay: float,  # s, of the inputs
    step: float,  # s
) -> Scene:
    """Return a scene with a comment at its head."""
    lines = (*comment, *(f"Note: {note}." for note in notes))
    xml = rendered(
        "mjcf/scene.xml",
        title=title,
        comment=[line.replace("--", "- -") for line in lines],
        bodies=bodies,
        joints=joints,
        gravity=gravity,
        # MuJoCo interpolates delayed inputs linearly; holding them would be half a step later.
        delay=delay + 0.5 * step if delay > 0.0 else 0.0,
        step=step,
        text=_text,
        polynomial=_polynomial,
    )
    return Scene(xml, tuple(notes))


def _polynomial(first: float, *higher: float) -> str:
    """Return coefficients up to the last nonzero one; more than one needs MuJoCo 3.7."""
    count = max((i for i, value in enumerate(higher, 1) if value), default=0)
    return _text(first, *higher[:count])


def _text(*numbers: float) -> str:
    """Return numbers as the text of an attribute."""
    return " ".join(f"{number + 0.0:.10g}" for number in numbers)


_GRAVITY = 9.81  # m/s^2; only its product with mass and lever matters
_LONGEST_LEVER = 1.0  # m

_HEADING = (
    "A joint that flexid identified. SI units; positions at the link's side of the gear.",
    "Only the product of mass, lever and gravity acts on the link.",
)
_SLIDING = 1e-3  # kg m^2 of a body that does not turn, since MuJoCo needs some


def write(result: Identification, directory: Path) -> tuple[str, ...]:
    """Write ``joint.xml``, the scene of an estimate."""
    check_possible(result)
    values = values_of(result, 0)
    check_known(values)
    made = mjcf_scene(
        result.model,
        values,
        result.input_unit,
        result.joint,
        delays=delays_of(result),
    )
    (directory / "joint.xml").write_text(made.xml, encoding="utf-8")
    several = [name for name in result.coefficients if name.endswith("[1]")]
    doubts = [
        f"{name.removesuffix('[1]')} differs between logs: the scene has the value of the first"
        for name in several
    ]
    return (*doubts_of(result.coefficients), *doubts, *made.notes)


def mjcf_scene(
    kind: Kind,
    coefficients: Mapping[str, float],
    input_unit: str = "N m",
    joint: JointType = "revolute",
    *,
    delays: Mapping[str, float] = MappingProxyType({}),  # s, by name
) -> Scene:
    """Return the MuJoCo scene of a joint."""
    if kind == "link":
        raise SettingError(
            "mjcf",
            "needs a joint with its motor, but the estimate is of the link alone: identify a log "
            "with the motor's torque",
        )
    values = dict(coefficients)  # those that the scene models are removed
    torque = input_unit in FORCES
    notes: list[str] = []
    if not torque:
        notes.append(
            f"the input is in {input_unit}, so all torques are relative: the motor's inertia is "
            f"set to 1 {unit_of('kg m^2', joint)}"
        )
    gain = values.pop("beta1")
    inertia = 1.0 / gain if torque else 1.0
    by_motor, by_link = values.pop("alpha1", 0.0), values.pop("theta2", 0.0)
    fastest = sqrt(abs(by_link + by_motor))
    if kind == "rigid":
        link, motor, spring = None, _side(values, "gamma", inertia), None
    else:
        stiffness = by_motor * inertia
        link = _side(values, "theta", stiffness / by_link)
        motor = _side(values, "alpha", inertia)
        spring = _spring(values, stiffness, inertia, notes)
    for grip in GRIPS:  # the scene has no presliding
        values.pop(grip, None)
    delay = delays.get(INPUT_DELAY, 0.0)
    values |= {INPUT_DELAY: min(delay, 0.0), LINK_DELAY: delays.get(LINK_DELAY, 0.0)}
    notes += _left_out(values)
    if link is not None:
        link = link._replace(coulomb=possible(link.coulomb, "the link's Coulomb friction", notes))
    motor = motor._replace(coulomb=possible(motor.coulomb, "the motor's Coulomb friction", notes))
    dry = any(side is not None and side.coulomb > 0.0 for side in (link, motor))
    dry |= spring is not None and spring.hysteresis > 0.0
    if joint == "prismatic":
        sides = {"motor": motor} if link is None else {"link": link, "motor": motor}
        bodies = [_carriage(name, side) for name, side in sides.items()]
    elif link is None:
        bodies = [_pendulum("motor", motor)]
    else:
        seen = Shape("cylinder", (0.0, 0.05, 0.0, 0.0, 0.1, 0.0), 0.05)
        bodies = [_pendulum("link", link), rotor("motor", _TURNING, motor, shape=seen)]
    link_offset = 0.0 if link is None else link.offset
    return scene(
        "rigid joint" if link is None else "flexible joint",
        _HEADING[: 2 if joint == "revolute" else 1],
        notes,
        bodies,
        [Joint("", spring, gain * motor.inertia, motor.offset, link_offset)],
        gravity=(0.0, 0.0, -_GRAVITY),
        delay=delay,
        step=timestep(fastest, dry=dry),
    )


def _carriage(name: str, side: Side) -> Body:
    """Return a body that slides."""
    place = 0.1 if name == "motor" else 0.0
    shape = Shape("capsule", (0.0, place, 0.0, 0.1, place, 0.0), 0.04)
    return Body(name, Axis("slide", "1 0 0"), side, side.inertia, _SLIDING, shape=shape)


def _pendulum(name: str, side: Side) -> Body:
    """Return a body that turns, with its centre off the hinge if gravity acts on it."""
    torque, down = hypot(side.sine, side.cosine), -atan2(side.cosine, side.sine)
    lever = min(_GRAVITY * side.inertia / (2.0 * torque), _LONGEST_LEVER) if torque else 0.0
    # Mass times lever squared is half of the inertia, or less; the rest is about the centre.
    mass = torque / (_GRAVITY * lever) if torque else side.inertia
    along, across = sin(down), -cos(down)
    return Body(
        name,
        _TURNING,
        side,
        mass,
        side.inertia - mass * lever**2,
        lever * along,
        lever * across,
        shape=Shape("capsule", (0.0, 0.0, 0.0, 0.3 * along, 0.0, 0.3 * across), 0.02),
    )


def _side(values: dict[str, float], row: str, inertia: float) -> Side:
    """Return one side, and remove its coefficients from `values`."""
    found = {what: values.pop(f"{row}_{what}", 0.0) for what in Side._fields[1:]}
    found["sine"] += values.pop(f"{row}1", 0.0)
    found["viscous"] += values.pop(f"{row}2", 0.0)
    return Side(inertia, **{what: inertia * value for what, value in found.items()})


def _spring(
    values: dict[str, float], stiffness: float, motor_inertia: float, notes: list[str]
) -> Spring:
    """Return the spring, and remove its coefficients from `values`."""

    def torque(name: str) -> float:
        values.pop(f"theta_{name}", None)
        return motor_inertia * values.pop(f"alpha_{name}", 0.0)

    half_gap, hysteresis = torque("backlash") / stiffness, torque("hysteresis")
    half_gap = possible(half_gap, "backlash", notes, "tendon")
    hysteresis = possible(hysteresis, "spring_hysteresis", notes, "tendon")
    return Spring(
        stiffness,
        torque("lopsided"),
        torque("cubic"),
        torque("damping"),
        hysteresis,
        half_gap,
    )


def _left_out(values: Mapping[str, float]) -> list[str]:
    """Return a note on each term that the scene does not model."""
    lost = [c for c, value in values.items() if value]
    notes = []
    for name, term in (TERMS | SHAPE_TERMS).items():
        own = {c: values[c] for c in (*term.link, *term.motor) if c in lost}
        if own:
            shown = ", ".join(f"{c} = {v:.4g}" for c, v in own.items() if c not in TIES)
            notes.append(
                f"{name} ({term.description}; {shown}) is left out: MuJoCo does not model it"
            )
            lost = [c for c in lost if c not in own]
    notes += [f"{c} = {values[c]:.4g} is left out: MuJoCo does not model it" for c in lost]
    return notes
