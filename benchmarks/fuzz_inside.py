"""Readers without a child process, for fuzzing with thousands of files and branch counts.

flexid starts a process for each file, which takes a quarter of a second or more. Here the same
messages go through pipes to a thread. A library that ends its process ends this one. The caller
notices this and tries the file again as flexid reads it.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from unittest.mock import patch

from flexid.readers import child, guard

MEMORY = 2_000_000_000  # bytes, limit of this process


class Inside:
    """Thread with the methods of a process that `flexid.readers.guard` uses."""

    returncode = 0

    def __init__(self, module: str, path: str, *_: object) -> None:
        questions, self._asked = os.pipe()
        answers, self._answered = os.pipe()
        self.stdin = os.fdopen(self._asked, "wb")
        self.stdout = os.fdopen(answers, "rb")
        child._pipe = os.fdopen(self._answered, "wb")
        self._answers = child._pipe
        self._questions = os.fdopen(questions, "rb")
        self._thread = threading.Thread(target=self._run, args=(module, path), daemon=True)
        self._thread.start()

    def _run(self, module: str, path: str) -> None:
        with suppress(OSError, ValueError):  # the reader has closed the pipe
            child.say(module, Path(path), self._questions)
        with suppress(OSError):
            self._answers.close()

    def kill(self) -> None:
        """Do nothing: the thread ends by itself."""

    def communicate(self) -> None:
        """Wait for the thread's end."""
        for pipe in (self.stdin, self.stdout):
            with suppress(OSError):
                pipe.close()
        self._thread.join()
        self._questions.close()


@contextmanager
def readers_inside() -> Iterator[None]:
    """Make flexid read other formats in this process, with a memory limit."""
    import resource

    before = resource.getrlimit(resource.RLIMIT_DATA)
    resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, before[1]))
    try:
        with patch.object(guard, "_started", Inside):
            yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, before)
