"""Column maps: renaming, scaling, combining, and what is refused."""

import tomllib
from collections import OrderedDict
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest
from joint_log import (
    assert_words,
    csv_text,
    joint_columns,
    read_columns,
    refused,
    said,
    without,
    written,
)

from flexid.arrays import FloatArray
from flexid.recording import Log, read_log

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


def read(text: str, columns: Mapping[str, FloatArray] = RAW) -> Log:
    """Columns by a map, as TOML."""
    return read_columns(columns, tomllib.loads(text))


def renamed(**names: str) -> dict[str, FloatArray]:
    """The canonical columns, some by another name."""
    return {names.get(name, name): values for name, values in COLUMNS.items()}


def test_raw_columns() -> None:
    """Assert that scale, offset, unit and the header's unit give the channels in SI."""
    log = read(RAW_MAP)
    assert log.warnings == ()  # with a map, unused columns are no surprise
    (recording,) = log.recordings
    assert recording.input_unit == "V"
    assert recording.sample_time == pytest.approx(0.005)
    for found, name in (
        (recording.motor_position, "motor_position"),
        (recording.needed_link_position, "link_position"),
        (recording.needed_input, "motor_torque"),
    ):
        np.testing.assert_allclose(found, COLUMNS[name], atol=1e-12)


def test_sum_of_columns() -> None:
    """Assert that a sum adds its terms, each with its scale, before scale and offset."""
    lines = [line for line in RAW_MAP.split("\n") if not line.startswith("deflection")]
    link = """
    [link_position]
    sum = [{column = "pot_V", scale = 15.0}, "strain"]
    scale = 2.0
    offset = -90.0
    unit = "deg"
    """
    (recording,) = read("\n".join(lines) + link).recordings
    expected = COLUMNS["link_position"]
    np.testing.assert_allclose(recording.needed_link_position, expected, atol=1e-12)


@pytest.mark.parametrize("unread", ["link_position", "motor_torque"])
def test_a_channel_that_is_not_to_be_read(unread: str) -> None:
    """Assert that false leaves a column of the channel's name alone, without a question."""
    log = read_columns(COLUMNS, {unread: False})
    assert unread not in log.columns
    assert not any("so only the" in warning for warning in log.warnings)
    assert "no motor_position" in refused(read_columns, COLUMNS, {"motor_position": False})


def test_a_name_that_the_map_takes_may_stand_twice() -> None:
    """Assert that two columns of a channel's name are no question where the map answers it."""
    columns = {**COLUMNS, "MotorTorque": 2 * COLUMNS["motor_torque"]}
    assert "are both motor_torque" in refused(read_columns, columns)
    log = read_columns(columns, {"motor_torque": "MotorTorque"})
    assert log.columns["motor_torque"].columns == {"MotorTorque": 1.0}
    assert "motor_torque" not in read_columns(columns, {"motor_torque": False}).columns


@pytest.mark.parametrize(
    ("written", "ratio"),
    [(101, 101.0), ("1/101", 101.0), ("101:1", 101.0), (-50.5, -50.5), ("3/157", 157 / 3)],
)
def test_gear_ratio(written: object, ratio: float) -> None:
    """Assert that angles and velocities are divided and the torque is multiplied, and so said."""
    factors = {"motor_torque": ratio, "motor_position": 1 / ratio, "motor_velocity": 1 / ratio}
    columns = {name: values / factors.get(name, 1.0) for name, values in COLUMNS.items()}
    log = read_columns(columns, {"gear_ratio": written})
    assert log.warnings == ()
    (recording,) = log.recordings
    np.testing.assert_allclose(recording.needed_input, COLUMNS["motor_torque"], rtol=1e-12)
    for name in ("link_position", "motor_position", "link_velocity", "motor_velocity"):
        np.testing.assert_allclose(getattr(recording, name), COLUMNS[name], rtol=1e-12)
    for name, origin in log.columns.items():
        assert origin.factor == pytest.approx(factors.get(name, 1.0))
        assert origin.gear_ratio == (pytest.approx(ratio) if name in factors else None)


def test_side_of_the_gear() -> None:
    """Assert that a channel that is at the link's side already is left as it is."""
    text = """
        gear_ratio = 101
        motor_position = {column = "motor_position", side = "link"}
        motor_velocity = {column = "motor_velocity", side = "link"}
        motor_torque = {column = "torque", unit = "mN m", scale = 1000}
    """
    torque = {"torque": COLUMNS["motor_torque"] / 101.0}
    log = read(text, without(COLUMNS, "torque") | torque)
    (recording,) = log.recordings
    np.testing.assert_array_equal(recording.motor_position, COLUMNS["motor_position"])
    np.testing.assert_allclose(recording.needed_input, COLUMNS["motor_torque"], rtol=1e-12)
    assert log.columns["motor_torque"].factor == pytest.approx(101.0)
    assert log.columns["motor_position"].gear_ratio is None


@pytest.mark.parametrize("name", ["motor_current", "motor_voltage", "motor_torque [V]"])
def test_a_gear_carries_no_current(name: str) -> None:
    """Assert that a current or a voltage has no side of the gear."""
    (recording,) = read("gear_ratio = 1.5", renamed(motor_torque=name)).recordings
    np.testing.assert_array_equal(recording.input, COLUMNS["motor_torque"])


def test_origin_is_the_formula() -> None:
    """Assert that factor, weights and offset give the channel from the file's own numbers."""
    text = RAW_MAP.replace(
        'column = "u"', 'sum = ["u", {column = "other", scale = "1/4"}], scale = 3, offset = 0.5'
    )
    log = read(text)
    (recording,) = log.recordings
    for name, values in (
        ("motor_position", recording.motor_position),
        ("motor_voltage", recording.needed_input),
    ):
        origin = log.columns[name]
        total = sum(weight * RAW[column] for column, weight in origin.columns.items())
        np.testing.assert_allclose(origin.factor * total + origin.offset, values, atol=1e-12)
    assert log.columns["motor_voltage"].columns == {"u": 1.0, "other": 0.25}


def test_letter_case() -> None:
    """Assert that a map finds a column in other letters, unless two differ by no more or a unit."""
    columns = renamed(motor_position="q_m [rad]", link_position="Q_L")
    names = {"motor_position": "Q M", "link_position": "q l"}
    (recording,) = read_columns(columns, names).recordings
    np.testing.assert_array_equal(recording.motor_position, columns["q_m [rad]"])
    columns["Q_M"] = columns["q_m [rad]"]
    words = "'q_m [rad]', 'Q_M' both match 'Q M': write the name as in the file"
    assert words in refused(read_columns, columns, names)
    read_columns(columns, names | {"motor_position": "Q_M"})
    columns["q_m [deg]"] = np.degrees(COLUMNS["motor_position"])
    assert "both match 'q_m'" in refused(read_columns, columns, names | {"motor_position": "q_m"})


RATIOS = ("0.01", "true", '"1/0"', '"a"', "inf")
BAD: dict[str, tuple[str, ...]] = {  # in the place of a text of the map
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


def test_bad_maps(tmp_path: Path, golden: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Assert that the message names the map, the key and the remedy, of a mapping likewise."""
    monkeypatch.chdir(tmp_path)
    log, found = written(Path(), csv_text(RAW)), {}
    for old, new in ((old, new) for old, others in BAD.items() for new in others):
        assert old in RAW_MAP
        text = RAW_MAP.replace(old, new)
        message = said(read_log, log, written(Path(), text, name="columns.toml"))
        found[f"{old[:20]} as {new}".replace("\n", " ")] = message
        with suppress(tomllib.TOMLDecodeError):
            of_mapping = said(read_log, log, tomllib.loads(text))
            assert (
                message.replace("the column map columns.toml", "columns").replace(
                    "columns.toml", "columns"
                )
                == of_mapping
            )
    golden(found)
    path = written(Path(), RAW_MAP.replace("2.0", "2.0.1"), name="columns.toml")
    assert_words("^columns.toml: the column map is not TOML.*line 4", refused(read_log, log, path))


@pytest.mark.parametrize("kind", [dict, OrderedDict, MappingProxyType])
def test_a_mapping_is_read_as_the_file_is(kind: Any) -> None:
    """Assert that a mapping of whatever type gives the same samples, origins and warnings."""
    text = "gear_ratio = 50\n" + RAW_MAP.replace('column = "u"', 'sum = ["u", {column = "other"}]')
    content = {k: kind(v) if isinstance(v, dict) else v for k, v in tomllib.loads(text).items()}
    terms = ("u", kind({"column": "other"}))
    content["motor_voltage"] = {**content["motor_voltage"], "sum": terms}
    content["gear_ratio"] = np.int64(50)
    content["deflection"] = kind({"column": "strain", "scale": np.float32(2.0)})
    wanted, found = read(text), read_columns(RAW, kind(content))
    assert found.columns == wanted.columns
    assert found.warnings == wanted.warnings
    for channel in ("link_position", "motor_position", "input"):
        one, other = getattr(wanted.recordings[0], channel), getattr(found.recordings[0], channel)
        np.testing.assert_array_equal(other, one)


ONLY_IN_PYTHON: list[Mapping[Any, object]] = [
    {3: "q"},
    {"gear_ratio": {}},
    {"time": np.arange(3)},
    {"time": ("t [ms]", "s")},
]


def test_mappings_that_no_file_holds(golden: Any) -> None:
    """Assert that what only Python can give is refused in a sentence, too."""
    golden({repr(content): said(read_columns, RAW, content) for content in ONLY_IN_PYTHON})
