"""What figures show, mark by mark with what it spans, as it stands in ``texts/``."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest
from made_result import VALIDATION, made_result
from shown import chart_lines, check
from test_identification_charts import TIME, result

from flexid.comparisons.comparison import compare_estimates
from flexid.identification.vocabulary.estimate import Estimate
from flexid.identification.vocabulary.evidence import FreeRun
from flexid.recording.recording import Log, Recording
from flexid.report.chart import Chart
from flexid.report.comparison import charts as comparison_charts
from flexid.report.identification_charts import (
    confidence_regions_chart,
    estimates_chart,
    excitation_chart,
    fit_chart,
    regions_chart,
)
from flexid.report.reproduction_charts import Played, play_chart
from flexid.report.response_charts import free_run_chart, log_chart
from made_estimates import STIFFER, TRUE, exact, with_parameter


def estimates() -> Iterator[Chart]:
    """With an observer that arrives, with one that does not, and with an open interval."""
    yield estimates_chart(result())
    yield estimates_chart(result(end=0.5, first=0.5))
    ends = {"interval": (-np.inf, np.inf), "std": np.inf, "verdict": "undetermined"}
    free = replace(result().parameters["joint_stiffness"], **ends)
    yield estimates_chart(replace(result(), parameters={"joint_stiffness": free}))


def excitation_of_rows() -> Iterator[Chart]:
    """Singular values over the largest, both limits, and the pair that correlates."""
    yield excitation_chart(made_result())


def regions() -> Iterator[Chart]:
    """Of physical parameters, at another level, and where one of the two is free."""
    assert regions_chart(made_result()) is None
    found = regions_chart(result(), 0.9)
    assert found is not None
    yield found
    free = Estimate(("a", "b"), np.array([1.0, -5.0]), np.diag([np.inf, 4.0]), (9.0, 12.0))
    yield confidence_regions_chart("least squares", free, [("a", "b")], {"a": "m", "b": "s"})


def fits() -> Iterator[Chart]:
    """With channels at rest, without noise, twice, and beyond the frame by more and more."""
    still = replace(VALIDATION, fit_percent={"motor": np.nan})
    yield fit_chart(made_result())
    yield fit_chart(replace(made_result(), model="link"))
    yield fit_chart(replace(made_result(), validation=still))
    seen = np.sin(TIME)[:, None]
    later = FreeRun(TIME + 20.0, 2.0 * seen, 2.1 * seen)
    with np.errstate(invalid="ignore"):
        predicted = (seen + 0.03, 3.0 * seen, np.inf * seen)
    for found, more in zip(predicted, ((later,), (), ()), strict=True):
        runs = (FreeRun(TIME, seen, found), *more)
        held = replace(VALIDATION, fit_percent={"motor_position": 99.876}, runs=runs)
        yield free_run_chart("fit", "title", held, {"motor_position": 0.01})


def compared() -> Iterator[Chart]:
    """A stiffer drive in per cent of the first, and a number that may be zero in its unit."""
    yield from comparison_charts(compare_estimates(exact(TRUE, "a"), exact(STIFFER, "b")))
    a, b = (exact({**TRUE, "alpha_offset": value}, str(value)) for value in (1.0, 0.5))
    a = with_parameter(a, "motor_offset_torque", value=0.1, std=0.25, interval=(-0.4, 0.6))
    yield from comparison_charts(compare_estimates(a, b))


def logs() -> Iterator[Chart]:
    """A log with a gap, across which no line leads; and one of the motor alone."""
    made = {"sample_time": 0.1, "motor_position": np.arange(10.0)}
    both = {**made, "link_position": 2.0 * np.arange(10.0), "input": -np.arange(10.0)}
    gap = [Recording(**both, start_time=start, input_unit="V") for start in (0.0, 5.0)]
    motor = Recording(**made, start_time=0.0, link_position=None, input=None, input_unit="")
    for recordings in (gap, [motor]):
        yield log_chart(Log(tuple(recordings), (), "log", ""))


def played(scale: float) -> Played:
    """Return a run whose errors fall, with a zero among them."""
    time = np.linspace(0.0, 30.0, 3001)
    falling = scale * np.exp(-time)
    falling[300:340] = 0.0
    moments = np.linspace(2.0, 30.0, 40)
    errors = {"theta1": falling, "alpha1": 2 * falling}
    final = {"theta1": (1.0, "%"), "alpha1": (2.0, "%")}
    conditions = {"link": 3.0 + moments}
    return Played(time, falling, errors, final, falling**2, moments, conditions, 1.0, 2.0)


def plays() -> Iterator[Chart]:
    """A run with a pinned one behind it, dashed and without names; peaks, with zeros as gaps."""
    yield play_chart(played(1.0), played(2.0))
    yield play_chart(played(1.0), None)


FIGURES = (estimates, excitation_of_rows, regions, fits, compared, logs, plays)


@pytest.mark.parametrize("figures", FIGURES)
def test_it_shows_what_it_showed(
    figures: Callable[[], Iterator[Chart]], request: pytest.FixtureRequest
):
    """Assert that words, axes, limits and marks are as before."""
    lines = [line for chart in figures() for line in chart_lines(chart)]
    check(f"figure_{figures.__name__}", lines, request)
