"""The same parts on a Dask cluster, where a lost worker's parts go to another one."""

import gc
import logging
from collections.abc import Iterable, Iterator
from concurrent.futures import CancelledError
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING, Any

import flexid
from flexid.campaigns.rows import Part, PartResult, run_part
from flexid.errors import CampaignError
from flexid.experiments import Experiment

if TYPE_CHECKING:
    from distributed import Client

_TIMEOUT = 10.0  # s, to reach the scheduler


def run_on_cluster(
    experiment: Experiment, parts: Iterable[Part], scheduler: str
) -> Iterator[PartResult]:
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
        raise CampaignError(
            "--scheduler", "needs the package distributed: pip install 'flexid[dask]'"
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


def _run(version: str, experiment: Experiment, part: Part) -> PartResult:
    """What a worker does; one that came later may have another version."""
    if flexid.__version__ != version:
        raise CampaignError(
            "a worker", f"has flexid {flexid.__version__}: install {version} there, as here"
        )
    return run_part(experiment, part)


def _results(
    client: "Client", experiment: Experiment, parts: Iterable[Part], scheduler: str
) -> Iterator[PartResult]:
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
