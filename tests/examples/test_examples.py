"""The examples: scripts, logs and column maps, and conversion of publishers' files."""

import hashlib
import importlib.util
import re
import runpy
import sys
import tomllib
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import polars as pl
import pytest
from numpy.typing import NDArray
from scipy.io import savemat

from flexid.recording.read import read_log
from flexid.studies.runs import PHYSICAL
from made_estimates import TRUE


@pytest.mark.thorough
def test_the_example_runs(examples, tmp_path, monkeypatch, capsys):
    """Assert that the example identifies the joint, validates it, and writes its files."""
    script = examples / "library.py"
    arguments = [str(script), str(examples / "flexible_joint.csv"), str(tmp_path)]
    monkeypatch.setattr(sys, "argv", arguments)
    runpy.run_path(str(script), run_name="__main__")
    printed = capsys.readouterr().out
    assert "joint_stiffness: 100.000" in printed
    assert "resonance with the motor locked: 10.000 rad/s" in printed
    assert "parameters: 5 determined" in printed
    assert {path.name for path in tmp_path.iterdir()} >= {"estimate.json", "fit.png"}


def test_a_bad_log_ends_it_with_a_sentence(examples, tmp_path):
    """Assert that one except clause catches all errors of a bad log."""
    main = runpy.run_path(str(examples / "library.py"))["main"]
    with pytest.raises(SystemExit, match="no such file"):
        main(tmp_path / "missing.csv", tmp_path)


@pytest.fixture(scope="module")
def script(examples: Path) -> ModuleType:
    """Return the script as a module."""
    file = examples / "make_flexible_joint_log.py"
    specification = importlib.util.spec_from_file_location(file.stem, file)
    assert specification is not None
    assert specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def committed(examples: Path) -> NDArray[np.float64]:
    """Return the committed log."""
    return np.loadtxt(examples / "flexible_joint.csv", delimiter=",", skiprows=1)


def test_log_and_truth_are_what_the_script_makes(
    script: ModuleType, committed: NDArray[np.float64], examples: Path
) -> None:
    """Assert times and torques, angles within two counts, and the truth, which is Table I."""
    remade = script.log()
    assert remade.shape == committed.shape
    np.testing.assert_allclose(remade[:, [0, 3]], committed[:, [0, 3]], rtol=0, atol=1e-9)
    two_counts = 2 * 2 * np.pi / 65536
    np.testing.assert_allclose(remade[:, 1:3], committed[:, 1:3], rtol=0, atol=two_counts)
    text = (examples / "flexible_joint_truth.toml").read_text(encoding="utf-8")
    assert text == script.truth()
    truth = tomllib.loads(text)
    values = {name: entry["value"] for table in truth.values() for name, entry in table.items()}
    assert values == pytest.approx({**PHYSICAL, **TRUE}, rel=1e-15)


def test_the_column_map_undoes_what_the_logger_did(examples, tmp_path, monkeypatch):
    """Assert that the map reverts counts and gear, and that only the link has a delay."""
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
    "log", ["ist-flexible-arm/ist_square_1p5V", "kr300/kr300_A", "kr300/kr300_B"]
)
def test_real_logs(log: str, shared_data: Path, tmp_path: Path, monkeypatch: Any, capsys: Any):
    """Assert that the publisher's structure gives the log with the digest on the page."""
    published = shared_data / f"{log}.csv"
    columns = pl.read_csv(published, infer_schema_length=None)
    kind, write = ("ist-arm", write_arm) if log.startswith("ist") else ("kuka", write_kuka)
    write(tmp_path / "log.mat", columns.cast(pl.Float64))
    convert(monkeypatch, kind, tmp_path / "log.mat", tmp_path / "log.csv")
    assert (tmp_path / "log.csv").read_bytes() == published.read_bytes()
    printed = capsys.readouterr().out
    shown = re.search(r"\d+ samples, every .* ms, SHA-256 \w{16}", printed)
    assert shown is not None
    assert shown[0] in PAGE.read_text(encoding="utf-8")
