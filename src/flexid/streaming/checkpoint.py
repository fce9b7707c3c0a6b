"""A session in a file: everything it knows, versioned, with a checksum, as exact numbers in JSON.

Arrays of floats stand as the bytes of their numbers, in base64, so that a session that goes on from
a file does so bit for bit. Nothing in the file is executed, and every size is checked.
"""

import base64
import hashlib
import json
from collections.abc import Mapping
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from flexid.arrays import FloatArray
from flexid.atomic import write_atomically
from flexid.errors import SettingError
from flexid.files import read_bytes
from flexid.streaming.options import WatchOptions
from flexid.streaming.recent import CAUSES
from flexid.streaming.session import Change, Memory, Session

FORMAT = "flexid watch"
VERSION = 1
"""Of the files that this version writes, and the only one that it reads."""

LARGEST_FILE = 50_000_000  # bytes; the largest model makes some megabytes
WANTED = "a checkpoint of flexid watch"


def save_session(session: Session, path: Path) -> None:
    """Write a session into a file, which appears whole or not at all."""
    content = _content(session)
    document = {
        "format": FORMAT,
        "version": VERSION,
        "sha256": _digest(content),
        "content": content,
    }
    text = json.dumps(document, indent=1, allow_nan=False) + "\n"
    try:
        write_atomically(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))
    except (OSError, ValueError) as error:  # ValueError: a null character in the path
        reason = getattr(error, "strerror", None) or "its name cannot be used"
        raise SettingError("checkpoint", f"{path} cannot be written ({reason})") from None


def read_session(path: Path) -> Session:
    """Read a session from a file; it goes on as if it had never ended."""

    def refuse(reason: str) -> SettingError:
        return SettingError("checkpoint", f"{path}: {reason}")

    raw = read_bytes(path, LARGEST_FILE, WANTED, refuse)
    try:
        document = json.loads(raw.decode("utf-8"))
    except (ValueError, RecursionError):
        raise refuse(f"this is no JSON: give {WANTED}") from None
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise refuse(f"this is something else: give {WANTED}")
    if document.get("version") != VERSION:
        raise refuse(
            f"it is of version {document.get('version')!r}, and this flexid reads version "
            f"{VERSION}: begin anew, without it"
        )
    content = document.get("content")
    if not isinstance(content, dict) or document.get("sha256") != _digest(content):
        raise refuse("its checksum is wrong, so it was changed or cut: begin anew, without it")
    try:
        return _session(content)
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError):
        raise refuse("it does not hold what it should: begin anew, without it") from None


def _digest(content: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _content(session: Session) -> dict[str, Any]:
    recent = session.recent
    memories = {"now": session.now, "newer": session.newer, "older": session.older}
    return {
        "options": session.options.document,
        "fed": session.fed,
        "n_read": session.n_read,
        "first_read": _text(session.first_read.ravel()),
        "guard": _text(session.guard_state),
        "gear": _text(np.array(session.gear.state)),
        **{
            name: {
                "fed": memory.fed,
                "determined": memory.determined,
                "states": [_text(state) for state in memory.states],
            }
            for name, memory in memories.items()
        },
        "recent": {
            "errors": _text(recent.errors),
            "equations": recent.equations,
            "powers": _text(recent.powers),
            "equations_before": recent.equations_before,
            "usual": _text(recent.usual.ravel()),
            "counts_before": _text(recent.counts_before),
            "bad_share": recent.bad_share,
            "bad_cause": recent.bad_cause,
        },
        "suspected": session.suspected,
        "n_changes": session.n_changes,
        "changes": [[change.time, change.row, change.times_worse] for change in session.changes],
    }


def _session(content: Mapping[str, Any]) -> Session:
    session = Session(WatchOptions.of(content["options"]))
    n_rows = len(session.learner.system.rows)
    sizes = session.learner.sizes()
    session.fed = _count(content["fed"])
    session.n_read = _count(content["n_read"])
    session.first_read = _rows(content["first_read"], session.options.width)
    session.guard_state = _array(content["guard"], len(session.guard_state))
    session.gear.state = _array(content["gear"], len(session.gear.state)).tolist()
    session.now = _memory(content["now"], sizes)
    session.newer = _memory(content["newer"], sizes)
    session.older = _memory(content["older"], sizes)
    stored = content["recent"]
    recent = session.recent
    recent.errors = _array(stored["errors"], n_rows)
    recent.equations = _count(stored["equations"])
    recent.powers = _array(stored["powers"], n_rows)
    recent.equations_before = _count(stored["equations_before"])
    recent.usual = _array(stored["usual"], 2 * n_rows).reshape(2, n_rows)
    recent.counts_before = _array(stored["counts_before"], len(CAUSES) + 1)
    recent.bad_share = float(stored["bad_share"])
    recent.bad_cause = str(stored["bad_cause"])
    session.suspected = bool(content["suspected"])
    session.n_changes = _count(content["n_changes"])
    session.changes = tuple(
        Change(_finite(time), str(row), _finite(worse)) for time, row, worse in content["changes"]
    )
    return session


def _memory(stored: Mapping[str, Any], sizes: tuple[int, ...]) -> Memory:
    states = [_array(text, size) for text, size in zip(stored["states"], sizes, strict=True)]
    return Memory(_count(stored["fed"]), tuple(states), bool(stored["determined"]))


def _text(array: FloatArray) -> str:
    return base64.b64encode(np.asarray(array, dtype="<f8").tobytes()).decode("ascii")


def _array(text: str, size: int) -> FloatArray:
    array = _numbers(text)
    if array.shape != (size,):
        raise ValueError("another size")
    return array


def _rows(text: str, width: int) -> FloatArray:
    return _numbers(text).reshape(-1, width)


def _numbers(text: str) -> FloatArray:
    raw = base64.b64decode(text, validate=True)
    return np.frombuffer(raw, dtype="<f8").astype(np.float64)


def _count(value: object) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or value < 0:
        raise ValueError("no count")
    return value


def _finite(value: object) -> float:
    if not isinstance(value, int | float) or not isfinite(value):
        raise ValueError("no number")
    return float(value)
