"""How large a log may be that is read at once."""

from flexid.errors import RecordingError

LARGEST_FILE = 500_000_000  # bytes; read at once, at about four times that in memory
MOST_ROWS = 5_000_000  # an identification in memory takes 2 kB for each
MOST_COLUMNS = 10_000
MOST_CELLS = 100_000_000  # a small file may hold any number of empty or equal ones
LONGEST_SAMPLE_TIME = 0.5  # s
SHORTEST_SAMPLE_TIME = 1e-6  # s


def check_cells(file: str, rows: int, columns: int) -> None:
    """Refuse a table that would not fit into memory, before it is there."""
    if columns > MOST_COLUMNS or rows * columns > MOST_CELLS:
        raise RecordingError(
            file,
            "",
            f"there are {columns} columns of {rows} rows, more than are read at once: write the "
            f"columns of one joint",
        )
