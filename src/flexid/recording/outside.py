"""Files that a library of another project reads: sized, hashed, and its faults in one sentence."""

from __future__ import annotations

import io
import os
import warnings
from contextlib import contextmanager
from importlib.util import find_spec
from typing import TYPE_CHECKING

from flexid.errors import FlexidError, RecordingError
from flexid.files import check_file, sha256, shown
from flexid.recording.limits import LARGEST_HELD

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

DEEPEST = 16  # levels of structs, messages or groups that are looked into
_PLENTY = 1_000_000  # bytes


def digest_of(path: Path, largest: int = LARGEST_HELD) -> str:
    """SHA-256 of a file of at most so many bytes.

    Raises
    ------
    RecordingError
        If it cannot be read, is empty or larger.
    """
    file = shown(path)

    def refuse(reason: str) -> RecordingError:
        return RecordingError(file, "", reason)

    size = check_file(path, "a log", refuse)
    if size == 0:
        raise refuse("the file is empty: export the log again")
    if size > largest:
        raise refuse(
            f"the file is larger than {largest / 1e6:g} MB, the most that is read: cut the log "
            f"into shorter files"
        )
    try:
        return sha256(path)
    except OSError as error:
        raise refuse(f"the file cannot be read ({error.strerror}): copy it again") from None


class OutsideFile(io.BufferedReader):
    """A file for a library that reads it, which reserves no more than there is.

    A damaged file states any length, and for what is asked of a file memory is reserved first.

    Parameters
    ----------
    path : Path
    """

    def __init__(self, path: Path) -> None:
        super().__init__(io.FileIO(path))
        self._size = os.fstat(self.fileno()).st_size

    def read(self, size: int | None = -1, /) -> bytes:
        """At most so many bytes; all that are left without a size."""
        if size is not None and size > _PLENTY:
            size = min(size, max(0, self._size - self.tell()))
        return super().read(size)


def need(file: str, package: str, extra: str) -> None:
    """Raise unless a package of an extra is installed."""
    if find_spec(package) is None:
        raise RecordingError(
            file,
            "",
            f"such files are read by {package}, which is not installed: pip install "
            f"'flexid[{extra}]'",
        )


@contextmanager
def readable(file: str, what: str) -> Iterator[None]:
    """Turn whatever a library raises on a damaged file into a sentence; what it warns of, too.

    Such libraries are written for files that are whole: on others they raise what their parsers
    come across, errors of indices, of memory and of recursion.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except FlexidError:
        raise
    except MemoryError as error:
        raise RecordingError(
            file, "", "it asks for more memory than there is: export it again, or a part of it"
        ) from error
    except Exception as error:
        raise RecordingError(
            file, "", f"this is no {what} that can be read: export or copy it again"
        ) from error
