"""Log of an arm: read and check the channels of each joint like the log of a single joint."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from flexid.errors import RecordingError
from flexid.estimators.samples import Samples
from flexid.files import shown
from flexid.identification.full_model.model import Data, encoder_noise
from flexid.models.motion import JointType
from flexid.readers.formats import format_of
from flexid.readers.guard import Reading
from flexid.recording.columns import read_channels
from flexid.recording.names import folded, named_channel, nearest_name, split_header
from flexid.recording.read import logs_of_joints, table_of_file
from flexid.recording.recipes import ARGUMENT, map_in_file
from flexid.recording.recording import INPUTS, SI_UNITS, Log
from flexid.recording.series import names_of
from flexid.recording.sides import several
from flexid.recording.table import Table
from flexid.recording.text import read_table

_NEEDED = (
    ("time", "sample_time"),
    ("motor_position",),
    ("link_position", "deflection"),
    INPUTS,
)
_SHARED = ("time", "sample_time")  # keys of a column map without a joint number, like the ratios
_RATIOS: Mapping[JointType, str] = {"revolute": "gear_ratio", "prismatic": "lead"}


@dataclass(frozen=True, eq=False)
class ArmLog:
    """Recordings, units and warnings from the log of an arm."""

    # positions of link 1, motor 1, link 2, ... and the motors' inputs
    recordings: tuple[Samples, ...]
    input_units: tuple[str, ...]  # of each joint
    relative_to: Mapping[str, str]  # link rows measured as a deflection, and their motor rows
    resting: tuple[int, ...]  # joints whose motors rest
    warnings: tuple[str, ...]  # one sentence each
    provenance: dict[str, Any]  # file, digest, and the columns of each joint

    @cached_property
    def data(self) -> Data:
        """Data for fits."""
        return arm_data(self.recordings, self.relative_to)

    @property
    def source(self) -> str:
        """Name of the file."""
        return self.provenance["file"]

    @property
    def sha256(self) -> str:
        """SHA-256 digest of the file."""
        return self.provenance["sha256"]


def arm_data(recordings: Sequence[Samples], relative_to: Mapping[str, str] | None = None) -> Data:
    """Return data for fits; only the inputs are assumed to be delayed."""
    groups = tuple(0 for _ in recordings)
    noise = encoder_noise(recordings)
    return Data(tuple(recordings), groups, noise, relative_to or {}, largest_delay=0.0)


def read_arm_log(path: Path, types: Sequence[JointType], columns: Path | None = None) -> ArmLog:
    """Read the log of an arm whose joints have these types."""
    file, joints = shown(path), len(types)
    is_text = format_of(path) is None
    table = read_table(path) if is_text else _names(path)
    given = {} if columns is None else map_in_file(columns)
    _check_joints(file, table, given, joints)
    if columns is not None:
        _check_keys(columns, given, types)
    maps = [_columns_of(file, table, given, joint, types) for joint in range(1, joints + 1)]
    logs = _logs(file, [(table if is_text else table_of_file(path, own), own) for own in maps])
    return ArmLog(
        _merged(logs),
        tuple(log.recordings[0].input_unit for log in logs),
        {
            f"link_{joint}": f"motor_{joint}"
            for joint, log in enumerate(logs, 1)
            if log.recordings[0].link_from_deflection
        },
        tuple(joint for joint, log in enumerate(logs, 1) if log.rests),
        tuple(dict.fromkeys(warning for log in logs for warning in log.warnings)),
        {
            "file": file,
            "sha256": logs[0].sha256,
            "joints": [log.provenance["columns"] for log in logs],
        },
    )


def _logs(file: str, parts: Sequence[tuple[Table, dict[str, Any]]]) -> list[Log]:
    """Return the logs of all joints; an error in a column map names its joint."""
    try:
        return logs_of_joints(parts)
    except RecordingError as error:
        if error.file != ARGUMENT:
            raise
        for joint, (table, columns) in enumerate(parts, 1):
            try:
                read_channels(table, columns)
            except RecordingError as own:
                place = f"joint {joint}, {own.place.removeprefix('key ')}"
                raise RecordingError(file, place, own.reason) from None
        raise


def _names(path: Path) -> Table:
    with Reading(path) as reading:
        return names_of(reading)


def _check_joints(file: str, table: Table, given: dict[str, Any], joints: int) -> None:
    """Raise if a channel has a number that is not a joint of the arm."""
    names = [*given, *(split_header(table.short_name(header))[0] for header in table.names)]
    for name in names:
        stem, _, number = folded(name).rpartition("_")
        if stem in SI_UNITS and number.isdigit() and not 1 <= int(number) <= joints:
            raise RecordingError(
                file,
                f"channel {name!r}",
                f"the arm has {joints} joint{'s' if joints > 1 else ''}: give a length for each "
                f"joint of the log in [arm], or leave this channel out of the log",
            )


def _check_keys(columns: Path, given: Mapping[str, Any], types: Sequence[JointType]) -> None:
    """Raise for a key of a column map that no joint reads."""
    ratios = [_RATIOS[joint_type] for joint_type in types]
    own = [f"{name}_{n}" for n, ratio in enumerate(ratios, 1) for name in (*SI_UNITS, ratio)]
    known = [*_SHARED, *ratios, *own]
    for key in given:
        if key not in known:
            near = "" if key.startswith((*_RATIOS.values(),)) else nearest_name(key, known)
            reason = (
                f"this is not a channel of a joint{near}: use a channel, the gear_ratio of a "
                f"joint that turns, or the lead of one that slides, with the joint's number, as in "
                f"motor_position_1"
            )
            raise RecordingError(shown(columns), f"key {key!r}", reason)


def _columns_of(
    file: str, table: Table, given: dict[str, Any], joint: int, types: Sequence[JointType]
) -> dict[str, Any]:
    """Return the column map of one joint: its entries in `given`, then columns found by name."""
    joints, joint_type = len(types), types[joint - 1]
    ratio = _RATIOS[joint_type]
    found = {key: value for key, value in given.items() if key in (*_SHARED, ratio)}
    found["joint"] = joint_type
    for channel in (*SI_UNITS, ratio):
        if f"{channel}_{joint}" in given:
            found[channel] = given[f"{channel}_{joint}"]
    named = _named(table, joint, types)
    for choices in _NEEDED:
        if any(channel in found for channel in choices):
            continue
        channel = next((channel for channel in choices if channel in named), "")
        columns = named.get(channel, {})
        if len(columns) > 1 and channel != "time":
            reason = several(f"{channel}_{joint}", [*columns], is_guess=False)
            raise RecordingError(file, table.header, reason)
        if not channel:
            wanted = " or ".join(c if c in _SHARED else f"{c}_{joint}" for c in choices)
            raise RecordingError(
                file,
                table.header,
                f"there is no column {wanted} for joint {joint} of {joints}; the columns are "
                f"{table.listing}: rename the column, or name it in a column map (--columns)",
            )
        found[channel] = next(iter(columns.values()))
    return found


def _named(table: Table, joint: int, types: Sequence[JointType]) -> dict[str, dict[str, Any]]:
    """Return the columns of a joint by channel and header, recognised by their usual names.

    Names need no number if the arm has one joint. If there is a motor position, a column named
    only "position" is the link's. A force is the motor's if the joint slides. A column with the
    name of a channel takes precedence, then measured over filtered, and these over commanded ones.
    """
    numbers = {str(joint), *([""] if len(types) == 1 else [])}
    found: dict[str, dict[str, Any]] = {}
    ranks: dict[str, tuple[bool, int]] = {}
    for header in table.names:
        name = table.short_name(header)
        usual = named_channel(name)
        if usual is None or (usual.channel != "time" and usual.joint.lstrip("0") not in numbers):
            continue
        stated = split_header(header)[1] is not None or usual.unit is None
        column = header if stated else {"column": header, "unit": usual.unit}
        is_own = folded(split_header(name)[0]) in (usual.channel, f"{usual.channel}_{joint}")
        rank = (not is_own, usual.precedence)
        if rank < ranks.setdefault(usual.channel, rank):
            ranks[usual.channel], found[usual.channel] = rank, {}
        if rank == ranks[usual.channel]:
            found.setdefault(usual.channel, {})[header] = column
    if "position" in found and "motor_position" in found:
        found.setdefault("link_position", found["position"])
    if "force" in found and types[joint - 1] == "prismatic" and not {*INPUTS} & found.keys():
        found["motor_torque"] = found["force"]
    return found


def _merged(logs: Sequence[Log]) -> tuple[Samples, ...]:
    """Return recordings with the columns of all joints, from the logs of single joints."""
    found = []
    for parts in zip(*(log.recordings for log in logs), strict=True):
        sides = [side for r in parts for side in (r.needed_link_position, r.motor_position)]
        inputs = np.column_stack([r.needed_input for r in parts]).astype(np.float64)
        first = parts[0]
        found.append(
            Samples(np.column_stack(sides), None, inputs, first.sample_time, first.start_time)
        )
    return tuple(found)
