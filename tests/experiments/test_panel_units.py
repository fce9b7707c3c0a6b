"""Units of what an experiment sets and a campaign keeps."""

from pathlib import Path

import pytest

from flexid.experiments.experiment_file import read_experiment
from flexid.experiments.measures import Units

EXPERIMENTS = Path(__file__).parents[2] / "experiments"
PATHS = {
    "plant.link_inertia": "kg m^2",
    "plant.gravity_torque": "N m",
    "controller.k": "1/s",
    "controller.proportional": "N m/rad",
    "controller.poles.2": "1/s",
    "controller.nominal.joint_stiffness": "N m/rad",
    "reference.amplitudes.1": "rad",
    "reference.angular_frequency": "rad/s",
    "initial_estimates.alpha2": "1/s",
    "initial_state.x2": "rad/s",
    "sampling.velocity_noise": "rad/s",
    "sampling.sample_time": "s",
    "controller.exponents.1": "",
    "observer.link": "",
    "sampling.seed": "",
}
RESULTS = {
    "reached": "s",
    "steps": "1",
    "final_error.alpha1": "1/s^2",
    "relative_error.alpha1": "1",
    "final_state.x4": "rad/s",
    "settling_time.theta1": "s",
    "tracking_peak": "rad",
    "excitation.link": "1",
    "peak_input.u": "N m",
}


def test_units_of_the_joint():
    """Assert units by hand, for what is set and for what is kept."""
    units = Units('[model]\nterms = ["gravity"]')
    assert {path: units.of_value(path) for path in PATHS} == PATHS
    assert {name: units.of_result(name) for name in RESULTS} == RESULTS


def test_units_that_are_not_known():
    """Assert that nothing is said of units of a model or law of one's own, or of a damaged text."""
    units = Units('[model]\nfile = "pendulum.toml"')
    assert {units.of_value(path) for path in PATHS} == {"", "s"}
    assert {units.of_result(name) for name in RESULTS} == {"", "s", "1"}
    assert units.of_result("final_error.alpha1") == units.of_value("plant.link_inertia") == ""

    units = Units('[controller]\nlaw = "expressions"')
    for path in ("reference.amplitude", "controller.k"):
        assert units.of_value(path) == ""
    assert units.of_result("tracking_rms") == ""
    assert units.of_value("plant.link_inertia") == "kg m^2"

    assert Units("= no TOML").of_result("final_error.alpha1") == ""


@pytest.mark.parametrize("name", ["noise_campaign", "huang2003_campaign", "excitation_campaign"])
def test_what_the_shipped_campaigns_vary_has_units(name):
    """Assert that no number that they vary is without, but for gains of the observer."""
    path = EXPERIMENTS / f"{name}.toml"
    experiment = read_experiment(path)
    assert experiment.variation is not None
    units = Units(path.read_text(encoding="utf-8"))
    for varied in experiment.variation.inputs:
        assert units.of_value(varied) or varied.startswith("observer."), varied
