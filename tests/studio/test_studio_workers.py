"""Worker processes of the studio, and many windows at once."""

import asyncio
import os
import sys
import time
from pathlib import Path

import pytest
from benchmarks.studio import load

from flexid.errors import SettingError
from flexid.studio.jobs import JobError, Workers


def echo(text: str) -> tuple[str, str, int]:
    """Return a text, with the folder and the process."""
    return text, os.getcwd(), os.getpid()


def sleep() -> None:
    """Sleep very long, and leave a mark in the folder."""
    Path("asleep").touch()
    time.sleep(600)


def fail() -> None:
    """Fail with bad input."""
    raise SettingError("port", "is none")


def stumble() -> None:
    """Fail with a defect."""
    raise KeyError("oh")


def die() -> None:
    """End the process."""
    os._exit(1)


pytestmark = pytest.mark.anyio


async def test_a_job_is_done_in_its_folder(tmp_path: Path):
    """Assert that a job's answer is returned, and that one process runs several jobs."""
    workers = Workers(1)
    first = await workers.run(echo, "a", folder=tmp_path)
    second = await workers.run(echo, "b", folder=tmp_path)
    assert first == ("a", str(tmp_path), second[2])
    assert first[2] != os.getpid()


async def test_a_cancelled_job_makes_room(tmp_path: Path):
    """Assert that jobs wait for a free process, and that cancelling frees one."""
    workers = Workers(1)
    long = asyncio.create_task(workers.run(sleep, folder=tmp_path))
    while not (tmp_path / "asleep").exists():
        await asyncio.sleep(0.01)
    gone = asyncio.create_task(workers.run(echo, "a", folder=tmp_path))
    waiting = asyncio.create_task(workers.run(echo, "b", folder=tmp_path))
    await asyncio.sleep(0.1)
    assert not waiting.done()
    gone.cancel()
    await asyncio.sleep(0)
    long.cancel()
    assert (await waiting)[0] == "b"


async def test_what_fails_is_said_and_work_goes_on(tmp_path: Path):
    """Assert that bad input, a defect, a process's end or a lost folder stops no other job."""
    workers = Workers(1)
    for job, kind, words in (
        (fail, SettingError, "port"),
        (stumble, JobError, "defect"),
        (die, JobError, "ended early"),
    ):
        with pytest.raises(kind, match=words):
            await workers.run(job, folder=tmp_path)
    assert (await workers.run(echo, "a", folder=tmp_path))[0] == "a"
    workers = Workers(1)
    with pytest.raises(JobError, match="folder of the log cannot be entered"):
        await workers.run(echo, "a", folder=tmp_path / "gone")
    assert (await workers.run(echo, "a", folder=tmp_path))[0] == "a"


@pytest.mark.thorough
@pytest.mark.skipif(sys.platform != "linux", reason="memory is read from /proc")
def test_twenty_windows_stay_within_two_gigabytes():
    """Assert that twenty logs are checked, and some identified, within two gigabytes."""
    assert load(20, 2).peak_memory < 2e9
