"""Column maps: renaming, scaling, combining, and what is refused."""

from __future__ import annotations

import tomllib
from collections import OrderedDict
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import polars as pl
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from joint_log import joint_columns, write_csv

from flexid.errors import RecordingError
from flexid.recording import Log, read_log

RAW_MAP = """
time = "t [ms]"
motor_position = {column = "pot_V", scale = 30.0, offset = -90.0, unit = "deg"}
deflection = {column = "strain", scale = 2.0}
motor_voltage = {column = "u", unit = "mV"}
"""


def raw_log(folder: Path) -> Path:
    """Write a log of raw sensor columns."""
    columns = joint_columns()
    deflection = columns["link_position"] - columns["motor_position"]
    return write_csv(
        folder,
        {
            "t [ms]": columns["time"] * 1e3,
            "pot_V": (np.degrees(columns["motor_position"]) + 90.0) / 30.0,
            "strain [deg]": np.degrees(deflection) / 2.0,
            "u": columns["motor_torque"] * 1e3,
            "other": columns["time"],
        },
    )


def read_mapped(folder: Path, text: str) -> Log:
    """Read the raw log with a map."""
    path = folder / "columns.toml"
    path.write_text(text, encoding="utf-8")
    return read_log(raw_log(folder), path)


def test_raw_columns(tmp_path: Path) -> None:
    """Assert that scale, offset, unit and the header's unit give the channels in SI."""
    columns = joint_columns()
    log = read_mapped(tmp_path, RAW_MAP)
    assert log.warnings == ()  # with a map, unused columns are no surprise
    (recording,) = log.recordings
    assert recording.input_unit == "V"
    assert recording.sample_time == pytest.approx(0.005)
    np.testing.assert_allclose(recording.motor_position, columns["motor_position"], atol=1e-12)
    np.testing.assert_allclose(recording.needed_link_position, columns["link_position"], atol=1e-12)
    np.testing.assert_allclose(recording.needed_input, columns["motor_torque"], atol=1e-12)


def test_sum_of_columns(tmp_path: Path) -> None:
    """Assert that a sum adds its terms, each with its scale, before scale and offset."""
    text = RAW_MAP.replace("deflection = {column", "link_velocity = {column").split("\n")
    text = [line for line in text if not line.startswith("link_velocity")]
    link = """
    [link_position]
    sum = [{column = "pot_V", scale = 15.0}, "strain"]
    scale = 2.0
    offset = -90.0
    unit = "deg"
    """
    (recording,) = read_mapped(tmp_path, "\n".join(text) + link).recordings
    expected = joint_columns()["link_position"]
    np.testing.assert_allclose(recording.needed_link_position, expected, atol=1e-12)


def test_canonical_columns_need_no_entry(tmp_path: Path) -> None:
    """Assert that what the map does not name is taken by its canonical name."""
    columns = joint_columns()
    columns["drive"] = columns.pop("motor_torque")
    map_path = tmp_path / "columns.toml"
    map_path.write_text('motor_torque = "drive"')
    (recording,) = read_log(write_csv(tmp_path, columns), map_path).recordings
    np.testing.assert_array_equal(recording.input, columns["drive"])


@pytest.mark.parametrize("unread", ["link_position", "motor_torque"])
def test_a_channel_that_is_not_to_be_read(tmp_path: Path, unread: str) -> None:
    """Assert that false leaves a column of the channel's name alone, without a question."""
    path = write_csv(tmp_path, joint_columns())
    log = read_log(path, {unread: False})
    assert unread not in log.columns
    assert not any("so only the" in warning for warning in log.warnings)
    with pytest.raises(RecordingError, match="no motor_position"):
        read_log(path, {"motor_position": False})


def test_a_name_that_the_map_takes_may_stand_twice(tmp_path: Path) -> None:
    """Assert that two columns of a channel's name are no question where the map answers it."""
    columns = joint_columns()
    path = write_csv(tmp_path, {**columns, "MotorTorque": 2 * columns["motor_torque"]})
    with pytest.raises(RecordingError, match="are both motor_torque"):
        read_log(path)
    log = read_log(path, {"motor_torque": "MotorTorque"})
    assert log.columns["motor_torque"].columns == {"MotorTorque": 1.0}
    assert "motor_torque" not in read_log(path, {"motor_torque": False}).columns


def geared_log(folder: Path, ratio: float) -> Path:
    """Write a log whose motor's columns are at the motor's side of a gear."""
    columns = joint_columns()
    columns["motor_position"] *= ratio
    columns["motor_velocity"] *= ratio
    columns["motor_torque"] /= ratio
    return write_csv(folder, columns)


@pytest.mark.parametrize(
    ("written", "ratio"),
    [
        ("101", 101.0),
        ('"1/101"', 101.0),
        ('"101:1"', 101.0),
        ("-50.5", -50.5),
        ('"3/157"', 157 / 3),
    ],
)
def test_gear_ratio(tmp_path: Path, written: str, ratio: float) -> None:
    """Assert that angles and velocities are divided and the torque is multiplied, and so said."""
    map_path = tmp_path / "columns.toml"
    map_path.write_text(f"gear_ratio = {written}")
    log = read_log(geared_log(tmp_path, ratio), map_path)
    assert log.warnings == ()
    (recording,) = log.recordings
    for name, values in joint_columns().items():
        if name != "time":
            read = recording.needed_input if name == "motor_torque" else getattr(recording, name)
            np.testing.assert_allclose(read, values, rtol=1e-12)
    for name, origin in log.columns.items():
        factor = {"motor_torque": ratio, "motor_position": 1 / ratio, "motor_velocity": 1 / ratio}
        assert origin.factor == pytest.approx(factor.get(name, 1.0))
        assert origin.gear_ratio == (pytest.approx(ratio) if name in factor else None)


def test_side_of_the_gear(tmp_path: Path) -> None:
    """Assert that a channel that is at the link's side already is left as it is."""
    columns = joint_columns()
    columns["torque"] = columns.pop("motor_torque") / 101.0
    map_path = tmp_path / "columns.toml"
    map_path.write_text("""
        gear_ratio = 101
        motor_position = {column = "motor_position", side = "link"}
        motor_velocity = {column = "motor_velocity", side = "link"}
        motor_torque = {column = "torque", unit = "mN m", scale = 1000}
    """)
    log = read_log(write_csv(tmp_path, columns), map_path)
    (recording,) = log.recordings
    np.testing.assert_array_equal(recording.motor_position, columns["motor_position"])
    np.testing.assert_allclose(recording.needed_input, joint_columns()["motor_torque"], rtol=1e-12)
    assert log.columns["motor_torque"].factor == pytest.approx(101.0)
    assert log.columns["motor_position"].gear_ratio is None


@pytest.mark.parametrize("name", ["motor_current", "motor_voltage", "motor_torque [V]"])
def test_a_gear_carries_no_current(tmp_path: Path, name: str) -> None:
    """Assert that a current or a voltage has no side of the gear."""
    columns = joint_columns()
    columns[name] = columns.pop("motor_torque")
    map_path = tmp_path / "columns.toml"
    map_path.write_text("gear_ratio = 1.5")
    (recording,) = read_log(write_csv(tmp_path, columns), map_path).recordings
    np.testing.assert_array_equal(recording.input, joint_columns()["motor_torque"])


def test_origin_is_the_formula(tmp_path: Path) -> None:
    """Assert that factor, weights and offset give the channel from the file's own numbers."""
    text = RAW_MAP.replace(
        'column = "u"', 'sum = ["u", {column = "other", scale = "1/4"}], scale = 3, offset = 0.5'
    )
    log = read_mapped(tmp_path, text)
    frame = pl.read_csv(tmp_path / "log.csv")
    (recording,) = log.recordings
    for name, values in (
        ("motor_position", recording.motor_position),
        ("motor_voltage", recording.needed_input),
    ):
        origin = log.columns[name]
        total = sum(weight * frame[column] for column, weight in origin.columns.items())
        np.testing.assert_allclose(origin.factor * total + origin.offset, values, atol=1e-12)
    assert log.columns["motor_voltage"].columns == {"u": 1.0, "other": 0.25}


def test_letter_case(tmp_path: Path) -> None:
    """Assert that a map finds a column in other letters, unless two differ by nothing else."""
    map_path = tmp_path / "columns.toml"
    map_path.write_text('motor_position = "Q M"\nlink_position = "q l"')
    columns = joint_columns()
    columns["q_m [rad]"] = columns.pop("motor_position")
    columns["Q_L"] = columns.pop("link_position")
    (recording,) = read_log(write_csv(tmp_path, columns), map_path).recordings
    np.testing.assert_array_equal(recording.motor_position, columns["q_m [rad]"])
    columns["Q_M"] = columns["q_m [rad]"]
    with pytest.raises(RecordingError, match=r"'q_m \[rad\]', 'Q_M' both match 'Q M'"):
        read_log(write_csv(tmp_path, columns), map_path)
    map_path.write_text('motor_position = "Q_M"\nlink_position = "q l"')
    read_log(write_csv(tmp_path, columns), map_path)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("scale = 30.0", "scal = 30.0", ["key 'motor_position.scal'", "not known", "scale"]),
        ("30.0", '"30"', ["key 'motor_position.scale'", "valid number"]),
        ("30.0", "nan", ["key 'motor_position.scale'", "finite number"]),
        ('column = "u", ', "", ["key 'motor_voltage'", "exactly one of 'column' and 'sum'"]),
        ('column = "u"', 'column = "u", sum = ["u"]', ["exactly one of 'column' and 'sum'"]),
        ('column = "u"', "sum = []", ["exactly one of 'column' and 'sum'"]),
        ('column = "u"', 'sum = ["u", "u"]', ["'sum' has the column 'u' twice", "with a scale"]),
        ('column = "u"', 'sum = ["strain", "strain [deg]"]', ["'strain [deg]' twice", "a scale"]),
        ('column = "u"', "sum = [3]", ["key 'motor_voltage.sum.0'", "neither a column name"]),
        ('"t [ms]"', "3", ["key 'time'", "neither a column name nor a table"]),
        ("motor_voltage", "motor_volts", ["key 'motor_volts'", "did you mean 'motor_voltage'?"]),
        ('"pot_V"', '"pot"', ["key 'motor_position'", "log.csv has no column 'pot'", "'pot_V'"]),
        ('"pot_V"', '"pot_v1"', ["did you mean 'pot_V'?"]),
        ('"deg"', '"count"', ["key 'motor_position'", "[count] does not measure", "[deg]"]),
        ('"mV"', '"A"', ["key 'motor_voltage'", "[A] does not measure", "[V]"]),
        ("scale = 2.0", "scale = 2.0.1", ["the column map is no TOML", "line 4"]),
        ('column = "strain"', 'sum = ["strain", "u"]', ["differ in unit", "'unit'"]),
        ("time =", "time = 1\ntime =", ["the column map is no TOML", "correct it"]),
        ("time =", "gear_ratio = 0.01\ntime =", ["key 'gear_ratio'", "0.01 is no ratio", "101"]),
        ("time =", "gear_ratio = true\ntime =", ["key 'gear_ratio'", "True is no ratio"]),
        ("time =", 'gear_ratio = "1/0"\ntime =', ["key 'gear_ratio'", "no ratio"]),
        ("time =", 'gear_ratio = "high"\ntime =', ["key 'gear_ratio'", "'high' is no ratio"]),
        ("time =", "gear_ratio = inf\ntime =", ["key 'gear_ratio'", "inf is no ratio"]),
        ('unit = "deg"', 'side = "link"', ["'motor_position.side'", "but the map no gear_ratio"]),
        ("scale = 2.0", 'side = "motor"', ["key 'deflection.side'", "deflection has no side"]),
        ('unit = "deg"', 'side = "left"', ["'motor_position.side'", "'motor' or 'link'"]),
    ],
)
def test_bad_maps(tmp_path: Path, old: str, new: str, words: list[str]) -> None:
    """Assert that the message names the map, the key and the remedy."""
    assert old in RAW_MAP
    with pytest.raises(RecordingError) as caught:
        read_mapped(tmp_path, RAW_MAP.replace(old, new))
    assert caught.value.file == str(tmp_path / "columns.toml")
    for word in words:
        assert word in str(caught.value)

    content = toml_of(RAW_MAP.replace(old, new))
    if content is not None:  # what no TOML can say is no mapping either
        with pytest.raises(RecordingError) as again:
            read_log(raw_log(tmp_path), content)
        assert str(again.value) == str(caught.value).replace(caught.value.file, "columns", 1)


def toml_of(text: str) -> dict[str, Any] | None:
    """The tables of a TOML file, None where it is none."""
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return None


@pytest.mark.parametrize("kind", [dict, OrderedDict, MappingProxyType])
def test_a_mapping_is_read_as_the_file_is(tmp_path: Path, kind: Any) -> None:
    """Assert that a mapping of whatever type gives the same samples, origins and warnings."""
    text = "gear_ratio = 50\n" + RAW_MAP.replace('column = "u"', 'sum = ["u", {column = "other"}]')
    content = {
        key: kind(value) if isinstance(value, dict) else value
        for key, value in tomllib.loads(text).items()
    }
    content["motor_voltage"] = {
        **content["motor_voltage"],
        "sum": tuple(
            one if isinstance(one, str) else kind(one) for one in ("u", {"column": "other"})
        ),
    }
    content["gear_ratio"] = np.int64(50)
    content["deflection"] = kind({"column": "strain", "scale": np.float32(2.0)})
    wanted, found = read_mapped(tmp_path, text), read_log(raw_log(tmp_path), kind(content))
    assert found.columns == wanted.columns
    assert found.warnings == wanted.warnings
    for channel in ("link_position", "motor_position", "input"):
        one, other = getattr(wanted.recordings[0], channel), getattr(found.recordings[0], channel)
        np.testing.assert_array_equal(other, one)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ({}, "columns: the column map is empty"),
        ({3: "q"}, "columns: key 3: this is no channel"),
        ({"gear_ratio": object()}, "columns: key 'gear_ratio': <object .* is no ratio"),
        ({"time": np.arange(3)}, "columns: key 'time': this is neither a column name nor a table"),
        ({"time": ("t [ms]", "s")}, "columns: key 'time': this is neither a column name nor"),
        ({"time": "t [ms]"}, "no motor_position.* say in columns which is which"),
    ],
)
def test_mappings_that_no_file_holds(
    tmp_path: Path, content: Mapping[Any, object], words: str
) -> None:
    """Assert that what only Python can give is refused in a sentence, too."""
    with pytest.raises(RecordingError, match=words):
        read_log(raw_log(tmp_path), content)


def test_missing_entry(tmp_path: Path) -> None:
    """Assert that a channel that neither file nor map has is named, with both."""
    text = "\n".join(line for line in RAW_MAP.split("\n") if "motor_pos" not in line)
    with pytest.raises(RecordingError, match=r"no motor_position.* the column map .*columns\.toml"):
        read_mapped(tmp_path, text)


def test_ambiguous_name(tmp_path: Path) -> None:
    """Assert that a name that two columns share but for the unit is not guessed."""
    columns = joint_columns()
    columns["q [deg]"] = np.degrees(columns["motor_position"])
    columns["q [rad]"] = columns.pop("motor_position")
    path = tmp_path / "columns.toml"
    path.write_text('motor_position = "q"')
    with pytest.raises(RecordingError, match="both match 'q': write the name as in the file"):
        read_log(write_csv(tmp_path, columns), path)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "the column map is empty"),
        (b"a=\xff\xfe\x00", "the column map is no text at byte 2: save it as UTF-8"),
        (b"time,q\n0,1\n", "no column map but perhaps the log: give --columns a TOML file"),
        (b"t;q\n" + b"0;1\n" * 100_000, "larger than 200 kB, the most that is read"),
        (b"a = " + b"[" * 5000, "the column map is no TOML that can be read"),
    ],
)
def test_unreadable_maps(tmp_path: Path, content: bytes, words: str) -> None:
    """Assert that a file that is no column map is refused."""
    path = tmp_path / "columns.toml"
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=words):
        read_log(raw_log(tmp_path), path)


def test_missing_map(tmp_path: Path) -> None:
    """Assert that a missing map is named."""
    with pytest.raises(RecordingError, match=r"nowhere\.toml: there is no such file"):
        read_log(raw_log(tmp_path), tmp_path / "nowhere.toml")


@settings(
    max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_any_map(tmp_path: Path, data: st.DataObject) -> None:
    """Assert that a mutated map raises nothing but a `RecordingError`."""
    content = bytearray(RAW_MAP.encode())
    for _ in range(data.draw(st.integers(1, 3))):
        start = data.draw(st.integers(0, len(content) - 1))
        length = data.draw(st.sampled_from([0, 1, 5]))
        patches = [b"", b"inf", b"1e308", b"-", b'"', b"{", b"[", b"9", b"e99"]
        content[start : start + length] = data.draw(
            st.sampled_from(patches) | st.binary(max_size=4)
        )
    path = tmp_path / "columns.toml"
    path.write_bytes(bytes(content))
    with suppress(RecordingError):
        read_log(raw_log(tmp_path), path)
