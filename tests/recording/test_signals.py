"""Files of signals in MATLAB, HDF5, MDF, MCAP and ROS bags: contents, refusals, one log in all."""

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import polars as pl
import pytest
from asammdf import Signal
from benchmarks.fuzz_files import STAMPS, matlab_73, mcap
from joint_log import refused, said
from log_files import (
    COLUMNS,
    SIGNALS,
    TORQUE,
    WRITERS,
    hdf5,
    in_groups,
    log_file,
    mdf,
    measured,
    parquet,
    signal,
)
from log_files import MAPS as FORMAT_MAPS
from rosbags.typesys.store import Typestore
from scipy.io import savemat

from flexid.readers import guard, ros
from flexid.recording import read_log
from flexid.recording.frame import write_parquet
from flexid.recording.read import table_of_file, tables_of_file

TIME, LINK, MOTOR, INPUT = COLUMNS.values()
BOTH = np.stack([MOTOR, LINK], axis=1)
ENCODERS = in_groups()[0]
FAST = np.arange(0.0, 0.5, 0.001)
Write = Callable[[Path], object]


def with_units(path: Path) -> None:
    """Write an HDF5 file with units as attributes."""
    hdf5(path, {**COLUMNS, "time": 1e3 * TIME, "motor_position": np.degrees(MOTOR)})
    with h5py.File(path, "a") as file:
        file["motor_position"].attrs["units"] = "deg"
        file["time"].attrs["unit"] = np.bytes_("[ms]")


def table_and_matrices(path: Path) -> None:
    """Write a table and two matrices."""
    table = np.zeros(100, dtype=[("t", "f8"), ("tau", "f4")])
    table["t"], table["tau"] = TIME, INPUT
    hdf5(path, {"table": table, "q": BOTH, "p": BOTH.T})


def runs(*names: str) -> Write:
    """Return a function that writes the log in groups of an HDF5 file, with a picture."""
    arrays = {f"{group}/{name}": values for group in names for name, values in COLUMNS.items()}
    others = {"picture": np.zeros((200, 300), dtype=np.uint8), "note": "hello"}
    return lambda path: hdf5(path, {**arrays, **others})


def links(path: Path) -> None:
    """Write an HDF5 file with links of all kinds to other files."""
    runs("run")(path.with_name("other.h5"))
    path.with_name("secret").write_bytes(bytes(800))
    with h5py.File(path, "w") as file:
        file["linked"] = h5py.ExternalLink("other.h5", "/run")
        layout = h5py.VirtualLayout((100,), "f8")
        layout[:] = h5py.VirtualSource("other.h5", "/run/time", (100,))
        file.create_virtual_dataset("time", layout)
        file.create_dataset("x", (100,), "f8", external=[("secret", 0, 800)])


def much_of_nothing(path: Path) -> None:
    """Write an HDF5 file whose arrays claim 8 TB each."""
    with h5py.File(path, "w") as file:
        for name in COLUMNS:
            file.create_dataset(name, (10**12,), "f8", chunks=(1000,))


def edited(write: Write, change: Callable[[bytes], bytes]) -> Write:
    """Return a function that writes a file and changes its bytes."""

    def written(path: Path) -> None:
        write(path)
        path.write_bytes(change(path.read_bytes()))

    return written


def of_type(kind: int) -> Write:
    """Return a function that writes an element of an invalid type, which crashes SciPy."""
    double = (9).to_bytes(4, "little") + (800).to_bytes(4, "little")
    other = kind.to_bytes(4, "little") + double[4:]
    return edited(lambda p: savemat(p, {"run": COLUMNS}), lambda raw: raw.replace(double, other))


def invalid(path: Path) -> None:
    """Write a sample that is marked as invalid."""
    torque = signal("motor_torque", INPUT)
    torque.invalidation_bits = np.arange(100) == 57
    mdf(path, [*ENCODERS, torque])


def changed(change: Callable[[bytes], bytes]) -> Write:
    """Return a function that writes an MDF file and changes its bytes."""
    return edited(lambda p: mdf(p, ENCODERS), change)


def out_of_order(by: int) -> Write:
    """Return a function that writes a message after later ones."""
    messages = measured()
    messages.insert(20 + 2 * by, messages.pop(20))
    return lambda path: mcap(path, messages)


def without_a_number(path: Path) -> None:
    """Write messages of which one lacks its value."""
    messages = measured()
    del messages[101][2]["data"]
    mcap(path, messages)


def damaged(form: str, place: int, size: int) -> Write:
    """Return a function that writes a file whose first record claims 900 MB."""
    large = (900_000_000).to_bytes(size, "little")
    return edited(
        lambda path: log_file(path.parent, form).rename(path),
        lambda raw: raw[:place] + large + raw[place + size :],
    )


def half(form: str) -> Write:
    """Return a function that writes half of a file."""
    return edited(
        lambda path: log_file(path.parent, form).rename(path), lambda raw: raw[: len(raw) // 2]
    )


def timeseries(of_torque: Any = TIME) -> dict[str, Any]:
    """Return the log as structs with a time each, as Simulink exports them."""
    times = {"motor_position": TIME, "link_position": TIME, "motor_torque": of_torque}
    return {"out": {name: {"Time": t, "Data": COLUMNS[name]} for name, t in times.items()}}


def promising(count: int) -> Write:
    """Return a function that writes a page with a wrong count, which crashes Polars."""
    value = (count << 1) ^ (count >> 63)  # encoding of Thrift
    other = bytes([value & 127 | 128, value >> 7 & 127])
    values = np.random.default_rng(1).normal(size=(3, 100))
    table = pl.DataFrame(dict(zip(("time", "motor_position", "tau"), values, strict=True)))
    return edited(table.write_parquet, lambda raw: raw.replace(bytes([0xC8, 0x01]), other, 1))


MISSING = pl.when(pl.col("time") > 0.0).then("time").alias("time")
DURATIONS = np.rint(1e3 * TIME).astype("m8[ms]").astype("m8[ps]")
MOMENTS = np.datetime64("2024-05-01", "us") + DURATIONS.astype("m8[us]")
TIMES = pl.col("time").cast(pl.String)
DATES = (pl.col("motor_torque") * 1e6).cast(pl.Datetime("us"))
BIG = pl.lit(pl.Series("big", np.zeros((100, 50_000))))
STRUCTS = np.array([({"tau": INPUT},)], dtype=object)
OF_MATRIX = {"time": "t", "motor_position": "q(:,1)", "link_position": "q(:,2)"}
OF_TABLE = {"time": "table.t", "motor_position": "q[:,0]", "motor_torque": "table.tau"}
DEGREES = signal("motor_position", np.degrees(MOTOR), unit="deg")
FAST_TORQUE = signal("motor_torque", np.sin(4.0 * FAST), FAST)
LATE_TORQUE = signal("motor_torque", INPUT, np.where(np.arange(100) == 75, TIME[74], TIME))
ANOTHER = signal("u", TIME)
STATE = Signal(np.array([b"ok"] * 100), TIME, name="state", encoding="utf-8")
IMAGES = [("/imu", stamp, {"x": 1.0, "image": [0] * 100, "frame": "a"}) for stamp in STAMPS]
CUT = {"MATLAB 5": ".mat", "HDF5": ".h5", "ROS 1": ".bag", "ROS 2, database": ".db3"}
CUT |= {"ROS 2, MCAP": ".mcap"}
FILES: dict[str, tuple[str, Callable[[Path], object]]] = {
    "text": ("a.parquet", lambda p: parquet(p, pl.exclude("time"), TIMES)),
    "dates": ("a.parquet", lambda p: parquet(p, pl.exclude("motor_torque"), DATES)),
    "an empty cell": ("a.parquet", lambda p: parquet(p, pl.exclude("time"), MISSING)),
    "no rows": ("a.parquet", lambda p: parquet(p, pl.all().head(0))),
    "much that is not read": ("a.parquet", lambda p: parquet(p, pl.all(), BIG)),
    **{f"a page of {count}": ("a.parquet", promising(count)) for count in (-1, 63, 127)},
    "durations": ("a.npz", lambda p: np.savez(p, **{**COLUMNS, "time": DURATIONS})),
    "times": ("a.npz", lambda p: np.savez(p, **{**COLUMNS, "time": MOMENTS})),
    "a matrix": ("a.mat", lambda p: savemat(p, {"t": TIME, "q": BOTH, "s": STRUCTS})),
    "its columns": ("a.mat", lambda p: savemat(p, {"t": TIME, "q": BOTH, "s": {"tau": 3 * MOTOR}})),
    "one of MATLAB 7.3": ("a.mat", lambda p: matlab_73(p, {"t": TIME, "q": BOTH.T})),
    "timeseries of one time": ("a.mat", lambda p: savemat(p, timeseries())),
    "timeseries of two times": ("a.mat", lambda p: savemat(p, timeseries(0.5 * TIME))),
    "another length": ("a.mat", lambda p: savemat(p, {**COLUMNS, "motor_torque": INPUT[:50]})),
    "no signals": ("a.mat", lambda p: savemat(p, {"note": "hello", "gain": 3.0})),
    **{f"type {kind}": ("a.mat", of_type(kind)) for kind in (0, 2**31 - 1)},
    "MATLAB by another name": ("a.csv", lambda p: savemat(p, COLUMNS, appendmat=False)),
    "units of HDF5": ("a.hdf5", with_units),
    "a table": ("a.h5", table_and_matrices),
    "a matrix in columns": ("a.h5", table_and_matrices),
    "a matrix in rows": ("a.h5", table_and_matrices),
    "a wrong name": ("a.h5", runs("a")),
    "two runs": ("a.h5", runs("a", "b")),
    "the second": ("a.h5", runs("a", "b")),
    "other files": ("a.h5", links),
    "a claim to be large": ("a.h5", much_of_nothing),
    "an empty file": ("a.h5", lambda p: p.write_bytes(b"")),
    "two clocks": ("a.mf4", lambda p: mdf(p, [DEGREES, ENCODERS[0]], [FAST_TORQUE])),
    "a clock that repeats": ("a.mf4", lambda p: mdf(p, ENCODERS, [LATE_TORQUE])),
    "an invalid sample": ("a.mf4", invalid),
    "a name in two groups": ("a.mf4", lambda p: mdf(p, ENCODERS, ENCODERS, [ANOTHER])),
    "one of them": ("a.mf4", lambda p: mdf(p, ENCODERS, ENCODERS, [ANOTHER])),
    "texts": ("a.mf4", lambda p: mdf(p, [signal("speed", TIME, unit="rpm"), STATE])),
    "a cut file": ("a.mf4", changed(lambda raw: raw[:200])),
    "a text": ("a.mf4", changed(lambda _: b"time,motor_position\n")),
    "other marks": ("a.mf4", changed(lambda raw: raw.replace(b"##DG", b"##XX"))),
    "topics at different times": ("a.mcap", lambda p: mcap(p, measured(2_000_000))),
    **{f"overtaken by {by}": ("a.mcap", out_of_order(by)) for by in (1, 20)},
    "a number that is missing": ("a.mcap", without_a_number),
    "pictures": ("a.mcap", lambda p: mcap(p, IMAGES)),
    "no times in common": ("a.mcap", lambda p: mcap(p, measured(10**12))),
    "a large record": ("a.mcap", damaged("ROS 2, MCAP", 9, 8)),
    "a large record of ROS 1": ("b.bag", damaged("ROS 1", 13, 4)),
    **{f"half of {form}": (f"a{suffix}", half(form)) for form, suffix in CUT.items()},
    "a folder": ("folder", Path.mkdir),
    "a folder of zstd": ("c", lambda p: (p.mkdir(), (p / "a.db3.zstd").write_bytes(b""))),
}
MAPS: dict[str, Mapping[str, object]] = {
    "its columns": OF_MATRIX | {"motor_torque": "s.tau"},
    "a matrix in columns": OF_TABLE | {"link_position": "q[:,1]"},
    "a matrix in rows": OF_TABLE | {"link_position": "p[1,:]"},
    "a wrong name": {"motor_torque": "current"},
    "the second": {name: f"b/{name}" for name in COLUMNS},
    "one of them": {one.name: f"group 1 task1/{one.name}" for one in ENCODERS}
    | {"motor_torque": "u"},
    **dict.fromkeys(("topics at different times", "overtaken by 1", "overtaken by 20"), TORQUE),
    **dict.fromkeys(("a number that is missing", "no times in common"), TORQUE),
}


def test_signals_of_files(here: Path, golden: Any, capfd: Any) -> None:
    """Assert the contents of files, or one sentence, without output of the libraries."""
    found = {}
    for case, (name, write) in FILES.items():
        path = Path(case) / name
        path.parent.mkdir()
        write(path)
        found[case] = said(read_log, path, MAPS.get(case))
    golden(found)
    assert capfd.readouterr() == ("", "")


def test_invalid_samples_of_a_part(tmp_path: Path) -> None:
    """Assert that invalid samples are named if a file is read in parts."""
    invalid(tmp_path / "log.mf4")
    tables = tables_of_file(tmp_path / "log.mf4", None, 25)
    assert "1 of its 25 samples, from 51 on, are marked" in refused(next, tables)


def test_names_that_are_code(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Assert that an invalid type name does not reach code that executes it."""
    trap = tmp_path / "executed"
    names = [f"a/msg/B: pass\nopen({str(trap)!r}, 'w')\nclass C", "__import__('os')", "a//b"]
    for name in names:
        decode, why = ros.decoder(ros.Topic("/x", name, "cdr", "float64 data\n", "ros2msg"))
        assert decode is None
        assert "a type whose name" in why
    idl = "module a { module msg { struct B { double data; }; }; };"
    assert ros.decoder(ros.Topic("/x", "a/msg/B", "cdr", idl, "ros2idl"))[0] is not None
    made: list[object] = []
    monkeypatch.setattr(Typestore, "register", lambda _, types: made.append(types))
    inner = f"float64 x\n{'=' * 80}\nMSG: 9c/D\nfloat64 y\n"
    for definition in (inner, "float64"):
        topic = ros.Topic("/x", "a/msg/B", "cdr", definition, "ros2msg")
        assert "definition cannot be read" in ros.decoder(topic)[1]
    assert not made
    assert not trap.exists()


def test_bombs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Assert that contents which exceed a limit of memory, or claim to, are refused."""
    size = (100_000).to_bytes(4, "little") * 2
    claim = edited(
        lambda p: savemat(p, {"time": np.arange(100.0)}, format="4"),
        lambda raw: raw[:4] + size + raw[12:],
    )
    claim(tmp_path / "4.mat")
    refused(read_log, tmp_path / "4.mat")
    monkeypatch.setattr(guard, "LIMITS", guard.LIMITS._replace(memory=300_000_000))
    savemat(tmp_path / "log.mat", {"zeros": np.zeros(40_000_000)}, do_compression=True)
    assert (tmp_path / "log.mat").stat().st_size < 1_000_000
    assert "exceeds the limit of memory or time" in refused(read_log, tmp_path / "log.mat")
    monkeypatch.setattr(guard, "LIMITS", guard.LIMITS._replace(memory=150_000_000))
    messages = [("/drive", STAMPS[0], {"zeros": " " * 200_000_000})]
    for compression in ("ZSTD", "LZ4"):
        path = mcap(tmp_path / f"{compression}.mcap", messages, compression)
        assert path.stat().st_size < 1_000_000
        assert re.search("MCAP file that can be read|memory or time", refused(read_log, path))


EVERY_MS = np.arange(0.0007, 0.4, 1e-3)
LATE_TORQUES = sorted(measured(2_000_000), key=lambda one: one[0])
TORQUE_OF_MDF = [signal("motor_torque", np.sin(EVERY_MS), EVERY_MS)]
IN_PARTS = {
    **{name: WRITERS[name] for name in ("Parquet", "HDF5", "MDF 3")},
    "MDF, two rates": (
        "a.mf4",
        lambda p: mdf(p, in_groups()[0], TORQUE_OF_MDF),
    ),
    "MCAP in blocks": ("a.mcap", lambda p: mcap(p, LATE_TORQUES)),
}


@pytest.mark.parametrize("name", WRITERS)
def test_channels_are_the_same_bits(name: str, tmp_path: Path):
    """Assert that every format gives the same channels, at the same times."""
    (recording,) = read_log(log_file(tmp_path, name), FORMAT_MAPS.get(name)).recordings
    np.testing.assert_array_equal(recording.link_position, COLUMNS["link_position"])
    np.testing.assert_array_equal(recording.motor_position, COLUMNS["motor_position"])
    np.testing.assert_array_equal(recording.input, COLUMNS["motor_torque"])
    assert recording.sample_time == pytest.approx(0.005, rel=1e-9)
    assert recording.input_unit == "N m"


@pytest.mark.parametrize("name", IN_PARTS)
def test_parts_are_the_whole(name: str, tmp_path: Path):
    """Assert that parts of a file, with one clock or two, equal the whole."""
    file, write = IN_PARTS[name]
    path, column_map = tmp_path / file, TORQUE if "MCAP" in name else None
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
        log = read_log(log_file(tmp_path, name))
        assert log.columns["motor_position"].columns == {path: 1.0}
        assert len(log.warnings) == name.startswith("ROS")  # recognised by name
    assert {*log.columns} == {"time", *SIGNALS}
    table, path = pl.DataFrame({"time": [0.0, 0.1]}), tmp_path / "a.parquet"
    write_parquet(table.head(1), path)
    write_parquet(table, path)
    assert pl.read_parquet(path).equals(table)
    full = Path("/dev/full")
    if full.exists():
        with pytest.raises(OSError, match="No space left on device") as caught:
            write_parquet(table, full)
        assert caught.value.filename == str(full)
