"""A campaign from its experiment to its rows: what is missing is run, here or on a cluster."""

import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from pathlib import Path

import flexid
from flexid.campaigns.plan import Plan, make_plan
from flexid.campaigns.rows import Part, PartResult, result_schema, run_part
from flexid.campaigns.store import Manifest, Store, open_store
from flexid.errors import ExperimentError, SettingError
from flexid.estimators.threads import cores
from flexid.experiments import Experiment
from flexid.experiments.variation import Variation
from flexid.simulation.ensemble import SIDE_BY_SIDE

_PARTS = 200
_MOST_RUNS = 500
_MOST_SERIES = 10

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
        raise SettingError("workers", f"{workers!r} must be at least 1")
    variation = experiment.variation
    if variation is None:
        raise ExperimentError(
            experiment.path, "campaign", "is missing: say there what varies, or use flexid simulate"
        )
    try:
        plan = make_plan(variation, experiment.sampling is not None)
    except SettingError as error:
        raise ExperimentError(experiment.path, error.setting, error.reason) from None
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
        keep=variation.keep,
        runs_per_part=variation.runs_per_part or _runs_per_part(experiment, variation),
        text=Path(experiment.path).read_text(encoding="utf-8"),
    )


def _runs_per_part(experiment: Experiment, variation: Variation) -> int:
    """Small enough that little is lost and many workers have work, large enough for few files.

    Runs that go side by side are quick, and quicker the more of them there are.
    """
    most = _MOST_SERIES if "time_series" in variation.keep else _MOST_RUNS
    fewest = SIDE_BY_SIDE if experiment.side_by_side else 1
    return min(most, max(fewest, variation.runs // _PARTS))


def _complete(
    store: Store,
    experiment: Experiment,
    plan: Plan,
    workers: int,
    scheduler: str | None,
    progress: Progress | None,
) -> None:
    manifest = store.manifest
    missing = store.missing(plan, result_schema(experiment.loop.system, manifest.keep))
    left = sum(len(manifest.runs_of(part)) for part in missing)
    if progress is not None:
        progress(manifest.runs - left, manifest.runs)
    if not missing:
        return
    parts = (Part(n, plan.table(manifest.runs_of(n)), manifest.keep) for n in missing)
    if scheduler is None:
        finished = run_here(experiment, parts, workers)
    else:
        from flexid.campaigns.cluster import run_on_cluster

        finished = run_on_cluster(experiment, parts, scheduler)
    for number, rows, series in finished:
        store.write(number, rows, series)
        left -= len(rows)
        if progress is not None:
            progress(manifest.runs - left, manifest.runs)


def run_here(experiment: Experiment, parts: Iterable[Part], workers: int) -> Iterator[PartResult]:
    """Run parts on threads of this process, and yield each when it is done.

    Compiled code lets other threads run, so that these use all cores.
    """
    stop = threading.Event()
    waiting: set[Future[PartResult]] = set()
    with ThreadPoolExecutor(workers) as pool:
        try:
            for part in parts:
                waiting.add(pool.submit(run_part, experiment, part, stop.is_set))
                if len(waiting) > 2 * workers:  # what is done does not pile up in memory
                    done, waiting = wait(waiting, return_when=FIRST_COMPLETED)
                    yield from (future.result() for future in done)
            while waiting:
                done, waiting = wait(waiting, return_when=FIRST_COMPLETED)
                yield from (future.result() for future in done)
        finally:  # an interrupt: every thread ends within a few runs
            stop.set()
            for future in waiting:
                future.cancel()
