"""Parquet files, by Polars."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    import polars


def read(path: Path) -> polars.LazyFrame:
    """The table of a Parquet file, of which only what is wanted is read."""
    import polars as pl

    return pl.scan_parquet(path, glob=False)
