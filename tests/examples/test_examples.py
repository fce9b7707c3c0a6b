"""The examples: the script and its log, the library, and a raw log."""

import importlib.util
import runpy
import sys
import tomllib
from pathlib import Path
from types import ModuleType

import numpy as np
import polars as pl
import pytest
from numpy.typing import NDArray

from flexid.recording.read import read_log
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


def test_committed_log_is_what_the_script_makes(
    script: ModuleType, committed: NDArray[np.float64]
) -> None:
    """Assert that the script reproduces the log: times and torques, angles within two counts."""
    remade = script.log()
    assert remade.shape == committed.shape
    np.testing.assert_allclose(remade[:, [0, 3]], committed[:, [0, 3]], rtol=0, atol=1e-9)
    two_counts = 2 * 2 * np.pi / 65536
    np.testing.assert_allclose(remade[:, 1:3], committed[:, 1:3], rtol=0, atol=two_counts)


def test_truth_is_table_1(script: ModuleType, examples: Path) -> None:
    """Assert that the committed truth equals the script's, and Table I with its coefficients."""
    text = (examples / "flexible_joint_truth.toml").read_text(encoding="utf-8")
    assert text == script.truth()
    truth = tomllib.loads(text)
    values = {name: entry["value"] for table in truth.values() for name, entry in table.items()}
    physical = {"gravity_torque": 5.0, "link_inertia": 1.0, "joint_stiffness": 100.0}
    physical |= {"motor_inertia": 0.3, "motor_viscous_friction": 0.1}
    assert values == pytest.approx({**physical, **TRUE}, rel=1e-15)


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
