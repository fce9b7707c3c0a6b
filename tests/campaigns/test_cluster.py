"""A campaign on a real Dask cluster with a scheduler and two workers, one of which is killed."""

import os
import signal
import socket
import subprocess
import sys
import time
from contextlib import contextmanager

import pytest
from tests.campaigns.tiny import EXPERIMENT, rows_of, same_bits, write_experiment

from flexid.errors import CampaignError, SettingError
from flexid.experiments import campaign_runner as runner
from flexid.experiments.campaign_runner import run_campaign
from flexid.experiments.experiment import read_experiment

pytest.importorskip("distributed", reason="the package distributed is not installed")

CAMPAIGN = """
[campaign]
kind = "latin-hypercube"
runs = 60
runs_per_part = 2
vary.controller.proportional = { uniform = [10.0, 50.0] }
"""

OTHER_VERSION = "import flexid; flexid.__version__ = '0.0'; from dask.__main__ import main; main()"


def start(*arguments, code="from dask.__main__ import main; main()"):
    """Start a process of the cluster."""
    return subprocess.Popen(
        [sys.executable, "-c", code, *map(str, arguments)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        # A connection to the killed worker is tried for 30 s by default
        env=os.environ | {"DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT": "3s"},
    )


def wait_for_workers(address, count):
    """Wait until this number of workers is connected."""
    from distributed import Client

    with Client(address, timeout=60, set_as_default=False) as client:
        if count:
            client.wait_for_workers(count, timeout=120)


@contextmanager
def workers(address, *names, **code):
    """Run workers with one thread, which are not restarted."""
    options = ("--no-nanny", "--nthreads", 1, "--no-dashboard", "--name")
    started = [start("worker", address, *options, name, **code) for name in names]
    try:
        wait_for_workers(address, len(names))
        yield started
    finally:
        for worker in started:
            worker.kill()
            worker.wait(60)


@pytest.fixture(scope="module")
def scheduler():
    """Return the address of a scheduler on the loopback."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    process = start("scheduler", "--host", "127.0.0.1", "--port", port, "--no-dashboard")
    address = f"tcp://127.0.0.1:{port}"
    try:
        wait_for_workers(address, 0)
        yield address
    finally:
        process.kill()
        process.wait(60)


@pytest.fixture
def experiment(tmp_path):
    """Return a campaign that takes a second or two."""
    text = EXPERIMENT.replace("duration = 0.1", "duration = 30.0")
    return read_experiment(write_experiment(tmp_path / "tiny.toml", CAMPAIGN, text))


def test_a_killed_worker_changes_no_bit(scheduler, experiment, tmp_path):
    """Assert that two workers, one of them killed in between, give the rows of this machine."""
    with workers(scheduler, "one", "two") as (one, other):
        kept = []

        def killing(done, _):
            kept.append(done)
            if len(kept) == 2:
                one.send_signal(signal.SIGKILL)

        run_campaign(experiment, tmp_path / "cluster", scheduler=scheduler, progress=killing)
        assert one.wait(60) == -signal.SIGKILL
        assert other.poll() is None
    assert rows_of(tmp_path / "cluster")["status"].to_list() == ["finished"] * 60
    assert kept == list(range(0, 61, 2))
    run_campaign(experiment, tmp_path / "here")
    assert same_bits(rows_of(tmp_path / "cluster"), rows_of(tmp_path / "here"))


def test_a_scheduler_without_workers_is_one_sentence(scheduler, experiment, tmp_path):
    """Assert that a scheduler without workers is refused with the command that starts one."""
    deadline = time.monotonic() + 60
    while True:  # workers of an earlier test may take a moment to end
        with pytest.raises(CampaignError) as refused:
            run_campaign(experiment, tmp_path / "out", scheduler=scheduler)
        if "has no workers" in str(refused.value) or time.monotonic() > deadline:
            break
    assert str(refused.value) == (
        f"{scheduler} has no workers: start them with `dask worker {scheduler}`"
    )


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "tcp://127.0.0.1", "http://x", "", "::"])
def test_a_scheduler_that_is_not_there_is_one_sentence(experiment, tmp_path, monkeypatch, address):
    """Assert that an address without a scheduler gives one sentence instead of a traceback."""
    monkeypatch.setattr(runner, "_TIMEOUT", 1.0)
    with pytest.raises(CampaignError, match="cannot be reached"):
        run_campaign(experiment, tmp_path / "out", scheduler=address)


def test_workers_and_packages_that_do_not_fit(scheduler, experiment, tmp_path, monkeypatch):
    """Assert that other versions are refused by worker, and a missing package by its command."""
    with (
        workers(scheduler, "other", code=OTHER_VERSION),
        pytest.raises(CampaignError, match=r"does not have flexid .*: install the same version"),
    ):
        run_campaign(experiment, tmp_path / "out", scheduler=scheduler)
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(SettingError, match=r"pip install 'flexid\[dask\]'"):
        run_campaign(experiment, tmp_path / "out", scheduler="tcp://127.0.0.1:8786")
    assert os.listdir(tmp_path / "out" / "runs") == []
