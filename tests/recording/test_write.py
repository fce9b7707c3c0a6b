"""Tables written as Parquet files."""

from pathlib import Path

import polars as pl
import pytest

from flexid.recording.frame import write_parquet

FULL = Path("/dev/full")
TABLE = pl.DataFrame({"time": [0.0, 0.1]})


def test_table_comes_back(tmp_path: Path):
    """Assert that what is written is read, and replaces what was there."""
    path = tmp_path / "a.parquet"
    write_parquet(TABLE.head(1), path)
    write_parquet(TABLE, path)
    assert pl.read_parquet(path).equals(TABLE)


@pytest.mark.skipif(not FULL.exists(), reason="needs a device that is always full")
def test_full_disk_is_an_error_of_the_system():
    """Assert that the error is one that the command line tells in a sentence, with the place."""
    with pytest.raises(OSError, match="No space left on device") as caught:
        write_parquet(TABLE, FULL)
    assert caught.value.filename == str(FULL)
