"""What became of the files of each reader, and the tables of it in `docs/reliability.md`."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from datetime import date
from pathlib import Path

from benchmarks.page_block import block_of, write_block

PAGE = Path(__file__).parents[1] / "docs" / "reliability.md"


@dataclass
class Tally:
    """What became of the files of one target."""

    read: int = 0
    refused: int = 0
    longest: float = 0.0
    seconds: float = 0.0
    growth: float = 0.0
    faults: list[str] = field(default_factory=list)
    branches: int = 0

    @property
    def files(self) -> int:
        """How many there were."""
        return self.read + self.refused + len(self.faults)

    def add(self, other: Tally) -> None:
        """Join what another process tallied."""
        self.read += other.read
        self.refused += other.refused
        self.longest = max(self.longest, other.longest)
        self.seconds += other.seconds
        self.growth = max(self.growth, other.growth)
        self.faults += other.faults


@dataclass(frozen=True)
class Table:
    """A table of the page, with one row for each reader, which says when it was made.

    Parameters
    ----------
    name : str
        Of its marks in the page.
    options : str
        Of the command that makes it.
    columns : tuple of str
        After the reader, the day and the seconds.
    cells : callable
        What stands in them.
    """

    name: str
    options: str
    columns: tuple[str, ...]
    cells: Callable[[Tally], tuple[str, ...]]

    @property
    def head(self) -> tuple[str, str]:
        """Its first two lines."""
        columns = ("reader", "day", "s", *self.columns)
        return f"|{'|'.join(columns)}|", "|---" * len(columns) + "|"

    def row(self, name: str, tally: Tally) -> str:
        """The row of a reader, of today."""
        cells = (name, date.today().isoformat(), f"{tally.seconds:.0f}", *self.cells(tally))
        return f"|{'|'.join(cells)}|"

    def write(self, row: str, names: Iterable[str], page: Path = PAGE) -> None:
        """Put a row into the page in place of the one of its reader.

        Parameters
        ----------
        row : str
            See `row`.
        names : iterable of str
            All readers there are, in the table's order; rows of others go.
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
