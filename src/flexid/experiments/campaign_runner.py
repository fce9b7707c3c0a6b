"""A campaign, run on threads of this machine or on a Dask cluster, part by part."""

import gc
import logging
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import polars as pl

import flexid
from flexid.errors import CampaignError, ExperimentError, SettingError
from flexid.estimators.segments import cores
from flexid.experiments import Experiment
from flexid.experiments.campaign_rows import part_rows
from flexid.experiments.campaign_store import Manifest, Store, open_store
from flexid.experiments.variation import Plan, Variation, make_plan
from flexid.simulation.closed_loop import SIDE_BY_SIDE

if TYPE_CHECKING:
    from distributed import Client


_PARTS = 200
_MOST_RUNS = 500

Part = tuple[int, pl.DataFrame]
"""The number of a part, and of each of its runs the values from the plan, or what came of it."""

Progress = Callable[[int, int], None]
"""Called with the number of runs whose rows are kept, and the number of all."""


def run_campaign(
    experiment: Experiment,
    out: str | Path,
    workers: int | None = None,  # threads of this machine; all its cores by default
    scheduler: str | None = None,  # address
    progress: Progress | None = None,
) -> None:
    """Run a campaign, or what is missing of it, here or on the workers of a Dask scheduler.

    Rows are kept part by part. After an interrupt the same call goes on with the campaign; every
    row is the same as without the interrupt, on any machine.
    """
    if workers is not None and workers < 1:
        raise SettingError("workers", f"must be at least 1, got {workers}")
    variation = experiment.variation
    if variation is None:
        raise ExperimentError(
            experiment.path, "campaign", "is missing: say there what varies, or use flexid simulate"
        )
    plan = make_plan(variation, experiment.sampling is not None)
    with open_store(Path(out), _manifest(experiment, variation, plan)) as store:
        _complete(store, experiment, plan, workers or cores(), scheduler, progress)


def _manifest(experiment: Experiment, variation: Variation, plan: Plan) -> Manifest:
    return Manifest(
        flexid=flexid.__version__,
        experiment=experiment.digest,
        plan=plan.digest,
        kind=variation.kind,
        runs=variation.runs,
        inputs=plan.inputs,
        runs_per_part=variation.runs_per_part or _runs_per_part(experiment, variation),
        text=Path(experiment.path).read_text(encoding="utf-8"),
    )


def _runs_per_part(experiment: Experiment, variation: Variation) -> int:
    """Small enough that little is lost and many workers have work, large enough for few files.

    Runs that go side by side are quick, and quicker the more of them there are.
    """
    fewest = SIDE_BY_SIDE if experiment.side_by_side else 1
    return min(_MOST_RUNS, max(fewest, variation.runs // _PARTS))


def _complete(
    store: Store,
    experiment: Experiment,
    plan: Plan,
    workers: int,
    scheduler: str | None,
    progress: Progress | None,
) -> None:
    manifest = store.manifest
    missing = store.missing()
    left = sum(len(manifest.runs_of(part)) for part in missing)
    if progress is not None:
        progress(manifest.runs - left, manifest.runs)
    if not missing:
        return
    parts = ((n, plan.table(manifest.runs_of(n))) for n in missing)
    if scheduler is None:
        finished = run_here(experiment, parts, workers)
    else:
        finished = run_on_cluster(experiment, parts, scheduler)
    for number, rows in finished:
        store.write(number, rows)
        left -= len(rows)
        if progress is not None:
            progress(manifest.runs - left, manifest.runs)


def run_here(experiment: Experiment, parts: Iterable[Part], workers: int) -> Iterator[Part]:
    """Run parts on threads of this process, and yield them one after the other.

    Compiled code lets other threads run, so that these use all cores.
    """
    stop = threading.Event()
    waiting: deque[tuple[int, Future[pl.DataFrame]]] = deque()
    with ThreadPoolExecutor(workers) as pool:
        try:
            for number, table in parts:
                job = pool.submit(part_rows, experiment, table, stop.is_set)
                waiting.append((number, job))
                if len(waiting) > 2 * workers:  # what is done does not pile up in memory
                    yield _finished(*waiting.popleft())
            while waiting:
                yield _finished(*waiting.popleft())
        finally:  # an interrupt: every thread ends within a few runs
            stop.set()
            for _, job in waiting:
                job.cancel()


def _finished(number: int, job: "Future[pl.DataFrame]") -> Part:
    return number, job.result()


_TIMEOUT = 10.0  # s, to reach the scheduler


def run_on_cluster(experiment: Experiment, parts: Iterable[Part], scheduler: str) -> Iterator[Part]:
    """Run parts on the workers of a Dask scheduler, and yield each when it is done."""
    client = _connect(scheduler)
    try:
        _check_workers(client, scheduler)
        yield from _results(client, experiment, parts, scheduler)
    finally:
        client.close(timeout=_TIMEOUT)  # what is not done is not run any more


def _connect(scheduler: str) -> "Client":
    try:
        from distributed import Client
    except ImportError:
        raise SettingError(
            "scheduler", "needs the package distributed: pip install 'flexid[dask]'"
        ) from None
    # What goes wrong is said in one sentence; the package would add a traceback
    for name in ("distributed", "distributed.client"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    with suppress(OSError, ValueError, TypeError):
        return Client(scheduler, timeout=_TIMEOUT, set_as_default=False)
    # A client that could not connect closes itself when it is collected. Were that to happen while
    # another one starts, the two would wait for each other for ever.
    gc.collect()
    raise CampaignError(
        scheduler,
        "cannot be reached: start one there with `dask scheduler`, or correct the address",
    )


def _check_workers(client: "Client", scheduler: str) -> None:
    answers: Any = client.run(_version, on_error="return")
    versions: dict[str, object] = answers
    if not versions:
        raise CampaignError(scheduler, f"has no workers: start them with `dask worker {scheduler}`")
    for address, version in versions.items():
        if version != flexid.__version__:
            found = "no flexid" if isinstance(version, Exception) else f"flexid {version}"
            raise CampaignError(
                address,
                f"is a worker with {found}: install flexid {flexid.__version__} there, as here",
            )


def _version() -> str:
    return flexid.__version__


def _run(version: str, experiment: Experiment, part: Part) -> Part:
    """What a worker does; one that came later may have another version."""
    if flexid.__version__ != version:
        raise CampaignError(
            "a worker", f"has flexid {flexid.__version__}: install {version} there, as here"
        )
    number, table = part
    return number, part_rows(experiment, table)


def _results(
    client: "Client", experiment: Experiment, parts: Iterable[Part], scheduler: str
) -> Iterator[Part]:
    from distributed import KilledWorker, as_completed

    job = partial(_run, flexid.__version__, experiment)
    futures = client.map(job, list(parts), pure=False)
    for future in as_completed(futures, loop=client.loop):
        try:
            yield future.result()
        except KilledWorker:
            raise CampaignError(
                scheduler,
                "lost every worker that took one of the parts: see their logs, for memory above "
                "all; the same command goes on",
            ) from None
        except (CancelledError, OSError):
            raise CampaignError(
                scheduler, "was lost: start it and its workers; the same command goes on"
            ) from None
        future.release()
