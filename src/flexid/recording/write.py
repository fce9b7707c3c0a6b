"""Tables as Parquet files."""

import errno
from pathlib import Path

import polars as pl


def write_parquet(table: pl.DataFrame, path: Path) -> None:
    """Write a table; a full disk, for which Polars has its own error, raises an `OSError`."""
    try:
        table.write_parquet(path)
    except pl.exceptions.ComputeError as error:
        reason = str(error).rpartition(": ")[2]
        raise OSError(errno.EIO, reason, str(path)) from None
