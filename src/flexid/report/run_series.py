"""Time series of a simulated run, as files: what a drive would log, and everything."""

from pathlib import Path

import polars as pl

from flexid.experiments.run_columns import log_columns, run_columns
from flexid.recording.write import write_parquet
from flexid.simulation.run import Run


def save_run_series(run: Run, directory: Path, csv: bool) -> None:
    """Write run.parquet and log.parquet, and the same as CSV if wanted."""
    for name, columns in {"run": run_columns(run), "log": log_columns(run)}.items():
        table = pl.DataFrame(columns)
        write_parquet(table, directory / f"{name}.parquet")
        if csv:
            table.write_csv(directory / f"{name}.csv")
