"""Logs of other formats as streams."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest
from moving_joint import CHOSEN, LINK, MOTOR, TIME, TORQUE, followed, same, stream, watched

from flexid.library.watched import Watch
from flexid.streaming import incoming
from flexid.streaming.incoming import Replay

NAMES = {"time": TIME, "link_position": LINK, "motor_position": MOTOR, "motor_torque": TORQUE}


def written(path: Path, samples: np.ndarray) -> Path:
    """The samples as a Parquet file."""
    frame = pl.DataFrame({name: samples[:, column] for name, column in NAMES.items()})
    frame.write_parquet(path, row_group_size=130)  # what is read at once
    return path


def test_a_whole_log_is_watched_as_its_samples_are(tmp_path: Path):
    """Assert that playing a log at once is feeding it."""
    samples = stream(3.0)
    watch = Watch(str(written(tmp_path / "log.parquet", samples)), CHOSEN, stop_at_end=True)
    assert sum(watch.turns()) == 3
    assert same(watch.result, watched(samples))


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
    """Assert that no more rows than a block's are read at once, and none is lost between two."""
    samples = stream(3.0)
    samples[700:705, TIME] -= 0.5  # late ones, at the end of a block and after it
    path = written(tmp_path / "log.parquet", samples)
    monkeypatch.setattr(incoming, "BLOCK", 100)
    found = [*Replay(path, None)]
    assert max(map(len, found)) <= 130
    np.testing.assert_array_equal(np.concatenate(found), samples)
