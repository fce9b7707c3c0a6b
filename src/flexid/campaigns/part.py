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
    """Some runs.

    Parameters
    ----------
    number : int
    table : DataFrame
        Number and values of each run, from the plan.
    keep : tuple of str
        Which results to keep.
    """

    number: int
    table: pl.DataFrame
    keep: tuple[str, ...]


def run_part(
    experiment: Experiment, part: Part, stopped: Callable[[], bool] = lambda: False
) -> tuple[int, pl.DataFrame, pl.DataFrame | None]:
    """Run a part.

    Parameters
    ----------
    experiment : Experiment
    part : Part
    stopped : callable, optional
        Asked every few runs whether to stop.

    Returns
    -------
    number : int
        Of the part.
    rows : DataFrame
        One row per run.
    series : DataFrame or None
        Time series of the finished runs, where these are kept.

    Raises
    ------
    Stopped
        If `stopped` said so.
    AccelerationError
        If no run of this experiment is possible.
    """
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
