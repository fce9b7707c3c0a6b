"""A session in a file: everything it knows, versioned, with a checksum, as exact numbers in JSON.

Arrays of floats stand as the bytes of their numbers, in base64, so that a session that goes on from
a file does so bit for bit. Nothing in the file is executed, and every size is checked.

What a session has read of a file that it follows is left out when the file is read again.
"""

import base64
import hashlib
import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import fields, is_dataclass, replace
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import SettingError
from flexid.files import read_bytes, write_document
from flexid.streaming.options import WatchOptions
from flexid.streaming.session import Change, Session

FORMAT = "flexid watch"
VERSION = 5  # of the files that this version writes, and the only one that it reads
PARTS = (
    *("fed", "n_read", "guard_state", "now", "newer", "older"),
    *("recent", "suspected", "n_changes"),
)
"""Attributes of a session that have the same kind and size in all of them."""

LARGEST_FILE = 50_000_000  # bytes; the largest model makes some megabytes
WANTED = "a checkpoint of flexid watch"

_WRONG = (KeyError, TypeError, ValueError, AttributeError, OverflowError, RecursionError)
"""What is raised where something else stands in a file."""

_KNOWN_BY = 200  # samples by which a file is known again
_SAME = 1e-3  # relative difference of sample times of one stream


def save_session(session: Session, path: Path) -> None:
    """Write a session into a file, which appears whole or not at all."""
    content = content_of(session)
    document = {
        "format": FORMAT,
        "version": VERSION,
        "sha256": _digest(content),
        "content": content,
    }
    text = json.dumps(document, indent=1, allow_nan=False) + "\n"
    write_document(path, text, "checkpoint")


def read_session(path: Path) -> Session:
    """Read a session from a file; it goes on as if it had never ended."""

    def refuse(reason: str) -> SettingError:
        return SettingError("checkpoint", f"{path}: {reason}")

    raw = read_bytes(path, LARGEST_FILE, WANTED, refuse)
    with suppress(*_WRONG):
        document = json.loads(raw.decode("utf-8"))
        content = document["content"]
        kind = (document["format"], document["version"], document["sha256"])
        if kind == (FORMAT, VERSION, _digest(content)):
            return _session(content)
    raise refuse(
        f"this is no checkpoint of flexid watch in version {VERSION}, or it was changed or cut: "
        f"start without it"
    )


def _digest(content: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def content_of(session: Session) -> dict[str, Any]:
    """All that a session knows, ready for JSON."""
    parts = {name: _packed(getattr(session, name)) for name in PARTS}
    return {
        "options": session.options.document,
        "first_read": _packed(session.first_read),
        "changes": _packed(session.changes),
        **parts,
    }


def _session(content: Mapping[str, Any]) -> Session:
    session = Session(WatchOptions.of(content["options"]))
    for name in PARTS:
        setattr(session, name, _unpacked(content[name], getattr(session, name)))
    session.first_read = _numbers(content["first_read"]).reshape(-1, session.options.width)
    like = Change(0.0, "", 0.0)
    session.changes = tuple(_unpacked(change, like) for change in content["changes"])
    return session


def _packed(value: Any) -> Any:
    """Numbers, arrays, tuples and data classes, ready for JSON."""
    if isinstance(value, np.ndarray):
        return base64.b64encode(np.asarray(value, dtype="<f8").tobytes()).decode("ascii")
    if isinstance(value, tuple):
        return [_packed(part) for part in value]
    if is_dataclass(value):
        return {f.name: _packed(getattr(value, f.name)) for f in fields(value)}
    return value


def _unpacked(stored: Any, like: Any) -> Any:
    """What was packed, of the same kind and size as another; a `ValueError` for anything else."""
    if isinstance(like, np.ndarray):
        return _numbers(stored).reshape(like.shape)
    if isinstance(like, tuple):
        return tuple(_unpacked(s, part) for s, part in zip(stored, like, strict=True))
    if is_dataclass(like) and not isinstance(like, type):
        parts = {f.name: _unpacked(stored[f.name], getattr(like, f.name)) for f in fields(like)}
        return replace(like, **parts)
    if type(stored) is not type(like) or (isinstance(like, float) and not isfinite(stored)):
        raise ValueError("another type")
    if type(like) is int and stored < 0:
        raise ValueError("no count")
    return stored


def _numbers(text: str) -> FloatArray:
    raw = base64.b64decode(text, validate=True)
    return np.frombuffer(raw, dtype="<f8").astype(np.float64)


def opened_session(options: WatchOptions, checkpoint: Path | None) -> Session:
    """A session from a checkpoint, if there is one, or a new one."""
    if checkpoint is None:
        return Session(options)
    if not checkpoint.exists():
        if not checkpoint.absolute().parent.is_dir():
            raise SettingError(
                "checkpoint", f"{checkpoint} cannot be written: make the folder that it is in"
            )
        return Session(options)
    session = read_session(checkpoint)
    # What was measured from time stamps, or follows from that, differs a little from one stream to
    # the next.
    measured = {name: getattr(session.options, name) for name in ("sample_time", "filter_rate")}
    close = {
        name: was for name, was in measured.items() if abs(was / getattr(options, name) - 1) < _SAME
    }
    given = replace(options, **close)
    if session.options != given:
        was, now = session.options.document, given.document
        names = ", ".join(
            f"{name} {', '.join(was[name]) if name == 'terms' else was[name]}"
            for name in was
            if was[name] != now[name]
        )
        raise SettingError(
            "checkpoint", f"{checkpoint} was saved with {names}: choose the same, or another file"
        )
    return session


class ReadBefore:
    """Leaves out what a session from a checkpoint has read: twice, it narrows intervals."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._left = session.n_read
        self._is_compared = False

    def new(self, samples: FloatArray) -> FloatArray:
        """Those of the samples that the session has not read; all of a file that is another."""
        session = self._session
        if not self._is_compared and len(samples):
            self._is_compared = True
            count = min(len(samples), len(session.first_read))
            if not np.array_equal(samples[:count], session.first_read[:count], equal_nan=True):
                session.n_read = self._left = 0
                session.first_read = session.first_read[:0]
        left_out = min(self._left, len(samples))
        self._left -= left_out
        return samples[left_out:]

    def note(self, samples: FloatArray) -> None:
        """Count samples that the session was fed."""
        session = self._session
        room = _KNOWN_BY - len(session.first_read)
        if room > 0:
            session.first_read = np.vstack((session.first_read, samples[:room]))
        session.n_read += len(samples)
