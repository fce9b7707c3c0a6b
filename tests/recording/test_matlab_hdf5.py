"""MATLAB files of both kinds, and HDF5: what is found in them, and what is refused."""

from pathlib import Path

import h5py
import numpy as np
import pytest
from joint_log import refused
from log_files import COLUMNS, hdf5, matlab, matlab_73
from scipy.io import savemat

from flexid.readers import guard
from flexid.recording import read_log

TIME, MOTOR, LINK = (COLUMNS[name] for name in ("time", "motor_position", "link_position"))
BOTH = np.stack([MOTOR, LINK], axis=1)


def in_group(path: Path, group: str) -> Path:
    """The log in a group of an HDF5 file, with a picture beside it."""
    arrays = {f"{group}/{name}": values for name, values in COLUMNS.items()}
    return hdf5(path, {**arrays, "picture": np.zeros((200, 300), dtype=np.uint8), "note": "hello"})


def test_columns_of_a_matrix(tmp_path: Path):
    """Assert that columns of a matrix, and elements of arrays of structs, count from 1."""
    path = tmp_path / "log.mat"
    signals = np.array([({"tau": COLUMNS["motor_torque"]},)], dtype=object)
    message = refused(read_log, matlab(path, {"t": TIME, "q": BOTH, "s": signals}))
    assert "found 't' (float64, 100 values), 'q(:,1)' (float64, 100 values), 'q(:,2)'" in message
    matlab(path, {"t": TIME, "q": BOTH, "s": {"tau": 3.0 * MOTOR}})
    names = {"time": "t", "motor_position": "q(:,1)", "link_position": "q(:,2)"}
    (recording,) = read_log(path, {**names, "motor_torque": "s.tau"}).recordings
    np.testing.assert_array_equal(recording.motor_position, MOTOR)
    np.testing.assert_array_equal(recording.link_position, LINK)


def test_version_73(tmp_path: Path):
    """Assert that indices of a file of version 7.3 are those of one of version 5."""
    message = refused(read_log, matlab_73(tmp_path / "a.mat", {"t": TIME, "q": BOTH.T}))
    assert "'log.q(:,1)' (float64, 100 values), 'log.q(:,2)'" in message
    assert "'note' (char: save its values as arrays)" in message
    assert "#refs#" not in message


def test_units(tmp_path: Path):
    """Assert that the attribute of a dataset is its unit."""
    others = {"time": 1e3 * TIME, "motor_position": np.degrees(MOTOR)}
    path = hdf5(tmp_path / "log.hdf5", {**COLUMNS, **others})
    with h5py.File(path, "a") as file:
        file["motor_position"].attrs["units"] = "deg"
        file["time"].attrs["unit"] = np.bytes_("[ms]")
    recording = read_log(path).recordings[0]
    np.testing.assert_allclose(recording.motor_position, MOTOR, atol=1e-12)
    assert recording.sample_time == pytest.approx(0.005)


def test_a_table_and_matrices(tmp_path: Path):
    """Assert that fields of a table and the long sides of matrices are columns, from 0 on."""
    table = np.zeros(100, dtype=[("t", "f8"), ("tau", "f4")])
    table["t"], table["tau"] = TIME, COLUMNS["motor_torque"]
    path = hdf5(tmp_path / "log.h5", {"table": table, "q": BOTH, "p": BOTH.T})
    names = {"time": "table.t", "motor_position": "q[:,0]", "motor_torque": "table.tau"}
    for link in ("q[:,1]", "p[1,:]"):
        (recording,) = read_log(path, {**names, "link_position": link}).recordings
        np.testing.assert_array_equal(recording.link_position, LINK)
    message = refused(read_log, path)
    assert "'q[:,0]' (float64, 100 values), 'q[:,1]'" in message
    assert "'table.tau' (float32, 100 values)" in message


def test_what_it_holds(tmp_path: Path):
    """Assert that a wrong name, and a file without a signal, are answered with what is there."""
    message = refused(read_log, in_group(tmp_path / "log.h5", "a"), {"motor_torque": "current"})
    assert "has no column 'current'" in message
    assert "'a/time' (float64, 100 values)" in message
    assert "'note' (text or objects, one value)" in message
    assert "'picture' (uint8, 200 × 300)" in message
    message = refused(read_log, matlab(tmp_path / "log.mat", {"note": "hello", "gain": 3.0}))
    assert "holds no signals, only 'note' (text, 1), 'gain' (float64, 1 × 1)" in message


def test_two_runs(tmp_path: Path):
    """Assert that of two groups with the same names neither is taken unless one is named."""
    path = in_group(tmp_path / "log.h5", "a")
    with h5py.File(path, "a") as file:
        file.copy("a", "b")
    assert "there is no time" in refused(read_log, path)
    (recording,) = read_log(path, {name: f"b/{name}" for name in COLUMNS}).recordings
    np.testing.assert_array_equal(recording.link_position, LINK)


def test_arrays_of_other_lengths(tmp_path: Path):
    """Assert that a channel of another length than its time is refused."""
    path = matlab(tmp_path / "log.mat", {**COLUMNS, "motor_torque": COLUMNS["motor_torque"][:50]})
    assert "'motor_torque': it has 50 values where 'time' has 100" in refused(read_log, path)


def test_other_files_are_left_alone(tmp_path: Path):
    """Assert that values which stand in another file are not read, however they are linked."""
    in_group(tmp_path / "other.h5", "run")
    (tmp_path / "secret").write_bytes(bytes(800))
    with h5py.File(tmp_path / "log.h5", "w") as file:
        file["linked"] = h5py.ExternalLink("other.h5", "/run")
        layout = h5py.VirtualLayout((100,), "f8")
        layout[:] = h5py.VirtualSource("other.h5", "/run/time", (100,))
        file.create_virtual_dataset("time", layout)
        file.create_dataset("x", (100,), "f8", external=[(str(tmp_path / "secret"), 0, 800)])
    message = refused(read_log, tmp_path / "log.h5")
    words = "its values stand in another file"
    assert f"no signals, only 'time' ({words}, which is not read), 'x' ({words}" in message
    assert "linked" not in message


def test_bombs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Assert that what unpacks, or claims to, to more than a limit is refused."""
    with h5py.File(tmp_path / "log.h5", "w") as file:
        for name in COLUMNS:
            file.create_dataset(name, (10**12,), "f8", chunks=(1000,))
    assert "more than are read at once" in refused(read_log, tmp_path / "log.h5")
    path = matlab(tmp_path / "4.mat", {"time": np.arange(100.0)}, format="4")
    raw = bytearray(path.read_bytes())
    raw[4:12] = (100_000).to_bytes(4, "little") * 2
    path.write_bytes(raw)
    refused(read_log, path)
    monkeypatch.setattr(guard, "LIMITS", guard.LIMITS._replace(memory=300_000_000))
    savemat(tmp_path / "log.mat", {"zeros": np.zeros(40_000_000)}, do_compression=True)
    assert (tmp_path / "log.mat").stat().st_size < 1_000_000
    assert "more memory or time than it may have" in refused(read_log, tmp_path / "log.mat")


@pytest.mark.parametrize("kind", [0, 99, 2**15, 2**31 - 1])
def test_types_that_are_none(tmp_path: Path, kind: int):
    """Assert that an element of a type that is none, of which SciPy crashes, is refused."""
    path = matlab(tmp_path / "log.mat", {"run": COLUMNS})
    double = (9).to_bytes(4, "little") + (800).to_bytes(4, "little")
    assert double in path.read_bytes()
    path.write_bytes(path.read_bytes().replace(double, kind.to_bytes(4, "little") + double[4:]))
    assert "not a MATLAB file that can be read" in refused(read_log, path)


def test_other_names(tmp_path: Path):
    """Assert that an empty file is refused, and a file by another name said to be one."""
    (tmp_path / "empty.h5").write_bytes(b"")
    assert "the file is empty" in refused(read_log, tmp_path / "empty.h5")
    matlab(tmp_path / "log.mat", COLUMNS).rename(tmp_path / "log.csv")
    words = "this is a MATLAB file: rename it so that it ends in .mat"
    assert words in refused(read_log, tmp_path / "log.csv")
