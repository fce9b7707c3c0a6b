"""One log in every format that is read, as its programs lay it out."""

import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import polars as pl
from asammdf import MDF, Signal
from joint_log import joint_columns, without
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore
from scipy.io import savemat

COLUMNS = without(joint_columns(100), "velocity")
SIGNALS = without(COLUMNS, "time")
STAMPS = [1_700_000_000_000_000_000 + 5_000_000 * index for index in range(100)]
STATE = "sensor_msgs/msg/JointState"
STORE1, STORE2 = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_HUMBLE)
Message = tuple[str, int, dict[str, Any]]


def hdf5(path: Path, arrays: dict[str, Any], **attributes: object) -> Path:
    """Arrays by path, and attributes of each."""
    with h5py.File(path, "w") as file:
        for name, values in arrays.items():
            file[name] = values
            file[name].attrs.update(attributes)
    return path


def matlab(path: Path, variables: dict[str, Any], **form: Any) -> Path:
    """Variables of a MATLAB file of version 4 or 5."""
    savemat(path, variables, **form)
    return path


def matlab_73(path: Path, variables: dict[str, np.ndarray]) -> Path:
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


def numpy_archive(path: Path, **arrays: Any) -> Path:
    """Arrays of NumPy by name."""
    np.savez(path, **arrays)
    return path


def parquet(path: Path, *columns: Any) -> Path:
    """Columns of a Parquet file, made of the log's."""
    pl.DataFrame(COLUMNS).select(*columns).write_parquet(path)
    return path


def signal(name: str, values: Any, time: Any = COLUMNS["time"], unit: str = "") -> Signal:
    """A channel of an MDF file with its time stamps."""
    return Signal(values, time, name=name, unit=unit)


def mdf(path: Path, *groups: Iterable[Signal], version: str = "4.10") -> Path:
    """A file of groups, each with a clock of its own."""
    with MDF(version=version) as file:
        for number, group in enumerate(groups):
            file.append([*group], acq_name=f"task{number}", common_timebase=True)
        file.save(path, overwrite=True)
    return path


def in_groups() -> tuple[list[Signal], ...]:
    """Encoders and torque in two groups of an MDF file."""
    encoders = [signal(n, v, unit="rad") for n, v in SIGNALS.items() if n != "motor_torque"]
    return encoders, [signal("motor_torque", SIGNALS["motor_torque"], unit="Nm")]


def state(store: Any, index: int) -> Any:
    """A message of both encoders and the motor's torque, the joints in one order or the other."""
    names = ("motor", "link") if index % 2 else ("link", "motor")
    stamp = store.types["builtin_interfaces/msg/Time"](
        sec=STAMPS[index] // 10**9, nanosec=STAMPS[index] % 10**9
    )
    sequence = {"seq": index} if store is STORE1 else {}
    header = store.types["std_msgs/msg/Header"](stamp=stamp, frame_id="", **sequence)
    effort = {"motor": COLUMNS["motor_torque"][index], "link": 0.0}
    return store.types[STATE](
        header=header,
        name=list(names),
        position=np.array([COLUMNS[f"{name}_position"][index] for name in names]),
        velocity=np.array([]),
        effort=np.array([effort[name] for name in names]),
    )


def write_all(writer: Any, store: Any, serialize: Callable[[Any, str], Any]) -> None:
    """Write the log as joint states, with a note between."""
    states = writer.add_connection("/joint_states", STATE, typestore=store)
    notes = writer.add_connection("/note", "std_msgs/msg/String", typestore=store)
    for index, stamp in enumerate(STAMPS):
        late = 700_000 * (index % 3)  # the recorder is later than the sensor
        writer.write(states, stamp + late, serialize(state(store, index), STATE))
    note = store.types["std_msgs/msg/String"](data="hello")
    writer.write(notes, STAMPS[-1] + 10**9, serialize(note, "std_msgs/msg/String"))


def bag1(path: Path, compression: Any = None) -> Path:
    """A bag of ROS 1."""
    writer = Writer1(path)
    if compression is not None:
        writer.set_compression(compression)
    with writer:
        write_all(writer, STORE1, STORE1.serialize_ros1)
    return path


def bag2(path: Path, plugin: StoragePlugin = StoragePlugin.SQLITE3) -> Path:
    """A bag of ROS 2, which is a folder."""
    with Writer2(path, version=9, storage_plugin=plugin) as writer:
        write_all(writer, STORE2, STORE2.serialize_cdr)
    return path


def mcap(path: Path, messages: list[Message], compression: Any = CompressionType.NONE) -> Path:
    """An MCAP file of JSON messages, each with topic and time in ns."""
    with path.open("wb") as stream:
        writer = McapWriter(stream, compression=compression)
        writer.start()
        channels: dict[str, int] = {}
        for topic, stamp, message in messages:
            if topic not in channels:
                channels[topic] = writer.register_channel(topic, "json", 0)
            writer.add_message(channels[topic], stamp, json.dumps(message).encode(), stamp)
        writer.finish()
    return path


def measured(delay: int = 0) -> list[Message]:
    """The log as JSON, the torque on a topic of its own with a delay in ns."""
    messages: list[Message] = []
    for index, stamp in enumerate(STAMPS):
        values = {name: COLUMNS[name][index] for name in ("motor_position", "link_position")}
        messages.append(("/drive", stamp, {"joints": [values]}))
        messages.append(("/tau", stamp + delay, {"data": COLUMNS["motor_torque"][index]}))
    return messages


MATRIX = np.column_stack([*COLUMNS.values()])
RECORDS = np.rec.fromarrays([*COLUMNS.values()], names=",".join(COLUMNS))  # pyright: ignore[reportArgumentType, reportCallIssue]
OBJECTS = np.array([{}], dtype=object)
GROUP = {f"run/1/{name}": values for name, values in COLUMNS.items()}
WRITERS: dict[str, tuple[str, Callable[[Path], Path]]] = {
    "Parquet": ("a.parquet", lambda p: parquet(p, pl.all())),
    "NumPy, one of objects": ("a.npz", lambda p: numpy_archive(p, **COLUMNS, note=OBJECTS)),
    "NumPy, records": ("a.npz", lambda p: numpy_archive(p, run=RECORDS)),
    "NumPy, matrix": ("log.npy", lambda p: (np.save(p, MATRIX), p)[1]),
    "MATLAB 4": ("a.mat", lambda p: matlab(p, {**COLUMNS, "note": "hello"}, format="4")),
    "MATLAB 5": ("a.mat", lambda p: matlab(p, COLUMNS, do_compression=True, oned_as="row")),
    "MATLAB, struct": ("a.mat", lambda p: matlab(p, {"run": COLUMNS, "gain": 3.0})),
    "MATLAB 7.3": ("a.mat", lambda p: matlab_73(p, COLUMNS)),
    "HDF5": ("a.h5", lambda p: hdf5(p, GROUP)),
    "MDF 4": ("a.mf4", lambda p: mdf(p, *in_groups())),
    "MDF 3": ("a.mdf", lambda p: mdf(p, *in_groups(), version="3.30")),
    "ROS 1": ("a.bag", bag1),
    "ROS 1, bz2": ("a.bag", lambda p: bag1(p, Writer1.CompressionFormat.BZ2)),
    "ROS 1, lz4": ("a.bag", lambda p: bag1(p, Writer1.CompressionFormat.LZ4)),
    "ROS 2, folder": ("log", bag2),
    "ROS 2, database": ("log", lambda p: bag2(p) / "log.db3"),
    "ROS 2, MCAP in a folder": ("log", lambda p: bag2(p, StoragePlugin.MCAP)),
    "ROS 2, MCAP": ("log", lambda p: bag2(p, StoragePlugin.MCAP) / "log.mcap"),
    **{
        f"MCAP, {one.name}": ("a.mcap", lambda p, one=one: mcap(p, measured(), one))
        for one in CompressionType
    },
}
"""By format, the name of a file, and what writes the log into it."""
TORQUE: dict[str, object] = {"motor_torque": "/tau.data"}
FIELDS = {f"{side}_position": f"/drive.joints[0].{side}_position" for side in ("motor", "link")}
MAPS: dict[str, dict[str, object]] = {
    "NumPy, matrix": {name: f"log[:,{place}]" for place, name in enumerate(COLUMNS)},
    **{f"MCAP, {one.name}": FIELDS | TORQUE for one in CompressionType},
}
"""The column maps by which some are read."""


def log_file(folder: Path, form: str) -> Path:
    """The log in a format."""
    name, write = WRITERS[form]
    return write(folder / name)
