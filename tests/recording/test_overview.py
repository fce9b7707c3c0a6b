"""What a file holds before its columns are known, and what a log shows at a glance."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from joint_log import written
from log_files import hdf5

from flexid.recording.overview import overview, survey
from flexid.recording.recording import Log, Recording


def test_names_that_say_it_all(tmp_path: Path):
    """Assert that columns, units, first values and channels are found."""
    rows = "".join(f"{k},{k}.50,1,x\n" for k in range(30))
    found = overview(written(tmp_path, f"time [ms],q_motor_deg,tau,other\n{rows}"))
    assert found.rows == 30
    assert [(c.header, c.unit) for c in found.columns] == [
        ("time [ms]", "ms"),
        ("q_motor_deg", "deg"),
        ("tau", ""),
        ("other", ""),
    ]
    assert found.columns[1].cells == ("0.50", "1.50", "2.50", "3.50", "4.50")
    assert found.channels == {
        "time": "time [ms]",
        "motor_position": "q_motor_deg",
        "motor_torque": "tau",
    }
    assert found.unclear == ""


def test_names_that_do_not(tmp_path: Path):
    """Assert that the reason is given, and what can be guessed all the same."""
    rows = "".join(f"{k},{k},{k}\n" for k in range(30))
    found = overview(written(tmp_path, f"t,enc1,tau\n{rows}"))
    assert "motor_position" in found.unclear
    assert found.channels == {"time": "t", "motor_torque": "tau"}


def test_typed_columns(tmp_path: Path):
    """Assert that Parquet is looked into as text is, and that empty cells stay empty."""
    path = tmp_path / "a.parquet"
    pl.DataFrame({"time": [0.0, 0.1], "motor_position": [None, 1 / 3]}).write_parquet(path)
    found = overview(path)
    assert found.rows == 2
    assert found.columns[0].cells == ("0", "0.1")
    assert found.columns[1].cells == ("", "0.333333333")


def test_long_cells_are_cut(tmp_path: Path):
    """Assert that no cell fills the page."""
    path = written(tmp_path, f"time,text\n0,{'x' * 5000}\n1,y\n")
    assert len(overview(path).columns[1].cells[0]) < 30


def test_signals_of_a_file(tmp_path: Path):
    """Assert that a file of signals says what each is."""
    times = [0.0, 0.1, 0.2]
    arrays = {"run/time": times, "run/motor_position": times}
    found = overview(hdf5(tmp_path / "a.h5", arrays))
    assert found.rows == 3
    assert {c.header for c in found.columns} == {"run/time", "run/motor_position"}
    assert all("3 values" in c.kind for c in found.columns)
    assert found.channels["motor_position"] == "run/motor_position"


RATE = 200.0  # Hz
NOISE = 1e-4  # rad


def log(**changes: object) -> Log:
    """Return 20 s in which a motor goes to and fro at 0.5 Hz, and the link a little less."""
    random = np.random.default_rng(1)
    time = np.arange(4000) / RATE
    motor = np.sin(np.pi * time)
    recording = Recording(
        sample_time=1 / RATE,
        start_time=0.0,
        link_position=0.9 * motor + NOISE * random.standard_normal(len(time)),
        motor_position=motor + NOISE * random.standard_normal(len(time)),
        input=3.0 * np.sin(2 * np.pi * 2.0 * time),
        input_unit="N m",
    )
    return Log((replace(recording, **changes),), (), "log", "")  # type: ignore[arg-type]


def test_figures_of_a_known_motion():
    """Assert that rate, duration, reversals and deflection are those of the motion."""
    found = survey(log())
    assert found.model == "flexible"
    assert (found.samples, found.recordings) == (4000, 1)
    assert found.duration == pytest.approx(20.0)
    assert found.reversals == 20
    truth = 0.1 / np.sqrt(2) / (NOISE * np.sqrt(2))
    assert found.deflection_over_noise == pytest.approx(truth, rel=0.2)


def test_model_follows_from_the_channels():
    """Assert that what is missing says what can be asked for."""
    assert survey(log(input=None, input_unit="")).model == "link"
    rigid = survey(log(link_position=None))
    assert rigid.model == "rigid"
    assert np.isnan(rigid.deflection_over_noise)


def test_several_recordings():
    """Assert that gaps are counted, and all stretches looked at."""
    base = log().recordings[0]
    found = survey(Log((base.window(0, 1000), base.window(2000, 4000)), (), "log", ""))
    assert found.recordings == 2
    assert found.samples == 3000
    assert found.duration == pytest.approx(15.0)
