"""Reader of MDF files of measurement and calibration tools, versions 2 to 4, by asammdf."""

from collections import Counter
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from flexid.readers.formats import STAMPS, Contents, Frame, RefusedError, Series

_TIME_MASTER = (0, 1)  # sync types: unspecified, as in version 3, and time
_NUMBERS = range(6)  # data types of version 4: integers and floating point, of either byte order
_NUMBERS_3 = (*range(7), *range(9, 17))  # the same of version 3
_TEXT_CONVERSION = 7  # this and higher types convert numbers to text, or text to numbers
_TEXT_CONVERSION_3 = (10, 11, 12)


def read(path: Path) -> Contents:
    """Return the signals of an MDF file, each with the clock of its group."""
    from asammdf import MDF

    file: Any = MDF(path)
    others: dict[str, str] = {}
    channels = list(_channels(file, others))
    names = Counter(name for _, _, name in channels)
    series: list[Series] = []
    places: dict[str, tuple[int, int]] = {}
    groups: dict[str, int] = {}
    for group, index, name in channels:
        held = file.groups[group].channel_group
        clock = f"group {group} {getattr(held, 'acq_name', '') or ''}".strip()
        path_of = name if names[name] == 1 else f"{clock}/{name}"
        if path_of in places:
            path_of = f"{clock}/{index}/{name}"
        unit = (file.get_channel_unit(group=group, index=index) or "").strip().strip("[]()")
        series.append(Series(path_of, "number", int(held.cycles_nr), unit, clock))
        places[path_of], groups[clock] = (group, index), group

    def frames(paths: Collection[str], size: int) -> Iterator[Frame]:
        """Yield records of one group after the other, `size` at a time."""
        chosen = [one for one in series if one.path in paths]
        for clock, length in {one.clock: one.length for one in chosen}.items():
            for first in range(0, length, size):
                part = {"record_offset": first, "record_count": min(size, length - first)}
                columns = {STAMPS: np.asarray(file.get_master(groups[clock], **part), dtype=float)}
                for one in chosen:
                    if one.clock == clock:
                        columns[one.path] = _samples(file, *places[one.path], part)
                yield clock, columns

    return Contents(series, frames, others)


def _channels(file: Any, others: dict[str, str]) -> Iterator[tuple[int, int, str]]:
    """Yield group, index and name of every channel that is a signal; note the others."""
    for number, group in enumerate(file.groups):
        master = file.masters_db.get(number)
        timed = master is not None and (
            getattr(group.channels[master], "sync_type", 0) in _TIME_MASTER
        )
        for index, channel in enumerate(group.channels):
            name = str(channel.name)
            if index == master:
                continue
            if not timed:
                others[name] = "its group has no time"
            elif not _is_number(file, group, index):
                others[name] = "text, an array or a structure"
            else:
                yield number, index, name


def _is_number(file: Any, group: Any, index: int) -> bool:
    channel = group.channels[index]
    kind = getattr(channel.conversion, "conversion_type", 0)
    if group.channel_dependencies[index] is not None:
        return False
    if file.version < "4.00":
        return channel.data_type in _NUMBERS_3 and kind not in _TEXT_CONVERSION_3
    return channel.data_type in _NUMBERS and kind < _TEXT_CONVERSION


def _samples(file: Any, group: int, index: int, part: dict[str, int]) -> np.ndarray:
    """Values of some records; raise if any is marked as invalid."""
    signal = file.get(group=group, index=index, ignore_invalidation_bits=False, **part)
    lost = part["record_count"] - len(signal.samples)  # asammdf omits samples that are marked
    if lost:
        first = part["record_offset"]
        where = f", from {first + 1} on," if first else ""
        raise RefusedError(
            f"{signal.name!r}",
            f"{lost} of its {part['record_count']} samples{where} are marked as invalid: cut the "
            f"log to where all are valid",
        )
    return np.asarray(signal.samples, dtype=float)
