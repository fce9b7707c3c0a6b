"""Time series of the runs of a campaign, for those who ask for them."""

from collections.abc import Callable

import polars as pl

from flexid.campaigns.rows import FINISHED, STATUS, Stopped
from flexid.experiments import Experiment
from flexid.experiments.run_columns import run_columns


def part_series(
    experiment: Experiment, rows: pl.DataFrame, stopped: Callable[[], bool] = lambda: False
) -> pl.DataFrame:
    """Time series of the finished runs of a part, one below the other.

    The runs are made once more: the measures are taken at the integrator's own steps, the series
    at the samples.
    """
    inputs = rows.columns[1 : rows.columns.index(STATUS)]
    tables = []
    for values in rows.filter(pl.col(STATUS) == FINISHED).select("run", *inputs).to_dicts():
        if stopped():
            raise Stopped
        number = values.pop("run")
        try:
            run = experiment.with_values(values).run()
        except Exception:  # too long for the memory: its row is there, and others follow
            continue
        columns = pl.DataFrame(run_columns(run))
        tables.append(columns.select(pl.lit(number, pl.Int64).alias("run"), pl.all()))
    return pl.concat(tables) if tables else pl.DataFrame(schema={"run": pl.Int64})
