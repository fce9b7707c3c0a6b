"""Drive files: their values, and one sentence for each invalid one."""

import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from flexid.experiment_design.drive import read_drive
from flexid.models.physical import joint_coefficients
from flexid.stored_estimates.estimate_file import read_estimate, sealed
from made_estimates import stored_document, stored_value

PARAMETERS = {
    "gravity_torque": 5.0,
    "link_inertia": 1.0,
    "joint_stiffness": 100.0,
    "motor_inertia": 0.3,
    "motor_viscous_friction": 0.1,
}


@pytest.fixture
def text(examples):
    """Return the text of the shipped example."""
    return (examples / "drive.toml").read_text()


@pytest.fixture
def written(tmp_path):
    """Write a drive file and return its path."""

    def write(content):
        path = tmp_path / "drive.toml"
        path.write_text(content)
        return path

    return write


def test_the_example_is_table_1(examples):
    """Assert that the example has the paper's coefficients and model."""
    drive = read_drive(examples / "drive.toml").drive
    assert drive.coefficients == pytest.approx(joint_coefficients(PARAMETERS))
    assert set(drive.nominal.coefficients) == set(drive.coefficients)


def test_what_is_known_of_inertia_and_sensors(text, written):
    """Assert a known value in every perturbed drive, and an encoder's step as uniform noise."""
    drive = read_drive(written('known = ["motor_inertia"]\n' + text)).drive
    assert "beta1" not in drive.nominal.coefficients
    assert {case.system.constants["beta1"] for case in drive.cases(0)} == {1 / 0.3}
    drive = read_drive(written(text.replace("position_noise = 1e-4", "encoder_bits = 12"))).drive
    assert drive.sensors.noise == pytest.approx(2 * np.pi / 4096 / np.sqrt(12))


@pytest.fixture
def stored(tmp_path):
    """Write the estimate of Table I's joint with some parameters changed; return its path."""

    def write(terms=("gravity", "motor_viscous"), **changed):
        document = stored_document({}, {"joint_stiffness": 100.0, "link_inertia": 1.0})
        for name, changes in changed.items():
            document["parameters"][name] = stored_value(100.0, name=name) | changes
        document["choices"]["terms"] = terms
        path = tmp_path / "estimate.json"
        path.write_text(json.dumps(sealed(document)))
        return path

    return write


def test_an_estimate_replaces_beliefs(examples, stored):
    """Assert that estimated values replace parameters of the same name, and no others."""
    path = stored(link_inertia={"value": 1.5}, joint_damping={"value": 0.1})
    file = read_drive(examples / "drive.toml", read_estimate(path))
    assert file.drive.values == pytest.approx({**PARAMETERS, "link_inertia": 1.5})
    assert [name for name, _ in file.inputs] == ["drive.toml", "estimate.json"]
    (warning,) = file.warnings
    assert "joint_damping" in warning


def test_what_an_estimate_cannot_give_is_said(examples, stored):
    """Assert warnings of shapes, guesses and missing values; a missing value changes nothing."""
    undetermined = {"verdict": "undetermined"}
    path = stored(
        ("gravity", "motor_stribeck"),
        link_inertia={"value": None, **undetermined},
        joint_stiffness={"value": 90.0, **undetermined},
        motor_inertia={"value": PARAMETERS["motor_inertia"], **undetermined},
    )
    file = read_drive(examples / "drive.toml", read_estimate(path))
    assert file.drive.values == pytest.approx({**PARAMETERS, "joint_stiffness": 90.0})
    shape, nothing, guessed = file.warnings
    assert "motor_stribeck" in shape
    assert "gravity" not in shape
    assert "link_inertia has no finite value" in nothing
    assert "joint_stiffness, motor_inertia is undetermined" in guessed


OTHERWISE = {  # text in the example, and its replacement
    "a slide": ("[parameters]", 'joint = "prismatic"\n[parameters]'),
    **{
        f"a torque of {t}": ("torque = 30.0", f"torque = {t}")
        for t in ("nan", "inf", "-1.0", '"30"')
    },
    "a misspelt limit": ("torque = 30.0", "torqe = 30.0"),
    "no inertia": ("link_inertia = 1.0", "link_inertia = 0.0"),
    "an inertia missing": ("link_inertia = 1.0", ""),
    "no gravity": ("gravity_torque = 5.0", "gravity_torque = 0.0"),
    "a negative spring": ("= 100.0", "= -100.0"),
    "a negative duration": ("duration = 10.0", "duration = -10.0"),
    "an endless duration": ("duration = 10.0", "duration = 1e9"),
    "long samples": ("sample_time = 0.001", "sample_time = 0.05"),
    "many harmonics": ("sample_time = 0.001", "sample_time = 0.001\nharmonics = 1000"),
    "a long ramp": ("sample_time = 0.001", "sample_time = 0.001\nramp = 6.0"),
    "no noise": ("position_noise = 1e-4", ""),
    "noise twice": ("position_noise = 1e-4", "position_noise = 1e-4\nencoder_bits = 12"),
    "a misspelt table": ("[sensors]", "[sensor]"),
}


def test_what_no_drive_is(text, stored, refusals, monkeypatch, tmp_path):
    """Assert that file and key are named, for a drive as for its estimate."""
    monkeypatch.chdir(tmp_path)
    path = Path("drive.toml")

    def read(old="", new="", estimate=None):
        assert old in text
        path.write_text(text.replace(old, new) if old else text)
        return read_drive(path, estimate and read_estimate(estimate))

    alone = json.loads(stored().read_text())
    held = alone["parameters"].pop("joint_stiffness")
    alone["parameters"] = {"joint_stiffness_per_link_inertia": held}
    calls = {name: partial(read, *pair) for name, pair in OTHERWISE.items()}
    calls["an estimate of a link alone"] = partial(read, estimate=sealed(alone))
    stored(joint_stiffness={"value": -100.0})
    calls["an estimate's spring"] = partial(read, estimate="estimate.json")
    refusals(calls)
