"""A piece of a campaign: what any worker, a thread or a machine, is given and gives back."""

from collections.abc import Callable
from dataclasses import dataclass

import polars as pl

from flexid.campaigns.rows import piece_rows
from flexid.campaigns.series import piece_series
from flexid.experiments import Experiment
from flexid.simulation.ensemble import ensemble_kernel
from flexid.simulation.sampled import sampled_kernel


@dataclass(frozen=True)
class Piece:
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


def run_piece(
    experiment: Experiment, piece: Piece, stopped: Callable[[], bool] = lambda: False
) -> tuple[int, pl.DataFrame, pl.DataFrame | None]:
    """Run a piece.

    Parameters
    ----------
    experiment : Experiment
    piece : Piece
    stopped : callable, optional
        Asked every few runs whether to stop.

    Returns
    -------
    number : int
        Of the piece.
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
    rows = piece_rows(experiment, piece.table, piece.keep, stopped)
    wanted = "time_series" in piece.keep
    return piece.number, rows, piece_series(experiment, rows, stopped) if wanted else None


def _check(experiment: Experiment) -> None:
    """Load the compiled functions, which fails if no run is possible."""
    declaration = experiment.loop.declaration
    if experiment.sampling is None:
        ensemble_kernel(declaration, experiment.settings.stiff)
    else:
        sampled_kernel(declaration)
