"""Streams from a growing file, from standard input and from logs of other formats."""

import os
import sys
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from moving_joint import (
    LINK,
    MOTOR,
    TIME,
    TORQUE,
    followed,
    log_text,
    same,
    stream,
    watched,
)

from flexid.errors import RecordingError
from flexid.streaming import incoming
from flexid.streaming.incoming import Replay, open_source

LINES = [b"time,a\n", b"0.1,2\n", b"0.2,3\n"]


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """Return the beginning of a log."""
    path = tmp_path / "log.csv"
    path.write_bytes(LINES[0])
    return path


@pytest.fixture
def source(log: Path) -> Iterator[Generator[bytes]]:
    """Return the log as a source, with its present content read."""
    source = open_source(str(log))
    assert next(source) == LINES[0]
    yield source
    source.close()


@pytest.mark.parametrize("name", ["log.csv", "log.1"])
def test_a_file_that_grows(log: Path, source: Generator[bytes], name: str):
    """Assert that the source waits at the end of a file, also after it is renamed."""
    later = log.rename(log.with_name(name))
    assert next(source) == b""
    with later.open("ab") as file:
        file.write(LINES[1])
    assert next(source) == LINES[1]


@pytest.mark.parametrize(
    "act",
    [
        lambda path: path.write_bytes(b"x\n"),
        lambda path: path.write_bytes(b"time,b\n0.1,4\n0.2,5\n0.3,6\n"),
        lambda path: (path.rename(path.with_suffix(".1")), path.touch()),  # like a log rotation
    ],
    ids=["cut", "written again", "replaced"],
)
def test_a_file_that_is_another_is_refused(log: Path, source: Generator[bytes], act: Any):
    """Assert that a truncated or replaced file is refused."""
    act(log)
    with pytest.raises(RecordingError, match=r"cut, rewritten or replaced .*: watch it once more"):
        next(source)


def test_a_last_line_without_an_end(tmp_path: Path):
    """Assert that an incomplete last line is omitted, with a warning."""
    samples, log = stream(3.0), tmp_path / "log.csv"
    log.write_text(log_text(samples, TIME, LINK, MOTOR, TORQUE)[:-9])
    watch = followed(log)
    assert same(watch.result, watched(samples[:-1]))
    assert "may be incomplete" in watch.warnings[-1]


def test_standard_input(monkeypatch: pytest.MonkeyPatch):
    """Assert that a pipe is read until it is closed."""
    reading, writing = os.pipe()
    with os.fdopen(reading) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        source = open_source("-")
        assert next(source) == b""
        os.write(writing, LINES[0])
        assert next(source) == LINES[0]
        os.close(writing)
        assert next(source, None) is None


NAMES = {"time": TIME, "link_position": LINK, "motor_position": MOTOR, "motor_torque": TORQUE}


def written(path: Path, samples: np.ndarray) -> Path:
    """Write the samples to a Parquet file and return its path."""
    frame = pl.DataFrame({name: samples[:, column] for name, column in NAMES.items()})
    frame.write_parquet(path, row_group_size=130)  # rows read at once
    return path


def test_an_encoder_in_front_of_a_gear_wraps_by_what_the_column_map_says(tmp_path: Path):
    """Assert that the gear ratio of a column map reaches the session."""
    samples = stream(3.0)
    samples[:, MOTOR] = np.mod(40.0 * samples[:, MOTOR], 2.0 * np.pi)
    path = written(tmp_path / "log.parquet", samples)
    gear = {"gear_ratio": 40, "motor_torque": {"column": "motor_torque", "side": "link"}}
    right, found = watched(stream(3.0)), followed(path, column_map=gear).result
    assert found.counts.wraps > 20
    values = [session.learner.values(session.now.states) for session in (found, right)]
    np.testing.assert_allclose(values[0], values[1], rtol=1e-6)


def test_a_parquet_file_is_read_in_blocks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Assert that at most one block of rows is read at once, and that none is lost."""
    samples = stream(3.0)
    samples[700:705, TIME] -= 0.5  # late samples, at the end of a block and after it
    path = written(tmp_path / "log.parquet", samples)
    monkeypatch.setattr(incoming, "BLOCK", 100)
    found = [*Replay(path, None)]
    assert max(map(len, found)) <= 130
    np.testing.assert_array_equal(np.concatenate(found), samples)
