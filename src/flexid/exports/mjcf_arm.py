"""Export of an arm to MuJoCo, in the plane of x and z: links turn from x towards z."""

from collections.abc import Mapping
from math import cos, sin
from pathlib import Path

import numpy as np

from flexid.arms.disturbed import resonances
from flexid.arms.result import ArmIdentification
from flexid.exports import mjcf
from flexid.exports.request import check_known, doubts_of, impossible
from flexid.models.motion import FORCES
from flexid.models.planar_arm import PlanarArm, carried_links, planar_arm

_AXIS = mjcf.Axis("hinge", "0 -1 0")  # rotation from x towards z
_SLACKS = (2.0, 1.2, 1.02)  # mass over the smallest mass for a moment and an inertia
_HEADING = (
    "An arm that flexid identified. SI units; positions at the link's side of the gear.",
    "Only base parameters are identified: other masses with equal ones move alike.",
)


# A log determines only base parameters. All masses with equal base parameters move alike. The scene
# has almost the smallest possible ones.
def write(result: ArmIdentification, directory: Path) -> tuple[str, ...]:
    """Write ``arm.xml``, the scene of an arm's estimate."""
    made = arm_scene(result)
    (directory / "arm.xml").write_text(made.xml, encoding="utf-8")
    return (*doubts_of(result.parameters), *made.notes)


def arm_scene(result: ArmIdentification) -> mjcf.Scene:
    """Return the MuJoCo scene of an arm."""
    arm, notes = result.arm, []
    values = {**result.fit.by_name, **result.fixed}
    # The assumed values of a joint that rests are not estimates.
    check_known({name: p.value for name, p in result.parameters.items() if name in values})
    if not {*FORCES} & {*result.input_units}:
        notes.append(
            "no input is a torque or a force, so all inertias are relative: the torque constant of "
            "joint 1 is set to 1"
        )
    if result.input_delay < 0.0:
        notes.append(
            f"input_delay = {result.input_delay:.4g} is left out: MuJoCo does not model it"
        )
    for name in values:
        if "stribeck" in name and values[name] != 0.0:
            notes.append(f"{name} = {values[name]:.4g} is left out: MuJoCo does not model it")
    joints = range(1, arm.joints + 1)
    rotors = {joint: _rotor(values, joint, notes) for joint in joints}
    motors = {joint: _side(values, "motor", joint, notes) for joint in joints}
    sides = {joint: _side(values, "link", joint, notes) for joint in joints}
    springs = {joint: _spring(values, joint, notes) for joint in joints}
    links = _links(arm, values, rotors, sides)
    dry = any(side.coulomb > 0.0 for side in (*motors.values(), *sides.values()))
    world: list[mjcf.Body] = []
    before = world
    for joint in joints:
        turning, link = rotors[joint], links[joint - 1]
        home, place = (before, link.reach) if turning else (world, 0.0)
        own = max(turning, mjcf.NOTHING * motors[joint].inertia)
        home.append(mjcf.rotor(f"motor_{joint}", link.axis, motors[joint], own, reach=place))
        before.append(link)
        before = link.carried
    along, across = arm.gravity
    return mjcf.scene(
        f"planar arm of {arm.joints}",
        _HEADING,
        notes,
        world,
        [
            mjcf.Joint(
                f"_{joint}",
                springs[joint],
                values[f"torque_constant_{joint}"],
                motors[joint].offset,
            )
            for joint in joints
        ],
        gravity=(along, 0.0, across),
        delay=result.input_delay,
        step=mjcf.timestep(float(resonances(planar_arm(arm), values).max()), dry=dry),
    )


def _links(
    arm: PlanarArm,
    values: Mapping[str, float],
    rotors: Mapping[int, float],
    sides: Mapping[int, mjcf.Side],
) -> list[mjcf.Body]:
    """Return bodies of the links, so that links and rotors have the base parameters."""
    found: list[mjcf.Body] = []
    for slack in _SLACKS:
        found = _bodies(arm, values, rotors, sides, slack)
        if len(found) == arm.joints:
            return found
    name = carried_links(planar_arm(arm), arm.joints - len(found))[0]
    why = "less than the share of the links beyond it, which is impossible"
    raise impossible(name, f"{values[name]:g}", why)


def _bodies(
    arm: PlanarArm,
    values: Mapping[str, float],
    rotors: Mapping[int, float],
    sides: Mapping[int, mjcf.Side],
    slack: float,
) -> list[mjcf.Body]:
    """Return bodies up to the last link, without the first links if one has no inertia."""
    found: list[mjcf.Body] = []
    beyond = carried = 0.0  # mass of links that turn on this one, inertia of those that slide
    for joint in range(arm.joints, 0, -1):
        length = arm.lengths[joint - 1] if joint < arm.joints else 0.0
        turns = arm.types[joint - 1] == "revolute"
        along, across = _moments(arm, values, joint, beyond * length)
        carried += rotors.get(joint + 1, 0.0) + beyond * length**2
        square = along**2 + across**2
        if turns:
            inertia = values[f"link_inertia_{joint}"] - carried
            mass = slack * square / inertia if square and inertia > 0.0 else inertia
        else:
            mass = values[f"link_mass_{joint}"] - beyond
            inertia = (square / mass if mass else 0.0) + mjcf.NOTHING * mass
        if inertia <= 0.0 or mass <= 0.0:
            return found[::-1]
        axis, angle = _AXIS, arm.slides[joint - 1] if arm.slides else None
        if angle is not None:  # from the link before it
            axis = mjcf.Axis("slide", f"{cos(angle):.12g} 0 {sin(angle):.12g}")
        found.append(
            mjcf.Body(
                f"link_{joint}",
                axis,
                sides[joint],
                mass,
                inertia - square / mass,
                along / mass,
                across / mass,
                reach=arm.lengths[joint - 2] if joint > 1 else 0.0,
            )
        )
        beyond, carried = (beyond + mass, 0.0) if turns else (0.0, carried + inertia)
    return found[::-1]


def _moments(
    arm: PlanarArm, values: Mapping[str, float], joint: int, beyond: float
) -> tuple[float, float]:
    """Return the moments of a link's own mass, or zeros if they do not affect the motion."""
    along, across = f"link_moment_along_{joint}", f"link_moment_across_{joint}"
    felt = joint > 1 or arm.has_gravity  # a first joint that slides has none
    return (values[along] - beyond, values[across]) if felt and along in values else (0.0, 0.0)


def _rotor(values: Mapping[str, float], joint: int, notes: list[str]) -> float:
    """Return the part of a rotor's inertia that turns with the link before it."""
    coupling, motor = values.get(f"rotor_coupling_{joint}", 0.0), values[f"motor_inertia_{joint}"]
    if motor <= 0.0:
        why = "but every inertia is positive"
        raise impossible(f"motor_inertia_{joint}", f"{motor:g}", why)
    coupling = mjcf.possible(coupling, f"rotor_coupling_{joint}", notes, "rotor")
    if coupling > motor:
        notes.append(
            f"rotor_coupling_{joint} is {coupling:.4g}, above the motor's inertia, which no gear "
            f"explains: {motor:.4g} is used"
        )
    return min(coupling, motor)


def _side(values: Mapping[str, float], side: str, joint: int, notes: list[str]) -> mjcf.Side:
    """Return the friction, inertia and constant torque of one side."""
    names = {word: f"{side}_{word}_friction_{joint}" for word in ("viscous", "coulomb")}
    found = {word: mjcf.possible(values[name], name, notes) for word, name in names.items()}
    inertia = values.get(f"{side}_inertia_{joint}", 0.0)  # a link that slides has a mass instead
    return mjcf.Side(inertia, offset=-values.get(f"{side}_offset_{joint}", 0.0), **found)


def _spring(values: Mapping[str, float], joint: int, notes: list[str]) -> mjcf.Spring:
    stiffness, damping = (values[f"joint_{word}_{joint}"] for word in ("stiffness", "damping"))
    if stiffness <= 0.0:
        why = "but every stiffness is positive"
        raise impossible(f"joint_stiffness_{joint}", f"{stiffness:g}", why)
    damping = mjcf.possible(damping, f"joint_damping_{joint}", notes, "tendon")
    cubic = values[f"cubic_joint_stiffness_{joint}"]
    # The tendon's torque is the offset when both encoders agree.
    roots = np.roots([cubic, 0.0, stiffness, -values[f"joint_offset_{joint}"]])
    rest = float(min(roots[np.isreal(roots)].real, key=abs))
    return mjcf.Spring(stiffness, cubic=cubic, damping=damping, rest=rest)
