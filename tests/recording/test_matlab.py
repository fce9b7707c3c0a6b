"""MATLAB files of both kinds: what is found in them, and what is refused."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest
from joint_log import joint_columns
from scipy.io import savemat

from flexid.errors import RecordingError
from flexid.readers import guard
from flexid.recording import read_log
from flexid.recording.recording import Recording

COLUMNS = joint_columns(100)
CHANNELS = ("link_position", "motor_position", "link_velocity", "motor_velocity")


def refusal(path: Path, columns: Path | None = None) -> str:
    """The one line with which a file is refused."""
    with pytest.raises(RecordingError) as caught:
        read_log(path, columns)
    assert "\n" not in str(caught.value)
    return str(caught.value)


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


def assert_is_the_log(recording: Recording, channels: tuple[str, ...] = CHANNELS) -> None:
    """Assert that the channels are those that were written."""
    for name in channels:
        np.testing.assert_array_equal(getattr(recording, name), COLUMNS[name])
    np.testing.assert_array_equal(recording.input, COLUMNS["motor_torque"])


@pytest.mark.parametrize("form", ["4", "5"])
@pytest.mark.parametrize("compressed", [False, True])
def test_variables(tmp_path: Path, form: str, compressed: bool):
    """Assert that vectors are columns by their names, as rows and as columns of MATLAB."""
    savemat(
        tmp_path / "log.mat",
        {**COLUMNS, "note": "hello"},
        format=form,
        do_compression=compressed and form == "5",
        oned_as="row" if compressed else "column",
    )
    log = read_log(tmp_path / "log.mat")
    assert_is_the_log(log.recordings[0])
    assert not log.warnings


def test_a_struct(tmp_path: Path):
    """Assert that the fields of a struct are columns, by their own names in the struct."""
    savemat(tmp_path / "log.mat", {"run": COLUMNS, "gain": 3.0, "map": np.zeros((200, 300))})
    log = read_log(tmp_path / "log.mat")
    assert_is_the_log(log.recordings[0])
    assert log.columns["motor_position"].columns == {"run.motor_position": 1.0}


def test_columns_of_a_matrix(tmp_path: Path):
    """Assert that columns of a matrix, and elements of arrays of structs, count from 1."""
    both = np.stack([COLUMNS["motor_position"], COLUMNS["link_position"]], axis=1)
    signals = np.array([({"tau": COLUMNS["motor_torque"]},)], dtype=object)
    savemat(tmp_path / "log.mat", {"t": COLUMNS["time"], "q": both, "s": signals})
    (tmp_path / "map.toml").write_text(
        'time = "t"\nmotor_position = "q(:,1)"\nlink_position = "q(:,2)"\nmotor_torque = "s.tau"\n'
    )
    message = refusal(tmp_path / "log.mat")
    assert "found 't' (float64, 100 values), 'q(:,1)' (float64, 100 values), 'q(:,2)'" in message
    savemat(tmp_path / "log.mat", {"t": COLUMNS["time"], "q": both, "s": {"tau": 3.0 * both[:, 0]}})
    recording = read_log(tmp_path / "log.mat", tmp_path / "map.toml").recordings[0]
    np.testing.assert_array_equal(recording.motor_position, COLUMNS["motor_position"])
    np.testing.assert_array_equal(recording.link_position, COLUMNS["link_position"])


def test_version_73(tmp_path: Path):
    """Assert that a file of version 7.3 is read as one of version 5 is, indices included."""
    assert_is_the_log(read_log(written_73(tmp_path / "log.mat", COLUMNS)).recordings[0])
    both = np.stack([COLUMNS["motor_position"], COLUMNS["link_position"]])  # reversed
    path = written_73(tmp_path / "two.mat", {"t": COLUMNS["time"], "q": both})
    message = refusal(path)
    assert "'log.q(:,1)' (float64, 100 values), 'log.q(:,2)'" in message
    assert "'note' (char: save its values as arrays)" in message
    assert "#refs#" not in message


def test_lengths_that_differ(tmp_path: Path):
    """Assert that a channel of another length is named with both lengths."""
    short = {**COLUMNS, "motor_torque": COLUMNS["motor_torque"][:50]}
    savemat(tmp_path / "log.mat", short)
    assert "'motor_torque': it has 50 values where 'time' has 100" in refusal(tmp_path / "log.mat")


def test_times_that_differ(tmp_path: Path):
    """Assert that a channel with times of its own beside it is not taken for another clock's."""
    late = {"t": COLUMNS["time"] + 0.001, "motor_torque": COLUMNS["motor_torque"]}
    rest = {name: values for name, values in COLUMNS.items() if name != "motor_torque"}
    savemat(tmp_path / "log.mat", {"drive": late, "time": rest["time"], "joint": rest})
    (tmp_path / "map.toml").write_text('time = "joint.time"\nmotor_torque = "drive.motor_torque"\n')
    message = refusal(tmp_path / "log.mat", tmp_path / "map.toml")
    assert "its times stand in 'drive.t' and differ from those in 'joint.time'" in message
    late["t"] = COLUMNS["time"]
    savemat(tmp_path / "log.mat", {"drive": late, "joint": rest})
    assert_is_the_log(read_log(tmp_path / "log.mat", tmp_path / "map.toml").recordings[0])


def test_two_times_beside_a_channel(tmp_path: Path):
    """Assert that where two arrays could be a channel's times only its length is compared."""
    savemat(tmp_path / "log.mat", {"joint": {"t": np.arange(100.0), **COLUMNS}})
    assert_is_the_log(read_log(tmp_path / "log.mat").recordings[0])


def test_nothing_in_it(tmp_path: Path):
    """Assert that a file without a signal says what it holds."""
    savemat(tmp_path / "log.mat", {"note": "hello", "gain": 3.0})
    message = refusal(tmp_path / "log.mat")
    assert "holds no signals, only 'note' (text, 1), 'gain' (float64, 1 × 1)" in message


def test_a_bomb(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Assert that what unpacks to more memory than a limit is refused."""
    monkeypatch.setattr(guard, "LIMITS", guard.LIMITS._replace(memory=300_000_000))
    savemat(tmp_path / "log.mat", {"zeros": np.zeros(40_000_000)}, do_compression=True)
    assert (tmp_path / "log.mat").stat().st_size < 1_000_000
    assert "it asks for more memory than it may have" in refusal(tmp_path / "log.mat")


def test_damaged_files(tmp_path: Path):
    """Assert that a file cut short is refused, and a file by another name said to be one."""
    savemat(tmp_path / "log.mat", COLUMNS)
    raw = (tmp_path / "log.mat").read_bytes()
    (tmp_path / "cut.mat").write_bytes(raw[: len(raw) // 2])
    assert "no MATLAB file that can be read" in refusal(tmp_path / "cut.mat")
    (tmp_path / "log.csv").write_bytes(raw)
    assert "this is a MATLAB file: rename it so that it ends in .mat" in refusal(
        tmp_path / "log.csv"
    )


@pytest.mark.parametrize("kind", [0, 99, 2**15, 2**31 - 1])
def test_types_that_are_none(tmp_path: Path, kind: int):
    """Assert that an element of a type that is none, of which SciPy crashes, is refused."""
    savemat(tmp_path / "log.mat", {"run": COLUMNS})
    raw = (tmp_path / "log.mat").read_bytes()
    double = (9).to_bytes(4, "little") + (800).to_bytes(4, "little")
    assert double in raw
    (tmp_path / "log.mat").write_bytes(raw.replace(double, kind.to_bytes(4, "little") + double[4:]))
    assert "no MATLAB file that can be read" in refusal(tmp_path / "log.mat")


def test_a_size_that_is_none(tmp_path: Path):
    """Assert that a matrix of 80 GB, by what a small file of version 4 says, is refused."""
    path = tmp_path / "log.mat"
    savemat(path, {"time": np.arange(100.0)}, format="4")
    raw = bytearray(path.read_bytes())
    raw[4:12] = (100_000).to_bytes(4, "little") * 2
    path.write_bytes(raw)
    assert refusal(path)
