"""All sources of a log: equal samples from files, data frames, arrays and recordings."""

from datetime import date
from functools import partial

import numpy as np
import pandas as pd
import polars as pl
import pyarrow as pa
import pytest

import flexid
from flexid.errors import RecordingError, SettingError
from flexid.library.logs import all_logs

NAMES = ("time [s]", "link_position [deg]", "motor_position [rad]", "motor_torque [N m]")


@pytest.fixture(scope="module")
def arrays():
    """Return a log as arrays by name, one of them in degrees."""
    time = 1e-3 * np.arange(200)
    moved = np.sin(40.0 * time)
    link, torque = np.rad2deg(moved) + 0.3 * np.cos(90.0 * time), 3.0 * np.cos(35.0 * time)
    return dict(zip(NAMES, (time, link, moved, torque), strict=True))


KINDS = {
    "arrays": dict,
    "lists": lambda arrays: {name: values.tolist() for name, values in arrays.items()},
    "polars": pl.DataFrame,
    "pandas": pd.DataFrame,
    "pyarrow": lambda arrays: pa.table({n: pa.array(v) for n, v in arrays.items()}),
}


@pytest.mark.parametrize("kind", KINDS)
def test_memory_is_read_as_a_file_is(arrays, tmp_path, kind):
    """Assert that samples and units equal those of the log's file."""
    path = tmp_path / "log.parquet"
    pl.DataFrame(arrays).write_parquet(path)
    wanted, found = flexid.read_log(path), flexid.read_log(KINDS[kind](arrays))
    (one,), (other,) = wanted.recordings, found.recordings
    assert other.input_unit == "N m"
    assert other.sample_time == one.sample_time
    for channel in ("link_position", "motor_position", "input"):
        np.testing.assert_array_equal(getattr(other, channel), getattr(one, channel))


def test_a_column_map_serves_a_frame(arrays, tmp_path):
    """Assert that a column map applies to a frame."""
    path = tmp_path / "map.toml"
    path.write_text('link_position = {column = "q", unit = "deg"}')
    frame = pl.DataFrame(arrays).rename({NAMES[1]: "q"})
    (wanted,) = flexid.read_log(arrays).recordings
    for columns in (path, str(path), {"link_position": {"column": "q", "unit": "deg"}}):
        (found,) = flexid.read_log(frame, columns=columns).recordings
        link = found.needed_link_position
        np.testing.assert_allclose(link, wanted.needed_link_position, rtol=1e-15)


def test_an_index_with_a_name_is_a_column(arrays):
    """Assert that the time may be the index of a pandas frame."""
    frame = pd.DataFrame(arrays)
    expected = flexid.read_log(frame).recordings[0]
    (found,) = flexid.read_log(frame.set_index(NAMES[0])).recordings
    np.testing.assert_array_equal(found.time, expected.time)
    kept = frame.set_index(NAMES[0], drop=False)
    np.testing.assert_array_equal(flexid.read_log(kept).recordings[0].time, expected.time)


def test_the_same_data_twice_are_known(arrays):
    """Assert that the digest depends on the data and not on their form."""
    digests = {flexid.read_log(KINDS[kind](arrays)).sha256 for kind in KINDS}
    assert len(digests) == 1
    other = {**arrays, NAMES[3]: arrays[NAMES[3]] + 1e-9}
    assert flexid.read_log(other).sha256 not in digests


OTHERS = {name: np.arange(3.0) for name in NAMES}
NO_LOG = {
    "a number": 3,
    "nothing": None,
    "an array": np.zeros((3, 3)),
    "a lazy frame": pl.DataFrame({"a": [1]}).lazy(),
    "an empty list": [],
}
COLUMNS = {
    "no samples": {name: [] for name in NAMES},
    "two dimensions": {"time": np.zeros((3, 2))},
    "a number for a name": {1: [1.0]},
    "a frame without names": pd.DataFrame({0: [1.0]}),
    "a missing time": {**OTHERS, "time [s]": [0.0, None, 0.2]},
    "letters for times": {**OTHERS, "time [s]": ["a", "b", "c"]},
    "a masked array": {**OTHERS, "time [s]": np.ma.masked_greater([0.0, 1.0, 9.0], 2.0)},
    "dates": {**OTHERS, "time [s]": pl.Series([date(2026, 1, d) for d in (1, 2, 3)])},
}


def test_what_holds_no_log(refusals):
    """Assert that the message names the argument and valid kinds of logs, or the bad column."""
    refusals(
        {name: partial(flexid.identify, given) for name, given in NO_LOG.items()}
        | {name: partial(flexid.read_log, given) for name, given in COLUMNS.items()}
    )
    # The message of the library that makes the table.
    with pytest.raises(RecordingError, match="motor_torque"):
        flexid.read_log({"time": [0.0, 1.0], "motor_torque": [1.0]})
    with pytest.raises(RecordingError, match="'time' 2 times"):
        flexid.read_log(pd.DataFrame([[0.0, 1.0]], columns=["time", "time"]))


def test_a_log_is_taken_as_it_is(arrays, tmp_path):
    """Assert that logs and recordings are used unchanged, without a column map for them."""
    log = flexid.read_log(arrays)
    assert flexid.read_log(log) is log
    (recording,) = log.recordings
    alone = flexid.read_log(recording)
    assert alone.recordings == (recording,)
    assert all_logs([log, recording, arrays], None)[0] is log
    log = flexid.read_log(arrays)
    with pytest.raises(SettingError, match="columns"):
        flexid.read_log(log, columns=tmp_path / "map.toml")


@pytest.mark.parametrize(("most", "said"), [(199, ["200 samples take minutes"]), (200, [])])
def test_many_samples_are_said_to_take_long(arrays, monkeypatch, caplog, most, said):
    """Assert that a long log is announced at the start, and no shorter one."""
    monkeypatch.setattr("flexid.library.identify._MANY", most)
    monkeypatch.setattr("flexid.identification.identify.identify", lambda *_: None)
    caplog.set_level("INFO", "flexid")
    flexid.identify(arrays)
    assert [message.partition(":")[0] for message in caplog.messages] == said
