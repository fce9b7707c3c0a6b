"""A Parquet file chunk by chunk is the file at once; what is wrong in it is told with its row."""

import hashlib
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from flexid.errors import RecordingError
from flexid.recording.read import read_log
from flexid.recording.recording import CHANNELS
from flexid.recording.stream import LogStream

ROWS = 60_000
TIME = 1e-3 * np.arange(ROWS)


def table() -> dict[str, np.ndarray]:
    """A minute of a joint that moves, in degrees and millimetre-free SI units."""
    motor = np.sin(3.0 * TIME) + 0.3 * np.sin(11.0 * TIME)
    return {
        "time [s]": TIME.copy(),
        "link_position [deg]": np.degrees(motor + 0.02 * np.sin(7.0 * TIME)),
        "motor_position [rad]": motor,
        "motor_torque [N m]": np.cos(3.0 * TIME) + 1.0,
    }


def written(path: Path, columns: dict[str, np.ndarray], **options) -> Path:
    """The table as a Parquet file."""
    pl.DataFrame(columns).write_parquet(path, row_group_size=7_000, **options)
    return path


def read(path: Path, size: int, head: int = 10_000, columns: Path | None = None):
    """Chunks of a stream, and the stream."""
    stream = LogStream(path, columns, head)
    return list(stream.chunks(size)), stream


def refusal(path: Path, size: int = 10_007) -> str:
    """What a stream of a file is refused with."""
    with pytest.raises(RecordingError) as caught:
        read(path, size)
    return str(caught.value)


@pytest.mark.parametrize("size", [997, 25_000])
def test_encoders_on_either_side_of_zero_are_in_one_turn(tmp_path: Path, size: int):
    """Assert that chunks of encoders that wrap have the deflection of the log read at once."""
    motor = 4.0 * np.sin(1.5 * TIME)
    columns = {
        **table(),
        "link_position [deg]": np.degrees(np.mod(motor + 0.02 * np.cos(7.0 * TIME), 2.0 * np.pi)),
        "motor_position [rad]": np.mod(motor - 0.01, 2.0 * np.pi),
    }
    chunks, _ = read(written(tmp_path / "log.parquet", columns), size)
    found = np.concatenate([chunk.recording.deflection for chunk in chunks])
    np.testing.assert_allclose(found, 0.01 + 0.02 * np.cos(7.0 * TIME), atol=1e-9)


@pytest.mark.parametrize("size", [997, 25_000, 10**6])
def test_chunks_are_the_log(tmp_path: Path, size: int):
    """Assert that chunks of any size, joined at gaps, are the recordings of the file read at once.

    One of the gaps lies where a chunk ends.
    """
    columns = table()
    lost = np.isin(np.arange(ROWS), [25_000, 40_001, 40_002])
    kept = {name: values[~lost] for name, values in columns.items()}
    path = written(tmp_path / "log.parquet", kept)
    chunks, stream = read(path, size)
    log = read_log(path)
    begins = [place for place, chunk in enumerate(chunks) if chunk.begins]
    assert len(begins) == len(log.recordings) == 3
    for recording, first, stop in zip(log.recordings, begins, [*begins[1:], None], strict=True):
        parts = [chunk.recording for chunk in chunks[first:stop]]
        assert parts[0].start_time == recording.start_time
        assert parts[0].sample_time == pytest.approx(recording.sample_time, rel=1e-12)
        for name in CHANNELS:
            values = getattr(recording, name)
            if values is not None:
                joined = np.concatenate([getattr(part, name) for part in parts])
                np.testing.assert_array_equal(joined, values)
    assert any("samples are missing" in warning for warning in stream.warnings)
    assert stream.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.mark.parametrize("bad", [np.nan, np.inf, None])
def test_a_bad_number_names_its_row(tmp_path: Path, bad: float | None):
    """Assert that a cell of the third chunk that is no number is refused with its row."""
    columns = {name: values.astype(object) for name, values in table().items()}
    columns["motor_position [rad]"][23_456] = bad
    frame = pl.DataFrame(
        {name: pl.Series(v.tolist(), dtype=pl.Float64) for name, v in columns.items()}
    )
    frame.write_parquet(tmp_path / "log.parquet")
    message = refusal(tmp_path / "log.parquet")
    assert "row 23457, column 'motor_position [rad]'" in message


def test_time_backwards_across_chunks(tmp_path: Path):
    """Assert that time that runs backwards from one chunk to the next is refused with its row."""
    columns = table()
    columns["time [s]"][20_014:] -= 0.5
    message = refusal(written(tmp_path / "log.parquet", columns))
    assert "row 20015, column 'time [s]'" in message
    assert "backwards" in message


def test_jitter_is_refused(tmp_path: Path):
    """Assert that a time stamp off the even grid is refused with the remedy."""
    columns = table()
    columns["time [s]"][30_000] += 5e-5
    message = refusal(written(tmp_path / "log.parquet", columns))
    assert "row 30001" in message
    assert "resample" in message


@pytest.mark.parametrize("size", [1_000, 8_191])
def test_wraps_are_undone_across_chunks(tmp_path: Path, size: int):
    """Assert that an absolute encoder is unwrapped, with a warning, wherever chunks end."""
    columns = table()
    motor = 2.0 * TIME + 0.5 * np.sin(3.0 * TIME)
    columns["motor_position [rad]"] = (motor + np.pi) % (2.0 * np.pi) - np.pi
    columns["link_position [deg]"] = np.degrees(motor + 0.02 * np.sin(7.0 * TIME))
    chunks, stream = read(written(tmp_path / "log.parquet", columns), size)
    found = np.concatenate([chunk.recording.motor_position for chunk in chunks])
    np.testing.assert_allclose(found, motor, atol=1e-9)
    assert any("jumps by a turn" in w and "more times" in w for w in stream.warnings)


def test_a_jump_that_is_no_turn_is_refused(tmp_path: Path):
    """Assert that an outlier between two chunks is refused."""
    columns = table()
    columns["motor_position [rad]"][20_014] += 4.0
    assert "which is no whole turn" in refusal(written(tmp_path / "log.parquet", columns))


@pytest.mark.parametrize("size", [1_009, 20_000])
def test_a_stuck_encoder_is_told(tmp_path: Path, size: int):
    """Assert that an encoder that stands still over several chunks is told of, with the times."""
    columns = table()
    columns["link_position [deg]"][30_000:36_501] = columns["link_position [deg]"][30_000]
    _, stream = read(written(tmp_path / "log.parquet", columns), size)
    (warning,) = stream.warnings
    assert "does not change from 30 s to 36.5 s" in warning


def test_a_stop_at_the_end_is_told(tmp_path: Path):
    """Assert that an encoder that dies before the end of the log is told of."""
    columns = table()
    columns["link_position [deg]"][50_000:] = columns["link_position [deg]"][50_000]
    _, stream = read(written(tmp_path / "log.parquet", columns), 4_000)
    assert "from 50 s to 59.999 s" in stream.warnings[0]


def test_a_clock_that_changes_is_told(tmp_path: Path):
    """Assert that a sample time other than the head's is told of."""
    columns = table()
    columns["time [s]"][30_000:] += 1e-3 * 1e-4 * np.arange(30_000)
    _, stream = read(written(tmp_path / "log.parquet", columns), 8_000)
    assert "the sample time of the whole log differs" in stream.warnings[0]


def test_a_map_holds_for_all_chunks(tmp_path: Path):
    """Assert that a column map is heeded, and that only the columns it names are read."""
    columns = table()
    columns["q"] = 2.0 * columns.pop("motor_position [rad]")
    columns["other"] = np.full(ROWS, np.nan)
    map_file = tmp_path / "map.toml"
    map_file.write_text('motor_position = { column = "q", scale = 0.5 }')
    chunks, _ = read(written(tmp_path / "log.parquet", columns), 9_000, columns=map_file)
    found = np.concatenate([chunk.recording.motor_position for chunk in chunks])
    np.testing.assert_allclose(found, table()["motor_position [rad]"], rtol=1e-12)


def test_files_that_cannot_be_streamed(tmp_path: Path):
    """Assert that a file cut short, a text and an absent file are refused in a sentence."""
    path = written(tmp_path / "log.parquet", table())
    cut = tmp_path / "cut.parquet"
    cut.write_bytes(path.read_bytes()[:-1000])
    assert "no Parquet file that can be read" in refusal(cut)
    text = tmp_path / "log.csv"
    text.write_text("time\n")
    assert "only a Parquet file can be streamed" in refusal(text)
    assert "there is no such file" in refusal(tmp_path / "none.parquet")


def test_a_damaged_middle(tmp_path: Path):
    """Assert that a file whose data are destroyed behind the head is refused with the place."""
    path = written(tmp_path / "log.parquet", table())
    raw = bytearray(path.read_bytes())
    middle = len(raw) // 2  # within a page, whose header is left alone
    raw[middle : middle + 100] = bytes(100)
    path.write_bytes(raw)
    assert "the file cannot be read on from there" in refusal(path)
    raw[middle : middle + 60_000] = bytes(60_000)
    path.write_bytes(raw)
    assert "the file cannot be read on from there" in refusal(path)


def test_wrong_units(tmp_path: Path):
    """Assert that a unit that measures something else is refused before anything is streamed."""
    columns = table()
    columns["motor_position [N m]"] = columns.pop("motor_position [rad]")
    assert "does not measure what the column holds" in refusal(
        written(tmp_path / "l.parquet", columns)
    )
