"""One log in every supported format, with the layout of usual programs."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import polars as pl
from asammdf import MDF, Signal
from benchmarks.fuzz_files import STAMPS, Message, bag1, bag2, matlab_73, mcap
from joint_log import joint_columns, without
from scipy.io import savemat

COLUMNS = without(joint_columns(100), "velocity")
SIGNALS = without(COLUMNS, "time")


def hdf5(path: Path, arrays: dict[str, Any]) -> Path:
    """Write arrays to an HDF5 file by their paths."""
    with h5py.File(path, "w") as file:
        for name, values in arrays.items():
            file[name] = values
    return path


def parquet(path: Path, *columns: Any) -> None:
    """Write columns of the log to a Parquet file."""
    pl.DataFrame(COLUMNS).select(*columns).write_parquet(path)


def signal(name: str, values: Any, time: Any = COLUMNS["time"], unit: str = "") -> Signal:
    """Return a channel of an MDF file with its time stamps."""
    return Signal(values, time, name=name, unit=unit)


def mdf(path: Path, *groups: Iterable[Signal], version: str = "4.10") -> None:
    """Write an MDF file of groups, each with its own clock."""
    with MDF(version=version) as file:
        for number, group in enumerate(groups):
            file.append([*group], acq_name=f"task{number}", common_timebase=True)
        file.save(path, overwrite=True)


def in_groups() -> tuple[list[Signal], ...]:
    """Return encoders and torque as two groups of an MDF file."""
    encoders = [signal(n, v, unit="rad") for n, v in SIGNALS.items() if n != "motor_torque"]
    return encoders, [signal("motor_torque", SIGNALS["motor_torque"], unit="Nm")]


def measured(delay: int = 0) -> list[Message]:
    """Return the log as JSON messages; the torque has its own topic with a delay in ns."""
    messages: list[Message] = []
    for index, stamp in enumerate(STAMPS):
        values = {name: COLUMNS[name][index] for name in ("motor_position", "link_position")}
        messages.append(("/drive", stamp, {"joints": [values]}))
        messages.append(("/tau", stamp + delay, {"data": COLUMNS["motor_torque"][index]}))
    return messages


MATRIX = np.column_stack([*COLUMNS.values()])
RECORDS = np.rec.fromarrays([*COLUMNS.values()], names=",".join(COLUMNS))  # pyright: ignore[reportArgumentType, reportCallIssue]
ARRAYS: dict[str, Any] = {**COLUMNS, "note": np.array([{}], dtype=object)}
GROUP = {f"run/1/{name}": values for name, values in COLUMNS.items()}
WRITERS: dict[str, tuple[str, Callable[[Path], object]]] = {
    "Parquet": ("a.parquet", lambda p: parquet(p, pl.all())),
    "NumPy, one of objects": ("a.npz", lambda p: np.savez(p, **ARRAYS)),
    "NumPy, records": ("a.npz", lambda p: np.savez(p, run=RECORDS)),
    "NumPy, matrix": ("log.npy", lambda p: np.save(p, MATRIX)),
    "MATLAB 4": ("a.mat", lambda p: savemat(p, {**COLUMNS, "note": "hello"}, format="4")),
    "MATLAB 5": ("a.mat", lambda p: savemat(p, COLUMNS, do_compression=True, oned_as="row")),
    "MATLAB, struct": ("a.mat", lambda p: savemat(p, {"run": COLUMNS, "gain": 3.0})),
    "MATLAB 7.3": ("a.mat", lambda p: matlab_73(p, COLUMNS)),
    "HDF5": ("a.h5", lambda p: hdf5(p, GROUP)),
    "MDF 4": ("a.mf4", lambda p: mdf(p, *in_groups())),
    "MDF 3": ("a.mdf", lambda p: mdf(p, *in_groups(), version="3.30")),
    "ROS 1": ("a.bag", lambda p: bag1(p, COLUMNS)),
    "ROS 1, bz2": ("a.bag", lambda p: bag1(p, COLUMNS, "BZ2")),
    "ROS 1, lz4": ("a.bag", lambda p: bag1(p, COLUMNS, "LZ4")),
    "ROS 2, folder": ("log", lambda p: bag2(p, COLUMNS)),
    "ROS 2, database": ("log/log.db3", lambda p: bag2(p.parent, COLUMNS)),
    "ROS 2, MCAP in a folder": ("log", lambda p: bag2(p, COLUMNS, "MCAP")),
    "ROS 2, MCAP": ("log/log.mcap", lambda p: bag2(p.parent, COLUMNS, "MCAP")),
    "MCAP, NONE": ("a.mcap", lambda p: mcap(p, measured())),
    "MCAP, LZ4": ("a.mcap", lambda p: mcap(p, measured(), "LZ4")),
    "MCAP, ZSTD": ("a.mcap", lambda p: mcap(p, measured(), "ZSTD")),
}
"""Name of a file and function that writes the log, by format."""
TORQUE: dict[str, object] = {"motor_torque": "/tau.data"}
FIELDS = {f"{side}_position": f"/drive.joints[0].{side}_position" for side in ("motor", "link")}
MAPS: dict[str, dict[str, object]] = {
    "NumPy, matrix": {name: f"log[:,{place}]" for place, name in enumerate(COLUMNS)},
    **{f"MCAP, {packed}": FIELDS | TORQUE for packed in ("NONE", "LZ4", "ZSTD")},
}
"""Column maps for the formats that need one."""


def log_file(folder: Path, form: str) -> Path:
    """Write the log in a format and return its path."""
    name, write = WRITERS[form]
    write(folder / name)
    return folder / name
