"""Fixtures that several test packages share."""

import gc
import logging
import os
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from browser import browser  # noqa: F401 - a fixture

# One thread of linear algebra for each test process; NumPy reads the variable at its import.
os.environ.setdefault("OMP_NUM_THREADS", "1")

# Bytecode is kept, so that processes started by tests need not compile flexid's sources.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

from flexid.cli.main import main
from flexid.errors import FlexidError
from flexid.studies.reproduction import Reproduction, reproduce


@dataclass(frozen=True)
class Outcome:
    """Exit status of a command and what it printed."""

    status: int
    stdout: str
    stderr: str


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option that rewrites the golden files."""
    parser.addoption("--update-golden", action="store_true", help="rewrite the golden files")


def pytest_configure() -> None:
    """Draw the same examples on any machine, and collect compiled code as garbage less often."""
    logging.getLogger("flexid.kernels").setLevel(logging.WARNING)  # caches differ
    slow = [HealthCheck.too_slow, HealthCheck.function_scoped_fixture]
    settings.register_profile("tests", deadline=None, derandomize=True, suppress_health_check=slow)
    settings.load_profile("tests")
    gc.set_threshold(100_000, 20, 20)


def pytest_runtest_teardown(item: pytest.Item, nextitem: pytest.Item | None) -> None:
    """Freeze objects left by a test file, mostly compiled code, so that they are not collected."""
    if nextitem is None or nextitem.path != item.path:
        gc.collect()
        gc.freeze()


@pytest.fixture
def golden(request: pytest.FixtureRequest) -> Callable[[Mapping[str, str]], None]:
    """Return a function that compares texts by name with ``texts/`` in the test's folder.

    The file has the test's name; ``pytest --update-golden`` writes it.
    """
    path = request.path.parent / "texts" / f"{request.node.name.removeprefix('test_')}.txt"

    def compare(sentences: Mapping[str, str]) -> None:
        lines = [f"{name}: {sentence}" for name, sentence in sentences.items()]
        if request.config.getoption("--update-golden"):
            path.parent.mkdir(exist_ok=True)
            path.write_text("\n".join(lines) + "\n", encoding="utf-8")
        assert lines == path.read_text(encoding="utf-8").splitlines()

    return compare


@pytest.fixture
def refusals(
    golden: Callable[[Mapping[str, str]], None],
) -> Callable[[Mapping[str, Callable[[], object]]], None]:
    """Return a function that compares refusals of calls, by name, with stored texts."""

    def compare(calls: Mapping[str, Callable[[], object]]) -> None:
        found = {}
        for name, call in calls.items():
            with pytest.raises(FlexidError) as caught:
                call()
            assert "\n" not in str(caught.value)
            found[name] = f"{type(caught.value).__name__}: {caught.value}"
        golden(found)

    return compare


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return an empty folder, which is the working directory: messages name files in it alone."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Return the folder of real logs, which is no part of the project; skip without it."""
    folder = Path(__file__).parents[2] / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"the real logs are not here: no folder {folder.name} beside the repository")
    return folder


@pytest.fixture(scope="session")
def examples() -> Path:
    """Return the folder of the example logs and column maps."""
    return Path(__file__).parents[1] / "examples"


@pytest.fixture(scope="session")
def example_estimate(examples: Path):
    """Return the estimate of the example log with its true terms and hold."""
    from flexid.library.identify import identify

    log = examples / "flexible_joint.csv"
    return identify(log, terms=("gravity", "motor_viscous"), hold="zero", segment_duration=2.0)


@pytest.fixture(scope="session")
def tiny_drive(examples: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a drive file whose design takes seconds."""
    text = (examples / "drive.toml").read_text().replace("duration = 10.0", "duration = 2.0")
    path = tmp_path_factory.mktemp("drive") / "drive.toml"
    path.write_text(text.replace("sample_time = 0.001", "sample_time = 0.004\nharmonics = 3"))
    return path


@pytest.fixture(scope="session")
def reproduction() -> Reproduction:
    """Return the reproduction of Huang (2003), computed once for all tests."""
    return reproduce(lambda _: None)


@pytest.fixture
def flexid(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> Callable[..., Outcome]:
    """Return a function that runs ``flexid`` with arguments, as from a shell."""

    def run(*arguments: object) -> Outcome:
        monkeypatch.setattr(sys, "argv", ["flexid", *map(str, arguments)])
        status = 0
        try:
            main()
        except SystemExit as stopped:
            status = int(stopped.code or 0)
        captured = capsys.readouterr()
        return Outcome(status, captured.out, captured.err)

    return run
