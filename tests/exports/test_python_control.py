"""A plant for python-control: against a closed form, and against flexid's own runs."""

# python-control declares what it calls inputs and initial states as single numbers.
# pyright: reportArgumentType=false

import sys

import control
import numpy as np
import pytest

import flexid
from flexid.errors import SettingError
from flexid.simulation.free_run import free_run
from joint_logs import DAMPED as TRUE

PRECISE = {"rtol": 1e-9, "atol": 1e-11, "method": "LSODA"}


@pytest.fixture(scope="module")
def drive():
    """The joint of the paper, with all coefficients sought."""
    return flexid.flexible_joint(("gravity", "motor_viscous", "joint_damping"))


def test_linearised_it_is_the_two_mass_drive(drive):
    """Assert that the transfer functions of the linearised plant are the closed form."""
    plant = flexid.plant_io_system(drive, TRUE)
    linear = control.linearize(plant, np.zeros(4), 0.0)
    omega = np.geomspace(0.1, 300.0, 40)
    s = 1j * omega
    spring = TRUE["theta2"] + s * TRUE["theta_damping"]
    coupled = TRUE["alpha1"] + s * TRUE["alpha_damping"]
    link = s**2 + TRUE["theta1"] + spring
    determinant = link * (s**2 + s * TRUE["alpha2"] + coupled) - spring * coupled
    found = linear(s)[:, 0]
    # python-control differentiates with steps of 1e-6.
    np.testing.assert_allclose(found[2], TRUE["beta1"] * link / determinant, rtol=1e-4)
    np.testing.assert_allclose(found[0], TRUE["beta1"] * spring / determinant, rtol=1e-4)


def test_it_moves_as_the_free_run_does(drive):
    """Assert that the plant follows a torque on straight lines as flexid's own integrator does."""
    time = np.arange(501) * 1e-3
    torque = 8 * np.sin(3 * time) + 4 * np.sin(17 * time)
    plant = flexid.plant_io_system(drive, TRUE)
    start = np.array([0.3, 0.0, 0.2, 0.0])
    moved = control.input_output_response(plant, time, torque, start, solve_ivp_kwargs=PRECISE)
    own = free_run(drive, TRUE, start, torque, 1e-3, "linear")
    np.testing.assert_allclose(moved.outputs.T, own, atol=1e-6)
    softer = control.input_output_response(
        plant, time, torque, start, params={"theta2": 50.0}, solve_ivp_kwargs=PRECISE
    )
    own = free_run(drive, TRUE | {"theta2": 50.0}, start, torque, 1e-3, "linear")
    np.testing.assert_allclose(softer.outputs.T, own, atol=1e-6)


def test_an_estimate_is_a_plant(example_estimate, tmp_path):
    """Assert that an estimate, or its file, gives a plant with the values that were found."""
    estimate = example_estimate
    estimate.save(tmp_path / "estimate.json")
    for what in (estimate, tmp_path / "estimate.json"):
        plant = flexid.plant_io_system(what, name="arm")
        values = {name: c.value for name, c in estimate.coefficients.items()}
        assert plant.name == "arm"
        assert plant.params == pytest.approx(values)
    described = estimate.frequency_response(frequency=[3.0])
    linear = control.linearize(plant, np.zeros(4), 0.0)
    motor = described.responses[1].values[0]
    assert linear(6j * np.pi)[3, 0] == pytest.approx(motor, rel=1e-3)


def test_what_is_missing_is_said(drive, monkeypatch):
    """Assert that a missing value, an unknown name and a missing package are sentences."""
    with pytest.raises(SettingError, match="theta_damping, alpha_damping missing"):
        flexid.plant_io_system(drive, {n: v for n, v in TRUE.items() if "damping" not in n})
    with pytest.raises(SettingError, match="'teta1' is unknown"):
        flexid.plant_io_system(drive, TRUE | {"teta1": 1.0})
    monkeypatch.setitem(sys.modules, "control", None)
    with pytest.raises(SettingError, match=r"pip install 'flexid\[control\]'"):
        flexid.plant_io_system(drive, TRUE)
