"""Reader of Parquet files, by Polars."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import polars


def read(path: Path) -> polars.LazyFrame:
    """Return the table of a Parquet file, of which only the selected columns are read."""
    import polars as pl

    return pl.scan_parquet(path, glob=False)
