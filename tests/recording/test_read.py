"""Reading of usable logs: channels, units, inputs, times, and an overview of unknown columns."""

import hashlib
import io
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from joint_log import (
    assert_equal_logs,
    csv_text,
    joint_columns,
    read_columns,
    said,
    without,
    written,
)
from log_files import hdf5
from numpy.typing import NDArray

import flexid
from flexid.arrays import FloatArray
from flexid.errors import RecordingError
from flexid.recording import read_log
from flexid.recording.series import overview

CHANNELS = ("link_position", "motor_position", "link_velocity", "motor_velocity")


def test_canonical_columns(tmp_path: Path) -> None:
    """Assert that every channel is read bit for bit, with the digest of its file."""
    columns = joint_columns()
    path = written(tmp_path, csv_text(columns))
    log = read_log(path)
    assert (log.warnings, log.source) == ((), str(path))
    assert log.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    (recording,) = log.recordings
    assert recording.sample_time == pytest.approx(0.005, rel=1e-12)
    assert (recording.start_time, recording.input_unit) == (0.0, "N m")
    np.testing.assert_array_equal(recording.input, columns["motor_torque"])
    for name in CHANNELS:
        np.testing.assert_array_equal(getattr(recording, name), columns[name])


def test_standard_input(monkeypatch: pytest.MonkeyPatch) -> None:
    """Assert that text from standard input is read like a file, and named in messages."""
    columns = joint_columns()
    text = csv_text(columns)
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(text.encode())))
    (recording,) = read_log(Path("-")).recordings
    np.testing.assert_array_equal(recording.input, columns["motor_torque"])
    monkeypatch.setattr(sys, "stdin", None)
    with pytest.raises(RecordingError, match="standard input: it is closed"):
        read_log(Path("-"))
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(b"")))
    with pytest.raises(RecordingError, match="standard input: the file is empty"):
        read_log(Path("-"))


def test_xarray() -> None:
    """Assert that a data set's coordinate is a column, and that its attributes are units."""
    xarray = pytest.importorskip("xarray")
    columns = joint_columns()
    channels: dict[str, Any] = {
        name: ("time", values) for name, values in columns.items() if name != "time"
    }
    degrees = np.degrees(columns["link_position"])
    channels["link_position"] = ("time", degrees, {"units": "deg"})
    data = xarray.Dataset(channels, coords={"time": columns["time"], "rig": 7})
    assert_equal_logs(flexid.read_log(data), read_columns(columns), rtol=1e-12)


def rows(kept: NDArray[Any]) -> dict[str, FloatArray]:
    """Return some samples of all columns."""
    return {name: values[kept] for name, values in joint_columns().items()}


def jittered(share: float, count: int = 2000) -> dict[str, FloatArray]:
    """Return a motion with sampling jitter of up to `share` of a step."""
    offset = share * 0.005 * np.random.default_rng(7).uniform(-1.0, 1.0, count)
    time = 0.005 * np.arange(count) + offset
    motor = np.sin(2.0 * time)
    link = {"link_position": motor + 0.05 * np.sin(9.0 * time), "motor_position": motor}
    return {"time": time, **link, "motor_torque": np.cos(3.0 * time)}


def late_stamps(kind: str, steps: float) -> FloatArray:
    """Return 2000 even times with delayed stamps; the delays are in steps."""
    rng = np.random.default_rng(8)
    late = rng.uniform(0.0, steps, 2000) if kind == "uniform" else rng.exponential(steps, 2000)
    return np.sort(0.005 * (np.arange(2000) + np.minimum(late, 3.0))).astype(np.float64)


def test_a_quarter_of_the_samples_is_lost() -> None:
    """Assert that lost samples are interpolated."""
    kept = np.sort(np.random.default_rng(9).choice(2000, 1500, replace=False))
    columns = {name: values[kept] for name, values in jittered(0.0).items()}
    log = read_columns(columns)
    assert sum(map(len, log.recordings)) > 1450
    for recording in log.recordings:
        exact = np.sin(2.0 * recording.time) + 0.05 * np.sin(9.0 * recording.time)
        assert np.abs(recording.needed_link_position - exact).max() < 2e-6


def test_what_interpolation_leaves_alone() -> None:
    """Assert unchanged samples for a time with few digits, and a switched input in its levels."""
    columns = jittered(0.0005)
    log = read_columns(columns)
    assert log.warnings == ()
    np.testing.assert_array_equal(log.recordings[0].link_position, columns["link_position"])
    assert log.recordings[0].sample_time == pytest.approx(0.005, rel=1e-6)
    columns = jittered(0.08)
    columns["motor_torque"] = np.sign(columns["motor_torque"])
    assert np.abs(read_columns(columns).recordings[0].needed_input).max() <= 1.0
    columns["motor_torque"][5:9] = [0.0, 5e-324, 1e-323, 1.5e-323]
    assert np.isfinite(read_columns(columns).recordings[0].needed_input).all()


def coarse(columns: dict[str, FloatArray]) -> dict[str, FloatArray]:
    """Return the log with times in whole milliseconds."""
    return {**columns, "time": np.round(columns["time"], 3)}


@pytest.mark.parametrize("rate", [300.0, 400.0, 450.0, 600.0, 900.0, 970.0, 995.0, 1500.0, 2000.0])
def test_whole_milliseconds_are_even(rate: float) -> None:
    """Assert that times on an even grid, rounded to their last digit, count as even."""
    columns = coarse(joint_columns(sample_time=1.0 / rate))
    log = read_columns(columns)
    (recording,) = log.recordings
    assert recording.sample_time == pytest.approx(1.0 / rate, rel=1e-4)
    # Interpolation to even times would change positions by 1e-3 rad.
    np.testing.assert_array_equal(recording.link_position, columns["link_position"])
    (warning,) = log.warnings
    assert re.search("rounded to 1 ms; they fit even steps.*the time with more digits", warning)


COLUMNS = joint_columns()
TORQUE = COLUMNS["motor_torque"]
INPUTS = ("motor_torque [Nm]", "motor_torque [V]", "motor_torque [mA]", "motor_current")
NO_INPUT = without(COLUMNS, "torque")
MOTOR = without(COLUMNS, "link")
FAST = {**without(MOTOR, "velocity"), "motor_position": np.degrees(COLUMNS["motor_position"])}
EVERY = np.arange(400)
RNG = np.random.default_rng(10)
NINETEENS = np.concatenate([np.arange(start, start + 19) for start in range(0, 380, 25)])
SAID: dict[str, dict[str, FloatArray]] = {
    **{header: without(NO_INPUT, "link_vel") | {header: TORQUE} for header in INPUTS},
    "a voltage": NO_INPUT | {"motor_voltage": TORQUE},
    "torque and current": COLUMNS | {"motor_current": 2.0 * TORQUE},
    "a column that nobody knows": COLUMNS | {"note": TORQUE},
    "no input": NO_INPUT,
    "a misspelt input": NO_INPUT | {"motor_torqe": TORQUE},
    "no link": MOTOR,
    "a misspelt link": MOTOR | {"lnk_position": COLUMNS["link_position"]},
    "a deflection": without(COLUMNS, "link_position")
    | {"deflection": COLUMNS["link_position"] - COLUMNS["motor_position"]},
    "a link's velocity alone": MOTOR | {"link_velocity": COLUMNS["link_velocity"]},
    "a motor alone": without(MOTOR, "torque"),
    "a motor in degrees": FAST,
    "a gap": rows(np.r_[0:150, 190:400]),
    "a lost sample": rows(np.delete(EVERY, 100)),
    "ten samples between two gaps": rows(np.r_[0:200, 210:220, 230:400]),
    "nineteen between gaps": rows(NINETEENS),
    "much jitter": jittered(0.22),
    "the same in milliseconds": coarse(jittered(0.22)),
    **{
        f"stamps late by {steps} {kind}": joint_columns(2000) | {"time": late_stamps(kind, steps)}
        for kind, steps in (("uniform", 0.1), ("uniform", 0.9), ("exponential", 0.3))
    },
    "times of events": jittered(0.0) | {"time": np.cumsum(5e-3 * RNG.pareto(1.2, 2000))},
    "5 kHz in milliseconds": coarse(joint_columns(sample_time=1.0 / 5000.0)),
    "a slower rate": rows(np.r_[0:200, 200:400:4]),
    "a faster rate": rows(np.r_[0:200:4, 200:400]),
}


def test_what_is_said_of_channels(golden: Any) -> None:
    """Assert the channels that are read, the warnings, and that uneven times are refused."""
    golden({name: said(read_columns, columns) for name, columns in SAID.items()})


def thirty_rows(cells: str) -> str:
    """Return thirty rows, each with its number."""
    return "".join(f"{k},{cells.format(k=k)}\n" for k in range(30))


def parquet(folder: Path) -> Path:
    """Write a table with an empty cell."""
    table = pl.DataFrame({"time": [0.0, 0.1], "motor_position": [None, 1 / 3]})
    table.write_parquet(folder / "a.parquet")
    return folder / "a.parquet"


SIGNALS = {f"run/{name}": [0.0, 0.1, 0.2] for name in ("time", "motor_position")}
FILES: dict[str, Callable[[Path], Path]] = {
    "names": lambda p: written(p, f"time [ms],q_motor_deg,tau,other\n{thirty_rows('{k}.50,1,x')}"),
    "names that say little": lambda p: written(p, f"t,enc1,tau\n{thirty_rows('{k},{k}')}"),
    "a table": parquet,
    "long cells": lambda p: written(p, f"time,text\n0,{'x' * 5000}\n1,y\n"),
    "signals": lambda p: hdf5(p / "a.h5", SIGNALS),
}


def test_what_files_hold(tmp_path: Path, golden: Any) -> None:
    """Assert columns, units, first values, types and channels, or the reason for none."""
    found = {}
    for name, write in FILES.items():
        one = overview(write(tmp_path))
        columns = [f"{c.header!r} in {c.unit!r} {c.kind} {c.cells}" for c in one.columns]
        unclear = one.unclear.partition(";")[0]
        found[name] = f"{one.rows} rows; {'; '.join(columns)}; {one.channels}; {unclear}"
    golden(found)
