"""Hinges, bodies, spring, actuators and sensors of a joint as elements of MuJoCo's XML."""

from math import atan2, cos, hypot, sin
from typing import NamedTuple
from xml.etree import ElementTree as ET

_GRAVITY = 9.81  # m/s^2; only its product with mass and lever acts
_LONGEST_LEVER = 1.0  # m
_NOTHING = 1e-9  # of the armature: the engine wants every body to have some inertia

_SEEN = {"mass": "0", "contype": "0", "conaffinity": "0"}
"""Attributes of what is there to be looked at, and touches nothing."""


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
    lopsided: float
    cubic: float
    damping: float
    hysteresis: float
    half_gap: float


def scene(
    link: Side | None,
    motor: Side,
    spring: Spring | None,
    *,
    gain: float,
    delay: float,
    step: float,
) -> ET.Element:
    """The root of a scene."""
    root = ET.Element("mujoco", model="flexible joint" if link else "rigid joint")
    ET.SubElement(root, "compiler", angle="radian")
    gravity = f"0 0 {-_GRAVITY!r}"
    ET.SubElement(root, "option", timestep=_text(step), integrator="RK4", gravity=gravity)
    world = ET.SubElement(root, "worldbody")
    if link is None:
        _pendulum(world, "motor", motor, step)
    else:
        _pendulum(world, "link", link, step)
        _rotor(world, motor, step)
    if spring is not None:
        tendon = ET.SubElement(root, "tendon")
        fixed = ET.SubElement(tendon, "fixed", _spring_attributes(spring, step), name="spring")
        ET.SubElement(fixed, "joint", joint="link", coef="1")
        ET.SubElement(fixed, "joint", joint="motor", coef="-1")
    root.append(_actuators(link, motor, gain, delay, step))
    root.append(_sensors(link is not None))
    return root


def _pendulum(world: ET.Element, name: str, side: Side, step: float) -> None:
    """A body that hangs from its hinge, if gravity acts on it."""
    torque, down = hypot(side.sine, side.cosine), -atan2(side.cosine, side.sine)
    lever = min(_GRAVITY * side.inertia / (2.0 * torque), _LONGEST_LEVER) if torque else 0.0
    # Half of the inertia, or less, is the mass on its lever; the rest is about its own centre.
    mass = torque / (_GRAVITY * lever) if torque else side.inertia
    centre = side.inertia - mass * lever**2
    body = ET.SubElement(world, "body", name=name)
    ET.SubElement(body, "joint", _hinge_attributes(side, step), name=name)
    ET.SubElement(
        body,
        "inertial",
        pos=_text(lever * sin(down), 0.0, -lever * cos(down)),
        mass=_text(mass),
        diaginertia=_text(centre, centre, centre),
    )
    end = _text(0.0, 0.0, 0.0, 0.3 * sin(down), 0.0, -0.3 * cos(down))
    ET.SubElement(body, "geom", _SEEN, type="capsule", fromto=end, size="0.02")


def _rotor(world: ET.Element, motor: Side, step: float) -> None:
    """The motor, whose inertia is the armature of its hinge."""
    body = ET.SubElement(world, "body", name="motor")
    armature = _text(motor.inertia)
    attributes = _hinge_attributes(motor, step)
    ET.SubElement(body, "joint", attributes, name="motor", armature=armature)
    little = _NOTHING * motor.inertia
    inertias = _text(little, little, little)
    ET.SubElement(body, "inertial", pos="0 0 0", mass=_text(little), diaginertia=inertias)
    ends = "0 0.05 0 0 0.1 0"
    ET.SubElement(body, "geom", _SEEN, type="cylinder", fromto=ends, size="0.05")


def _hinge_attributes(side: Side, step: float) -> dict[str, str]:
    attributes = {"type": "hinge", "axis": "0 1 0"}
    if side.viscous or side.drag:
        attributes["damping"] = _polynomial(side.viscous, side.drag)
    if side.coulomb:
        attributes |= {"frictionloss": _text(side.coulomb), **_sharp_friction(step)}
    return attributes


def _spring_attributes(spring: Spring, step: float) -> dict[str, str]:
    gap = spring.half_gap
    attributes = {
        "stiffness": _polynomial(spring.stiffness, spring.lopsided, spring.cubic),
        "springlength": _text(-gap, gap) if gap else "0",
    }
    if spring.damping:
        attributes["damping"] = _text(spring.damping)
    if spring.hysteresis:
        attributes |= {"frictionloss": _text(spring.hysteresis), **_sharp_friction(step)}
    return attributes


def _sharp_friction(step: float) -> dict[str, str]:
    """What makes the engine's friction as dry as its step allows; its default creeps visibly."""
    return {"solreffriction": _text(2.0 * step, 1.0), "solimpfriction": "0.9999 0.9999 0.001"}


def _actuators(
    link: Side | None, motor: Side, gain: float, delay: float, step: float
) -> ET.Element:
    """The input's actuator, with the motor's constant torque, and one for that of the link."""
    actuators = ET.Element("actuator")
    attributes = {"name": "motor", "joint": "motor", "gainprm": _text(gain)}
    if motor.offset:
        attributes |= {"biastype": "affine", "biasprm": _text(motor.offset)}
    if delay > 0.0:
        # The engine draws straight lines between inputs that are held over a step: half a step.
        late = delay + 0.5 * step
        samples = str(int(late / step) + 2)
        attributes |= {"delay": _text(late), "nsample": samples, "interp": "linear"}
    ET.SubElement(actuators, "general", attributes)
    if link is not None and link.offset:
        offset = {"biastype": "affine", "biasprm": _text(link.offset)}
        ET.SubElement(actuators, "general", offset, name="link_offset", joint="link", gainprm="0")
    return actuators


def _sensors(with_link: bool) -> ET.Element:
    sensors = ET.Element("sensor")
    for quantity, kind in (("position", "jointpos"), ("velocity", "jointvel")):
        for side in ("link", "motor") if with_link else ("motor",):
            ET.SubElement(sensors, kind, name=f"{side}_{quantity}", joint=side)
    return sensors


def _polynomial(first: float, *higher: float) -> str:
    """Coefficients up to the last that is not zero: those beyond the first need MuJoCo 3.7."""
    count = max((i for i, value in enumerate(higher, 1) if value), default=0)
    return _text(first, *higher[:count])


def _text(*numbers: float) -> str:
    return " ".join(f"{number + 0.0:.10g}" for number in numbers)
