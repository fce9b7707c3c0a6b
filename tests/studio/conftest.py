"""A running studio, and a log that is identified quickly."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import islice
from pathlib import Path

import pytest

_LONG = 120_000  # ms, enough to compile a kernel


@pytest.fixture(scope="module")
def short_log(examples: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the first four seconds of the example log."""
    path = tmp_path_factory.mktemp("logs") / "short.csv"
    with (examples / "flexible_joint.csv").open() as file:
        path.write_text("".join(islice(file, 4001)))
    return path


@pytest.fixture
def start():
    """Return a context manager that runs a studio and yields its address."""
    return started


@contextmanager
def started(*arguments: object) -> Iterator[str]:
    """Run a studio and yield its address."""
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
    """Return the address of a studio with a log."""
    with started(short_log) as found:
        yield found


@pytest.fixture(scope="module")
def empty_address() -> Iterator[str]:
    """Return the address of a studio without a log."""
    with started() as found:
        yield found


@pytest.fixture
def page(browser):
    """Return a new browser window."""
    context = browser.new_context(viewport={"width": 1280, "height": 900})
    opened = context.new_page()
    opened.set_default_timeout(_LONG)
    yield opened
    context.close()


@pytest.fixture
def anyio_backend() -> str:
    """Return the event loop of asynchronous tests."""
    return "asyncio"
