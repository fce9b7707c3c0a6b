"""``flexid watch`` as a process: reports, checkpoints, Ctrl-C."""

import json
import signal
import subprocess
import sys
from pathlib import Path

import polars as pl
import pytest

from flexid.cli import live
from flexid.errors import SettingError
from flexid.streaming import checkpoint, incoming
from flexid.streaming.session import Session

LOG = Path("examples/flexible_joint.csv")
PAPER = ("--terms", "gravity,motor_viscous", "--hold", "linear")


def command(*arguments: str) -> list[str]:
    """A command line."""
    return [sys.executable, "-m", "flexid", "watch", *arguments]


def run(*arguments: str, text: str = "") -> subprocess.CompletedProcess[str]:
    """Run it to its end."""
    return subprocess.run(command(*arguments), capture_output=True, text=True, input=text)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """The reports of the example when it is watched to its end, as they were printed."""
    out = tmp_path_factory.mktemp("whole") / "out"
    done = run(str(LOG), "--stop-at-end", "--json", "--out", str(out), *PAPER)
    assert (done.returncode, done.stderr) == (0, "")
    reports = done.stdout.splitlines()
    assert json.loads((out / "watch.json").read_text()) == json.loads(reports[-1])
    return reports


def test_a_log_is_watched_to_its_end(whole: list[str]):
    """Assert that the last report holds the truth that made the example, and exits with 0."""
    reports = [json.loads(line) for line in whole]
    assert len(reports) == 31  # one a second, and the last
    assert reports[0]["health"] == "converging"
    assert reports[-1]["health"] == "converged"
    low, high = reports[-1]["parameters"]["joint_stiffness"]["interval"]
    assert low < 100.0 < high < low + 1.0
    assert reports[-1]["samples"]["taken"] == 30000


def test_a_stream_is_resumed(tmp_path: Path, whole: list[str]):
    """Assert that two halves with a checkpoint between them end as the whole log does."""
    header, *rows = LOG.read_text().splitlines()
    checkpoint = ("--checkpoint", str(tmp_path / "state.json"), "--json", *PAPER)
    run("-", *checkpoint, text="\n".join([header, *rows[:12345], ""]))
    ended = run("-", *checkpoint, text="\n".join([header, *rows[12345:], ""]))
    assert json.loads(ended.stdout.splitlines()[-1]) == json.loads(whole[-1])


def test_a_file_goes_on_where_it_was_left(tmp_path: Path, whole: list[str]):
    """Assert that the same command, when the file has grown, learns from what is new alone."""
    growing = tmp_path / "log.csv"
    again = (str(growing), "--stop-at-end", "--json", *PAPER)
    again += ("--checkpoint", str(tmp_path / "state.json"))
    lines = LOG.read_text().splitlines(keepends=True)
    for count in (12345, 12345, len(lines)):
        growing.write_text("".join(lines[:count]))
        ended = run(*again)
        assert json.loads(ended.stdout.splitlines()[-1])["samples"]["taken"] == count - 1
    assert json.loads(ended.stdout.splitlines()[-1]) == json.loads(whole[-1])


def test_a_checkpoint_that_cannot_be_written_is_refused_at_once(tmp_path: Path):
    """Assert that a folder that is not there is named before anything is learnt."""
    done = run(str(LOG), "--stop-at-end", "--checkpoint", str(tmp_path / "no" / "state.json"))
    assert (done.returncode, done.stdout) == (2, "")
    assert "cannot be written: make the folder" in done.stderr


def test_a_checkpoint_that_cannot_be_written_costs_no_report(
    tmp_path: Path, flexid, monkeypatch: pytest.MonkeyPatch
):
    """Assert that a disk that is full is warned of meanwhile, and at its end the report comes."""
    (tmp_path / "log.csv").write_text("".join(LOG.read_text().splitlines(keepends=True)[:3001]))

    def full(_session: Session, path: Path) -> None:
        raise SettingError("checkpoint", f"{path} cannot be written (No space left on device)")

    monkeypatch.setattr(checkpoint, "save_session", full)
    monkeypatch.setattr(live, "_SAVED_EVERY", -1.0)
    watched = ("watch", tmp_path / "log.csv", "--stop-at-end", "--checkpoint", tmp_path / "state")
    outcome = flexid(*watched, *PAPER)
    assert outcome.status == 2
    assert "Samples: 3000 of 3000 learnt from" in outcome.stdout
    assert "warning: checkpoint" in outcome.stderr
    assert "flexid: --checkpoint" in outcome.stderr


def test_a_log_that_is_damaged_in_the_middle(
    tmp_path: Path, flexid, monkeypatch: pytest.MonkeyPatch
):
    """Assert that what was learnt before is reported and saved, and then the place is said."""
    log, state = tmp_path / "log.parquet", tmp_path / "state.json"
    pl.read_csv(LOG).write_parquet(log, row_group_size=1000)
    raw = bytearray(log.read_bytes())
    place = 2 * len(raw) // 3
    raw[place : place + 5000] = b"\xff" * 5000  # more than a page
    log.write_bytes(raw)
    monkeypatch.setattr(incoming, "BLOCK", 1000)
    outcome = flexid("watch", log, "--stop-at-end", "--json", "--checkpoint", state, *PAPER)
    assert outcome.status == 2
    assert "the file cannot be read on from there" in outcome.stderr
    taken = json.loads(outcome.stdout.splitlines()[-1])["samples"]["taken"]
    assert 1000 <= taken < 30000
    assert json.loads(state.read_text())["content"]["fed"] == taken


def test_ctrl_c_leaves_a_checkpoint_and_a_report(tmp_path: Path):
    """Assert that an interrupted watch saves what it knows, reports it, and exits with 3."""
    growing, checkpoint = tmp_path / "log.csv", tmp_path / "state.json"
    growing.write_text("\n".join(LOG.read_text().splitlines()[:5001]) + "\n")
    arguments = (str(growing), "--checkpoint", str(checkpoint), "--json", *PAPER)
    with subprocess.Popen(
        command(*arguments), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
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
    assert json.loads(checkpoint.read_text())["content"]["fed"] == 5000


def test_a_drive_that_does_not_move_exits_with_1():
    """Assert that an estimate that has not converged is not called done."""
    rows = (f"{k / 1000},{1e-4 * (k % 3)},{1e-4 * (k % 2)},{0.1}" for k in range(3000))
    header = "time [s],link_position [rad],motor_position [rad],motor_torque [N m]"
    done = run("-", *PAPER, text="\n".join([header, *rows]))
    assert done.returncode == 1
    assert done.stdout.startswith("not excited: ")
