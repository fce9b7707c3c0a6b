"""A simulated log as a logger writes it, and back by the column map that is shipped for it."""

import runpy
import sys

import numpy as np
import polars as pl

from flexid.recording.read import read_log


def test_the_column_map_undoes_what_the_logger_did(examples, tmp_path, monkeypatch):
    """Assert that counts, gear and units come back, and that the link alone is two samples late."""
    time = 1e-3 * np.arange(400)
    link, motor = 0.3 * np.sin(9.0 * time), 0.31 * np.sin(9.0 * time)
    torque = 40.0 * np.cos(9.0 * time)
    names = ("time [s]", "link_position [rad]", "motor_position [rad]", "motor_torque [N m]")
    log, raw = tmp_path / "log.csv", tmp_path / "raw.csv"
    columns = dict(zip(names, (time, link, motor, torque), strict=True))
    pl.DataFrame({**columns, "other": time}).write_csv(log)
    monkeypatch.setattr(sys, "argv", ["raw_log.py", str(log), str(raw)])
    runpy.run_path(str(examples / "raw_log.py"), run_name="__main__")
    found = read_log(raw, examples / "columns_geared_drive.toml")
    (recording,) = found.recordings
    step = 2.0 * np.pi / (8192 * 101)
    np.testing.assert_allclose(recording.motor_position, motor[2:], atol=0.51 * step)
    np.testing.assert_allclose(recording.needed_link_position, link[:-2], atol=1e-7)
    np.testing.assert_allclose(recording.needed_input, torque[2:], atol=1e-4)
    assert recording.sample_time == 1e-3
