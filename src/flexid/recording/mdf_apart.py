"""What runs in a process of its own: asammdf, of which damaged MDF files can end the process.

It writes one line of JSON on what the file holds, then answers each line with the signals it asks
for: one line of JSON, and their numbers as they stand in memory.
"""

from __future__ import annotations

import json
import sys
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import numpy as np

from flexid.recording.limits import MOST_COLUMNS
from flexid.recording.series import LONGEST_PATH

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flexid.arrays import FloatArray

LONGEST = 600  # s of processor, after which a file is given up
_TIME_MASTER = (0, 1)  # sync types: none stated, as in version 3, and time
_NUMBERS = range(6)  # data types of version 4: integers and floating point, of either byte order
_NUMBERS_3 = (*range(7), *range(9, 17))  # of version 3
_TEXT_CONVERSION = 7  # and those above it make texts of numbers, or numbers of texts
_TEXT_CONVERSION_3 = (10, 11, 12)


class RefusedError(Exception):
    """A place and a reason, for the process that asked."""


def main() -> None:
    """Serve the file that the command line names, until nothing more is asked."""
    with suppress(ImportError):  # which Windows has not
        import resource

        resource.setrlimit(resource.RLIMIT_CPU, (LONGEST, LONGEST))
    from asammdf import MDF

    with MDF(sys.argv[1]) as content:
        _answer(lambda: (_held(content), []))
        for line in sys.stdin.buffer:
            asked = json.loads(line)
            _answer(lambda asked=asked: _read(content, asked))


def _answer(make: Any) -> None:
    """Write what something makes, or why it cannot."""
    try:
        document, arrays = make()
    except RefusedError as error:
        document, arrays = {"refused": error.args}, []
    out = sys.stdout.buffer
    out.write(json.dumps(document).encode() + b"\n")
    for array in arrays:
        out.write(np.ascontiguousarray(array, dtype="<f8").tobytes())
    out.flush()


def _held(content: Any) -> dict[str, Any]:
    """Every channel that is a signal, and what else there is."""
    others: dict[str, str] = {}
    series = [
        {
            "group": group,
            "index": index,
            "name": name,
            "where": _group_name(content, group),
            "unit": (content.get_channel_unit(group=group, index=index) or "")
            .strip()
            .strip("[]()"),
            "length": int(content.groups[group].channel_group.cycles_nr),
        }
        for group, index, name in _channels(content, others)
    ]
    return {"series": series, "others": others}


def _channels(content: Any, others: dict[str, str]) -> Iterator[tuple[int, int, str]]:
    """Group, index and name of every channel that is a signal."""
    count = 0
    for number, group in enumerate(content.groups):
        master = content.masters_db.get(number)
        timed = master is not None and _is_time(group.channels[master])
        for index, channel in enumerate(group.channels):
            count += 1
            if count > MOST_COLUMNS:
                raise RefusedError("", "it holds too many channels: export those of one joint")
            name = str(channel.name)[:LONGEST_PATH]
            if index == master:
                continue
            if not timed:
                others[name] = "its group has no time"
            elif not _is_number(content, group, index):
                others[name] = "text, an array or a structure"
            else:
                yield number, index, name


def _is_time(master: Any) -> bool:
    return getattr(master, "sync_type", 0) in _TIME_MASTER


def _is_number(content: Any, group: Any, index: int) -> bool:
    channel = group.channels[index]
    kind = getattr(channel.conversion, "conversion_type", 0)
    if group.channel_dependencies[index] is not None:
        return False
    if content.version < "4.00":
        return channel.data_type in _NUMBERS_3 and kind not in _TEXT_CONVERSION_3
    return channel.data_type in _NUMBERS and kind < _TEXT_CONVERSION


def _group_name(content: Any, group: int) -> str:
    """A name for a group that no other has."""
    name = getattr(content.groups[group].channel_group, "acq_name", "") or ""
    return f"group {group} {name}".strip()


def _read(content: Any, asked: dict[str, Any]) -> tuple[dict[str, Any], list[FloatArray]]:
    """Channels by group and index, and the time stamps of groups, each from a record on."""
    arrays = [_samples(content, *channel) for channel in asked["channels"]]
    for group, first, count in asked["clocks"]:
        stamps = content.get_master(group, record_offset=first, record_count=count)
        arrays.append(np.asarray(stamps, dtype=float))
    return {"lengths": [len(array) for array in arrays]}, arrays


def _samples(content: Any, group: int, index: int, first: int, count: int) -> FloatArray:
    signal = content.get(
        group=group,
        index=index,
        ignore_invalidation_bits=False,
        record_offset=first,
        record_count=count,
    )
    cycles = min(count, int(content.groups[group].channel_group.cycles_nr) - first)
    lost = cycles - len(signal.samples)  # those that are marked are left out
    if lost:
        where = f", from {first + 1} on," if first else ""
        raise RefusedError(
            f"{signal.name!r}",
            f"{lost} of its {cycles} samples{where} are marked as invalid: cut the log to where "
            f"all are valid",
        )
    return np.asarray(signal.samples, dtype=float)
