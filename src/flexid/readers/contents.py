"""What a reader returns: what a file holds, and how its values are read."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

if TYPE_CHECKING:
    import polars

Frame: TypeAlias = "tuple[str, Mapping[str, Any] | polars.DataFrame]"
Read: TypeAlias = Callable[[Collection[str], int], Iterator[Frame]]

STAMPS = ""  # the column of a frame that holds time stamps: seconds, or whole nanoseconds
WIDEST = 64  # columns of a matrix that are signals each; one that has more is an image or a map


class Series(NamedTuple):
    """A signal of a file."""

    path: str  # where it stands, as a column map names it
    kind: str  # type of its values, for a list of what the file holds
    length: int
    unit: str = ""  # as the file states it
    clock: str = ""  # whose stamps are those of the values; empty where the time is a signal


@dataclass(frozen=True, eq=False)
class Contents:
    """What a file holds.

    `read` is called with the paths of some signals and a number of values. It yields frames of
    about so many, each with the name of its clock: values by path, and where there are clocks the
    time stamps under `STAMPS`.
    """

    series: list[Series]
    read: Read
    others: Mapping[str, str] = field(default_factory=dict)  # what is no signal, and why
    notes: Mapping[str, str] = field(default_factory=dict)  # what to say of a clock that is used
    is_table: bool = False  # whether the signals are the columns of one table


class RefusedError(Exception):
    """A file is refused: the place in it, empty for the whole, and the reason with the remedy."""

    def __init__(self, place: str, reason: str) -> None:
        self.place, self.reason = place, reason
        super().__init__(reason)


def of_frame(frame: polars.DataFrame | polars.LazyFrame) -> Contents:
    """A frame, which may be read only when it is wanted, as what a file holds."""
    import polars as pl

    lazy = frame.lazy()
    rows = lazy.select(pl.len()).collect().item()
    series = [Series(path, str(kind), rows) for path, kind in lazy.collect_schema().items()]

    def read(paths: Collection[str], size: int) -> Iterator[Frame]:
        # Polars reads ahead by some batches and then waits, so that memory stays bounded.
        for batch in lazy.select(paths).collect_batches(chunk_size=size):
            yield "", batch

    return Contents(series, read, is_table=True)
