"""The example log and its truth are what their script says."""

import importlib.util
import tomllib
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from numpy.typing import NDArray

from made_estimates import TRUE


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
    """Assert that the log is remade: same times and torques, angles within two counts."""
    remade = script.log()
    assert remade.shape == committed.shape
    np.testing.assert_allclose(remade[:, [0, 3]], committed[:, [0, 3]], rtol=0, atol=1e-9)
    two_counts = 2 * 2 * np.pi / 65536
    np.testing.assert_allclose(remade[:, 1:3], committed[:, 1:3], rtol=0, atol=two_counts)


def test_truth_is_table_1(script: ModuleType, examples: Path) -> None:
    """Assert that the committed truth is the script's, and Table I with its coefficients."""
    text = (examples / "flexible_joint_truth.toml").read_text(encoding="utf-8")
    assert text == script.truth()
    truth = tomllib.loads(text)
    values = {name: entry["value"] for table in truth.values() for name, entry in table.items()}
    physical = {"gravity_torque": 5.0, "link_inertia": 1.0, "joint_stiffness": 100.0}
    physical |= {"motor_inertia": 0.3, "motor_viscous_friction": 0.1}
    assert values == pytest.approx({**physical, **TRUE}, rel=1e-15)
