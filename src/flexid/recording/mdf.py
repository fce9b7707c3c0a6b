"""MDF files of measurement and calibration tools, versions 2 to 4: through asammdf."""

from __future__ import annotations

import gc
import logging
import sys
from collections import Counter
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

import numpy as np

from flexid.errors import RecordingError
from flexid.files import shown
from flexid.recording.limits import MOST_COLUMNS
from flexid.recording.outside import digest_of, need, readable
from flexid.recording.series import LONGEST_PATH, Series, SeriesFile

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from numpy.typing import NDArray

    from flexid.arrays import FloatArray

_WHAT = "MDF file"
_TIME_MASTER = (0, 1)  # sync types: none stated, as in version 3, and time
_NUMBERS = range(6)  # data types of version 4: integers and floating point, of either byte order
_NUMBERS_3 = (*range(7), *range(9, 17))  # of version 3
_TEXT_CONVERSION = 7  # and those above it make texts of numbers, or numbers of texts
_TEXT_CONVERSION_3 = (10, 11, 12)


def open_series(path: Path) -> SeriesFile:
    """The signals of an MDF file, each on the clock of its group.

    Raises
    ------
    RecordingError
        If it is no MDF file, a damaged one, or asammdf is not installed.
    """
    file = shown(path)
    digest = digest_of(path)
    need(file, "asammdf", "mdf")
    others: dict[str, str] = {}
    with readable(file, _WHAT), _opened(path) as content:
        found = list(_channels(file, content, others))
        names = Counter(name for _, _, name, _ in found)
        series, clocks = [], {}
        for group, index, name, kind in found:
            where = _group_name(content, group)
            unit = _unit(content, group, index)
            unique = name if names[name] == 1 else f"{where}/{name}"
            if names[name] > 1 and any(one.path == unique for one in series):
                unique = f"{where}/{index}/{name}"
            read = _reader(path, group, index)
            length = int(content.groups[group].channel_group.cycles_nr)
            series.append(Series(unique, kind, length, read, unit, where))
            clocks.setdefault(where, _clock_reader(path, group))
    return SeriesFile(file, digest, tuple(series), others, clocks)


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """The file as asammdf has it.

    What it could not read it leaves half made, and that raises once more when it is cleared away,
    where nothing can catch it but the hook that would print it. It also writes to the terminal.
    """
    from asammdf import MDF

    hook, content = sys.unraisablehook, None
    log = logging.getLogger("asammdf")
    sys.unraisablehook, log.disabled = lambda _: None, True
    try:
        with suppress(Exception):
            content = MDF(str(path))
        if content is None:
            gc.collect(1)  # it is young
    finally:
        sys.unraisablehook, log.disabled = hook, False
    if content is None:
        raise ValueError("asammdf cannot read it")
    with content:
        yield content


def _channels(
    file: str, content: Any, others: dict[str, str]
) -> Iterator[tuple[int, int, str, str]]:
    """Group, index, name and type of every channel that is a signal."""
    count = 0
    for number, group in enumerate(content.groups):
        master = content.masters_db.get(number)
        timed = master is not None and _is_time(group.channels[master])
        for index, channel in enumerate(group.channels):
            count += 1
            if count > MOST_COLUMNS:
                raise RecordingError(
                    file, "", "it holds too many channels: export those of one joint"
                )
            name = str(channel.name)[:LONGEST_PATH]
            if index == master:
                continue
            if not timed:
                others[name] = "its group has no time"
            elif not _is_number(content, group, index):
                others[name] = "text, an array or a structure"
            else:
                yield number, index, name, "number"


def _is_time(master: Any) -> bool:
    return getattr(master, "sync_type", 0) in _TIME_MASTER


def _is_number(content: Any, group: Any, index: int) -> bool:
    channel = group.channels[index]
    dependency = group.channel_dependencies[index]
    conversion = channel.conversion
    kind = getattr(conversion, "conversion_type", 0)
    if content.version < "4.00":
        return (
            dependency is None
            and channel.data_type in _NUMBERS_3
            and kind not in _TEXT_CONVERSION_3
        )
    return dependency is None and channel.data_type in _NUMBERS and kind < _TEXT_CONVERSION


def _group_name(content: Any, group: int) -> str:
    """A name for a group that no other has."""
    name = getattr(content.groups[group].channel_group, "acq_name", "") or ""
    return f"group {group} {name}".strip()


def _unit(content: Any, group: int, index: int) -> str:
    return (content.get_channel_unit(group=group, index=index) or "").strip().strip("[]()")


def _reader(path: Path, group: int, index: int) -> Callable[[], NDArray[np.generic]]:
    """Read a channel when it is wanted."""

    def read() -> NDArray[np.generic]:
        with readable(shown(path), _WHAT), _opened(path) as content:
            signal = content.get(group=group, index=index, ignore_invalidation_bits=False)
            cycles = int(content.groups[group].channel_group.cycles_nr)
            lost = cycles - len(signal.samples)  # those that are marked are left out
            if lost:
                raise RecordingError(
                    shown(path),
                    f"{signal.name!r}",
                    f"{lost} of its {cycles} samples are marked as invalid: cut the log to where "
                    f"all are valid",
                )
            return np.asarray(signal.samples)

    return read


def _clock_reader(path: Path, group: int) -> Callable[[], FloatArray]:
    def read() -> FloatArray:
        with readable(shown(path), _WHAT), _opened(path) as content:
            return np.asarray(content.get_master(group), dtype=np.float64)

    return read
