"""What a file holds before its columns are known, and what a log shows at a glance."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from joint_log import written
from log_files import hdf5

from flexid.recording.overview import overview, survey
from flexid.recording.recording import Log, Recording


def rows(cells: str) -> str:
    """Thirty rows, each with its number."""
    return "".join(f"{k},{cells.format(k=k)}\n" for k in range(30))


def parquet(folder: Path) -> Path:
    """A table with an empty cell."""
    table = pl.DataFrame({"time": [0.0, 0.1], "motor_position": [None, 1 / 3]})
    table.write_parquet(folder / "a.parquet")
    return folder / "a.parquet"


SIGNALS = {f"run/{name}": [0.0, 0.1, 0.2] for name in ("time", "motor_position")}
FILES: dict[str, Callable[[Path], Path]] = {
    "names": lambda p: written(p, f"time [ms],q_motor_deg,tau,other\n{rows('{k}.50,1,x')}"),
    "names that say little": lambda p: written(p, f"t,enc1,tau\n{rows('{k},{k}')}"),
    "a table": parquet,
    "long cells": lambda p: written(p, f"time,text\n0,{'x' * 5000}\n1,y\n"),
    "signals": lambda p: hdf5(p / "a.h5", SIGNALS),
}


def test_what_files_hold(tmp_path: Path, golden: Any) -> None:
    """Assert that columns, units, first values, types and channels are found, or why not."""
    found = {}
    for name, write in FILES.items():
        one = overview(write(tmp_path))
        columns = [f"{c.header!r} in {c.unit!r} {c.kind} {c.cells}" for c in one.columns]
        unclear = one.unclear.partition(";")[0]
        found[name] = f"{one.rows} rows; {'; '.join(columns)}; {one.channels}; {unclear}"
    golden(found)


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


def test_model_and_recordings():
    """Assert that what is missing says what can be asked for, and that gaps are counted."""
    assert survey(log(input=None, input_unit="")).model == "link"
    rigid = survey(log(link_position=None))
    assert rigid.model == "rigid"
    assert np.isnan(rigid.deflection_over_noise)
    base = log().recordings[0]
    found = survey(Log((base.window(0, 1000), base.window(2000, 4000)), (), "log", ""))
    assert (found.recordings, found.samples) == (2, 3000)
    assert found.duration == pytest.approx(15.0)
