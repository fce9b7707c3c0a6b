"""Exit status of commands, files left after failures, and ``flexid watch`` as a process."""

import json
import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import polars as pl
import pytest

from flexid.cli.generated import ExitStatus
from flexid.cli.main import _INTERRUPTED
from flexid.errors import ConvergenceError
from flexid.streaming import incoming

RUN = "from flexid.cli.main import main; main()"
LOG = Path("examples/flexible_joint.csv")
PAPER = ("--terms", "gravity,motor_viscous", "--hold", "linear")


def start(*arguments, code=RUN, **keywords) -> Any:
    """Start the command in its own process."""
    return subprocess.Popen(
        [sys.executable, "-c", code, *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        **keywords,
    )


@pytest.mark.parametrize(
    ("verdict", "is_strict", "status"),
    [("determined", True, 0), ("weak", False, 0), ("weak", True, 1), ("undetermined", False, 1)],
)
def test_the_worst_verdict_decides(
    flexid, monkeypatch, examples, example_estimate, verdict, is_strict, status
):
    """Assert that a weak parameter counts with --strict only, and an undetermined one always."""
    from flexid.identification import identify as module

    found = example_estimate.result
    stiffness = replace(found.parameters["joint_stiffness"], verdict=verdict)
    judged = replace(found, parameters={**found.parameters, "joint_stiffness": stiffness})
    monkeypatch.setattr(module, "identify", lambda *_: judged)
    options = ("--strict",) if is_strict else ()
    assert flexid("identify", examples / "flexible_joint.csv", *options).status == status


@pytest.mark.parametrize(
    ("error", "options", "status", "begins", "ends"),
    [
        (ConvergenceError("a fit", "check it"), (), 1, "flexid: a fit: check it\n", "check it"),
        # An unexpected error has a paragraph on how to see its traceback.
        (KeyError("oh"), (), 70, "flexid: ", "flexid --debug identify"),
        (KeyError("oh"), ("--debug",), 70, "Traceback", "KeyError: 'oh'"),
    ],
)
def test_what_fails_is_the_datas_or_a_defect(
    flexid, monkeypatch, examples, error, options, status, begins, ends
):
    """Assert that an unsuitable log exits with 1 and one sentence, and a defect with 70."""
    from flexid.identification import identify as module

    def fail(*_):
        raise error

    monkeypatch.setattr(module, "identify", fail)
    outcome = flexid(*options, "identify", examples / "flexible_joint.csv")
    assert outcome.status == status
    assert outcome.stderr.startswith(begins)
    assert ends in " ".join(outcome.stderr.split())
    assert ("Traceback" in outcome.stderr) == bool(options)


def test_the_status_of_an_interruption_is_one():
    """Assert that the status of an early interruption equals that of a later one."""
    assert ExitStatus.INTERRUPTED == _INTERRUPTED


SLOW = """
import os
import signal
import sys
import time
signal.signal(signal.SIGHUP, signal.SIG_DFL)  # the tests may run under nohup
import flexid.studies.reproduction as module
def reproduce(finished):
    print([name[:8] for name in os.listdir(sys.argv[-1])], flush=True)
    time.sleep(60.0)
module.reproduce = reproduce
from flexid.cli.main import main
main()
"""


@pytest.mark.skipif(os.name != "posix", reason="signals")
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_an_interruption_leaves_nothing_behind(tmp_path: Path, name: str):
    """Assert that Ctrl-C, SIGTERM and SIGHUP exit with 3 and a message, without partial files."""
    out = tmp_path / "results"
    out.mkdir()
    process = start("reproduce", "--out", out, code=SLOW)
    assert process.stdout.readline() == "['.flexid-']\n"
    process.send_signal(signal.Signals[name])
    _, said = process.communicate(timeout=60)
    assert process.returncode == 3
    assert said.splitlines()[-1] == "flexid: interrupted; no half-written file is left"
    assert list(out.iterdir()) == []


EARLY = """
import os, signal, sys, threading
from flexid.cli import main as module
class Finder:
    def find_spec(self, name, path=None, target=None):
        if name == sys.argv[-1]:
            signal.raise_signal(signal.SIGINT)
sys.meta_path.insert(0, Finder())
sys.argv[1:] = ["--help", sys.argv[-1]]
module.main()
"""


@pytest.mark.skipif(os.name != "posix", reason="signals")
@pytest.mark.parametrize("loading", ["flexid.cli.commands", "click", "click.core", "flexid.errors"])
def test_an_interruption_while_the_commands_are_loaded(loading: str):
    """Assert that Ctrl-C during start-up is handled like a later one."""
    process = start(loading, code=EARLY)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 3, said
    assert said.splitlines() == ["flexid: interrupted; no half-written file is left"]


@pytest.mark.skipif(os.name != "posix", reason="pipes that close")
def test_a_reader_that_has_seen_enough_is_no_error():
    """Assert that the exit status is unchanged if the reader closes the pipe."""
    run = ("simulate", "experiments/huang2003.toml", "--set", "run.duration=1")
    with start(*run) as process:
        process.stdout.close()
        said = process.stderr.read()
    lines = [line for line in said.splitlines() if not line.startswith("Compiling")]  # printed once
    assert lines == []
    assert process.returncode == 0


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_nohup_is_respected():
    """Assert that a command that ignores SIGHUP continues without its terminal."""
    code = (
        "import signal; signal.signal(signal.SIGHUP, signal.SIG_IGN)\n"
        "from flexid.cli import commands, main\n"
        "commands.run = lambda: signal.raise_signal(signal.SIGHUP) or 0\n"
        "main.main()"
    )
    process = start(code=code)
    assert process.communicate(timeout=60) == ("", "")
    assert process.returncode == 0


def test_a_log_is_watched_to_its_end(flexid, tmp_path: Path):
    """Assert that the last report covers the example's true values, with status 0."""
    out = tmp_path / "out"
    done = flexid("watch", LOG, "--stop-at-end", "--json", "--out", out, *PAPER)
    assert (done.status, done.stderr) == (0, "")
    reports = [json.loads(line) for line in done.stdout.splitlines()]
    assert json.loads((out / "watch.json").read_text()) == reports[-1]
    assert len(reports) == 31  # one per second, and the last
    assert reports[0]["health"] == "converging"
    assert reports[-1]["health"] == "converged"
    low, high = reports[-1]["parameters"]["joint_stiffness"]["interval"]
    assert low < 100.0 < high < low + 1.0
    assert reports[-1]["samples"]["taken"] == 30000


def test_a_log_that_is_damaged_in_the_middle(tmp_path: Path, flexid, monkeypatch: Any):
    """Assert that a damaged log is reported up to the damage, and then refused with the place."""
    log = tmp_path / "log.parquet"
    pl.read_csv(LOG).write_parquet(log, row_group_size=1000)
    raw = bytearray(log.read_bytes())
    place = 2 * len(raw) // 3
    raw[place : place + 5000] = b"\xff" * 5000  # longer than a page
    log.write_bytes(raw)
    monkeypatch.setattr(incoming, "BLOCK", 1000)
    outcome = flexid("watch", log, "--stop-at-end", "--json", *PAPER)
    assert outcome.status == 2
    assert "the file cannot be read further" in outcome.stderr
    taken = json.loads(outcome.stdout.splitlines()[-1])["samples"]["taken"]
    assert 1000 <= taken < 30000


def test_ctrl_c_leaves_a_report(tmp_path: Path):
    """Assert that an interrupted watch reports its estimate, and exits with 3."""
    growing = tmp_path / "log.csv"
    growing.write_text("\n".join(LOG.read_text().splitlines()[:5001]) + "\n")
    with start("watch", growing, "--json", *PAPER) as process:
        reports = [json.loads(process.stdout.readline()) for _ in range(5)]
        process.send_signal(signal.SIGINT)
        printed, said = process.communicate()
    assert process.returncode == 3
    assert "interrupted" in said
    (last,) = (json.loads(line) for line in printed.splitlines())
    assert last == reports[-1]
    assert last["samples"]["taken"] == 5000


def test_a_drive_that_does_not_move_exits_with_1():
    """Assert that an estimate that has not converged exits with 1."""
    rows = (f"{k / 1000},{1e-4 * (k % 3)},{1e-4 * (k % 2)},{0.1}" for k in range(3000))
    header = "time [s],link_position [rad],motor_position [rad],motor_torque [N m]"
    with start("watch", "-", *PAPER, stdin=subprocess.PIPE) as process:
        printed, _ = process.communicate("\n".join([header, *rows]))
    assert process.returncode == 1
    assert printed.startswith("not excited: ")
