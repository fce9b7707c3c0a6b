"""Overview of a file whose columns are unknown."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import polars as pl
from joint_log import written
from log_files import hdf5

from flexid.recording.series import overview


def rows(cells: str) -> str:
    """Return thirty rows, each with its number."""
    return "".join(f"{k},{cells.format(k=k)}\n" for k in range(30))


def parquet(folder: Path) -> Path:
    """Write a table with an empty cell."""
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
    """Assert columns, units, first values, types and channels, or the reason for none."""
    found = {}
    for name, write in FILES.items():
        one = overview(write(tmp_path))
        columns = [f"{c.header!r} in {c.unit!r} {c.kind} {c.cells}" for c in one.columns]
        unclear = one.unclear.partition(";")[0]
        found[name] = f"{one.rows} rows; {'; '.join(columns)}; {one.channels}; {unclear}"
    golden(found)
