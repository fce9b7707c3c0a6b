"""A Parquet file as tables of some rows at a time, for logs that no memory holds."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

from flexid.errors import RecordingError
from flexid.files import shown
from flexid.recording.limits import check_cells
from flexid.recording.table import Table, scan_parquet

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path


class ParquetBlocks:
    """A Parquet file that is read in blocks.

    Parameters
    ----------
    path : Path
        The file.

    Raises
    ------
    RecordingError
        If it is none, or holds nothing.
    """

    def __init__(self, path: Path) -> None:
        self.file = shown(path)
        self._scan, self.rows = scan_parquet(path)

    def head(self, rows: int) -> Table:
        """All columns of the first rows.

        Raises
        ------
        RecordingError
            If they cannot be read, or are too many cells.
        """
        rows = min(rows, self.rows)
        check_cells(self.file, rows, self._scan.collect_schema().len())
        with self._readable(0):
            frame = self._scan.head(rows).collect()
        return Table(self.file, "", 1, "row", frame, "")

    def tables(self, columns: Sequence[str], size: int) -> Iterator[Table]:
        """Some columns of all rows, so many rows at a time.

        Raises
        ------
        RecordingError
            With the first row that cannot be read.
        """
        row = 0
        # Polars reads ahead by some batches and then waits, so that memory stays bounded.
        batches = self._scan.select(columns).collect_batches(chunk_size=size)
        while row < self.rows:
            with self._readable(row):
                frame = next(batches, None)
            if frame is None:
                raise self._broken(row)
            yield Table(self.file, "", row + 1, "row", frame, "")
            row += frame.height

    @contextmanager
    def _readable(self, row: int) -> Iterator[None]:
        """Turn what Polars says of a damaged file into a sentence."""
        import polars as pl

        try:
            yield
        except (pl.exceptions.PolarsError, pl.exceptions.PanicException, OSError) as error:
            raise self._broken(row) from error

    def _broken(self, row: int) -> RecordingError:
        return RecordingError(
            self.file,
            f"row {row + 1} or after",
            "the file cannot be read on from there: export or copy it again",
        )
