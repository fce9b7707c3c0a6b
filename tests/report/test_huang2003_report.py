"""Figures, tables and document of the reproduction."""

import json

import numpy as np
import pytest

from flexid.report.documents import to_json
from flexid.report.huang2003_document import reproduction_document
from flexid.report.huang2003_figures import error_figure, theorem_figure, tracking_figure
from flexid.report.huang2003_table import print_reproduction


def test_document_survives_json(reproduction):
    """Assert that the document is the same after JSON, save infinite numbers."""
    document = json.loads(to_json(reproduction_document(reproduction)))
    run = reproduction.runs["1,2,3"]
    found = document["readings"]["1,2,3"]
    assert found["parameter_errors_at_30s"] == run.parameter_errors
    assert found["max_tracking_error_20_30"] == run.max_tracking_error
    assert set(document["unstable_readings"]) == {"1,1,0", "1,1,1"}
    assert len(document["claims"]) == len(reproduction.claims)


def test_printed_tables_fit_80_columns(reproduction, capsys):
    """Assert that no line is longer than 80 characters and every claim is printed."""
    print_reproduction(reproduction)
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    assert sum("holds" in line or "does not hold" in line for line in lines) >= 15


def test_figures_name_quantities_and_units(reproduction):
    """Assert that every axes of Figures 1 to 5 has a labelled quantity with its unit."""
    runs = reproduction.runs
    tracking = tracking_figure(runs)
    assert [ax.get_ylabel() for ax in tracking.axes[::2]] == ["tracking error (rad)"] * 2
    for coefficient, unit in (("theta1", "1/s²"), ("alpha2", "1/s")):
        axes = error_figure(runs, coefficient).axes
        assert all(f"({unit})" in ax.get_ylabel() for ax in axes)
        assert axes[-1].get_xlabel() == "time (s)"


@pytest.mark.parametrize("reading", ["1,2,3", "1,1,3"])
def test_figure_2_draws_the_run(reproduction, reading):
    """Assert that the curve of Figure 2 ends at the error of the run."""
    lines = error_figure(reproduction.runs, "theta1").axes[0].get_lines()
    line = next(line for line in lines if line.get_label() == f"gains ({reading})")
    assert np.asarray(line.get_ydata())[-1] == reproduction.runs[reading].parameter_errors["theta1"]


def test_theorem_figure_draws_value_and_rates(reproduction):
    """Assert that V is drawn for both readings and three rates for both rows."""
    value, link, motor = theorem_figure(reproduction.runs, reproduction.rates).axes
    assert len(value.get_lines()) == 2
    assert [len(ax.get_lines()) for ax in (link, motor)] == [3, 3]
