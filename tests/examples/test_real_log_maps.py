"""Pages on real logs: conversion of publishers' files, and column maps."""

import hashlib
import re
import runpy
import sys
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from scipy.io import savemat

from flexid.recording.read import read_log

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "real-logs.md"
LOGS = {  # column map, samples, sample time in s, unit of the input, and the warnings
    "ist-flexible-arm/ist_square_1p5V.csv": ("columns_voltage_arm.toml", 2001, 0.01, "V", ""),
    "dfki-pendulum/ddp.csv": ("columns_pendulum.toml", 3000, 0.002, "N m", "no link_position"),
    "kr300/kr300_A.csv": ("columns_kuka_axis_1.toml", 2501, 0.004, "N m", ""),
    "kr300/kr300_B.csv": ("columns_kuka_axis_1.toml", 2501, 0.004, "N m", ""),
}


@pytest.mark.parametrize("name", LOGS)
def test_a_page_s_column_map_reads_its_log(shared_data, examples, name):
    """Assert that the log has the digest shown on the page, and that all of it is read."""
    columns, count, sample_time, unit, words = LOGS[name]
    path = shared_data / name
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    assert digest[:16] in PAGE.read_text(encoding="utf-8")
    log = read_log(path, examples / columns)
    assert sum(len(recording) for recording in log.recordings) >= count - 1
    assert log.recordings[0].sample_time == pytest.approx(sample_time, rel=2e-3)
    assert log.recordings[0].input_unit == unit
    assert bool(log.warnings) == bool(words)
    assert words in " ".join(log.warnings)
    assert not any("did you mean" in warning for warning in log.warnings)


SCRIPT = ROOT / "examples" / "real_logs" / "from_matlab.py"
FIELDS = (
    "act_pos_se_deg",
    "act_vel_se_deg_per_s",
    "act_pos_mot_deg",
    "act_vel_mot_deg_per_s",
    "act_torque_abs_nm",
)


def convert(monkeypatch: pytest.MonkeyPatch, *arguments: object) -> None:
    """Run the script as from a shell."""
    monkeypatch.setattr(sys, "argv", [str(SCRIPT), *map(str, arguments)])
    runpy.run_path(str(SCRIPT), run_name="__main__")


def write_arm(path: Path, columns: pl.DataFrame) -> None:
    """Write a Simulink scope as MATLAB saves it."""
    values = columns.select("u_V", "pot_V", "strain_V").to_numpy()
    signals = {"values": values, "dimensions": 3.0, "label": "scope"}
    scope = {"time": columns["t_s"].to_numpy()[:, None], "signals": signals, "blockName": "x"}
    savemat(path, {"Input": scope})


def write_kuka(path: Path, columns: pl.DataFrame) -> None:
    """Write a structure of six axes, three of which have a link encoder."""
    rows = columns.drop("t_s").to_numpy().T.reshape(3, 5, -1)
    axes = np.concatenate([rows, np.zeros_like(rows)])
    savemat(path, {"rec": {field: axes[:, k] for k, field in enumerate(FIELDS)}})


@pytest.mark.parametrize(
    ("kind", "log"),
    [
        ("ist-arm", "ist-flexible-arm/ist_square_1p5V.csv"),
        ("kuka", "kr300/kr300_A.csv"),
        ("kuka", "kr300/kr300_B.csv"),
    ],
)
def test_real_logs(
    kind: str,
    log: str,
    shared_data: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Assert that the publisher's structure gives the log with the digest on the page."""
    columns = pl.read_csv(shared_data / log, infer_schema_length=None)
    write = write_arm if kind == "ist-arm" else write_kuka
    write(tmp_path / "log.mat", columns.cast(pl.Float64))
    convert(monkeypatch, kind, tmp_path / "log.mat", tmp_path / "log.csv")
    assert (tmp_path / "log.csv").read_bytes() == (shared_data / log).read_bytes()
    printed = capsys.readouterr().out
    shown = re.search(r"\d+ samples, every .* ms, SHA-256 \w{16}", printed)
    assert shown is not None
    assert shown[0] in PAGE.read_text(encoding="utf-8")
