"""Logs that are sent to the studio: their names, their kinds, their size."""

from __future__ import annotations

import os
import re
import secrets
import shutil
from collections.abc import AsyncIterator
from pathlib import Path

from flexid.errors import FlexidError
from flexid.readers.formats import suffixes

LARGEST_UPLOAD = 100_000_000  # bytes; read at once, at about four times that in memory
LEAST_FREE = 1_000_000_000  # bytes that a log leaves on the disk
SUFFIXES = suffixes()
_LONGEST_NAME = 80


class UploadError(FlexidError):
    """A log is not taken."""

    def __init__(self, reason: str, status: int) -> None:
        self.reason = reason
        self.status = status
        super().__init__(reason)


def safe_name(name: str) -> str:
    """A name for a file from what a browser says: the last part, of plain characters, with a kind.

    Examples
    --------
    >>> safe_name("../../etc/run 1<b>.CSV")
    'run 1_b_.CSV'
    """
    last = re.split(r"[/\\]", name)[-1]
    stem, dot, suffix = last.rpartition(".")
    if not dot or f".{suffix.lower()}" not in SUFFIXES:
        raise UploadError(
            f"the studio takes logs whose names end in {', '.join(SUFFIXES)}: export the log as "
            f"one of these",
            415,
        )
    plain = re.sub(r"[^\w .()+-]", "_", stem, flags=re.ASCII).lstrip(". -")[:_LONGEST_NAME]
    return f"{plain or 'log'}.{suffix}"


async def save(chunks: AsyncIterator[bytes], name: str, folder: Path) -> Path:
    """Write a log into a folder, as far as it is not too large."""
    path = folder / safe_name(name)
    if shutil.disk_usage(folder).free < LEAST_FREE + LARGEST_UPLOAD:
        raise UploadError("the disk is almost full: make room for the log", 507)
    size, part = 0, folder / f".{secrets.token_hex(8)}"  # no log's name begins so
    try:
        with part.open("wb") as file:
            async for chunk in chunks:
                size += len(chunk)
                if size > LARGEST_UPLOAD:
                    raise UploadError(
                        f"the log is larger than {LARGEST_UPLOAD / 1e6:g} MB, the most that the "
                        f"studio takes: identify it with flexid identify",
                        413,
                    )
                file.write(chunk)
        if not size:
            raise UploadError("the file is empty: export the log again", 400)
        os.replace(part, path)
    except BaseException:
        part.unlink(missing_ok=True)
        raise
    return path
