"""Readers in this process, for a fuzzer that tries thousands of files and counts branches.

flexid starts a process for each file, which takes a quarter of a second and more. Here the same
messages go through pipes to a thread. A library that ends its process ends this one: who calls
notices, and tries the file once more as flexid reads it.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from unittest.mock import patch

from flexid.readers import child, guard

MEMORY = 2_000_000_000  # bytes that this process may have


class Inside:
    """What `flexid.readers.guard` needs of a process, as a thread."""

    returncode = 0

    def __init__(self, module: str, path: str, *_: object) -> None:
        questions, self._asked = os.pipe()
        answers, self._answered = os.pipe()
        self.stdin = os.fdopen(self._asked, "wb")
        self.stdout = os.fdopen(answers, "rb")
        child._pipe = os.fdopen(self._answered, "wb")
        self._said = child._pipe
        self._questions = os.fdopen(questions, "rb")
        self._thread = threading.Thread(target=self._run, args=(module, path), daemon=True)
        self._thread.start()

    def _run(self, module: str, path: str) -> None:
        with suppress(OSError, ValueError):  # nobody listens any more
            child.say(
                lambda: child._send_contents(child.contents_of(module, Path(path))), self._questions
            )
        with suppress(OSError):
            self._said.close()

    def kill(self) -> None:
        """Let it end."""

    def communicate(self) -> None:
        """Wait for its end."""
        for pipe in (self.stdin, self.stdout):
            with suppress(OSError):
                pipe.close()
        self._thread.join()
        self._questions.close()


@contextmanager
def readers_inside() -> Iterator[None]:
    """Read files of other programs in this process, within a limit of memory."""
    import resource

    before = resource.getrlimit(resource.RLIMIT_DATA)
    resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, before[1]))
    try:
        with patch.object(guard, "_started", Inside):
            yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, before)
