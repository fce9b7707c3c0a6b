"""Charts of an identification show what was found, and say what they cut off."""

from dataclasses import replace
from typing import TypeVar

import numpy as np
import pytest
from made_result import VALIDATION, made_result

from flexid.analysis.excitation import LOST_CONDITION, WEAK_CONDITION
from flexid.identification.result.identification import Identification
from flexid.identification.vocabulary.estimate import Estimate
from flexid.identification.vocabulary.evidence import (
    CoefficientEstimate,
    FreeRun,
    ObserverTrace,
    ParameterEstimate,
    Validation,
)
from flexid.report.chart import Band, Level, Line, Panel, Points
from flexid.report.free_run_chart import free_run_chart, residual_chart
from flexid.report.identification_charts import (
    correlated_pairs,
    estimates_chart,
    excitation_chart,
    identification_charts,
    observer_histories,
    parameter_estimate,
    regions_chart,
)

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


def test_estimates_carry_names_values_and_units():
    """Assert that each panel has its parameter, verdict, interval, unit and the observer."""
    chart = estimates_chart(result())
    stiffness, inertia = chart.panels
    assert stiffness.title == "joint_stiffness, determined\n100.0 [98.0, 102.0]; start cut off"
    assert [stiffness.y.unit, inertia.y.unit] == ["N m/rad", "kg m^2"]
    assert [stiffness.colour, inertia.colour] == ["green", "orange"]
    (history,), (interval,) = marks(stiffness, Line), marks(stiffness, Band)
    assert np.array_equal(history.x, TIME)
    assert history.y[[0, -1]] == pytest.approx([3000.0, 100.0])
    assert [*interval.low, *interval.high] == [98.0, 98.0, 102.0, 102.0]
    assert [level.value for level in marks(stiffness, Level)] == [100.0]
    assert "Determined by the log: 1 of 2" in chart.says
    assert "converges to 2 of these estimates" in chart.says


def test_an_observer_that_does_not_arrive_takes_no_room():
    """Assert that a curve that ends elsewhere is not drawn, that this is said, and 100 is seen."""
    chart = estimates_chart(result(end=0.5, first=0.5))
    panel = chart.panels[0]
    assert marks(panel, Line) == []
    assert panel.title.endswith("; observer ends elsewhere")
    assert "converges to 0 of these estimates" in chart.says
    assert panel.y.limits is not None
    low, high = panel.y.limits
    assert 80.0 < low < 98.0
    assert 102.0 < high < 120.0


def test_an_unlimited_interval_has_no_band():
    """Assert that what is not determined is drawn without an interval, in a finite frame."""
    found = result()
    free = replace(
        found.parameters["joint_stiffness"],
        interval=(-np.inf, np.inf),
        std=np.inf,
        verdict="undetermined",
    )
    panel = estimates_chart(replace(found, parameters={"joint_stiffness": free})).panels[0]
    assert marks(panel, Band) == []
    assert panel.colour == "red"
    assert panel.y.limits is not None
    assert all(map(np.isfinite, panel.y.limits))


def test_regions_are_of_stiffness_and_inertia():
    """Assert that the pair is physical, and its covariance that of the delta method."""
    found = parameter_estimate(result())
    slopes = np.array([[1 / 3, -100 / 3], [0.0, -1 / 9]])
    assert found.covariance == pytest.approx(slopes @ COVARIANCE @ slopes.T)
    assert correlated_pairs(found) == (("joint_stiffness", "motor_inertia"),)
    chart = regions_chart(result(), 0.9)
    assert chart is not None
    assert [chart.panels[0].x.unit, chart.panels[0].y.unit] == ["N m/rad", "kg m^2"]
    assert chart.panels[0].marks[0].label == "prediction error: joint 90 %"
    assert regions_chart(made_result()) is None


def validation(scale: float) -> Validation:
    """Return a free run that is some times as large as the measured motion."""
    measured = np.sin(TIME)[:, None]
    with np.errstate(invalid="ignore"):
        runs = (FreeRun(TIME, measured, scale * measured),)
    return Validation({"motor_position": 99.0}, runs)


@pytest.mark.parametrize(
    ("scale", "said"),
    [(1.01, ""), (3.0, "; beyond the frame, by up to 2 rad"), (np.inf, "; it diverges")],
)
def test_what_leaves_the_frame_is_said(scale, said):
    """Assert that the title says by how much a prediction runs out of the picture."""
    chart = free_run_chart("fit", "title", validation(scale), {}, "time")
    motion, residual = chart.panels
    assert motion.title == f"motor position: fit 99.0 %{said}"
    assert motion.y.limits == pytest.approx((-1.29934, 1.29949), abs=2e-3)
    assert (residual.y.limits is None) == (not said)
    assert ("diverges from the measured motor position" in chart.says) == ("diverges" in said)


def test_a_free_run_is_what_the_result_holds():
    """Assert that each run of each channel has its measured and predicted values and residual."""
    run = FreeRun(TIME, np.sin(TIME)[:, None], np.cos(TIME)[:, None])
    later = FreeRun(TIME + 20.0, 2.0 * run.measured, 3.0 * run.simulated)
    held = Validation({"motor_position": 99.0}, (run, later))
    chart = free_run_chart("fit", "title", held, {"motor_position": 0.5}, "time")
    motion, residual = chart.panels
    assert [line.label for line in motion.marks] == 2 * ["measured", "free run of the model"]
    for place, one in enumerate((run, later)):
        seen, predicted = marks(motion, Line)[2 * place : 2 * place + 2]
        left = marks(residual, Line)[place]
        assert np.array_equal(seen.x, one.time)
        assert np.array_equal(seen.y, one.measured[:, 0])
        assert np.array_equal(predicted.y, one.simulated[:, 0])
        assert np.array_equal(left.y, (one.measured - one.simulated)[:, 0])
    assert [level.value for level in marks(residual, Level)] == [-1.0, 1.0]


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
    assert f"{100 * shares[0]:.0f} % of the link position's" in chart.says
    diverged = (FreeRun(time, measured, np.full_like(measured, np.inf)),)
    lost = residual_chart(Validation({"link_position": -np.inf, "motor_position": 0.0}, diverged))
    assert not marks(lost.panels[1], Line)


def test_excitation_shows_singular_values_over_the_largest():
    """Assert that each row has its values, both limits, and the pair that correlates."""
    chart = excitation_chart(made_result())
    (panel,) = chart.panels
    (points,) = marks(panel, Points)
    assert points.y == pytest.approx([1.0, 0.7 / 1.3])
    assert points.stems
    assert panel.y.logarithmic
    limits = [level.value for level in marks(panel, Level)]
    assert limits == [1.0 / WEAK_CONDITION, 1.0 / LOST_CONDITION]
    assert panel.title == "link row: condition number 1.86\ntheta1 and theta2 correlate by 0.30"
    assert "theta1 and theta2 correlate by 0.30" in chart.says


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
