"""Run the command line in this process, as a shell would."""

import sys
from collections.abc import Callable
from dataclasses import dataclass

import pytest

from flexid.cli.main import main


@dataclass(frozen=True)
class Outcome:
    """Exit status and what was printed."""

    status: int
    stdout: str
    stderr: str


@pytest.fixture
def flexid(capsys, monkeypatch) -> Callable[..., Outcome]:
    """Return a function that runs ``flexid`` with arguments."""

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
