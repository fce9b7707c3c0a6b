"""Hinges, bodies, spring, actuators and sensors of a joint as elements of MuJoCo's XML."""

from math import atan2, cos, hypot, sin
from typing import NamedTuple
from xml.etree import ElementTree as ET

_GRAVITY = 9.81  # m/s^2; only its product with mass and lever acts
_LONGEST_LEVER = 1.0  # m
NOTHING = 1e-9
"""Of the armature: the engine wants every body to have some inertia."""

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
    rest: float = 0.0  # rad, of link less motor, where it has no torque


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
    name = "flexible joint" if link else "rigid joint"
    root, world = empty_scene(name, (0.0, 0.0, -_GRAVITY), step)
    if link is None:
        _pendulum(world, "motor", motor, step)
    else:
        _pendulum(world, "link", link, step)
        _rotor(world, motor, step)
    if spring is not None:
        add_spring(ET.SubElement(root, "tendon"), spring, step)
    add_actuators(ET.SubElement(root, "actuator"), link, motor, gain, delay, step)
    add_sensors(ET.SubElement(root, "sensor"), ("link", "motor") if link else ("motor",))
    return root


def empty_scene(
    name: str, gravity: tuple[float, float, float], step: float
) -> tuple[ET.Element, ET.Element]:
    """The root of a scene, and its world."""
    root = ET.Element("mujoco", model=name)
    ET.SubElement(root, "compiler", angle="radian")
    options = {"timestep": text(step), "integrator": "RK4", "gravity": text(*gravity)}
    ET.SubElement(root, "option", options)
    return root, ET.SubElement(root, "worldbody")


def add_spring(tendons: ET.Element, spring: Spring, step: float, number: str = "") -> None:
    """A tendon between the link and the motor of a joint, whose number ends all names."""
    attributes = _spring_attributes(spring, step)
    fixed = ET.SubElement(tendons, "fixed", attributes, name=f"spring{number}")
    ET.SubElement(fixed, "joint", joint=f"link{number}", coef="1")
    ET.SubElement(fixed, "joint", joint=f"motor{number}", coef="-1")


def _pendulum(world: ET.Element, name: str, side: Side, step: float) -> None:
    """A body that hangs from its hinge, if gravity acts on it."""
    torque, down = hypot(side.sine, side.cosine), -atan2(side.cosine, side.sine)
    lever = min(_GRAVITY * side.inertia / (2.0 * torque), _LONGEST_LEVER) if torque else 0.0
    # Half of the inertia, or less, is the mass on its lever; the rest is about its own centre.
    mass = torque / (_GRAVITY * lever) if torque else side.inertia
    centre = side.inertia - mass * lever**2
    body = ET.SubElement(world, "body", name=name)
    ET.SubElement(body, "joint", hinge_attributes(side, step), name=name)
    ET.SubElement(
        body,
        "inertial",
        pos=text(lever * sin(down), 0.0, -lever * cos(down)),
        mass=text(mass),
        diaginertia=text(centre, centre, centre),
    )
    end = text(0.0, 0.0, 0.0, 0.3 * sin(down), 0.0, -0.3 * cos(down))
    ET.SubElement(body, "geom", _SEEN, type="capsule", fromto=end, size="0.02")


def _rotor(world: ET.Element, motor: Side, step: float) -> None:
    """The motor, whose inertia is the armature of its hinge."""
    body = ET.SubElement(world, "body", name="motor")
    armature = text(motor.inertia)
    attributes = hinge_attributes(motor, step)
    ET.SubElement(body, "joint", attributes, name="motor", armature=armature)
    little = NOTHING * motor.inertia
    inertias = text(little, little, little)
    ET.SubElement(body, "inertial", pos="0 0 0", mass=text(little), diaginertia=inertias)
    ends = "0 0.05 0 0 0.1 0"
    ET.SubElement(body, "geom", _SEEN, type="cylinder", fromto=ends, size="0.05")


def hinge_attributes(side: Side, step: float, axis: str = "0 1 0") -> dict[str, str]:
    """Attributes of a hinge about an axis, with what brakes it."""
    attributes = {"type": "hinge", "axis": axis}
    if side.viscous or side.drag:
        attributes["damping"] = _polynomial(side.viscous, side.drag)
    if side.coulomb:
        attributes |= {"frictionloss": text(side.coulomb), **_sharp_friction(step)}
    return attributes


def _spring_attributes(spring: Spring, step: float) -> dict[str, str]:
    gap, rest = spring.half_gap, spring.rest
    attributes = {
        "stiffness": _polynomial(spring.stiffness, spring.lopsided, spring.cubic),
        "springlength": text(rest - gap, rest + gap) if gap else text(rest),
    }
    if spring.damping:
        attributes["damping"] = text(spring.damping)
    if spring.hysteresis:
        attributes |= {"frictionloss": text(spring.hysteresis), **_sharp_friction(step)}
    return attributes


def _sharp_friction(step: float) -> dict[str, str]:
    """What makes the engine's friction as dry as its step allows; its default creeps visibly."""
    return {"solreffriction": text(2.0 * step, 1.0), "solimpfriction": "0.9999 0.9999 0.001"}


def add_actuators(
    actuators: ET.Element,
    link: Side | None,
    motor: Side,
    gain: float,
    delay: float,
    step: float,
    number: str = "",
) -> None:
    """The input's actuator, with the motor's constant torque, and one for that of the link."""
    name = f"motor{number}"
    attributes = {"name": name, "joint": name, "gainprm": text(gain)}
    if motor.offset:
        attributes |= {"biastype": "affine", "biasprm": text(motor.offset)}
    if delay > 0.0:
        # The engine draws straight lines between inputs that are held over a step: half a step.
        late = delay + 0.5 * step
        samples = str(int(late / step) + 2)
        attributes |= {"delay": text(late), "nsample": samples, "interp": "linear"}
    ET.SubElement(actuators, "general", attributes)
    if link is not None and link.offset:
        offset = {"biastype": "affine", "biasprm": text(link.offset)}
        ET.SubElement(actuators, "general", offset, name="link_offset", joint="link", gainprm="0")


def add_sensors(sensors: ET.Element, sides: tuple[str, ...], number: str = "") -> None:
    """Sensors of position and velocity."""
    for quantity, kind in (("position", "jointpos"), ("velocity", "jointvel")):
        for side in sides:
            name = f"{side}_{quantity}{number}"
            ET.SubElement(sensors, kind, name=name, joint=f"{side}{number}")


def _polynomial(first: float, *higher: float) -> str:
    """Coefficients up to the last that is not zero: those beyond the first need MuJoCo 3.7."""
    count = max((i for i, value in enumerate(higher, 1) if value), default=0)
    return text(first, *higher[:count])


def text(*numbers: float) -> str:
    """Numbers as an attribute has them."""
    return " ".join(f"{number + 0.0:.10g}" for number in numbers)
