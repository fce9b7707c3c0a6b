"""A part of a campaign: what any worker, a thread or a machine, is given and gives back."""

from collections.abc import Callable
from dataclasses import dataclass

import polars as pl

from flexid.campaigns.rows import part_rows
from flexid.campaigns.series import part_series
from flexid.experiments import Experiment
from flexid.simulation.ensemble import ensemble_kernel
from flexid.simulation.sampled import sampled_kernel


@dataclass(frozen=True)
class Part:
    """Some runs."""

    number: int
    table: pl.DataFrame  # number and values of each run, from the plan
    keep: tuple[str, ...]  # which results to keep


def run_part(
    experiment: Experiment, part: Part, stopped: Callable[[], bool] = lambda: False
) -> tuple[int, pl.DataFrame, pl.DataFrame | None]:
    """Run a part."""
    _check(experiment)
    rows = part_rows(experiment, part.table, part.keep, stopped)
    wanted = "time_series" in part.keep
    return part.number, rows, part_series(experiment, rows, stopped) if wanted else None


def _check(experiment: Experiment) -> None:
    """Load the compiled functions, which fails if no run is possible."""
    declaration = experiment.loop.declaration
    if experiment.sampling is None:
        ensemble_kernel(declaration, experiment.settings.stiff)
    else:
        sampled_kernel(declaration)
