"""Work that takes long, in processes of its own: compiled code ends only with its process."""

from __future__ import annotations

import asyncio
import os
import signal
import tempfile
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

from anyio import BrokenWorkerProcess, CapacityLimiter, to_process

from flexid.errors import FlexidError

if TYPE_CHECKING:
    from flexid.recording.series import FileOverview
    from flexid.studio.choices import Choices


@dataclass(eq=False, repr=False)
class JobError(FlexidError):
    """A job did not end as it should."""

    reason: str
    _text = "{reason}"


class Workers:
    """Some of AnyIO's processes, shared by all windows; jobs wait in one queue."""

    def __init__(self, most: int) -> None:
        self._free = asyncio.Semaphore(most)  # lets in one after the other

    async def run(self, job: Callable[..., Any], *arguments: Any, folder: Path) -> Any:
        """Do a job and return what it returns; cancel the coroutine to cancel the job."""
        async with self._free:
            try:
                return await to_process.run_sync(
                    _do, job, arguments, str(folder), cancellable=True, limiter=CapacityLimiter(1)
                )
            except BrokenWorkerProcess:
                raise JobError(
                    "the work ended early, perhaps for lack of memory: close other windows, or "
                    "give a shorter log"
                ) from None


def _do(job: Callable[..., Any], arguments: tuple[Any, ...], folder: str) -> Any:
    """Do a job in a folder."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the studio, which ends us
    try:
        os.chdir(folder)
    except OSError as error:
        raise JobError(
            f"the folder of the log cannot be entered ({error.strerror}): choose the log again"
        ) from None
    try:
        return job(*arguments)
    except FlexidError:
        raise
    except MemoryError:
        raise JobError("the memory does not suffice: give a shorter log") from None
    except Exception as error:  # an error that nobody foresaw must not end the process
        raise JobError(f"a defect of flexid ({type(error).__name__}: {error})") from None


ESTIMATE = "estimate.json"
REPORT = "report.html"


@dataclass(frozen=True)
class Checked:
    """A log, read and looked at."""

    model: str  # "flexible", "link" or "rigid": what can be identified of it
    facts: dict[str, str]  # what it shows at a glance
    warnings: tuple[str, ...]  # what was mended, or looks odd
    figure: str  # its channels over time, as HTML
    kinds_of: dict[str, str]  # by term, the kinds of joint that have it


def look(name: str) -> FileOverview:
    """Say what a file holds."""
    from flexid.recording.series import overview

    return overview(Path(name))


def check(name: str, choices: Choices) -> Checked:
    """Read a log as it would be identified, and say what it shows."""
    from flexid.identification.preparation.joint import Kind, joint_of
    from flexid.recording.read import read_log
    from flexid.report.response_charts import log_chart
    from flexid.studio.choices import ALL_TERMS
    from flexid.studio.window import fragment

    log = read_log(Path(name), choices.column_map)
    kinds_of = {
        term: " ".join(
            kind for kind in get_args(Kind) if term in joint_of(kind, log.recordings[0].joint).terms
        )
        for term in ALL_TERMS
    }
    figure = fragment("figure.html", chart=log_chart(log))
    longest, samples = max(log.recordings, key=len), sum(map(len, log.recordings))
    model = "link" if longest.input is None else "flexible"
    facts = {
        "Duration": f"{samples * longest.sample_time:.4g} s",
        "Rate": f"{1.0 / longest.sample_time:.4g} Hz",
        "Samples": str(samples),
        "Gaps": str(len(log.recordings) - 1),
    }
    return Checked(
        "rigid" if longest.link_position is None else model, facts, log.warnings, figure, kinds_of
    )


def identify(name: str, choices: Choices, into: str) -> float:
    """Leave estimate and report of a log in a folder; return the log's sample time in s."""
    from flexid.library.identify import identify as run
    from flexid.recording.read import read_log

    log = read_log(Path(name), choices.column_map)
    estimate = run(log, **choices.settings)
    estimate.save(Path(into) / ESTIMATE)
    estimate.report(Path(into) / REPORT)
    return log.recordings[0].sample_time


def export(to: str, sample_time: float, folder: str) -> tuple[str, tuple[str, ...]]:
    """Write an estimate for another tool, as an archive; return its name, and what it lacks."""
    from flexid.library.export import export as write

    place = Path(folder)
    options = {"sample_time": sample_time} if to == "c99" else {}
    with tempfile.TemporaryDirectory(dir=place) as made:
        written = write(place / ESTIMATE, to=to, out=made, **options)  # type: ignore[arg-type] - one of EXPORTS
        archive = place / f"{to}.zip"
        with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as file:
            for path in written.paths:
                file.write(path, path.name)
    return archive.name, written.warnings
