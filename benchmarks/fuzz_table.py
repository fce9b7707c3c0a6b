"""Results of fuzzing by reader, and their tables in `docs/reliability.md`."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from datetime import date
from pathlib import Path

from benchmarks.page_block import block_of, write_block

PAGE = Path(__file__).parents[1] / "docs" / "reliability.md"


@dataclass
class Tally:
    """Counts of one target's files by result."""

    read: int = 0
    refused: int = 0
    longest: float = 0.0
    seconds: float = 0.0
    growth: float = 0.0
    faults: list[str] = field(default_factory=list)
    branches: int = 0

    @property
    def files(self) -> int:
        """Number of files."""
        return self.read + self.refused + len(self.faults)

    def add(self, other: Tally) -> None:
        """Add the counts of another process."""
        self.read += other.read
        self.refused += other.refused
        self.longest = max(self.longest, other.longest)
        self.seconds += other.seconds
        self.growth = max(self.growth, other.growth)
        self.faults += other.faults


@dataclass(frozen=True)
class Table:
    """Table of the page, with one dated row for each reader.

    Parameters
    ----------
    name : str
        Name of its marks in the page.
    options : str
        Options of the command that makes it.
    columns : tuple of str
        Headings after reader, day and seconds.
    cells : callable
        Function that returns the texts of these columns.
    """

    name: str
    options: str
    columns: tuple[str, ...]
    cells: Callable[[Tally], tuple[str, ...]]

    @property
    def head(self) -> tuple[str, str]:
        """First two lines of the table."""
        columns = ("reader", "day", "s", *self.columns)
        return f"|{'|'.join(columns)}|", "|---" * len(columns) + "|"

    def row(self, name: str, tally: Tally) -> str:
        """Return the row of a reader, with today's date."""
        cells = (name, date.today().isoformat(), f"{tally.seconds:.0f}", *self.cells(tally))
        return f"|{'|'.join(cells)}|"

    def write(self, row: str, names: Iterable[str], page: Path = PAGE) -> None:
        """Replace a reader's row in the page.

        Parameters
        ----------
        row : str
            Row made by `row`.
        names : iterable of str
            All readers in the table's order; rows of others are removed.
        page : Path, optional
        """
        before = block_of(page.read_text(encoding="utf-8"), self.name).splitlines()
        width = row.count("|")
        rows = {_reader(line): line for line in (*before, row) if line.count("|") == width}
        kept = [rows[name] for name in names if name in rows]
        command = f"`python -m benchmarks.fuzz{self.options} --write`:"
        write_block(page, self.name, "\n".join((command, "", *self.head, *kept, "")))


def _reader(row: str) -> str:
    return row.split("|")[1].strip()


MUTATED = Table(
    "fuzz-mutated",
    "",
    ("files", "faults", "memory"),
    lambda tally: (str(tally.files), str(len(tally.faults)), f"+{tally.growth:.0f}MB"),
)
GUIDED = Table(
    "fuzz-guided",
    " --guided",
    ("files", "faults", "branches"),
    lambda tally: (str(tally.files), str(len(tally.faults)), str(tally.branches)),
)
