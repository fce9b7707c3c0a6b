"""Charts of an identification show what was found, and say what they cut off."""

from dataclasses import replace
from typing import TypeVar

import numpy as np
import pytest
from made_result import VALIDATION, made_result

from flexid.identification.result.identification import Identification
from flexid.identification.vocabulary.estimate import Estimate
from flexid.identification.vocabulary.evidence import (
    CoefficientEstimate,
    FreeRun,
    ObserverTrace,
    ParameterEstimate,
    Validation,
)
from flexid.report.chart import Band, Line, Panel
from flexid.report.identification_charts import (
    identification_charts,
    observer_histories,
    parameter_estimate,
)
from flexid.report.response_charts import residual_chart

M = TypeVar("M")
COVARIANCE = np.array([[9.0, 0.05], [0.05, 0.0009]])
TIME = np.linspace(0.0, 10.0, 101)


def result(end: float = 3.0, first: float = 0.1) -> Identification:
    """Return 300/3 N m/rad and 1/3 kg m², with an observer whose beta1 ends somewhere."""
    alpha1 = CoefficientEstimate("alpha1", "1/s^2", 300.0, 3.0, (294.0, 306.0), "determined")
    beta1 = CoefficientEstimate("beta1", "rad/s^2/(N m)", 3.0, 0.03, (2.94, 3.06), "determined")
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


def marks(panel: Panel, kind: type[M]) -> list[M]:
    """Marks of one kind."""
    return [mark for mark in panel.marks if isinstance(mark, kind)]


def test_the_covariance_of_parameters_is_that_of_the_delta_method():
    """Assert that slopes carry it over from the coefficients."""
    found = parameter_estimate(result())
    slopes = np.array([[1 / 3, -100 / 3], [0.0, -1 / 9]])
    assert found.covariance == pytest.approx(slopes @ COVARIANCE @ slopes.T)


def test_residuals_that_repeat_leave_the_band():
    """Assert that noise leaves its band in a twentieth of the lags, and a sine in most."""
    generator = np.random.default_rng(3)
    time = np.linspace(0.0, 20.0, 20_001)
    noise = generator.standard_normal(len(time))
    measured = np.column_stack([noise, noise + np.sin(2.0 * time)])
    runs = (FreeRun(time, measured, np.zeros_like(measured)),)
    chart = residual_chart(Validation({"link_position": 1.0, "motor_position": 1.0}, runs))
    assert [panel.x.label for panel in chart.panels] == ["time", "lag"] * 2
    shares = []
    for panel in chart.panels[1::2]:
        (band,), (line,) = marks(panel, Band), marks(panel, Line)
        assert line.x[0] == 0.0
        assert line.y[0] == pytest.approx(1.0)
        shares.append(np.mean(np.abs(line.y[1:]) > band.high[0]))
    assert 0.03 < shares[0] < 0.07
    assert shares[1] > 0.8
    diverged = (FreeRun(time, measured, np.full_like(measured, np.inf)),)
    lost = residual_chart(Validation({"link_position": -np.inf, "motor_position": 0.0}, diverged))
    assert not marks(lost.panels[1], Line)


def test_a_loaded_estimate_has_the_charts_that_need_no_series():
    """Assert that time series are left out where there are none."""
    coefficients = {
        name: CoefficientEstimate(name, "1/s^2", value, 0.1, (1.0, 9.0), "determined")
        for name, value in (("theta1", 5.0), ("theta2", 100.0), ("alpha1", 333.0), ("beta1", 3.0))
    }
    whole = replace(result(), coefficients=coefficients)
    names = ["fit", "residuals", "estimates", "excitation", "bode", "regions"]
    assert [chart.name for chart in identification_charts(whole)] == names
    loaded = replace(
        whole,
        validation=replace(VALIDATION, runs=()),
        observer=ObserverTrace(np.empty(0), ("theta1",), np.empty((0, 1)), {}),
    )
    assert [chart.name for chart in identification_charts(loaded)] == names[3:]
    assert all(chart.says for chart in identification_charts(loaded))
