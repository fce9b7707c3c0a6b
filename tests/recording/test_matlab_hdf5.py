"""MATLAB files of both kinds, and HDF5: what is found in them, and what is refused."""

from pathlib import Path

import h5py
import numpy as np
import polars as pl
import pytest
from joint_log import joint_columns, refused
from scipy.io import savemat

from flexid.readers import guard
from flexid.recording import read_log
from flexid.recording.recording import Recording
from flexid.recording.series import table_of_file, tables_of_file

COLUMNS = joint_columns(100)
CHANNELS = ("link_position", "motor_position", "link_velocity", "motor_velocity")
BOTH = np.stack([COLUMNS["motor_position"], COLUMNS["link_position"]], axis=1)


def written_73(path: Path, variables: dict[str, np.ndarray]) -> Path:
    """A file as MATLAB's ``save -v7.3`` lays it out: HDF5 behind a header, dimensions reversed."""
    with h5py.File(path, "w", userblock_size=512) as file:
        group = file.create_group("log")
        group.attrs["MATLAB_class"] = np.bytes_("struct")
        for name, values in variables.items():
            dataset = group.create_dataset(name, data=np.atleast_2d(values))
            dataset.attrs["MATLAB_class"] = np.bytes_("double")
        text = file.create_dataset("note", data=np.array([[104, 105]], dtype=np.uint16))
        text.attrs["MATLAB_class"] = np.bytes_("char")
        file.create_dataset("#refs#/a", data=np.zeros(5))
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")
    return path


def written(path: Path, group: str = "run/1") -> Path:
    """A log in a group of an HDF5 file, with a picture beside it."""
    with h5py.File(path, "w") as file:
        for name, values in COLUMNS.items():
            file.create_dataset(f"{group}/{name}", data=values, compression="gzip")
        file["picture"] = np.zeros((200, 300), dtype=np.uint8)
        file["note"] = "hello"
    return path


def assert_is_the_log(recording: Recording, channels: tuple[str, ...] = CHANNELS) -> None:
    """Assert that the channels are those that were written."""
    for name in channels:
        np.testing.assert_array_equal(getattr(recording, name), COLUMNS[name])
    np.testing.assert_array_equal(recording.input, COLUMNS["motor_torque"])


@pytest.mark.parametrize(("form", "compressed"), [("4", False), ("5", False), ("5", True)])
def test_variables(tmp_path: Path, form: str, compressed: bool):
    """Assert that vectors are columns by their names, as rows and as columns of MATLAB."""
    savemat(
        tmp_path / "log.mat",
        {**COLUMNS, "note": "hello"},
        format=form,
        do_compression=compressed,
        oned_as="row" if compressed else "column",
    )
    log = read_log(tmp_path / "log.mat")
    assert_is_the_log(log.recordings[0])
    assert not log.warnings


def test_structs_and_groups(tmp_path: Path):
    """Assert that fields of a struct and datasets of a group are columns, by their own names."""
    savemat(tmp_path / "log.mat", {"run": COLUMNS, "gain": 3.0, "map": np.zeros((200, 300))})
    log = read_log(tmp_path / "log.mat")
    assert_is_the_log(log.recordings[0])
    assert log.columns["motor_position"].columns == {"run.motor_position": 1.0}
    log = read_log(written(tmp_path / "log.h5"))
    assert_is_the_log(log.recordings[0])
    assert log.columns["time"].columns == {"run/1/time": 1.0}


def test_columns_of_a_matrix(tmp_path: Path):
    """Assert that columns of a matrix, and elements of arrays of structs, count from 1."""
    signals = np.array([({"tau": COLUMNS["motor_torque"]},)], dtype=object)
    savemat(tmp_path / "log.mat", {"t": COLUMNS["time"], "q": BOTH, "s": signals})
    message = refused(read_log, tmp_path / "log.mat")
    assert "found 't' (float64, 100 values), 'q(:,1)' (float64, 100 values), 'q(:,2)'" in message
    savemat(tmp_path / "log.mat", {"t": COLUMNS["time"], "q": BOTH, "s": {"tau": 3.0 * BOTH[:, 0]}})
    names = {"time": "t", "motor_position": "q(:,1)", "link_position": "q(:,2)"}
    log = read_log(tmp_path / "log.mat", {**names, "motor_torque": "s.tau"})
    np.testing.assert_array_equal(log.recordings[0].motor_position, COLUMNS["motor_position"])
    np.testing.assert_array_equal(log.recordings[0].link_position, COLUMNS["link_position"])


def test_version_73(tmp_path: Path):
    """Assert that a file of version 7.3 is read as one of version 5 is, indices included."""
    assert_is_the_log(read_log(written_73(tmp_path / "log.mat", COLUMNS)).recordings[0])
    message = refused(read_log, written_73(tmp_path / "a.mat", {"t": COLUMNS["time"], "q": BOTH.T}))
    assert "'log.q(:,1)' (float64, 100 values), 'log.q(:,2)'" in message
    assert "'note' (char: save its values as arrays)" in message
    assert "#refs#" not in message


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


def test_a_table_and_matrices(tmp_path: Path):
    """Assert that fields of a table and the long sides of matrices are columns, from 0 on."""
    table = np.zeros(100, dtype=[("t", "f8"), ("tau", "f4")])
    table["t"], table["tau"] = COLUMNS["time"], COLUMNS["motor_torque"]
    with h5py.File(tmp_path / "log.h5", "w") as file:
        file["table"], file["q"], file["p"] = table, BOTH, BOTH.T
    names = {"time": "table.t", "motor_position": "q[:,0]", "motor_torque": "table.tau"}
    for link in ("q[:,1]", "p[1,:]"):
        (recording,) = read_log(tmp_path / "log.h5", {**names, "link_position": link}).recordings
        np.testing.assert_array_equal(recording.link_position, COLUMNS["link_position"])
    message = refused(read_log, tmp_path / "log.h5")
    assert "'q[:,0]' (float64, 100 values), 'q[:,1]'" in message
    assert "'table.tau' (float32, 100 values)" in message


def test_parts_are_the_whole(tmp_path: Path):
    """Assert that arrays are read as many rows at a time as are asked for, each alike."""
    path = written(tmp_path / "log.h5")
    parts = [table.frame for table in tables_of_file(path, None, 30)]
    assert [part.height for part in parts] == [30, 30, 30, 10]
    assert pl.concat(parts).equals(table_of_file(path, None).frame)


def test_what_it_holds(tmp_path: Path):
    """Assert that a wrong name, and a file without a signal, are answered with what is there."""
    message = refused(read_log, written(tmp_path / "log.h5"), {"motor_torque": "current"})
    assert "has no column 'current'" in message
    assert "'run/1/time' (float64, 100 values)" in message
    assert "'note' (text or objects, one value)" in message
    assert "'picture' (uint8, 200 × 300)" in message
    savemat(tmp_path / "log.mat", {"note": "hello", "gain": 3.0})
    message = refused(read_log, tmp_path / "log.mat")
    assert "holds no signals, only 'note' (text, 1), 'gain' (float64, 1 × 1)" in message


def test_two_runs(tmp_path: Path):
    """Assert that of two groups with the same names neither is taken unless one is named."""
    path = written(tmp_path / "log.h5", "a")
    with h5py.File(path, "a") as file:
        file.copy("a", "b")
    assert "there is no time" in refused(read_log, path)
    names = ("time", "motor_position", "link_position", "motor_torque")
    (recording,) = read_log(path, {name: f"b/{name}" for name in names}).recordings
    np.testing.assert_array_equal(recording.link_position, COLUMNS["link_position"])


def test_lengths_that_differ(tmp_path: Path):
    """Assert that a channel of another length is named with both lengths."""
    short = {**COLUMNS, "motor_torque": COLUMNS["motor_torque"][:50]}
    savemat(tmp_path / "log.mat", short)
    words = "'motor_torque': it has 50 values where 'time' has 100"
    assert words in refused(read_log, tmp_path / "log.mat")


def test_times_that_differ(tmp_path: Path):
    """Assert that a channel with times of its own beside it is not taken for another clock's."""
    drive = {"t": COLUMNS["time"].copy(), "motor_torque": COLUMNS["motor_torque"]}
    joint = {name: values for name, values in COLUMNS.items() if name != "motor_torque"}
    names = {"time": "joint.time", "motor_torque": "drive.motor_torque"}
    savemat(tmp_path / "log.mat", {"drive": drive, "joint": joint})
    assert_is_the_log(read_log(tmp_path / "log.mat", names).recordings[0])
    drive["t"][60] += 0.001
    savemat(tmp_path / "log.mat", {"drive": drive, "joint": joint})
    words = "its times stand in 'drive.t' and differ from those in 'joint.time'"
    assert words in refused(read_log, tmp_path / "log.mat", names)
    tables = tables_of_file(tmp_path / "log.mat", names, 50)
    assert next(tables).frame.height == 50
    assert words in refused(next, tables)


def test_two_times_beside_a_channel(tmp_path: Path):
    """Assert that where two arrays could be a channel's times only its length is compared."""
    savemat(tmp_path / "log.mat", {"joint": {"t": np.arange(100.0), **COLUMNS}})
    assert_is_the_log(read_log(tmp_path / "log.mat").recordings[0])


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
    savemat(tmp_path / "4.mat", {"time": np.arange(100.0)}, format="4")
    raw = bytearray((tmp_path / "4.mat").read_bytes())
    raw[4:12] = (100_000).to_bytes(4, "little") * 2
    (tmp_path / "4.mat").write_bytes(raw)
    refused(read_log, tmp_path / "4.mat")
    monkeypatch.setattr(guard, "LIMITS", guard.LIMITS._replace(memory=300_000_000))
    savemat(tmp_path / "log.mat", {"zeros": np.zeros(40_000_000)}, do_compression=True)
    assert (tmp_path / "log.mat").stat().st_size < 1_000_000
    assert "it asks for more memory than it may have" in refused(read_log, tmp_path / "log.mat")


def test_damaged_files(tmp_path: Path):
    """Assert that a file cut short is refused, and a file by another name said to be one."""
    savemat(tmp_path / "log.mat", COLUMNS)
    written(tmp_path / "log.h5")
    for name, words in (("mat", "not a MATLAB file"), ("h5", "not an HDF5 file")):
        raw = (tmp_path / f"log.{name}").read_bytes()
        (tmp_path / f"cut.{name}").write_bytes(raw[: len(raw) // 2])
        assert f"{words} that can be read" in refused(read_log, tmp_path / f"cut.{name}")
    (tmp_path / "empty.h5").write_bytes(b"")
    assert "the file is empty" in refused(read_log, tmp_path / "empty.h5")
    (tmp_path / "log.mat").rename(tmp_path / "log.csv")
    words = "this is a MATLAB file: rename it so that it ends in .mat"
    assert words in refused(read_log, tmp_path / "log.csv")


@pytest.mark.parametrize("kind", [0, 99, 2**15, 2**31 - 1])
def test_types_that_are_none(tmp_path: Path, kind: int):
    """Assert that an element of a type that is none, of which SciPy crashes, is refused."""
    savemat(tmp_path / "log.mat", {"run": COLUMNS})
    raw = (tmp_path / "log.mat").read_bytes()
    double = (9).to_bytes(4, "little") + (800).to_bytes(4, "little")
    assert double in raw
    (tmp_path / "log.mat").write_bytes(raw.replace(double, kind.to_bytes(4, "little") + double[4:]))
    assert "not a MATLAB file that can be read" in refused(read_log, tmp_path / "log.mat")
