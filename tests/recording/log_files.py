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
Map = dict[str, object] | None
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
TORQUE: dict[str, object] = {"motor_torque": "/tau.data"}
FIELDS: dict[str, object] = {
    name: f"/drive.joints[0].{name}" for name in ("motor_position", "link_position")
}
RECORDS = np.rec.fromarrays([*COLUMNS.values()], names=",".join(COLUMNS))  # pyright: ignore[reportArgumentType, reportCallIssue]
OWN_TIMES = {name: {"Time": COLUMNS["time"], "Data": values} for name, values in SIGNALS.items()}
NAMED = np.array([{"Name": n, "Data": v} for n, v in COLUMNS.items()], dtype=object)
WRITERS: dict[str, tuple[Callable[[Path], Path], Map]] = {
    "Parquet": (lambda f: parquet(f / "log.parquet", pl.all()), None),
    "Parquet, records": (
        lambda f: parquet(f / "a.parquet", "time", pl.struct(*SIGNALS).alias("joint")),
        None,
    ),
    "Parquet, lists": (
        lambda f: parquet(
            f / "log.parquet",
            "time",
            pl.concat_list("link_position", "motor_position").alias("q"),
            "motor_torque",
        ),
        {"link_position": "q[0]", "motor_position": "q[1]"},
    ),
    "NumPy, one of objects": (
        lambda f: numpy_archive(f / "log.npz", **COLUMNS, note=np.array([{}], dtype=object)),
        None,
    ),
    "NumPy, records": (lambda f: numpy_archive(f / "log.npz", run=RECORDS), None),
    "NumPy, matrix": (
        lambda f: (np.save(f / "log.npy", MATRIX), f / "log.npy")[1],
        {name: f"log[:,{place}]" for place, name in enumerate(COLUMNS)},
    ),
    "MATLAB 4": (lambda f: matlab(f / "log.mat", {**COLUMNS, "note": "hello"}, format="4"), None),
    "MATLAB 5, rows": (
        lambda f: matlab(f / "a.mat", dict(COLUMNS), do_compression=True, oned_as="row"),
        None,
    ),
    "MATLAB, struct": (lambda f: matlab(f / "log.mat", {"run": COLUMNS, "gain": 3.0}), None),
    "MATLAB, own times": (lambda f: matlab(f / "log.mat", {"out": OWN_TIMES}), None),
    "MATLAB, structs with names": (lambda f: matlab(f / "a.mat", {"run": {"Y": NAMED}}), None),
    "MATLAB 7.3": (lambda f: matlab_73(f / "log.mat", COLUMNS), None),
    "HDF5": (lambda f: hdf5(f / "log.h5", {f"run/1/{n}": v for n, v in COLUMNS.items()}), None),
    "HDF5, matrix with names": (
        lambda f: hdf5(f / "log.h5", {"run": MATRIX}, columns=[*COLUMNS]),
        None,
    ),
    "HDF5, matrix of pandas": (
        lambda f: hdf5(
            f / "log.h5",
            {"df/block0_values": MATRIX, "df/block0_items": [name.encode() for name in COLUMNS]},
        ),
        None,
    ),
    "MDF 4": (lambda f: mdf(f / "log.mf4", *in_groups()), None),
    "MDF 3": (lambda f: mdf(f / "log.mdf", *in_groups(), version="3.30"), None),
    "ROS 1": (lambda f: bag1(f / "log.bag"), None),
    "ROS 1, bz2": (lambda f: bag1(f / "log.bag", Writer1.CompressionFormat.BZ2), None),
    "ROS 1, lz4": (lambda f: bag1(f / "log.bag", Writer1.CompressionFormat.LZ4), None),
    "ROS 2, folder": (lambda f: bag2(f / "log"), None),
    "ROS 2, database": (lambda f: bag2(f / "log") / "log.db3", None),
    "ROS 2, MCAP in a folder": (lambda f: bag2(f / "log", StoragePlugin.MCAP), None),
    "ROS 2, MCAP": (lambda f: bag2(f / "log", StoragePlugin.MCAP) / "log.mcap", None),
    **{
        f"MCAP, {one.name}": (
            lambda f, one=one: mcap(f / "log.mcap", measured(), one),
            FIELDS | TORQUE,
        )
        for one in CompressionType
    },
}
"""By format, what writes the log, and the column map by which it is read."""
