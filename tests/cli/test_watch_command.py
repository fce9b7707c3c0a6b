"""``flexid watch`` as a process: reports, damaged logs, Ctrl-C."""

import json
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import polars as pl

from flexid.streaming import incoming

LOG = Path("examples/flexible_joint.csv")
PAPER = ("--terms", "gravity,motor_viscous", "--hold", "linear")


def command(*arguments: str) -> list[str]:
    """Return the command line."""
    return [sys.executable, "-m", "flexid", "watch", *arguments]


def run(*arguments: str, text: str = "") -> subprocess.CompletedProcess[str]:
    """Run the command to its end."""
    return subprocess.run(command(*arguments), capture_output=True, text=True, input=text)


def test_a_log_is_watched_to_its_end(tmp_path: Path):
    """Assert that the last report covers the example's true values, with status 0."""
    out = tmp_path / "out"
    done = run(str(LOG), "--stop-at-end", "--json", "--out", str(out), *PAPER)
    assert (done.returncode, done.stderr) == (0, "")
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
    with subprocess.Popen(
        command(str(growing), "--json", *PAPER),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
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
    done = run("-", *PAPER, text="\n".join([header, *rows]))
    assert done.returncode == 1
    assert done.stdout.startswith("not excited: ")
