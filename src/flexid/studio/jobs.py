"""Long jobs in worker processes: compiled code can be cancelled only with its process."""

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
    """A job failed."""

    reason: str
    _text = "{reason}"


class Workers:
    """Worker processes of AnyIO, shared by all windows; jobs wait in one queue."""

    def __init__(self, most: int) -> None:
        self._free = asyncio.Semaphore(most)  # first come, first served

    async def run(self, job: Callable[..., Any], *arguments: Any, folder: Path) -> Any:
        """Run a job and return its result; cancelling the coroutine cancels the job."""
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
    """Run a job in a folder; raise a `JobError` for any unexpected error."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the studio handles Ctrl-C and ends this process
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
        raise JobError("there is not enough memory: give a shorter log") from None
    except Exception as error:  # an unforeseen error must not end the process
        raise JobError(f"a defect of flexid ({type(error).__name__}: {error})") from None


ESTIMATE = "estimate.json"
REPORT = "report.html"


@dataclass(frozen=True)
class Checked:
    """Result of a log's check."""

    model: str  # the richest model that can be identified: "flexible", "link" or "rigid"
    facts: dict[str, str]  # duration, rate, numbers of samples and gaps
    warnings: tuple[str, ...]  # corrections and suspicious features of the log
    figure: str  # the log's channels over time, as HTML
    kinds_of: dict[str, str]  # by term, the kinds of joint that have it


def look(name: str) -> FileOverview:
    """Return an overview of a file: its columns and the channels by their names."""
    from flexid.recording.series import overview

    return overview(Path(name))


def check(name: str, choices: Choices) -> Checked:
    """Read a log as for an identification, and return its check."""
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
    """Write a log's estimate and report into a folder; return the log's sample time in s."""
    from flexid.library.identify import identify as run
    from flexid.recording.read import read_log

    log = read_log(Path(name), choices.column_map)
    estimate = run(log, **choices.settings)
    estimate.save(Path(into) / ESTIMATE)
    estimate.report(Path(into) / REPORT)
    return log.recordings[0].sample_time


def export(to: str, sample_time: float, folder: str) -> tuple[str, tuple[str, ...]]:
    """Write an estimate for another tool as an archive; return its name and any warnings."""
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
