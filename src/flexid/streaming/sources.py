"""Where a stream comes from: a file that grows, or standard input.

A source is read in turns of a tenth of a second: bytes that have come, none if nothing has, None at
its end.
"""

import io
import os
import select
import sys
import time
from pathlib import Path
from typing import TypeAlias

from flexid.errors import RecordingError, SettingError
from flexid.files import check_file, shown

WAIT = 0.1  # seconds after which a source says that nothing has come
MOST = 1 << 20  # bytes that are handed over at once

_COMPARED = 256  # bytes, by which a file is known that is read on


def open_source(text: str, *, stop_at_end: bool = False) -> "Source":
    """Open a source."""
    if text == "-":
        return StandardInput()
    if "://" in text:
        raise SettingError(
            "source",
            f"{text!r} cannot be opened: give the path of a file, or - and let another program "
            f"write to standard input",
        )
    return GrowingFile(Path(text), stop_at_end=stop_at_end)


class GrowingFile:
    """A text file that a recorder is still writing.

    Before it is read on, its last bytes are compared with those that were read: so one that was
    cut or written again is found, even where it has grown beyond that place.
    """

    def __init__(self, path: Path, *, stop_at_end: bool) -> None:
        self.name = shown(path)
        check_file(path, "a log as text", lambda reason: RecordingError(self.name, "", reason))
        self._path = path
        self._stop_at_end = stop_at_end
        self._last = b""  # of what was read
        try:
            self._file = path.open("rb", buffering=0)
        except OSError as error:
            raise RecordingError(
                self.name, "", f"the file cannot be opened ({error.strerror}): check its rights"
            ) from None

    def read(self) -> bytes | None:
        """What was written since; raise where another text stands there now."""
        self._file.seek(-len(self._last), os.SEEK_CUR)
        found = self._file.read(len(self._last) + MOST)
        new = found.removeprefix(self._last)
        is_other = not found.startswith(self._last) or (not new and self._is_replaced())
        if is_other:
            raise RecordingError(
                self.name,
                "",
                "it was cut, rewritten or replaced while it was watched: watch it once more",
            )
        self._last = found[-_COMPARED:]
        if new or self._stop_at_end:
            return new or None
        time.sleep(WAIT)
        return b""

    def _is_replaced(self) -> bool:
        """Whether another file stands there now, as where logs are rotated."""
        try:
            return not os.path.samestat(self._path.stat(), os.fstat(self._file.fileno()))
        except OSError:  # it is not there yet
            return False

    def close(self) -> None:
        """Close it."""
        self._file.close()


class StandardInput:
    """What another program writes into this one."""

    name = "standard input"

    def __init__(self) -> None:
        try:
            self._file = sys.stdin.fileno()
        except (AttributeError, ValueError, io.UnsupportedOperation):
            raise SettingError("source", "there is no standard input: give a file") from None

    def read(self) -> bytes | None:
        """What came; a console of Windows keeps us waiting for it."""
        if os.name == "posix" and not select.select([self._file], [], [], WAIT)[0]:
            return b""
        return os.read(self._file, MOST) or None

    def close(self) -> None:
        """Nothing: others may read on."""


Source: TypeAlias = GrowingFile | StandardInput
"""Bytes as they come: `read` returns none if nothing has come for a while, None at the end."""
