"""Small logs in every supported format, each written by its own library."""

from __future__ import annotations

import io
import json
import tempfile
from collections.abc import Callable
from datetime import date, datetime, timedelta
from datetime import time as dt_time
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

Columns = dict[str, np.ndarray]
Message = tuple[str, int, dict[str, Any]]

STAMPS = [1_700_000_000_000_000_000 + 5_000_000 * index for index in range(100)]
"""Time stamps of messages, in ns."""

_STATE, _NOTE = "sensor_msgs/msg/JointState", "std_msgs/msg/String"


def log_columns(rows: int = 100) -> Columns:
    """Return a small log with two encoders."""
    t = 0.005 * np.arange(rows)
    motor = np.sin(20.0 * t) + 0.4 * np.sin(53.0 * t)
    return {
        "time": t,
        "link_position": motor + 0.05 * np.sin(37.0 * t + 1.0),
        "motor_position": motor,
        "motor_torque": 20.0 * np.sin(20.0 * t),
    }


def log_text() -> bytes:
    """Return the log as a CSV file."""
    return pl.DataFrame(log_columns()).write_csv(float_precision=6).encode()


def log_parquet() -> tuple[bytes, ...]:
    """Return the log as Parquet files."""
    buffers = []
    for compression in ("zstd", "snappy", "uncompressed"):
        buffers.append(io.BytesIO())
        pl.DataFrame(log_columns()).write_parquet(buffers[-1], compression=compression)
    return tuple(buffer.getvalue() for buffer in buffers)


def strange_parquet() -> tuple[bytes, ...]:
    """Return Parquet files with columns of every type in place of numbers."""
    frame = pl.DataFrame(log_columns())
    rows = frame.height
    columns = (
        pl.Series(["1.5"] * rows), pl.Series([b"1.5"] * rows), pl.Series([True] * rows),
        pl.Series([None] * rows), pl.Series([[1.0, 2.0]] * rows), pl.Series([{"a": 1.0}] * rows),
        pl.Series([date(2024, 5, 1)] * rows), pl.Series([datetime(2024, 5, 1)] * rows),
        pl.Series([timedelta(seconds=1)] * rows), pl.Series([dt_time(12)] * rows),
        pl.Series([Decimal("1.5")] * rows), pl.Series(["a"] * rows, dtype=pl.Categorical),
        pl.Series([1.0, None] * (rows // 2)), pl.Series([np.inf] * rows),
        pl.Series(range(rows), dtype=pl.Int8), pl.Series(range(rows), dtype=pl.UInt64) + 2**60,
        pl.Series(range(rows), dtype=pl.Float32),
    )  # fmt: skip
    files = []
    for column in columns:
        for name in ("time", "motor_torque"):
            buffer = io.BytesIO()
            frame.with_columns(column.alias(name)).write_parquet(buffer)
            files.append(buffer.getvalue())
    return tuple(files)


def log_matlab() -> tuple[bytes, ...]:
    """Return the log as MATLAB files before version 7.3."""
    from scipy.io import savemat

    columns, files = log_columns(), []
    for form, compressed, variables in (
        ("5", False, columns),
        ("5", True, columns),
        ("5", False, {"run": columns, "note": "text", "cells": np.array([1, "a"], dtype=object)}),
        ("4", False, columns),
    ):
        buffer = io.BytesIO()
        savemat(buffer, variables, format=form, do_compression=compressed)
        files.append(buffer.getvalue())
    return tuple(files)


def log_hdf5() -> tuple[bytes, ...]:
    """Return the log as HDF5 files."""
    import h5py

    files = []
    for compression, libver in ((None, "earliest"), ("gzip", "latest")):
        buffer = io.BytesIO()
        with h5py.File(buffer, "w", libver=libver) as file:
            for name, values in log_columns().items():
                data = file.create_dataset(
                    f"run/{name}", data=np.atleast_2d(values), compression=compression
                )
                data.attrs["units"] = np.bytes_("s" if name == "time" else "")
            file["note"] = "text"
        files.append(buffer.getvalue())
    return tuple(files)


def matlab_73(path: Path, variables: Columns, compression: str | None = None, **form: Any) -> Path:
    """Return a file like MATLAB's ``save -v7.3``: a header, then HDF5 with reversed dimensions."""
    import h5py

    with h5py.File(path, "w", userblock_size=512, **form) as file:
        group = file.create_group("log")
        group.attrs["MATLAB_class"] = np.bytes_("struct")
        for name, values in variables.items():
            data = np.atleast_2d(values)
            dataset = group.create_dataset(name, data=data, compression=compression)
            dataset.attrs["MATLAB_class"] = np.bytes_("double")
        text = file.create_dataset("note", data=np.array([[104, 105]], dtype=np.uint16))
        text.attrs["MATLAB_class"] = np.bytes_("char")
        file.create_dataset("#refs#/a", data=np.zeros(5))
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")
    return path


def log_matlab_73() -> tuple[bytes, ...]:
    """Return the log as MATLAB files of version 7.3."""
    with tempfile.TemporaryDirectory() as folder:
        return tuple(
            matlab_73(Path(folder) / "a.mat", log_columns(), packed, libver=libver).read_bytes()
            for packed, libver in ((None, "earliest"), ("gzip", "latest"))
        )


def log_mdf() -> tuple[bytes, ...]:
    """Return the log as MDF files."""
    from asammdf import MDF, Signal

    columns, files = log_columns(), []
    for version in ("3.30", "4.10"):
        with tempfile.TemporaryDirectory() as folder, MDF(version=version) as file:
            signals = [
                Signal(values, columns["time"], name=name)
                for name, values in columns.items()
                if name != "time"
            ]
            file.append(signals[:2])
            file.append(signals[2:])
            path = file.save(Path(folder) / "log", compression=2 * (version > "4"))
            files.append(Path(path).read_bytes())
    return tuple(files)


def bag1(path: Path, columns: Columns, compression: Any = None) -> Path:
    """Return a bag of ROS 1."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store, writer = get_typestore(Stores.ROS1_NOETIC), Writer(path)
    if compression is not None:
        writer.set_compression(writer.CompressionFormat[compression])
    with writer:
        _write_states(writer, columns, store, store.serialize_ros1)
    return path


def bag2(path: Path, columns: Columns, plugin: str = "SQLITE3") -> Path:
    """Return a bag of ROS 2, which is a folder."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    with Writer(path, version=9, storage_plugin=StoragePlugin[plugin]) as writer:
        _write_states(writer, columns, store, store.serialize_cdr)
    return path


def log_bag1() -> tuple[bytes, ...]:
    """Return the log as bags of ROS 1."""
    with tempfile.TemporaryDirectory() as folder:
        return tuple(
            bag1(Path(folder) / f"{form}.bag", log_columns(), form).read_bytes()
            for form in (None, "BZ2", "LZ4")
        )


def log_bag2(plugin: str) -> tuple[bytes, ...]:
    """Return the log as the database and as the MCAP file of a ROS 2 bag."""
    with tempfile.TemporaryDirectory() as folder:
        path = bag2(Path(folder) / "log", log_columns(), plugin)
        return tuple(one.read_bytes() for one in path.iterdir() if one.suffix != ".yaml")


def _write_states(
    writer: Any, columns: Columns, store: Any, serialize: Callable[[Any, str], Any]
) -> None:
    """Write the log as joint states, with joints in either order, and a separate text message."""
    states = writer.add_connection("/joint_states", _STATE, typestore=store)
    notes = writer.add_connection("/note", _NOTE, typestore=store)
    for index, stamp in enumerate(STAMPS):
        late = 700_000 * (index % 3)  # the recorder is later than the sensor
        writer.write(states, stamp + late, serialize(_state(columns, store, index), _STATE))
    writer.write(notes, STAMPS[-1] + 10**9, serialize(store.types[_NOTE](data="hello"), _NOTE))


def _state(columns: Columns, store: Any, index: int) -> Any:
    """Return a message with both encoders and the motor's torque."""
    names = ("motor", "link") if index % 2 else ("link", "motor")
    stamp = store.types["builtin_interfaces/msg/Time"](
        sec=STAMPS[index] // 10**9, nanosec=STAMPS[index] % 10**9
    )
    kind = store.types["std_msgs/msg/Header"]
    sequence = {"seq": index} if "seq" in kind.__dataclass_fields__ else {}
    effort = {"motor": columns["motor_torque"][index], "link": 0.0}
    return store.types[_STATE](
        header=kind(stamp=stamp, frame_id="", **sequence),
        name=list(names),
        position=np.array([columns[f"{name}_position"][index] for name in names]),
        velocity=np.array([]),
        effort=np.array([effort[name] for name in names]),
    )


def mcap(path: Path, messages: list[Message], compression: str = "NONE", **form: Any) -> Path:
    """Return an MCAP file of JSON messages, each with topic and time in ns."""
    from mcap.writer import CompressionType, Writer

    with path.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType[compression], **form)
        writer.start()
        channels: dict[str, int] = {}
        for topic, stamp, message in messages:
            if topic not in channels:
                channels[topic] = writer.register_channel(topic, "json", 0)
            writer.add_message(channels[topic], stamp, json.dumps(message).encode(), stamp)
        writer.finish()
    return path


def log_json_mcap() -> tuple[bytes, ...]:
    """Return the log as MCAP files of JSON, in compressed chunks and without chunks."""
    columns = log_columns()
    messages = [
        ("/drive", stamp, {n: v[index] for n, v in columns.items() if n != "time"})
        for index, stamp in enumerate(STAMPS)
    ]
    with tempfile.TemporaryDirectory() as folder:
        return tuple(
            mcap(Path(folder) / "a.mcap", messages, form, use_chunking=chunked).read_bytes()
            for form, chunked in (("LZ4", True), ("ZSTD", True), ("NONE", False))
        )


SEEDS = {
    "Parquet": lambda: (*log_parquet() * 10, *strange_parquet()),
    "MATLAB": log_matlab,
    "HDF5": log_hdf5,
    "MDF": log_mdf,
    "MCAP": lambda: (*log_json_mcap(), *log_bag2("MCAP")),
    "ROS 1 bag": log_bag1,
    "ROS 2 bag": lambda: log_bag2("SQLITE3"),
}
"""Makers of files by the name of their format in `flexid.readers.formats`."""
