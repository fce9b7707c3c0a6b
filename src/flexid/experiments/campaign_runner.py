"""Execution of a campaign on threads of this machine or on a Dask cluster, part by part."""

import gc
import logging
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError, ThreadPoolExecutor, as_completed
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import polars as pl

import flexid
from flexid.errors import CampaignError, ExperimentError, SettingError
from flexid.estimators.samples import cores
from flexid.experiments.campaign_rows import part_rows
from flexid.experiments.campaign_store import Manifest, open_store
from flexid.experiments.experiment import Experiment
from flexid.experiments.variation import Plan, Variation, make_plan
from flexid.simulation.closed_loop import SIDE_BY_SIDE

if TYPE_CHECKING:
    from distributed import Client


_PARTS = 200
_MOST_RUNS = 500

Part = tuple[int, pl.DataFrame]
"""Number of a part, and a table with the values or the results of its runs."""

Progress = Callable[[int, int], None]
"""Called with the number of stored runs and the number of all runs."""


def run_campaign(
    experiment: Experiment,
    out: str | Path,
    workers: int | None = None,  # threads of this machine; all its cores by default
    scheduler: str | None = None,  # address
    progress: Progress | None = None,
) -> None:
    """Run the missing parts of a campaign, here or on the workers of a Dask scheduler."""
    if workers is not None and workers < 1:
        raise SettingError("workers", f"must be at least 1, got {workers}")
    variation = experiment.variation
    if variation is None:
        raise ExperimentError(
            experiment.path,
            "campaign",
            "is missing: add what varies, or use flexid simulate",
        )
    plan = make_plan(variation, experiment.sampling is not None)
    with open_store(Path(out), _manifest(experiment, variation, plan)) as store:
        manifest, missing = store.manifest, store.missing()
        done = manifest.runs - sum(len(manifest.runs_of(part)) for part in missing)
        report = progress or (lambda _done, _all: None)
        report(done, manifest.runs)
        if not missing:
            return
        parts = ((part, plan.table(manifest.runs_of(part))) for part in missing)
        if scheduler is None:
            finished = run_here(experiment, parts, workers or cores())
        else:
            finished = run_on_cluster(experiment, parts, scheduler)
        for part, rows in finished:
            store.write(part, rows)
            done += len(rows)
            report(done, manifest.runs)


def _manifest(experiment: Experiment, variation: Variation, plan: Plan) -> Manifest:
    # Small parts lose little work and keep many workers busy, large ones make few files. Vectorised
    # runs are fastest in full batches.
    fewest = SIDE_BY_SIDE if experiment.side_by_side else 1
    return Manifest(
        flexid=flexid.__version__,
        experiment=experiment.digest,
        plan=plan.digest,
        kind=variation.kind,
        runs=variation.runs,
        inputs=plan.inputs,
        runs_per_part=variation.runs_per_part
        or min(_MOST_RUNS, max(fewest, variation.runs // _PARTS)),
        text=Path(experiment.path).read_text(encoding="utf-8"),
    )


def run_here(experiment: Experiment, parts: Iterable[Part], workers: int) -> Iterator[Part]:
    """Run parts on threads of this process, and yield each when it is finished."""
    stop = threading.Event()
    with ThreadPoolExecutor(workers) as pool:
        jobs = (pool.submit(_rows_of, experiment, part, stop.is_set) for part in parts)
        try:
            for job in as_completed(jobs):  # frees each job once it is yielded
                yield job.result()
        finally:  # on an interrupt, every thread stops after a few runs
            stop.set()
            pool.shutdown(cancel_futures=True)


def _rows_of(
    experiment: Experiment, part: Part, stopped: Callable[[], bool] = lambda: False
) -> Part:
    number, table = part
    return number, part_rows(experiment, table, stopped)


_TIMEOUT = 10.0  # s, to reach the scheduler


def run_on_cluster(experiment: Experiment, parts: Iterable[Part], scheduler: str) -> Iterator[Part]:
    """Run parts on the workers of a Dask scheduler, and yield each when it is finished."""
    client = _connect(scheduler)
    from distributed import KilledWorker, as_completed

    try:
        _check_workers(client, scheduler)
        job = partial(_work, flexid.__version__, experiment)
        for future in as_completed(client.map(job, list(parts), pure=False), loop=client.loop):
            yield future.result()
            future.release()
    except KilledWorker:
        raise CampaignError(
            scheduler,
            "lost every worker that took one of the parts: check their logs, memory above all; "
            "the same command continues",
        ) from None
    except (CancelledError, OSError):
        raise CampaignError(
            scheduler, "was lost: start it and its workers; the same command continues"
        ) from None
    finally:
        client.close(timeout=_TIMEOUT)  # cancels the remaining parts


def _connect(scheduler: str) -> "Client":
    try:
        from distributed import Client
    except ImportError:
        raise SettingError(
            "scheduler", "needs the package distributed: pip install 'flexid[dask]'"
        ) from None
    # The error below is one sentence; the package would log a traceback.
    for name in ("distributed", "distributed.client"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    with suppress(OSError, ValueError, TypeError):
        return Client(scheduler, timeout=_TIMEOUT, set_as_default=False)
    # A client that failed to connect closes itself when it is collected. If that happened while
    # another client starts, the two would deadlock.
    gc.collect()
    raise CampaignError(
        scheduler,
        "cannot be reached: start one there with `dask scheduler`, or correct the address",
    )


def _check_workers(client: "Client", scheduler: str) -> None:
    found: Any = client.run(_version, on_error="return")
    versions: dict[str, object] = found  # or the error
    if not versions:
        raise CampaignError(scheduler, f"has no workers: start them with `dask worker {scheduler}`")
    for address, version in versions.items():
        if version != flexid.__version__:
            raise _other_version(address, flexid.__version__)


def _version() -> str:
    return flexid.__version__


def _other_version(worker: str, wanted: str) -> CampaignError:
    return CampaignError(worker, f"does not have flexid {wanted}: install the same version there")


def _work(version: str, experiment: Experiment, part: Part) -> Part:
    """Run a part on a worker; one that joined later may have another version."""
    if flexid.__version__ != version:
        raise _other_version("a worker", version)
    return _rows_of(experiment, part)
