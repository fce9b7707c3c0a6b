"""Logs of other formats as streams, and when their samples are due."""

import time
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from moving_joint import CHOSEN, LINK, MOTOR, TIME, TORQUE, H, same, stream, watched

from flexid.errors import RecordingError, SettingError
from flexid.streaming import incoming
from flexid.streaming.follower import Follower
from flexid.streaming.incoming import LONGEST_WAIT, Pace, Replay

NAMES = {"time": TIME, "link_position": LINK, "motor_position": MOTOR, "motor_torque": TORQUE}


def written(path: Path, samples: np.ndarray) -> Path:
    """The samples as a Parquet file."""
    frame = pl.DataFrame({name: samples[:, column] for name, column in NAMES.items()})
    frame.write_parquet(path, row_group_size=130)  # what is read at once
    return path


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """A clock on the wall that only sleep moves, from 0 s on."""
    now = [0.0]

    def sleep(seconds: float) -> None:
        now[0] += seconds

    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    monkeypatch.setattr(time, "sleep", sleep)
    return now


def test_a_whole_log_is_watched_as_its_samples_are(tmp_path: Path):
    """Assert that playing a log at once is feeding it."""
    samples = stream(3.0)
    follower = Follower(str(written(tmp_path / "log.parquet", samples)), CHOSEN, stop_at_end=True)
    reports = sum(follower.turns(1.0))
    assert reports == 3
    assert follower.session is not None
    assert same(follower.session, watched(samples))


def test_an_encoder_in_front_of_a_gear_wraps_by_what_the_column_map_says(tmp_path: Path):
    """Assert that the gear ratio of a column map reaches the session."""
    samples = stream(3.0)
    samples[:, MOTOR] = np.mod(40.0 * samples[:, MOTOR], 2.0 * np.pi)
    path = written(tmp_path / "log.parquet", samples)
    gear = {"gear_ratio": 40, "motor_torque": {"column": "motor_torque", "side": "link"}}
    follower = Follower(str(path), CHOSEN, column_map=gear, stop_at_end=True)
    assert sum(follower.turns(1.0)) == 3
    assert follower.session is not None
    right, found = watched(stream(3.0)), follower.session
    assert found.counts.wraps > 20
    values = [session.learner.values(session.now.states) for session in (found, right)]
    np.testing.assert_allclose(values[0], values[1], rtol=1e-6)


def test_a_parquet_file_is_read_in_blocks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Assert that no more rows than a block's are read at once, and none is lost between two."""
    samples = stream(3.0)
    samples[700:705, TIME] -= 0.5  # late ones, at the end of a block and after it
    path = written(tmp_path / "log.parquet", samples)
    monkeypatch.setattr(incoming, "BLOCK", 100)
    replay, found = Replay(path, None, at_once=True), []
    while (part := replay.read(last=False)) is not None:
        found.append(part)
    assert max(map(len, found)) <= 130
    np.testing.assert_array_equal(np.concatenate(found), samples)


def test_an_mcap_file_is_watched(tmp_path: Path):
    """Assert the same of joint states in an MCAP file, with a column map for their topics."""
    pytest.importorskip("mcap", reason="mcap is not installed")
    import json

    from mcap.writer import Writer

    samples = stream(1.0)
    path = tmp_path / "log.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("drive", "jsonschema", b'{"type": "object"}')
        channel = writer.register_channel("drive", "json", schema)
        for t, link, motor, torque in samples:
            message = json.dumps({"link": link, "motor": motor, "torque": torque}).encode()
            stamp = round(1e9 * t)
            writer.add_message(channel, stamp, message, stamp)
        writer.finish()
    columns = {
        "link_position": {"column": "drive.link", "unit": "rad"},
        "motor_position": {"column": "drive.motor", "unit": "rad"},
        "motor_torque": {"column": "drive.torque", "unit": "N m"},
    }
    replay = Replay(path, columns, at_once=True)
    found = replay.read(last=False)
    assert found is not None
    np.testing.assert_allclose(found[:, 1:], samples[:, 1:], rtol=1e-12)
    np.testing.assert_allclose(np.diff(found[:, 0]), H, rtol=1e-6)
    assert replay.read(last=False) is None
    follower = Follower(str(path), CHOSEN, column_map=columns, stop_at_end=True)
    for _ in follower.turns(1.0):
        assert len([w for w in follower.warnings if "carry no time stamps" in w]) == 1


@pytest.mark.parametrize("block", [70, 10_000])
def test_its_own_pace(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, clock: list[float], block: int
):
    """Assert that samples come when they came, and those of a clock that was set back at once."""
    monkeypatch.setattr(incoming, "BLOCK", block)
    samples = stream(1.0)
    samples[256:, TIME] -= 0.5  # within a block, some of which is due later
    replay = Replay(written(tmp_path / "log.parquet", samples), None, at_once=False)
    came = np.empty(0)
    while (found := replay.read(last=False)) is not None:
        came = np.append(came, np.full(len(found), clock[0]))
    due = np.maximum.accumulate(samples[:, TIME])
    assert len(came) == len(samples)
    assert (came >= due - 1e-9).all()
    assert (came <= due + 0.11).all()


def test_a_stamp_in_the_future_holds_nobody_up(tmp_path: Path, clock: list[float]):
    """Assert that a sample from the next century delays others by a second, and is said."""
    samples = stream(3.0)
    samples[100, TIME] += 3e9
    replay = Replay(written(tmp_path / "log.parquet", samples), None, at_once=False)
    while replay.read(last=False) is not None:
        assert clock[0] < 10.0
    assert clock[0] == pytest.approx(4.0, abs=0.2)
    assert "time stamps jump ahead by more than 1 s" in replay.warnings[-1]


def test_what_cannot_be_played(tmp_path: Path):
    """Assert that a log without an input, and a header for one, are refused."""
    log = tmp_path / "log.parquet"
    pl.DataFrame({"time": [0.0, 1.0], "motor_position": [0.0, 1.0]}).write_parquet(log)
    with pytest.raises(RecordingError, match="no motor_torque"):
        Replay(log, None, at_once=True)
    with pytest.raises(SettingError, match="leave it out"):
        next(iter(Follower(str(log), CHOSEN, header="time").turns(1.0)))


STEP = 0.01
TIMES = 5.0 + STEP * np.arange(1000)
PLACES = np.arange(1000) >= 400


def due(times: np.ndarray, cut: int = 1000) -> tuple[np.ndarray, int]:
    """Due times, from two blocks, and how many jumps were counted."""
    pace = Pace()
    parts = [part for part in np.split(times, [cut]) if len(part)]
    return np.concatenate([pace.due(part) for part in parts]), pace.jumps


@pytest.mark.parametrize("cut", [1000, 399, 400, 401])
@pytest.mark.parametrize("ahead", [3600.0, 1e308])
def test_one_stamp_in_the_future(cut: int, ahead: float):
    """Assert that it is waited for a second once, however the samples are cut into blocks."""
    times = TIMES.copy()
    times[400] += ahead
    found, jumps = due(times, cut)
    assert jumps == 1
    right = TIMES - TIMES[0] + np.where(PLACES, LONGEST_WAIT, 0.0)
    np.testing.assert_allclose(found, right, atol=3 * STEP)


@pytest.mark.parametrize("cut", [1000, 400])
@pytest.mark.parametrize(("by", "wait"), [(3600.0, LONGEST_WAIT), (-3.0, 0.0), (0.9, 0.9)])
def test_a_clock_that_goes_on_elsewhere(cut: int, by: float, wait: float):
    """Assert that a pause is cut short, and a clock that is set back holds nobody up."""
    found, jumps = due(np.where(PLACES, TIMES + by, TIMES), cut)
    assert jumps == (by > LONGEST_WAIT)
    right = TIMES - TIMES[0] + np.where(PLACES, wait - STEP * (wait != 0.9), 0.0)
    np.testing.assert_allclose(found, right, atol=2 * STEP)


def test_late_samples_come_with_those_before_them():
    """Assert that no delay is waited for twice."""
    times = TIMES.copy()
    times[300:305] -= 0.5
    found, jumps = due(times)
    assert jumps == 0
    np.testing.assert_allclose(found, np.maximum.accumulate(times) - TIMES[0], atol=1e-9)


def test_a_clock_that_returns_after_long():
    """Assert that what it says then again comes at its own pace, not all at once."""
    times = np.concatenate((TIMES, 60.0 + TIMES, TIMES[-1] + TIMES - TIMES[0]))
    found, jumps = due(times)
    assert jumps == 1
    assert found[-1] == pytest.approx(3 * 1000 * STEP + LONGEST_WAIT, abs=4 * STEP)
