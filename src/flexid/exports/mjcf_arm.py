"""An identified arm as a MuJoCo scene, in the plane of x and z: links turn from x towards z."""

from collections.abc import Mapping
from math import cos, sin
from pathlib import Path

import numpy as np

from flexid.arms.disturbed import resonances
from flexid.arms.result import ArmIdentification
from flexid.exports.mjcf import (
    NOTHING,
    Axis,
    Body,
    Joint,
    Scene,
    Side,
    Spring,
    possible,
    rotor,
    scene,
    timestep,
)
from flexid.exports.request import check_known, doubts_of, impossible
from flexid.models.motion import FORCES
from flexid.models.planar_arm import PlanarArm, carried_links, planar_arm

_AXIS = Axis("hinge", "0 -1 0")  # about which x turns towards z
_SLACKS = (2.0, 1.2, 1.02)  # mass over the least that a body of some moment and inertia has
_HEADING = (
    "An arm that flexid identified. SI units; positions at the link's side of the gear.",
    "A log shows base parameters alone: other masses with the same ones move alike.",
)


# Of the masses a log shows base parameters alone, and all choices with these move alike: nearly the
# least that a body can have are taken.
def write(result: ArmIdentification, directory: Path) -> tuple[str, ...]:
    """Write ``arm.xml``, the scene of an arm's estimate."""
    made = arm_scene(result)
    (directory / "arm.xml").write_text(made.xml, encoding="utf-8")
    return (*doubts_of(result.parameters), *made.notes)


def arm_scene(result: ArmIdentification) -> Scene:
    """Write an arm as a MuJoCo scene."""
    arm, notes = result.arm, []
    values = {**result.fit.by_name, **result.fixed}
    # What a joint that rests was taken for is no value of it.
    check_known({name: p.value for name, p in result.parameters.items() if name in values})
    if not {*FORCES} & {*result.input_units}:
        notes.append(
            "no input is a torque or a force, so that no inertia is known: the torque constant of "
            "joint 1 is set to 1, and all inertias follow from that"
        )
    if result.input_delay < 0.0:
        notes.append(
            f"input_delay = {result.input_delay:.4g} is left out: MuJoCo has nothing like it"
        )
    joints = range(1, arm.joints + 1)
    rotors = {joint: _rotor(values, joint, notes) for joint in joints}
    motors = {joint: _side(values, "motor", joint, notes) for joint in joints}
    sides = {joint: _side(values, "link", joint, notes) for joint in joints}
    springs = {joint: _spring(values, joint, notes) for joint in joints}
    links = _links(arm, values, rotors, sides)
    dry = any(side.coulomb > 0.0 for side in (*motors.values(), *sides.values()))
    world: list[Body] = []
    before = world
    for joint in joints:
        turning, link = rotors[joint], links[joint - 1]
        home, place = (before, link.reach) if turning else (world, 0.0)
        own = max(turning, NOTHING * motors[joint].inertia)
        home.append(rotor(f"motor_{joint}", link.axis, motors[joint], own, reach=place))
        before.append(link)
        before = link.carried
    along, across = arm.gravity
    return scene(
        f"planar arm of {arm.joints}",
        _HEADING,
        notes,
        world,
        [
            Joint(
                f"_{joint}",
                springs[joint],
                values[f"torque_constant_{joint}"],
                motors[joint].offset,
            )
            for joint in joints
        ],
        gravity=(along, 0.0, across),
        delay=result.input_delay,
        step=timestep(float(resonances(planar_arm(arm), values).max()), dry=dry),
    )


def _links(
    arm: PlanarArm,
    values: Mapping[str, float],
    rotors: Mapping[int, float],
    sides: Mapping[int, Side],
) -> list[Body]:
    """Bodies of the links that have the base parameters, beside rotors that they carry."""
    found: list[Body] = []
    for slack in _SLACKS:
        found = _bodies(arm, values, rotors, sides, slack)
        if len(found) == arm.joints:
            return found
    name = carried_links(planar_arm(arm), arm.joints - len(found))[0]
    why = "less than what the links beyond it add to it, which no body has"
    raise impossible(name, f"{values[name]:g}", why)


def _bodies(
    arm: PlanarArm,
    values: Mapping[str, float],
    rotors: Mapping[int, float],
    sides: Mapping[int, Side],
    slack: float,
) -> list[Body]:
    """Bodies from the last link on; up to the first that would have no inertia."""
    found: list[Body] = []
    beyond = carried = 0.0  # mass that turns on a link, and inertia that slides on it
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
            inertia = (square / mass if mass else 0.0) + NOTHING * mass
        if inertia <= 0.0 or mass <= 0.0:
            return found[::-1]
        found.append(
            Body(
                f"link_{joint}",
                _axis(arm, joint),
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
    """Moments of a link's own mass; none where no motion shows them: its centre may be anywhere."""
    along, across = f"link_moment_along_{joint}", f"link_moment_across_{joint}"
    felt = joint > 1 or arm.has_gravity  # of the first joint there are none if it slides
    return (values[along] - beyond, values[across]) if felt and along in values else (0.0, 0.0)


def _axis(arm: PlanarArm, joint: int) -> Axis:
    """How a link moves: it turns, or slides at an angle from the link before it."""
    angle = arm.slides[joint - 1] if arm.slides else None
    return _AXIS if angle is None else Axis("slide", f"{cos(angle):.12g} 0 {sin(angle):.12g}")


def _rotor(values: Mapping[str, float], joint: int, notes: list[str]) -> float:
    """Inertia of a rotor's body that turns with the link before it."""
    coupling, motor = values.get(f"rotor_coupling_{joint}", 0.0), values[f"motor_inertia_{joint}"]
    if motor <= 0.0:
        why = "and every inertia is positive"
        raise impossible(f"motor_inertia_{joint}", f"{motor:g}", why)
    coupling = possible(coupling, f"rotor_coupling_{joint}", notes, "rotor")
    if coupling > motor:
        notes.append(
            f"rotor_coupling_{joint} is {coupling:.4g} and above the motor's inertia, which no "
            f"gear makes it: {motor:.4g} is taken"
        )
    return min(coupling, motor)


def _side(values: Mapping[str, float], side: str, joint: int, notes: list[str]) -> Side:
    """What brakes one side alone."""
    names = {word: f"{side}_{word}_friction_{joint}" for word in ("viscous", "coulomb")}
    found = {word: possible(values[name], name, notes) for word, name in names.items()}
    inertia = values.get(f"{side}_inertia_{joint}", 0.0)  # a link that slides has a mass instead
    return Side(inertia, offset=-values.get(f"{side}_offset_{joint}", 0.0), **found)


def _spring(values: Mapping[str, float], joint: int, notes: list[str]) -> Spring:
    stiffness, damping = (values[f"joint_{word}_{joint}"] for word in ("stiffness", "damping"))
    if stiffness <= 0.0:
        why = "and every spring's is positive"
        raise impossible(f"joint_stiffness_{joint}", f"{stiffness:g}", why)
    damping = possible(damping, f"joint_damping_{joint}", notes, "tendon")
    cubic = values[f"cubic_joint_stiffness_{joint}"]
    # Where the encoders agree, the tendon's torque is the offset.
    roots = np.roots([cubic, 0.0, stiffness, -values[f"joint_offset_{joint}"]])
    rest = float(min(roots[np.isreal(roots)].real, key=abs))
    return Spring(stiffness, cubic=cubic, damping=damping, rest=rest)
