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
from joint_log import assert_words, csv_text, joint_columns, read_columns, refused, without, written

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


def test_canonical_columns_need_no_entry() -> None:
    """Assert that what the map does not name is taken by its canonical name."""
    (recording,) = read('motor_torque = "drive"', renamed(motor_torque="drive")).recordings
    np.testing.assert_array_equal(recording.input, COLUMNS["motor_torque"])


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
    """Assert that a map finds a column in other letters, unless two differ by nothing else."""
    columns = renamed(motor_position="q_m [rad]", link_position="Q_L")
    names = {"motor_position": "Q M", "link_position": "q l"}
    (recording,) = read_columns(columns, names).recordings
    np.testing.assert_array_equal(recording.motor_position, columns["q_m [rad]"])
    columns["Q_M"] = columns["q_m [rad]"]
    words = "'q_m [rad]', 'Q_M' both match 'Q M': write the name as in the file"
    assert words in refused(read_columns, columns, names)
    read_columns(columns, names | {"motor_position": "Q_M"})


def test_ambiguous_name() -> None:
    """Assert that a name that two columns share but for the unit is not guessed."""
    columns = renamed(motor_position="q [rad]")
    columns["q [deg]"] = np.degrees(COLUMNS["motor_position"])
    assert "both match 'q'" in refused(read_columns, columns, {"motor_position": "q"})


BAD = [
    ("scale = 30.0", "scal = 30.0", "key 'motor_position.scal': .*not known.*scale"),
    ("30.0", '"30"', "key 'motor_position.scale': .*finite number"),
    ("30.0", "nan", "key 'motor_position.scale': .*finite number"),
    ('column = "u", ', "", "key 'motor_voltage': exactly one of 'column' and 'sum'"),
    ('column = "u"', 'column = "u", sum = ["u"]', "exactly one of 'column' and 'sum'"),
    ('column = "u"', "sum = []", "exactly one of 'column' and 'sum'"),
    ('column = "u"', 'sum = ["u", "u"]', "'sum' has the column 'u' twice: give it once, with a sc"),
    ('column = "u"', 'sum = ["strain", "strain [deg]"]', r"the column 'strain \[deg\]' twice"),
    ('column = "u"', "sum = [3]", "key 'motor_voltage.sum.0': .*neither a column name"),
    ('column = "u"', "sum = [{scale = 2.0}]", "key 'motor_voltage.sum.0': a column is needed"),
    ('column = "u"', 'sum = "u"', "key 'motor_voltage.sum': 'u' is not a list of columns"),
    ('column = "u"', "column = 3", "key 'motor_voltage.column': 3 is not the name of a column"),
    ('"mV"', "true", "key 'motor_voltage.unit': True is not the name of a unit"),
    ("30.0", "true", "key 'motor_position.scale': True is not a finite number"),
    ('"t [ms]"', "3", "key 'time': .*neither a column name nor a table"),
    ("motor_voltage", "motor_volts", "key 'motor_volts': .*did you mean 'motor_voltage'"),
    ('"pot_V"', '"pot"', "key 'motor_position': log.csv has no column 'pot'.*'pot_V'"),
    ('"pot_V"', '"pot_v1"', "did you mean 'pot_V'"),
    ('"deg"', '"count"', r"key 'motor_position': .*\[count\] depends on the encoder"),
    ('"mV"', '"A"', r"key 'motor_voltage': .*\[A\] is not known for this column.*\[V\]"),
    ("scale = 2.0", "scale = 2.0.1", "the column map is not TOML.*line 4"),
    ('column = "strain"', 'sum = ["strain", "u"]', "differ in unit.*'unit'"),
    ("time =", "gear_ratio = 0.01\ntime =", "key 'gear_ratio': 0.01 is not a ratio.*101"),
    ("time =", "gear_ratio = true\ntime =", "key 'gear_ratio': True is not a ratio"),
    ("time =", 'gear_ratio = "1/0"\ntime =', "key 'gear_ratio': .*not a ratio"),
    ("time =", 'gear_ratio = "high"\ntime =', "key 'gear_ratio': 'high' is not a ratio"),
    ("time =", "gear_ratio = inf\ntime =", "key 'gear_ratio': inf is not a ratio"),
    ('unit = "deg"', 'side = "link"', "'motor_position.side': .*but the map no gear_ratio"),
    ("scale = 2.0", 'side = "motor"', "key 'deflection.side': deflection has no side"),
    ('unit = "deg"', 'side = "left"', "'motor_position.side': .*'motor' or 'link'"),
]


@pytest.mark.parametrize(("old", "new", "words"), BAD)
def test_bad_maps(tmp_path: Path, old: str, new: str, words: str, monkeypatch) -> None:
    """Assert that the message names the map, the key and the remedy, of a mapping likewise."""
    assert old in RAW_MAP
    monkeypatch.chdir(tmp_path)
    text = RAW_MAP.replace(old, new)
    log, path = written(Path(), csv_text(RAW)), written(Path(), text, name="columns.toml")
    message = refused(read_log, log, path)
    assert_words(f"^columns.toml: .*{words}", message)
    with suppress(tomllib.TOMLDecodeError):
        content = tomllib.loads(text)
        assert refused(read_log, log, content) == message.replace("columns.toml", "columns", 1)


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


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ({}, "columns: the column map is empty"),
        ({3: "q"}, "columns: key 3: this is not a channel"),
        ({"gear_ratio": object()}, "columns: key 'gear_ratio': <object .* is not a ratio"),
        ({"time": np.arange(3)}, "columns: key 'time': this is neither a column name nor a table"),
        ({"time": ("t [ms]", "s")}, "columns: key 'time': this is neither a column name nor"),
        ({"time": "t [ms]"}, "no motor_position.* say in columns which is which"),
    ],
)
def test_mappings_that_no_file_holds(content: Mapping[Any, object], words: str) -> None:
    """Assert that what only Python can give is refused in a sentence, too."""
    assert_words(words, refused(read_columns, RAW, content))


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b'time = "t [ms]"', "no motor_position.* the column map .*columns.toml"),
        (b"", "the column map is empty"),
        (b"time,q\n0,1\n", "not a column map, but perhaps the log: give --columns a TOML file"),
    ],
)
def test_unreadable_maps(tmp_path: Path, content: bytes, words: str) -> None:
    """Assert that a file that is no column map is refused."""
    path = written(tmp_path, content, name="columns.toml")
    assert_words(words, refused(read_columns, RAW, path))
