"""A studio that runs, and a log that is identified quickly."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from itertools import islice
from pathlib import Path

import pytest


@pytest.fixture(scope="module")
def short_log(examples: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the first four seconds of the example log."""
    path = tmp_path_factory.mktemp("logs") / "short.csv"
    with (examples / "flexible_joint.csv").open() as file:
        path.write_text("".join(islice(file, 4001)))
    return path


Start = Callable[..., AbstractContextManager[str]]


@pytest.fixture
def start() -> Start:
    """Return what starts a studio for a while; it yields the address."""
    return started


@contextmanager
def started(*arguments: object) -> Iterator[str]:
    """Start a studio for a while; yields its address."""
    command = [sys.executable, "-m", "flexid", "studio", *map(str, arguments)]
    with subprocess.Popen(
        [*command, "--port", "0", "--no-browser"], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        try:
            yield process.stdout.readline().split()[2]
        finally:
            process.terminate()


@pytest.fixture(scope="module")
def address(short_log: Path) -> Iterator[str]:
    """Return the address of a studio that was given a log."""
    with started(short_log) as found:
        yield found


@pytest.fixture(scope="module")
def empty_address() -> Iterator[str]:
    """Return the address of a studio that was given no log."""
    with started() as found:
        yield found
