"""Campaigns that are interrupted, resumed and shared between workers end with the same bits."""

import os
import signal
import subprocess
import sys
import time

import pytest
from tests.campaigns.tiny import EXPERIMENT, rows_of, same_bits, write_experiment

from flexid.campaigns import run_campaign
from flexid.errors import CampaignError
from flexid.experiments import read_experiment

KILLED = """
import os, signal, sys
from flexid import files
from flexid.campaigns import run_campaign
from flexid.experiments import read_experiment

replace, count = os.replace, 0

def killing(*names):
    global count
    count += str(names[1]).endswith(".parquet")
    if count == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    replace(*names)

files.os.replace = killing
run_campaign(read_experiment(sys.argv[1]), sys.argv[2])
"""


@pytest.fixture(scope="module")
def experiment(tmp_path_factory):
    """The tiny campaign."""
    return read_experiment(write_experiment(tmp_path_factory.mktemp("file") / "tiny.toml"))


@pytest.fixture(scope="module")
def whole(experiment, tmp_path_factory):
    """Rows of the campaign run at once, on one thread."""
    out = tmp_path_factory.mktemp("whole") / "out"
    run_campaign(experiment, out, workers=1)
    rows = rows_of(out)
    assert rows["status"].to_list() == ["finished"] * 12
    return rows


def test_the_number_of_workers_changes_no_bit(experiment, whole, tmp_path):
    """Assert that three threads leave the rows of one."""
    run_campaign(experiment, tmp_path, workers=3)
    assert same_bits(rows_of(tmp_path), whole)


def test_threads_of_a_new_process_load_the_kernel_once(experiment, whole, tmp_path):
    """Assert that four threads that start together, with nothing loaded, leave the same rows."""
    code = "from flexid.cli.main import main; main()"
    command = [sys.executable, "-c", code, "campaign", experiment.path, "--out", str(tmp_path)]
    subprocess.run([*command, "--workers", "4"], check=True, timeout=300)
    assert same_bits(rows_of(tmp_path), whole)


def test_the_part_size_changes_no_bit(whole, tmp_path):
    """Assert that parts of five leave the rows of parts of three."""
    path = write_experiment(tmp_path / "tiny.toml")
    path.write_text(path.read_text().replace("runs_per_part = 3", "runs_per_part = 5"))
    run_campaign(read_experiment(path), tmp_path / "out")
    assert len(list(tmp_path.glob("out/runs/*.parquet"))) == 3
    assert same_bits(rows_of(tmp_path / "out"), whole)


def test_kill_9_loses_the_part_at_hand_alone(experiment, whole, tmp_path):
    """Assert that a campaign killed while it writes its third part goes on from the second."""
    out = tmp_path / "out"
    killed = subprocess.run([sys.executable, "-c", KILLED, experiment.path, str(out)], timeout=300)
    assert killed.returncode == -signal.SIGKILL
    assert len(list(out.glob("runs/part-*.parquet"))) == 2
    kept = []
    run_campaign(experiment, out, progress=lambda done, _: kept.append(done))
    assert kept == [6, 9, 12]
    assert same_bits(rows_of(out), whole)


def test_another_experiment_finds_the_directory_taken(experiment, tmp_path):
    """Assert that a changed gain in the file is another campaign, a changed title is not."""
    run_campaign(experiment, tmp_path / "out")
    text = EXPERIMENT.replace("derivative = 10.0", "derivative = 11.0")
    path = write_experiment(tmp_path / "other.toml", experiment=text)
    with pytest.raises(CampaignError, match="another experiment"):
        run_campaign(read_experiment(path), tmp_path / "out")
    path = write_experiment(tmp_path / "title.toml", experiment='name = "A title"\n' + EXPERIMENT)
    run_campaign(read_experiment(path), tmp_path / "out")


def test_control_c_keeps_what_is_done(tmp_path):
    """Assert that an interrupt exits 130 with one sentence that counts the parts kept."""
    text = EXPERIMENT.replace("duration = 0.1", "duration = 60.0")
    campaign = "[campaign]\nkind = 'latin-hypercube'\nruns = 2000\nruns_per_part = 2\n"
    campaign += "vary.observer.link = { uniform = [1.0, 2.0] }\n"
    path, out = write_experiment(tmp_path / "slow.toml", campaign, text), tmp_path / "out"
    command = [sys.executable, "-c", "from flexid.cli.main import main; main()"]
    process = subprocess.Popen(
        [*command, "campaign", str(path), "--out", str(out)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    while process.poll() is None and not list(out.glob("runs/part-*")):
        time.sleep(0.02)
    os.kill(process.pid, signal.SIGINT)
    stdout, stderr = process.communicate(timeout=120)
    done = 2 * len(list(out.glob("runs/part-*")))
    assert (process.returncode, stdout) == (3, "")
    assert stderr.splitlines() == [
        f"flexid: interrupted: {done} of 2000 runs are kept in {out}; the same command goes on"
    ]
    assert 0 < done < 2000
