"""Logs of linear axes, recognised by units, with a lead if the motor is rotary."""

from typing import Any

import numpy as np
import pytest
from joint_log import read_columns, said

from flexid.recording.jumps import without_wraps
from flexid.streaming.guard import Guard
from flexid.streaming.options import WatchOptions

TIME = 0.002 * np.arange(2000.0)
LINK = 0.1 * np.sin(3.0 * TIME)  # m
MOTOR = LINK + 1e-4 * np.cos(7.0 * TIME)
FORCE = 50.0 * np.cos(11.0 * TIME)  # N
LEAD = 0.01  # m per turn of the motor
TURNS = MOTOR / LEAD
TORQUE = FORCE * LEAD / (2.0 * np.pi)  # N m


def axis(link: str, motor: str, force: str, /, **changed: Any) -> dict[str, Any]:
    """Return the log with these names of channels."""
    values = {"link": LINK, "motor": MOTOR, "force": FORCE, **changed}
    return {"time": TIME, link: values["link"], motor: values["motor"], force: values["force"]}


IN_TURNS = ("link_position", "motor_position [turn]", "motor_torque [N]")
SLIDES: dict[str, tuple[dict[str, Any], dict[str, Any] | None]] = {
    "SI": (axis("link_position [m]", "motor_position [m]", "motor_torque [N]"), None),
    "link alone": (axis("link_position [m]", "motor_position", "motor_torque"), None),
    "force alone": (axis("link_position", "motor_position", "motor_torque [N]"), None),
    "prefixes": (axis("q_l [mm]", "q_m [um]", "force", link=1e3 * LINK, motor=1e6 * MOTOR), None),
    "stated": (axis("link_position", "motor_position", "motor_torque"), {"joint": "prismatic"}),
    "usual names": (axis("q_l", "q_m", "tau"), {"joint": "prismatic"}),
    "a screw": (
        axis("link_position", "m [turn]", "t [N m]", motor=-TURNS, force=-TORQUE),
        {"lead": -LEAD, "motor_position": "m", "motor_torque": "t"},
    ),
    "a screw and a torque by its voltage": (
        axis("link_position", "m [turn]", "u", motor=TURNS, force=0.5 * TORQUE),
        {
            "lead": LEAD,
            "motor_position": "m",
            "motor_voltage": {"column": "u", "scale": 2, "unit": "N m"},
        },
    ),
    "a force": (axis(*IN_TURNS, motor=TURNS), {"lead": LEAD}),
    # An absolute encoder before a screw restarts at each turn.
    "an absolute encoder": (axis(*IN_TURNS, motor=np.mod(TURNS, 1.0)), {"lead": LEAD}),
}


@pytest.mark.parametrize("name", SLIDES)
def test_units_say_that_it_slides(name: str) -> None:
    """Assert that all channels are in m and N if any of them has such a unit."""
    (recording,) = read_columns(*SLIDES[name]).recordings
    assert (recording.joint, recording.input_unit) == ("prismatic", "N")
    assert recording.link_position == pytest.approx(LINK, abs=1e-12)
    assert recording.motor_position == pytest.approx(MOTOR, abs=1e-12)
    assert recording.input == pytest.approx(FORCE, abs=1e-9)


@pytest.mark.parametrize("unit", ["", " [V]"])
def test_a_lead_changes_no_voltage(unit: str) -> None:
    """Assert that a lead does not scale a voltage, with or without a unit."""
    columns = axis("link_position", "m [turn]", f"motor_voltage{unit}", motor=TURNS)
    (recording,) = read_columns(columns, {"lead": LEAD, "motor_position": "m"}).recordings
    assert (recording.joint, recording.input_unit, recording.from_voltage) == (
        "prismatic",
        "V",
        False,
    )
    assert recording.input == pytest.approx(FORCE, abs=1e-9)


def test_a_slide_that_jumps_by_metres_has_made_no_turn() -> None:
    """Assert that 2π m are not subtracted as a turn, in a log with a lead or in a stream."""
    jumps = MOTOR + 2.0 * np.pi * (TIME > 2.0)
    np.testing.assert_array_equal(without_wraps(TIME, jumps, LEAD, "prismatic")[0], jumps)
    samples = np.column_stack((TIME, LINK + 10.0, jumps, FORCE))
    guard = Guard(WatchOptions(0.002, (), joint_type="prismatic"))
    state, _, rows, _ = guard.guard(guard.first_state(), samples)
    counts = guard.counts(state)
    assert (counts.wraps, counts.jumps) == (0, 1)
    assert rows[0] == pytest.approx([10.0, MOTOR[0], FORCE[0]])


FAR = np.linspace(0.0, 20.0, len(TIME)) + 7.0 * (TIME > 2.0)  # m, with a step near 2π
SAID = {
    "a jump by 7 m": axis("link_position", "motor_position", "force", link=FAR + LINK, motor=FAR),
    "one in mm": axis("link_position [m]", "motor_position [m]", "force", motor=1e3 * MOTOR),
    "both in mm": axis("link_position", "motor_position", "force [N]", link=1e4 * LINK)
    | {"motor_position": 1e4 * MOTOR},
    "a velocity in mm/s": axis("link_position [m]", "motor_position [m]", "force")
    | {"motor_velocity": 1e3 * np.gradient(MOTOR, TIME)},
    "one in rad": axis("link_position [rad]", "motor_position [m]", "force"),
}


def in_units(**units: str) -> dict[str, Any]:
    """Return a column map of columns with these names and units."""
    return {name: {"column": name, "unit": unit} for name, unit in units.items()}


TURNED = in_units(motor_position="turn", motor_torque="N m", link_position="m")
TURNED["motor_position"]["scale"], TURNED["link_position"]["scale"] = 100, 1000
IN_RADIANS = in_units(motor_position="rad", motor_torque="N m", link_position="m")
MAPS = {
    "no such joint": {"joint": "linear"},
    "no lead": {"lead": 0.0},
    "a lead of a joint that turns": {"lead": 0.01, "joint": "revolute"},
    "a lead and a gear": {"lead": 0.01, "gear_ratio": 10},
    "a gear of a slide": {"joint": "prismatic", "gear_ratio": 10},
    "a lead of columns without a unit": {"lead": 0.01},
    "a lead of an input without a unit": {"lead": 0.01, **in_units(motor_position="m")},
    "a lead that is too long": {"lead": 10.0, **TURNED},
    "a lead that is too short": {"lead": 1e-4, **IN_RADIANS},
    "a slide that is said to turn": {"joint": "revolute", **in_units(link_position="mm")},
    "a gear of columns that slide": {"gear_ratio": 10, **in_units(motor_torque="N")},
}


def test_what_makes_no_sense(golden: Any) -> None:
    """Assert that messages about a linear axis use its units, and none of angles."""
    columns = axis("link_position", "motor_position", "motor_torque")
    golden(
        {name: said(read_columns, one) for name, one in SAID.items()}
        | {name: said(read_columns, columns, one) for name, one in MAPS.items()}
    )
