"""Small logs in every format that is read, as its own library writes them."""

from __future__ import annotations

import io
import json
import tempfile
from datetime import date, datetime, timedelta
from datetime import time as dt_time
from decimal import Decimal
from pathlib import Path

import numpy as np
import polars as pl


def log_columns(rows: int = 100) -> dict[str, np.ndarray]:
    """A small log with two encoders."""
    t = 0.005 * np.arange(rows)
    motor = np.sin(20.0 * t) + 0.4 * np.sin(53.0 * t)
    return {
        "time": t,
        "link_position": motor + 0.05 * np.sin(37.0 * t + 1.0),
        "motor_position": motor,
        "motor_torque": 20.0 * np.sin(20.0 * t),
    }


def log_text() -> bytes:
    """It as a CSV file."""
    return pl.DataFrame(log_columns()).write_csv(float_precision=6).encode()


def log_parquet() -> tuple[bytes, ...]:
    """It as Parquet files."""
    buffers = []
    for compression in ("zstd", "snappy", "uncompressed"):
        buffers.append(io.BytesIO())
        pl.DataFrame(log_columns()).write_parquet(buffers[-1], compression=compression)
    return tuple(buffer.getvalue() for buffer in buffers)


def strange_parquet() -> tuple[bytes, ...]:
    """Parquet files with columns of every type where numbers are expected."""
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
    """It as MATLAB files before version 7.3."""
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


def log_hdf5(*, is_matlab: bool = False) -> tuple[bytes, ...]:
    """It as HDF5 files, or as MATLAB's of version 7.3, which have another header."""
    import h5py

    files = []
    for compression, libver in ((None, "earliest"), ("gzip", "latest")):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "log.h5"
            with h5py.File(path, "w", libver=libver, userblock_size=512 * is_matlab) as file:
                for name, values in log_columns().items():
                    data = file.create_dataset(
                        f"run/{name}", data=np.atleast_2d(values), compression=compression
                    )
                    data.attrs["MATLAB_class" if is_matlab else "units"] = np.bytes_(
                        "double" if is_matlab else "s" if name == "time" else ""
                    )
                file["note"] = "text"
            raw = path.read_bytes()
        header = b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM"
        files.append(header + raw[len(header) :] if is_matlab else raw)
    return tuple(files)


def log_mdf() -> tuple[bytes, ...]:
    """It as MDF files."""
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


def log_bag1() -> tuple[bytes, ...]:
    """It as bags of ROS 1."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store, files = get_typestore(Stores.ROS1_NOETIC), []
    for compression in (None, Writer.CompressionFormat.BZ2, Writer.CompressionFormat.LZ4):
        with tempfile.TemporaryDirectory() as folder:
            writer = Writer(Path(folder) / "log.bag")
            if compression is not None:
                writer.set_compression(compression)
            with writer:
                _write_states(writer, store, store.serialize_ros1)
            files.append((Path(folder) / "log.bag").read_bytes())
    return tuple(files)


def log_bag2(plugin: str) -> tuple[bytes, ...]:
    """It as the database of a bag of ROS 2, or as the MCAP file of one."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log"
        with Writer(path, version=9, storage_plugin=StoragePlugin[plugin]) as writer:
            _write_states(writer, store, store.serialize_cdr)
        return tuple(one.read_bytes() for one in path.iterdir() if one.suffix != ".yaml")


def _write_states(writer, store, serialize) -> None:
    """The log as joint states."""
    kind, columns = "sensor_msgs/msg/JointState", log_columns()
    connection = writer.add_connection("/joint_states", kind, typestore=store)
    header_type = store.types["std_msgs/msg/Header"]
    for index, time in enumerate(columns["time"]):
        nanoseconds = 10**18 + round(1e9 * time)
        stamp = store.types["builtin_interfaces/msg/Time"](
            sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9
        )
        more = {"seq": index} if "seq" in header_type.__dataclass_fields__ else {}
        message = store.types[kind](
            header=header_type(stamp=stamp, frame_id="", **more),
            name=["motor", "link"],
            position=np.array([columns[f"{side}_position"][index] for side in ("motor", "link")]),
            velocity=np.array([]),
            effort=np.array([columns["motor_torque"][index], 0.0]),
        )
        writer.write(connection, nanoseconds, serialize(message, kind))


def log_json_mcap() -> tuple[bytes, ...]:
    """It as an MCAP file of JSON, in compressed chunks and without chunks."""
    from mcap.writer import CompressionType, Writer

    columns, files = log_columns(), []
    for compression in (CompressionType.LZ4, CompressionType.ZSTD, None):
        buffer = io.BytesIO()
        writer = Writer(
            buffer,
            compression=compression or CompressionType.NONE,
            use_chunking=compression is not None,
        )
        writer.start()
        channel = writer.register_channel("/drive", "json", 0)
        for index, time in enumerate(columns["time"]):
            values = {name: float(of[index]) for name, of in columns.items() if name != "time"}
            writer.add_message(channel, 10**18 + round(1e9 * time), json.dumps(values).encode(), 0)
        writer.finish()
        files.append(buffer.getvalue())
    return tuple(files)


SEEDS = {
    "Parquet": lambda: (*log_parquet() * 10, *strange_parquet()),
    "MATLAB": log_matlab,
    "HDF5": log_hdf5,
    "MDF": log_mdf,
    "MCAP": lambda: (*log_json_mcap(), *log_bag2("MCAP")),
    "ROS 1 bag": log_bag1,
    "ROS 2 bag": lambda: log_bag2("SQLITE3"),
}
"""Files by the name of their format, in `flexid.readers.formats`."""
