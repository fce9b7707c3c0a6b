"""Streams: bytes with a log's samples, growing files, standard input, and logs of other formats."""

import os
import sys
from collections.abc import Generator, Iterator
from datetime import UTC, datetime, timedelta
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from moving_joint import LINK, MOTOR, TIME, TORQUE, followed, log_text, same, stream, watched

from flexid.errors import RecordingError
from flexid.recording.read import read_log
from flexid.streaming import incoming
from flexid.streaming.incoming import Replay, TextStream, open_source, sample_time_of

HEADER = "time [ms],motor current [A],link_position [deg],motor_position [rad]"
ROWS = [
    f"{2 * k},{np.sin(k):.6f},{10 * np.sin(k / 9):.6f},{0.2 * np.sin(k / 9):.7f}"
    for k in range(300)
]


def samples_of(text: str, parts: int = 1, column_map=None, header=None) -> np.ndarray:
    """Return the samples of a text that arrives in parts."""
    stream, found = TextStream("stream", column_map, header=header), []
    raw = text.encode()
    edges = np.linspace(0, len(raw), parts + 1).astype(int)
    for first, stop in pairwise(edges):
        samples = stream.samples(raw[first:stop], ended=stop == len(raw))
        if len(samples):
            found.append(samples)
    return np.concatenate(found)


MAPPED = [
    "t;a;b;enc;tau",
    *(
        f"{k / 500};{200 * np.sin(k / 40):.3f};{k % 5};{np.sin(k / 30):.6f};{k % 11}"
        for k in range(300)
    ),
]
MAP = {
    "time": "t",
    "gear_ratio": 100,
    "motor_torque": "tau",
    "motor_position": {"column": "enc", "unit": "turn"},
    "link_position": {
        "sum": ["a", {"column": "b", "scale": -1}], "offset": 3, "unit": "mrad"
    },
}  # fmt: skip


@pytest.mark.parametrize("parts", [1, 7, 400])
@pytest.mark.parametrize(("lines", "column_map"), [([HEADER, *ROWS], None), (MAPPED, MAP)])
def test_samples_are_those_of_the_log(tmp_path: Path, parts: int, lines: list[str], column_map):
    """Assert the samples of the log, with its names, units and column map, for any division."""
    text = "\n".join([*lines, ""])
    (tmp_path / "log.csv").write_text(text)
    (recording,) = read_log(tmp_path / "log.csv", column_map).recordings
    samples = samples_of(text, parts, column_map)
    channels = (recording.needed_link_position, recording.motor_position, recording.needed_input)
    right = np.column_stack((recording.time, *channels))
    np.testing.assert_allclose(samples, right, rtol=1e-12, atol=1e-15)


BEGIN = datetime(2024, 5, 1, 23, 59, 59, 900_000, tzinfo=UTC)


def stamped(form: str) -> list[str]:
    """Return the rows with time stamps, across midnight."""
    stamps = [(BEGIN + k * timedelta(milliseconds=2)).strftime(form) for k in range(len(ROWS))]
    return [stamp + row[row.index(",") :] for stamp, row in zip(stamps, ROWS, strict=True)]


@pytest.mark.parametrize("parts", [1, 40])
def test_time_stamps_count_from_1970(parts: int):
    """Assert that time stamps are read as in a log, and that an invalid one drops its sample."""
    rows = stamped("%Y-%m-%dT%H:%M:%S.%f+00:00")
    rows[250] = f"2024-05-02{rows[250][rows[250].index(',') :]}"
    header = HEADER.replace("time [ms]", "time [UTC]")
    samples = samples_of("\n".join([header, *rows, ""]), parts)
    right = BEGIN.timestamp() + 2e-3 * np.arange(len(ROWS))
    right[250] = np.nan
    np.testing.assert_allclose(samples[:, 0], right, rtol=0.0, atol=1e-6)
    whole = samples_of("\n".join([HEADER, *ROWS, ""]))
    np.testing.assert_array_equal(samples[:, 1:], whole[:, 1:])


@pytest.mark.parametrize("form", ["%Y-%m-%dT%H:%M:%S.%fZ", "%H:%M:%S.%f", ""])
def test_a_stream_that_is_joined_in_the_midst_of_a_line(form: str):
    """Assert that a stream that starts within a line loses that line alone."""
    rows = stamped(form) if form else ROWS
    header = HEADER.replace(" [ms]", "") if form else HEADER
    whole = samples_of("\n".join([header, *rows, ""]))
    assert np.isfinite(whole).all()
    np.testing.assert_array_equal(samples_of("\n".join([*rows, ""]), header=header), whole)
    for cut in range(2, len(rows[0])):
        samples = samples_of("\n".join([rows[0][cut:], *rows[1:], ""]), header=header)
        np.testing.assert_array_equal(samples[-len(rows) + 1 :], whole[1:])
        assert len(samples) == len(rows) - 1 or np.isnan(samples[0]).any()


@pytest.mark.parametrize(("end", "count"), [("\n", 300), ("\r\n", 300), ("\r", 300), ("", 299)])
def test_a_last_line_without_its_end_is_no_sample(end: str, count: int):
    """Assert that the last line counts only if it has ended, even before its line feed."""
    assert len(samples_of("\n".join([HEADER, *ROWS]) + end)) == count


def test_odd_lines_and_headers():
    """Assert samples without values for other lines, and a stream's own names over given ones."""
    rows = [*ROWS]
    rows[250], rows[251], rows[252] = "overrun!", "1,2", "504,,0.1,0.2"
    samples = samples_of("\n".join([HEADER, *rows, "", "# end", ""]))
    assert len(samples) == len(ROWS)
    assert np.isnan(samples[250:252]).all()
    assert np.isnan(samples[252]).tolist() == [False, False, False, True]
    assert np.isfinite(np.delete(samples, [250, 251, 252], axis=0)).all()
    text = "\n".join([HEADER, *ROWS, ""])
    found = samples_of(text, header=HEADER.replace("ms", "s"))
    np.testing.assert_array_equal(found, samples_of(text))


def test_sample_time():
    """Assert that gaps, repeats and late samples at the start do not change the sample time."""
    time = np.delete(1e-3 * np.arange(200, dtype=np.float64), [20, 21, 22])
    time[[50, 51]] = time[[51, 50]]
    time[70] = time[69]
    assert sample_time_of("stream", time) == pytest.approx(1e-3, rel=1e-3)


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


def test_ends_and_blocks_of_logs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Assert a warning of an incomplete last line, and blocks of Parquet without a loss."""
    samples, log = stream(3.0), tmp_path / "log.csv"
    log.write_text(log_text(samples, TIME, LINK, MOTOR, TORQUE)[:-9])
    watch = followed(log)
    assert same(watch.result, watched(samples[:-1]))
    assert "may be incomplete" in watch.warnings[-1]
    samples = stream(3.0)
    samples[700:705, TIME] -= 0.5  # late samples, at the end of a block and after it
    path = written(tmp_path / "log.parquet", samples)
    monkeypatch.setattr(incoming, "BLOCK", 100)
    found = [*Replay(path, None)]
    assert max(map(len, found)) <= 130
    np.testing.assert_array_equal(np.concatenate(found), samples)
