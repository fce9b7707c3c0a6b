"""HDF5 files: what is found in them, and what is refused."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest
from joint_log import joint_columns
from test_matlab import CHANNELS, assert_is_the_log, refusal

from flexid.recording import read_log

COLUMNS = joint_columns(100)


def written(path: Path, group: str = "run/1") -> Path:
    """A log in a group of a file, with a picture beside it."""
    with h5py.File(path, "w") as file:
        for name, values in COLUMNS.items():
            file.create_dataset(f"{group}/{name}", data=values, compression="gzip")
        file["picture"] = np.zeros((200, 300), dtype=np.uint8)
        file["note"] = "hello"
    return path


def test_datasets(tmp_path: Path):
    """Assert that datasets are columns by their names, wherever they stand."""
    log = read_log(written(tmp_path / "log.h5"))
    assert_is_the_log(log.recordings[0])
    assert log.columns["time"].columns == {"run/1/time": 1.0}


def test_units(tmp_path: Path):
    """Assert that the attribute of a dataset is its unit."""
    path = written(tmp_path / "log.hdf5")
    with h5py.File(path, "a") as file:
        for name, factor, key, unit in (
            ("motor_position", 180.0 / np.pi, "units", "deg"),
            ("time", 1e3, "unit", np.bytes_("[ms]")),
        ):
            del file[f"run/1/{name}"]
            dataset = file.create_dataset(f"run/1/{name}", data=factor * COLUMNS[name])
            dataset.attrs[key] = unit
    recording = read_log(path).recordings[0]
    np.testing.assert_allclose(recording.motor_position, COLUMNS["motor_position"], atol=1e-12)
    assert recording.sample_time == pytest.approx(0.005)


def test_a_table_and_a_matrix(tmp_path: Path):
    """Assert that fields of a table and columns of a matrix are columns, counted from 0."""
    table = np.zeros(100, dtype=[("t", "f8"), ("tau", "f4")])
    table["t"], table["tau"] = COLUMNS["time"], COLUMNS["motor_torque"]
    with h5py.File(tmp_path / "log.h5", "w") as file:
        file["table"] = table
        file["q"] = np.stack([COLUMNS["motor_position"], COLUMNS["link_position"]], axis=1)
    (tmp_path / "map.toml").write_text(
        'time = "table.t"\nmotor_position = "q[:,0]"\nlink_position = "q[:,1]"\n'
        'motor_torque = "table.tau"\n'
    )
    recording = read_log(tmp_path / "log.h5", tmp_path / "map.toml").recordings[0]
    np.testing.assert_array_equal(recording.link_position, COLUMNS["link_position"])
    message = refusal(tmp_path / "log.h5")
    assert "found 'q[:,0]' (float64, 100 values), 'q[:,1]'" in message
    assert "'table.tau' (float32, 100 values)" in message


def test_a_matrix_of_rows(tmp_path: Path):
    """Assert that of a matrix which is wider than high each row is a signal."""
    with h5py.File(tmp_path / "log.h5", "w") as file:
        file["time"], file["motor_torque"] = COLUMNS["time"], COLUMNS["motor_torque"]
        file["q"] = np.stack([COLUMNS["motor_position"], COLUMNS["link_position"]])
    (tmp_path / "map.toml").write_text('motor_position = "q[0,:]"\nlink_position = "q[1,:]"\n')
    assert_is_the_log(
        read_log(tmp_path / "log.h5", tmp_path / "map.toml").recordings[0], CHANNELS[:2]
    )


def test_what_it_holds(tmp_path: Path):
    """Assert that a wrong name in a column map is answered with names, types and lengths."""
    (tmp_path / "map.toml").write_text('motor_torque = "current"\n')
    message = refusal(written(tmp_path / "log.h5"), tmp_path / "map.toml")
    assert "has no column 'current'" in message
    assert "'run/1/time' (float64, 100 values)" in message
    assert "'note' (text or objects, one value)" in message
    assert "'picture' (uint8, 200 × 300)" in message


def test_two_runs(tmp_path: Path):
    """Assert that of two groups with the same names neither is taken unless one is named."""
    path = written(tmp_path / "log.h5", "a")
    with h5py.File(path, "a") as file:
        file.copy("a", "b")
    assert "there is no time" in refusal(path)
    names = ("time", "motor_position", "link_position", "motor_torque")
    (tmp_path / "map.toml").write_text("".join(f'{name} = "b/{name}"\n' for name in names))
    recording = read_log(path, tmp_path / "map.toml").recordings[0]
    np.testing.assert_array_equal(recording.link_position, COLUMNS["link_position"])


def test_other_files_are_left_alone(tmp_path: Path):
    """Assert that values which stand in another file are not read, however they are linked."""
    written(tmp_path / "other.h5")
    (tmp_path / "secret").write_bytes(bytes(800))
    with h5py.File(tmp_path / "log.h5", "w") as file:
        file["linked"] = h5py.ExternalLink("other.h5", "/run/1")
        layout = h5py.VirtualLayout((100,), "f8")
        layout[:] = h5py.VirtualSource("other.h5", "/run/1/time", (100,))
        file.create_virtual_dataset("time", layout)
        file.create_dataset("x", (100,), "f8", external=[(str(tmp_path / "secret"), 0, 800)])
    message = refusal(tmp_path / "log.h5")
    assert (
        "no signals, only 'time' (its values stand in another file, which is not read)" in message
    )
    assert "'x' (its values stand in another file" in message
    assert "linked" not in message


def test_too_large(tmp_path: Path):
    """Assert that a dataset of more values than are read is refused by its shape alone."""
    with h5py.File(tmp_path / "log.h5", "w") as file:
        for name in COLUMNS:
            file.create_dataset(name, (10**12,), "f8", chunks=(1000,))
    assert "more than are read at once" in refusal(tmp_path / "log.h5")


def test_damaged_files(tmp_path: Path):
    """Assert that a file cut short is refused, and what lacks its data when they are read."""
    path = written(tmp_path / "log.h5")
    raw = bytearray(path.read_bytes())
    (tmp_path / "cut.h5").write_bytes(raw[: len(raw) // 2])
    assert "no HDF5 file that can be read" in refusal(tmp_path / "cut.h5")
    (tmp_path / "empty.h5").write_bytes(b"")
    assert "the file is empty" in refusal(tmp_path / "empty.h5")
