"""Reading of files of other programs in a child process, with limits of memory and time.

For some damaged files the libraries crash, use all memory, or never return. The parent then raises
an error with one sentence.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Collection, Iterator
from contextlib import AbstractContextManager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from flexid.errors import RecordingError
from flexid.files import check_file, sha256, shown
from flexid.readers.formats import Series, files_of, format_of

if TYPE_CHECKING:
    import polars

_OUT_OF_TIME = -getattr(signal, "SIGXCPU", 0) or None  # Windows has none
PROGRAM = "from flexid.readers.child import main; main()"


class Limits(NamedTuple):
    """Limits of a child process. Times grow with the file, as the slowest reader requires."""

    memory: int = 4_000_000_000  # bytes
    silence: float = 15.0  # s without an answer, and 1 s for each 100 kB of the file
    processor: float = 15.0  # s, and 1 s for each 500 kB of the file
    message: int = 1_000_000_000  # bytes of one answer
    file: int = 10_000_000_000  # bytes


LIMITS = Limits()


class Reading(AbstractContextManager["Reading"]):
    """A file of one of `FORMATS`, or a folder of such files, that a child process has opened."""

    def __init__(self, path: Path) -> None:
        found = format_of(path)
        assert found is not None
        self.file = shown(path)
        self.format = found
        sizes = [check_file(one, "a log", self._refusal) for one in files_of(path)]
        if not all(sizes):
            raise self._refusal("the file is empty: export the log again")
        size = sum(sizes)
        if size > LIMITS.file:
            raise self._refusal(
                f"the file is larger than {LIMITS.file / 1e6:g} MB, the most that is read: cut the "
                f"log into shorter files"
            )
        self._silence = LIMITS.silence + size / 100e3
        self._is_late = False
        self._process = _start_child(
            found.module, str(path), LIMITS.memory, round(LIMITS.processor + size / 500e3)
        )
        try:
            held = self._next()[0]
            self.series = [Series(*one) for one in held["series"]]
            self.others: dict[str, str] = held["others"]
            self.notes: dict[str, str] = held["notes"]
            self.is_table: bool = held["is_table"]
            self.sha256 = self._digest(files_of(path))
        except BaseException:
            self.close()
            raise

    def frames(self, paths: Collection[str], size: int) -> Iterator[tuple[str, polars.DataFrame]]:
        """Yield frames of about `size` values of signals, each with the name of its clock."""
        import polars as pl

        rows: dict[str, int] = {}
        of_one_clock = [one.length for one in self.series if one.path in paths and not one.clock]
        fewest = min(of_one_clock, default=0)
        asked = json.dumps({"paths": list(paths), "size": size}).encode() + b"\n"
        assert self._process.stdin is not None
        with suppress(OSError):  # if the process has ended, `_next` raises
            self._process.stdin.write(asked)
            self._process.stdin.flush()
        while True:
            done = max(rows.values(), default=0)
            answer, data = self._next(done)
            if "end" in answer and done < fewest:  # some libraries skip damaged parts
                raise self._error({}, done)
            if "end" in answer:
                return
            frame = pl.read_ipc_stream(io.BytesIO(data))
            rows[answer["clock"]] = rows.get(answer["clock"], 0) + frame.height
            yield answer["clock"], frame

    def close(self) -> None:
        """End the child process."""
        self._process.kill()
        self._process.communicate()

    def __exit__(self, *_: object) -> None:
        self.close()

    def _next(self, rows: int | None = None) -> tuple[dict[str, Any], bytes]:
        """Next message of the child, after `rows` rows of values; raise if it fails."""
        out: Any = self._process.stdout
        data = b""
        timer = threading.Timer(self._silence, self._stop_late_child)
        timer.start()
        try:
            answer: dict[str, Any] = json.loads(out.readline(LIMITS.message))
            size = answer.get("bytes", 0)
            if size <= LIMITS.message:
                data = out.read(size)
        except ValueError:  # the process has ended, and the message is missing or incomplete
            answer = {"unreadable": ""}
        finally:
            timer.cancel()
        if answer.keys() & {"series", "end"} or len(data) == answer.get("bytes", -1):
            return answer, data
        self.close()
        raise self._error(answer, rows)

    def _stop_late_child(self) -> None:
        self._is_late = True
        self._process.kill()

    def _error(self, answer: dict[str, Any], rows: int | None) -> RecordingError:
        """Error from the last answer of the child, or from the way in which it ended."""
        if "refused" in answer:
            return RecordingError(self.file, *answer["refused"])
        if "missing" in answer and self.format.extra:
            return self._refusal(
                f"such files are read by {answer['missing']}, which is not installed: pip install "
                f"'flexid[{self.format.extra}]'"
            )
        is_large = "memory" in answer or answer.get("bytes", 0) > LIMITS.message
        if is_large or self._is_late or self._process.returncode == _OUT_OF_TIME:
            return self._refusal(
                "reading it exceeds the limit of memory or time: export it again, or a part of it"
            )
        if rows is not None:
            reason = "the file cannot be read further: export or copy it again"
            return RecordingError(self.file, f"row {rows + 1} or after", reason)
        return self._refusal(
            f"this is not {self.format.what} that can be read: export or copy it "
            f"again, or name it .csv if it is text"
        )

    def _digest(self, files: list[Path]) -> str:
        """SHA-256 digest of a file; of several files, the digest of their digests."""
        try:
            digests = [sha256(one) for one in files]
        except OSError as error:
            raise self._refusal(
                f"the file cannot be read ({error.strerror}): copy it again"
            ) from None
        if len(digests) == 1:
            return digests[0]
        return hashlib.sha256("".join(digests).encode()).hexdigest()

    def _refusal(self, reason: str) -> RecordingError:
        return RecordingError(self.file, "", reason)


def _start_child(*arguments: object) -> subprocess.Popen[bytes]:
    """Start a child with a new interpreter, which cannot import modules from the log's folder."""
    paths = os.pathsep.join(entry for entry in sys.path if entry)
    few = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "POLARS_MAX_THREADS": "4"}
    return subprocess.Popen(
        [sys.executable, "-P", "-c", PROGRAM, *map(str, arguments)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env={**os.environ, **few, "PYTHONPATH": paths},
    )
