"""Bytes of a stream give the samples of a log with the same text."""

from datetime import UTC, datetime, timedelta
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from flexid.recording.read import read_log
from flexid.streaming.incoming import TextStream, sample_time_of

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


def test_a_line_that_is_no_row_is_a_sample_without_numbers():
    """Assert that text, a short line and an empty cell count as samples without values."""
    rows = [*ROWS]
    rows[250], rows[251], rows[252] = "overrun!", "1,2", "504,,0.1,0.2"
    samples = samples_of("\n".join([HEADER, *rows, "", "# end", ""]))
    assert len(samples) == len(ROWS)
    assert np.isnan(samples[250:252]).all()
    assert np.isnan(samples[252]).tolist() == [False, False, False, True]
    assert np.isfinite(np.delete(samples, [250, 251, 252], axis=0)).all()


@pytest.mark.parametrize(("end", "count"), [("\n", 300), ("\r\n", 300), ("\r", 300), ("", 299)])
def test_a_last_line_without_its_end_is_no_sample(end: str, count: int):
    """Assert that the last line counts only if it has ended, even before its line feed."""
    assert len(samples_of("\n".join([HEADER, *ROWS]) + end)) == count


def test_names_of_its_own_count():
    """Assert that a given header does not replace the stream's own."""
    text = "\n".join([HEADER, *ROWS, ""])
    found = samples_of(text, header=HEADER.replace("ms", "s"))
    np.testing.assert_array_equal(found, samples_of(text))


def test_sample_time():
    """Assert that gaps, repeats and late samples at the start do not change the sample time."""
    time = np.delete(1e-3 * np.arange(200, dtype=np.float64), [20, 21, 22])
    time[[50, 51]] = time[[51, 50]]
    time[70] = time[69]
    assert sample_time_of("stream", time) == pytest.approx(1e-3, rel=1e-3)
