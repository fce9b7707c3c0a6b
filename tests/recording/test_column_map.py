"""Column maps: renaming, scaling, combining, and refusals."""

import re
import tomllib
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from joint_log import csv_text, joint_columns, read_columns, refused, said, without, written

from flexid.arrays import FloatArray
from flexid.errors import RecordingError
from flexid.recording import read_log

COLUMNS = joint_columns()
RAW_MAP = """
time = "t [ms]"
motor_position = {column = "pot_V", scale = 30.0, offset = -90.0, unit = "deg"}
deflection = {column = "strain", scale = 2.0}
motor_voltage = {column = "u", unit = "mV"}
"""
RAW = {
    "t [ms]": COLUMNS["time"] * 1e3,
    "pot_V": (np.degrees(COLUMNS["motor_position"]) + 90.0) / 30.0,
    "strain [deg]": np.degrees(COLUMNS["link_position"] - COLUMNS["motor_position"]) / 2.0,
    "u": COLUMNS["motor_torque"] * 1e3,
    "other": COLUMNS["time"],
}


def renamed(**names: str) -> dict[str, FloatArray]:
    """Return the canonical columns, some with another name."""
    return {names.get(name, name): values for name, values in COLUMNS.items()}


def geared(ratio: float) -> dict[str, FloatArray]:
    """Return the log with the motor's channels as before a gear."""
    factors = {"motor_torque": ratio, "motor_position": 1 / ratio, "motor_velocity": 1 / ratio}
    return {name: values / factors.get(name, 1.0) for name, values in COLUMNS.items()}


TORQUE = COLUMNS["motor_torque"]
STEPS = (1e6 * COLUMNS["time"]).astype("timedelta64[us]")
GEARS = {101: 101.0, "1/101": 101.0, "101:1": 101.0, -50.5: -50.5, "3/157": 157 / 3}
LINK_SIDE = {
    name: {"column": name, "side": "link"} for name in ("motor_position", "motor_velocity")
}
SCALED_TORQUE = {"column": "torque", "unit": "mN m", "scale": 1000}
IN_LETTERS = renamed(motor_position="q_m [rad]", link_position="Q_L")
LETTERS = {"motor_position": "Q M", "link_position": "q l"}
TWICE = {**COLUMNS, "MotorTorque": 2 * TORQUE}
IN_TURN = tomllib.loads(RAW_MAP)
SUM = {
    "sum": [{"column": "pot_V", "scale": 15.0}, "strain"],
    "scale": 2.0,
    "offset": -90.0,
    "unit": "deg",
}
QUOTIENT = {"sum": ["u", {"column": "four", "scale": "1/4"}], "scale": "1/2"}
MAPS: dict[str, tuple[dict[str, FloatArray], dict[str, Any]]] = {
    "raw columns": (RAW, IN_TURN),
    "a sum": (RAW, {**without(IN_TURN, "deflection"), "link_position": SUM}),
    "a quotient": (
        {**RAW, "u": TORQUE, "four": 4.0 * TORQUE},
        {**IN_TURN, "motor_voltage": QUOTIENT},
    ),
    **{f"a gear of {ratio!r}": (geared(n), {"gear_ratio": ratio}) for ratio, n in GEARS.items()},
    "the link's side": (
        without(COLUMNS, "torque") | {"torque": TORQUE / 101.0},
        {"gear_ratio": 101, **LINK_SIDE, "motor_torque": SCALED_TORQUE},
    ),
    **{
        f"a gear and {name}": (
            geared(1.5) | {name: TORQUE},
            {"gear_ratio": 1.5, "motor_torque": False},
        )
        for name in ("motor_current", "motor_voltage")
    },
    "a gear and a torque in V": (
        without(geared(1.5), "torque") | {"motor_torque [V]": TORQUE},
        {"gear_ratio": 1.5},
    ),
    "other letters": (IN_LETTERS, LETTERS),
    "letters as they stand": (IN_LETTERS | {"Q M": TORQUE}, LETTERS | {"motor_position": "q_m"}),
    **{f"a header after {mark!r}": (COLUMNS, {"time": f"{mark}time"}) for mark in ("%", "# ")},
    "a part of a sum": (
        without(COLUMNS, "link_position")
        | {"bend": COLUMNS["link_position"] - COLUMNS["motor_position"]},
        {"link_position": {"sum": ["motor_position", "bend"]}},
    ),
    "a torque by its current": (
        without(COLUMNS, "torque") | {"motor_current [A]": 0.5 * TORQUE},
        {"motor_torque": {"column": "motor_current", "scale": 2, "unit": "N m"}},
    ),
    "a torque by its voltage": (
        without(COLUMNS, "torque") | {"u": 0.5 * TORQUE},
        {"motor_voltage": {"column": "u", "scale": "4/2", "unit": "N m"}},
    ),
    "a gear and a torque by its voltage": (
        without(geared(1.5), "torque") | {"u": TORQUE / 1.5},
        {"gear_ratio": 1.5, "motor_voltage": {"column": "u", "unit": "N m"}},
    ),
    "a name twice": (
        COLUMNS | {"MotorTorque": 0.5 * TORQUE},
        {"motor_torque": {"column": "MotorTorque", "scale": 2}},
    ),
}


@pytest.mark.parametrize("name", MAPS)
def test_maps_give_the_log(name: str) -> None:
    """Assert that mapped channels equal the log's, and that their origins are right formulas."""
    columns, column_map = MAPS[name]
    log = read_columns(columns, column_map)
    assert log.warnings == ()  # a column map allows unused columns
    (recording,) = log.recordings
    assert recording.from_voltage == name.endswith("by its voltage")
    found = {**{one: getattr(recording, one) for one in COLUMNS if one != "motor_torque"}}
    found["motor_torque"] = recording.input
    for channel, values in found.items():
        if values is not None:
            np.testing.assert_allclose(values, COLUMNS[channel], atol=1e-11)
    found["deflection"] = recording.deflection
    found |= dict.fromkeys(("motor_current", "motor_voltage"), recording.input)
    bare = {header.partition(" [")[0]: values for header, values in columns.items()} | columns
    for channel, origin in log.columns.items():
        total = sum(weight * bare[column] for column, weight in origin.columns.items())
        right = origin.factor * total + origin.offset
        np.testing.assert_allclose(right, found[channel], atol=1e-11)


UNREAD = ("link_position", "motor_torque", "motor_position")
ORIGINS: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    **MAPS,
    **{f"no {name}": (COLUMNS, {name: False}) for name in UNREAD},
    "a torque twice": (TWICE, {}),
    "a torque twice, without a word": (TWICE, {"time": "time"}),
    "neither of both": (TWICE, {"motor_torque": False}),
    "a usual name beside a map": (renamed(motor_torque="tau"), {"time": "time"}),
    "a load beside a map": (
        renamed(link_position="load_position", motor_torque="I_A"),
        {"motor_torque": {"column": "I_A", "scale": 7.2, "unit": "N m"}},
    ),
    "both positions mapped, not the torque": (
        renamed(motor_torque="tau", link_position="a", motor_position="b"),
        {"link_position": "a", "motor_position": "b"},
    ),
    "a bare name beside a map": (renamed(link_position="position"), {"time": "time"}),
    "two loads beside a map": (
        renamed(link_position="load_position") | {"q_l": TORQUE},
        {"time": "time"},
    ),
    "loads of two joints beside a map": (
        without(renamed(link_position="q_l_1"), "velocity") | {"q_l_2": TORQUE},
        {"motor_position": "motor_position"},
    ),
    "another joint's load beside a map": (
        without(renamed(link_position="q_l_1", motor_position="q_m_2"), "velocity"),
        {"motor_position": "q_m_2"},
    ),
    "the load of a mapped joint": (
        without(renamed(link_position="q_l_2", motor_position="q_m_2"), "velocity")
        | {"q_l_1": TORQUE, "q_m_1": TORQUE},
        {"motor_position": "q_m_2"},
    ),
    "a stamp beside a map": (
        renamed(time="t", motor_torque="tau") | {"when": np.datetime64("2024-05-01") + STEPS},
        {"time": "t"},
    ),
    "a link left out": (renamed(link_position="load_position"), {"link_position": False}),
    "Quanser's deflection": (
        without(renamed(motor_position="theta", motor_torque="Vm (V)"), "velocity", "link")
        | {"alpha": COLUMNS["link_position"] - COLUMNS["motor_position"]},
        {"deflection": "alpha"},
    ),
    "a clamped link": (without(COLUMNS, "link_position"), {"link_position": 0.1}),
    "a clamped motor": (without(renamed(link_position="q_l"), "torque"), {"motor_position": 0}),
    "a clamped deflection": (COLUMNS, {"deflection": 0}),
    "two in other letters": (IN_LETTERS | {"Q_M": TORQUE}, LETTERS),
    "one of two units": (IN_LETTERS | {"q_m [deg]": TORQUE}, LETTERS | {"motor_position": "q_m"}),
}


def test_what_maps_make_of_columns(golden: Any) -> None:
    """Assert the formula of each channel, and that ambiguous columns are refused."""
    found = {}
    for name, (columns, column_map) in ORIGINS.items():
        try:
            log = read_columns(columns, column_map or None)
            origins = (f"{channel} {origin}" for channel, origin in log.columns.items())
            found[name] = "; ".join([*origins, *log.warnings])
        except RecordingError as error:
            found[name] = str(error)
    golden(found)


RATIOS = ("0.01", "true", '"1/0"', '"a"', "inf")
BAD: dict[str, tuple[str, ...]] = {  # replacements of a text of the map
    "scale = 30.0": ("scal = 30.0", 'scale = "30"', "scale = nan", "scale = true"),
    'column = "u", ': ("", 'column = "u", sum = ["u"], ', "sum = [], ", 'sum = ["u", "u"], '),
    'column = "u"': (
        *('sum = ["strain", "strain [deg]"]', "sum = [3]", "sum = [{scale = 2.0}]", 'sum = "u"'),
        "column = 3",
    ),
    '"t [ms]"': ("3", *(f'"t"\ngear_ratio = {n}' for n in RATIOS)),
    "motor_voltage": ("motor_volts",),
    '"pot_V"': ('"pot"', '"pot_v1"'),
    '"mV"': ('"A"', "true"),
    'column = "strain"': ('sum = ["strain", "u"]',),
    'unit = "deg"': ('unit = "count"', 'side = "link"', 'side = "left"'),
    "scale = 2.0": ('side = "motor"',),
    RAW_MAP: ('time = "t [ms]"', "", "time,q\n0,1\n"),
}


def test_bad_maps(here: Path, golden: Any) -> None:
    """Assert that the message names map, key and remedy, for a file as for a mapping."""
    log, found = written(Path(), csv_text(RAW)), {}
    for old, new in ((old, new) for old, others in BAD.items() for new in others):
        assert old in RAW_MAP
        text = RAW_MAP.replace(old, new)
        message = said(read_log, log, written(Path(), text, name="columns.toml"))
        found[f"{old[:20]} as {new}".replace("\n", " ")] = message
        with suppress(tomllib.TOMLDecodeError):
            of_mapping = said(read_log, log, tomllib.loads(text))
            assert re.sub(r"(the column map )?columns\.toml", "columns", message) == of_mapping
    golden(found)
    path = written(Path(), RAW_MAP.replace("2.0", "2.0.1"), name="columns.toml")
    assert re.search("^columns.toml: the column map is not TOML.* 4", refused(read_log, log, path))


ONLY_IN_PYTHON: list[Mapping[Any, object]] = [
    {3: "q"},
    {"gear_ratio": {}},
    {"time": np.arange(3)},
    {"time": ("t [ms]", "s")},
]


def test_mappings_that_no_file_holds(golden: Any) -> None:
    """Assert that mappings which only Python can express are refused in one sentence."""
    golden({repr(content): said(read_columns, RAW, content) for content in ONLY_IN_PYTHON})
