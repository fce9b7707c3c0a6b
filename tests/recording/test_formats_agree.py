"""One log in every format: the same channels at once, in parts, and after rewriting."""

from pathlib import Path

import log_files
import numpy as np
import polars as pl
import pytest
from benchmarks.fuzz_files import mcap

from flexid.recording import read_log
from flexid.recording.frame import write_parquet
from flexid.recording.read import table_of_file, tables_of_file

FAST = np.arange(0.0007, 0.4, 1e-3)
LATE = sorted(log_files.measured(2_000_000), key=lambda one: one[0])
TORQUE_OF_MDF = [log_files.signal("motor_torque", np.sin(FAST), FAST)]
IN_PARTS = {
    **{name: log_files.WRITERS[name] for name in ("Parquet", "HDF5", "MDF 3")},
    "MDF, two rates": (
        "a.mf4",
        lambda p: log_files.mdf(p, log_files.in_groups()[0], TORQUE_OF_MDF),
    ),
    "MCAP in blocks": ("a.mcap", lambda p: mcap(p, LATE)),
}


@pytest.mark.parametrize("name", log_files.WRITERS)
def test_channels_are_the_same_bits(name: str, tmp_path: Path):
    """Assert that every format gives the same channels, at the same times."""
    (recording,) = read_log(log_files.log_file(tmp_path, name), log_files.MAPS.get(name)).recordings
    np.testing.assert_array_equal(recording.link_position, log_files.COLUMNS["link_position"])
    np.testing.assert_array_equal(recording.motor_position, log_files.COLUMNS["motor_position"])
    np.testing.assert_array_equal(recording.input, log_files.COLUMNS["motor_torque"])
    assert recording.sample_time == pytest.approx(0.005, rel=1e-9)
    assert recording.input_unit == "N m"


@pytest.mark.parametrize("name", IN_PARTS)
def test_parts_are_the_whole(name: str, tmp_path: Path):
    """Assert that parts of a file, with one clock or two, equal the whole."""
    file, write = IN_PARTS[name]
    path, column_map = tmp_path / file, log_files.TORQUE if "MCAP" in name else None
    write(path)
    parts = [table.frame for table in tables_of_file(path, column_map, 30)]
    assert [part.height for part in parts[:2]] == [30, 30]
    assert pl.concat(parts).equals(table_of_file(path, column_map).frame)


def test_columns_and_tables_come_back(tmp_path: Path):
    """Assert paths of columns, with warnings by name, and Parquet files replaced or refused."""
    for name, path in (
        ("MATLAB, struct", "run.motor_position"),
        ("HDF5", "run/1/motor_position"),
        ("ROS 2, database", "/joint_states.position.motor [rad]"),
    ):
        log = read_log(log_files.log_file(tmp_path, name))
        assert log.columns["motor_position"].columns == {path: 1.0}
        assert len(log.warnings) == name.startswith("ROS")  # recognised by name
    assert {*log.columns} == {"time", *log_files.SIGNALS}
    table, path = pl.DataFrame({"time": [0.0, 0.1]}), tmp_path / "a.parquet"
    write_parquet(table.head(1), path)
    write_parquet(table, path)
    assert pl.read_parquet(path).equals(table)
    full = Path("/dev/full")
    if full.exists():
        with pytest.raises(OSError, match="No space left on device") as caught:
            write_parquet(table, full)
        assert caught.value.filename == str(full)
