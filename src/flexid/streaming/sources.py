"""Where a stream comes from, a growing file or standard input: its bytes each tenth of a second."""

import io
import os
import select
import sys
import time
from collections.abc import Generator
from pathlib import Path

from flexid.errors import RecordingError, SettingError
from flexid.files import check_file, shown

WAIT = 0.1  # seconds after which a source says that nothing has come
MOST = 1 << 20  # bytes that are handed over at once

_COMPARED = 256  # bytes, by which a file is known that is read on


def open_source(source: str, *, stop_at_end: bool = False) -> Generator[bytes]:
    """Bytes of a source as they come."""
    if source == "-":
        return _standard_input()
    if "://" in source:
        raise SettingError(
            "source",
            f"{source!r} cannot be opened: give the path of a file, or - and let another program "
            f"write to standard input",
        )
    return _growing_file(Path(source), stop_at_end=stop_at_end)


def _growing_file(path: Path, *, stop_at_end: bool) -> Generator[bytes]:
    """What a recorder writes into a text file; raise where another text stands there now."""
    name = shown(path)
    check_file(path, "a log as text", lambda reason: RecordingError(name, "", reason))
    try:
        file = path.open("rb", buffering=0)
    except OSError as error:
        raise RecordingError(
            name, "", f"the file cannot be opened ({error.strerror}): check its rights"
        ) from None
    last = b""  # of what was read: so a file is found that was written again and is longer now
    with file:
        while True:
            file.seek(-len(last), os.SEEK_CUR)
            found = file.read(len(last) + MOST)
            new = found.removeprefix(last)
            if not found.startswith(last) or (not new and _is_replaced(path, file)):
                raise RecordingError(
                    name,
                    "",
                    "it was cut, rewritten or replaced while it was watched: watch it once more",
                )
            last = found[-_COMPARED:]
            if not new and stop_at_end:
                return
            if not new:
                time.sleep(WAIT)
            yield new


def _is_replaced(path: Path, file: io.FileIO) -> bool:
    """Whether another file stands there now, as where logs are rotated."""
    try:
        return not os.path.samestat(path.stat(), os.fstat(file.fileno()))
    except OSError:  # it is not there yet
        return False


def _standard_input() -> Generator[bytes]:
    """What another program writes into this one; it is not closed, as others may read on."""
    try:
        file = sys.stdin.fileno()
    except (AttributeError, ValueError, io.UnsupportedOperation):
        raise SettingError("source", "there is no standard input: give a file") from None
    while True:  # a console of Windows keeps us waiting for it
        if os.name == "posix" and not select.select([file], [], [], WAIT)[0]:
            yield b""
        elif found := os.read(file, MOST):
            yield found
        else:
            return
