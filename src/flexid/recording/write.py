"""Tables as Parquet files."""

import errno
from pathlib import Path

import polars as pl


def write_parquet(table: pl.DataFrame, path: Path) -> None:
    """Write a table.

    Parameters
    ----------
    table : DataFrame
    path : Path
        Is replaced if it is there.

    Raises
    ------
    OSError
        If the disk is full or the place cannot be written; Polars has other errors for the former.
    """
    try:
        table.write_parquet(path)
    except pl.exceptions.ComputeError as error:
        reason = str(error).rpartition(": ")[2]
        raise OSError(errno.EIO, reason, str(path)) from None
