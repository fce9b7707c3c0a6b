"""Logs as their publishers ship them become the logs that the pages are about."""

import re
import runpy
import sys
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from scipy.io import savemat

ROOT = Path(__file__).parents[2]
SCRIPT = ROOT / "examples" / "real_logs" / "from_matlab.py"
PAGE = ROOT / "docs" / "real-logs.md"
FIELDS = (
    "act_pos_se_deg",
    "act_vel_se_deg_per_s",
    "act_pos_mot_deg",
    "act_vel_mot_deg_per_s",
    "act_torque_abs_nm",
)


def convert(monkeypatch: pytest.MonkeyPatch, *arguments: object) -> None:
    """Run the script as a shell would."""
    monkeypatch.setattr(sys, "argv", [str(SCRIPT), *map(str, arguments)])
    runpy.run_path(str(SCRIPT), run_name="__main__")


def write_arm(path: Path, columns: pl.DataFrame) -> None:
    """Write a scope of Simulink as MATLAB saves it."""
    values = columns.select("u_V", "pot_V", "strain_V").to_numpy()
    signals = {"values": values, "dimensions": 3.0, "label": "scope"}
    scope = {"time": columns["t_s"].to_numpy()[:, None], "signals": signals, "blockName": "x"}
    savemat(path, {"Input": scope})


def write_kuka(path: Path, columns: pl.DataFrame) -> None:
    """Write a structure of six axes, of which three have an encoder on the link."""
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
    """Assert that the publisher's structure gives the log, with the digest that the page names."""
    columns = pl.read_csv(shared_data / log, infer_schema_length=None)
    write = write_arm if kind == "ist-arm" else write_kuka
    write(tmp_path / "log.mat", columns.cast(pl.Float64))
    convert(monkeypatch, kind, tmp_path / "log.mat", tmp_path / "log.csv")
    assert (tmp_path / "log.csv").read_bytes() == (shared_data / log).read_bytes()
    printed = capsys.readouterr().out
    shown = re.search(r"\d+ samples, every .* ms, SHA-256 \w{16}", printed)
    assert shown is not None
    assert shown[0] in PAGE.read_text(encoding="utf-8")
