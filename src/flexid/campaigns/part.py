"""A part of a campaign: what any worker, a thread or a machine, is given and gives back."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import polars as pl

from flexid.campaigns.rows import FINISHED, STATUS, Stopped, part_rows
from flexid.experiments import Experiment
from flexid.experiments.run_columns import run_columns
from flexid.simulation.ensemble import ensemble_kernel
from flexid.simulation.sampled import sampled_kernel


@dataclass(frozen=True)
class Part:
    """Some runs."""

    number: int
    table: pl.DataFrame  # number and values of each run, from the plan
    keep: tuple[str, ...]  # which results to keep


class PartResult(NamedTuple):
    """What came of a part."""

    number: int
    rows: pl.DataFrame  # one for each run
    series: pl.DataFrame | None  # time series of the finished runs, where these are kept


def run_part(
    experiment: Experiment, part: Part, stopped: Callable[[], bool] = lambda: False
) -> PartResult:
    """Run a part; `stopped` is asked every few runs, and ends it with `Stopped`."""
    _load_kernels(experiment)
    rows = part_rows(experiment, part.table, part.keep, stopped)
    if "time_series" not in part.keep:
        return PartResult(part.number, rows, None)
    tables = [*_series(experiment, rows, stopped)]
    nothing = pl.DataFrame(schema={"run": pl.Int64})
    return PartResult(part.number, rows, pl.concat(tables) if tables else nothing)


def _load_kernels(experiment: Experiment) -> None:
    """Load the compiled functions, which fails if no run is possible."""
    declaration = experiment.loop.declaration
    if experiment.sampling is None:
        ensemble_kernel(declaration, experiment.settings.stiff)
    else:
        sampled_kernel(declaration)


def _series(
    experiment: Experiment, rows: pl.DataFrame, stopped: Callable[[], bool]
) -> Iterator[pl.DataFrame]:
    """Time series of each finished run, with its number.

    The runs are made once more: measures are taken at the integrator's own steps, series at the
    samples.
    """
    inputs = rows.columns[1 : rows.columns.index(STATUS)]
    for values in rows.filter(pl.col(STATUS) == FINISHED).select("run", *inputs).to_dicts():
        if stopped():
            raise Stopped
        number = values.pop("run")
        try:
            run = experiment.with_values(values).run()
        except Exception:  # too long for the memory: its row is there, and others follow
            continue
        columns = pl.DataFrame(run_columns(run))
        yield columns.select(pl.lit(number, pl.Int64).alias("run"), pl.all())
