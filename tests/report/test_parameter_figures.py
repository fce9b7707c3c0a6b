"""Figures of an identification show physical parameters, and say what they cut off."""

from dataclasses import replace

import numpy as np
import pytest
from made_result import made_result

from flexid.identification.estimate import Estimate
from flexid.identification.result import (
    CoefficientEstimate,
    FreeRun,
    Identification,
    ObserverTrace,
    ParameterEstimate,
)
from flexid.report.free_run_figure import free_run_figure
from flexid.report.identification_figures import correlated_pairs, fit_figure
from flexid.report.parameter_figures import (
    estimates_figure,
    observer_histories,
    parameter_estimate,
)

COVARIANCE = np.array([[9.0, 0.05], [0.05, 0.0009]])
TIME = np.linspace(0.0, 10.0, 101)


def result(end: float = 3.0, first: float = 0.1) -> Identification:
    """Return 300/3 N m/rad and 1/3 kg m², with an observer whose beta1 ends somewhere."""
    alpha1 = CoefficientEstimate("alpha1", "1/s^2", 300.0, 3.0, (294.0, 306.0), "determined")
    beta1 = CoefficientEstimate("beta1", "", 3.0, 0.03, (2.94, 3.06), "determined")
    slopes = {"alpha1": 1.0 / 3.0, "beta1": -100.0 / 3.0}
    stiffness = ParameterEstimate(
        "joint_stiffness", "N m/rad", 100.0, 1.0, (98.0, 102.0), "determined", slopes=slopes
    )
    inertia = ParameterEstimate(
        "motor_inertia", "kg m^2", 1 / 3, 0.01, (0.31, 0.35), "weak", slopes={"beta1": -1 / 9}
    )
    gain = np.where(TIME < 0.5, first, end)
    estimates = np.column_stack([np.full(101, 300.0), gain])
    return replace(
        made_result(),
        coefficients={"alpha1": alpha1, "beta1": beta1},
        parameters={"joint_stiffness": stiffness, "motor_inertia": inertia},
        observer=ObserverTrace(TIME, ("alpha1", "beta1"), estimates, {}),
        fit=Estimate(("alpha1", "beta1"), np.array([300.0, 3.0]), COVARIANCE, (9.0, 9.0)),
    )


def test_the_observer_is_shown_in_physical_parameters():
    """Assert that its coefficients are put together as those of the estimate are."""
    histories = observer_histories(result())
    assert histories["joint_stiffness"][[0, -1]] == pytest.approx([3000.0, 100.0])
    assert histories["motor_inertia"][-1] == pytest.approx(1 / 3)


def test_estimates_carry_names_values_and_units():
    """Assert that each panel names its parameter, value, interval and unit, and draws the curve."""
    figure = estimates_figure(result())
    stiffness, inertia = figure.axes[:2]
    assert stiffness.get_title().startswith("joint_stiffness\n100.0 [98.0, 102.0]")
    assert [stiffness.get_ylabel(), inertia.get_ylabel()] == ["N m/rad", "kg m^2"]
    assert len(stiffness.get_lines()) == 2
    assert "first tenth cut off" in stiffness.get_title()


def test_an_observer_that_does_not_arrive_takes_no_room():
    """Assert that a curve that ends elsewhere is not drawn, that this is said, and 100 is seen."""
    ax = estimates_figure(result(end=0.5, first=0.5)).axes[0]
    assert len(ax.get_lines()) == 1
    assert "the observer does not arrive" in ax.get_title()
    low, high = ax.get_ylim()
    assert 80.0 < low < 98.0
    assert 102.0 < high < 120.0


def test_regions_are_of_stiffness_and_inertia():
    """Assert that the pair is physical, and its covariance that of the delta method."""
    found = parameter_estimate(result())
    slopes = np.array([[1 / 3, -100 / 3], [0.0, -1 / 9]])
    assert found.covariance == pytest.approx(slopes @ COVARIANCE @ slopes.T)
    assert [*correlated_pairs(found).values()] == [("joint_stiffness", "motor_inertia")]


def runs(scale: float) -> tuple[FreeRun, ...]:
    """Return a free run that is some times as large as the measured motion."""
    measured = np.sin(TIME)[:, None]
    return (FreeRun(TIME, measured, scale * measured),)


@pytest.mark.parametrize(
    ("scale", "said"),
    [(1.01, ""), (3.0, "beyond the frame, by up to 2 rad"), (np.inf, "it diverges")],
)
def test_what_leaves_the_frame_is_said(scale, said):
    """Assert that the title says by how much a prediction runs out of the picture."""
    with np.errstate(invalid="ignore"):
        figure = free_run_figure({"motor_position": 99.0}, runs(scale), {}, "time (s)")
    title = figure.axes[0].get_title()
    assert title == "motor position: fit 99.0 %" + (f"; {said}" if said else "")


def test_every_fit_has_its_residual_beside_it():
    """Assert that below each channel stands what the free run leaves of it."""
    figure = fit_figure(made_result())
    labels = [ax.get_ylabel() for ax in figure.axes]
    assert labels == ["rad", "residual (rad)"] * 3
