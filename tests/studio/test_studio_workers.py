"""Processes that work for windows."""

from __future__ import annotations

import asyncio
import os
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from flexid.errors import SettingError
from flexid.studio.jobs import JobError, Workers

Said = Callable[[str], None]


def echo(said: Said, text: str) -> tuple[str, str, int]:
    """Say a text and return it, with the folder and the process."""
    said(text)
    return text, os.getcwd(), os.getpid()


def sleep(said: Said) -> None:
    """Take very long."""
    said("asleep")
    time.sleep(600)


def fail(_: Said) -> None:
    """Find bad input."""
    raise SettingError("port", "is none")


def stumble(_: Said) -> None:
    """Have a defect."""
    raise KeyError("oh")


def die(_: Said) -> None:
    """End the process."""
    os._exit(1)


pytestmark = pytest.mark.anyio


async def test_a_job_is_done_in_its_folder(tmp_path: Path):
    """Assert that a job's answer and progress come back, and one process does several."""
    said: list[str] = []
    workers = Workers(1)
    first = await workers.run(echo, "a", folder=tmp_path, said=said.append)
    second = await workers.run(echo, "b", folder=tmp_path, said=said.append)
    assert first == ("a", str(tmp_path), second[2])
    assert said == ["a", "b"]
    assert first[2] != os.getpid()


async def test_what_fails_is_said_and_work_goes_on(tmp_path: Path):
    """Assert that neither bad input, nor a defect, nor the end of a process stops the others."""
    workers = Workers(1)
    for job, kind, words in (
        (fail, SettingError, "port"),
        (stumble, JobError, "defect"),
        (die, JobError, "ended early"),
    ):
        with pytest.raises(kind, match=words):
            await workers.run(job, folder=tmp_path, said=print)
    assert (await workers.run(echo, "a", folder=tmp_path, said=print))[0] == "a"


async def test_a_cancelled_job_makes_room(tmp_path: Path):
    """Assert that others wait, are told so, and that cancelling lets them in."""
    asleep = asyncio.Event()
    said: list[str] = []
    workers = Workers(1)
    long = asyncio.create_task(workers.run(sleep, folder=tmp_path, said=lambda _: asleep.set()))
    await asleep.wait()
    gone = asyncio.create_task(workers.run(echo, "a", folder=tmp_path, said=print))
    waiting = asyncio.create_task(workers.run(echo, "b", folder=tmp_path, said=said.append))
    await asyncio.sleep(0)
    await asyncio.sleep(0)
    gone.cancel()
    await asyncio.sleep(0)
    long.cancel()
    assert (await waiting)[0] == "b"
    assert said == ["waiting for a free process", "b"]


async def test_a_folder_that_is_gone_is_said(tmp_path: Path):
    """Assert that a log's folder that was deleted ends neither the process nor the wait."""
    workers = Workers(1)
    with pytest.raises(JobError, match="folder of the log cannot be entered"):
        await workers.run(echo, "a", folder=tmp_path / "gone", said=print)
    assert (await workers.run(echo, "a", folder=tmp_path, said=print))[0] == "a"
