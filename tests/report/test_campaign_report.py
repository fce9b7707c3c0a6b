"""The printed summary of a campaign, its document and its charts."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flexid.campaigns.store import Manifest
from flexid.campaigns.summary import Correlation, Result, SobolIndex, Summary
from flexid.library.simulate import CampaignResult
from flexid.report.campaign import charts as campaign_charts
from flexid.report.campaign import correlation_text, index_text, status_lines
from flexid.report.chart import Level, Line, Points

NAN = float("nan")


def made_result(correlations=(), indices=(), values=(1.0, 2.0, NAN), name="tracking_rms"):
    """Return a result."""
    array = np.array(values)
    missing = int(np.isnan(array).sum())
    return Result(name, array, missing, (1.0, 1.5, 2.0), tuple(correlations), tuple(indices))


def made_summary(done=100, statuses=None, damaged=(), first_error="", results=()):
    """Return a summary of a campaign of 100 runs."""
    manifest = Manifest(
        flexid="1.0",
        experiment="0123",
        plan="4567",
        kind="sobol",
        runs=100,
        inputs=("controller.k",),
        keep=("tracking",),
        runs_per_part=10,
        text="the file",
    )
    inputs = {"controller.k": np.array([1.0, 2.0, 3.0])}
    statuses = statuses or {"finished": done}
    return Summary(Path("out"), manifest, done, damaged, statuses, first_error, inputs, results)


def test_a_finished_campaign_says_how_its_runs_ended():
    """Assert that shares are of the runs that are done."""
    lines = list(status_lines(made_summary(statuses={"finished": 97, "diverged": 3})))
    assert lines == ["100 runs, sobol", "finished 97 (97 %), diverged 3 (3 %)"]


def test_an_unfinished_campaign_says_that_it_is():
    """Assert that unfinished, failed and damaged are told, each with what it means."""
    summary = made_summary(
        40, {"finished": 30, "error": 10}, ("part-000003.parquet",), "file: no such value"
    )
    lines = list(status_lines(summary))
    assert lines[0].startswith("Unfinished: 40 of 100 runs, sobol; the command")
    assert lines[1] == "finished 30 (75 %), error 10 (25 %)"
    assert lines[2] == "The first error: file: no such value"
    assert lines[3].startswith("Damaged and left out: part-000003.parquet; the command")


@pytest.mark.parametrize(
    ("correlations", "text"),
    [
        ([], "does not vary, or in too few runs"),
        ([("a", 0.1, False)], "none is significant"),
        ([("a", -0.912, True), ("b", 0.02, False)], "a -0.91; 1 not significant"),
        (
            [(name, 0.5, True) for name in "abcdef"],
            "a +0.50, b +0.50, c +0.50, d +0.50, and 2 more",
        ),
    ],
)
def test_what_is_not_significant_has_no_number(correlations, text):
    """Assert that only significant correlations are printed, and the others counted."""
    assert correlation_text(made_result([Correlation(*one) for one in correlations])) == text


def test_indices_that_may_be_zero_are_not_printed():
    """Assert that an index within its own interval of 0 is counted as not significant."""
    indices = [SobolIndex("a", 0.4, 0.05, 0.7, 0.1), SobolIndex("b", 0.0, 0.1, 0.05, 0.1)]
    assert index_text(made_result(indices=indices)) == "a 0.70 ± 0.10 (0.40); 1 not significant"


def test_the_document_is_json():
    """Assert that numbers that JSON does not have become null."""
    nothing = Result("settling_time.theta1", np.array([NAN]), 1, (NAN, NAN, NAN), (), ())
    document = CampaignResult(made_summary(results=(nothing,))).document
    found = document["results"]["settling_time.theta1"]
    assert found["quantiles"] == {"0.05": None, "0.5": None, "0.95": None}
    assert (found["finite"], found["missing"]) == (0, 1)
    assert document["complete"]


def test_charts_are_of_what_varies():
    """Assert that constant or missing results make no panel, and nothing makes no chart."""
    dull = [made_result(values=(1.0, 1.0, 1.0)), made_result(values=(NAN, NAN, NAN))]
    assert campaign_charts(made_summary(results=tuple(dull))) == ()
    wide = made_result([Correlation("controller.k", 1.0, True)], values=(1e-6, 1.0, NAN))
    charts = campaign_charts(made_summary(results=(*dull, made_result(), wide)))
    panels = {chart.name: len(chart.panels) for chart in charts}
    assert panels == {"distributions": 2, "dependence": 1}


def test_a_distribution_counts_every_run():
    """Assert that the area of a histogram is the number of runs, with its quantiles as levels."""
    values = np.random.default_rng(4).uniform(1.0, 2.0, 500)
    (chart,) = campaign_charts(made_summary(results=(made_result(values=values),)))
    outline, *levels = chart.panels[0].marks
    assert isinstance(outline, Line)
    assert outline.filled
    assert outline.y[1::2][:-1].sum() == 500
    assert [outline.y[0], outline.y[-1]] == [0.0, 0.0]
    assert [level.value for level in levels if isinstance(level, Level)] == [1.0, 1.5, 2.0]
    assert "tracking_rms is between 1 and 2" in chart.says


def test_dependence_is_of_the_runs_that_have_both():
    """Assert that each point is a finite result over the input of the same run."""
    correlated = [Correlation("controller.k", 1.0, True)]
    result = made_result(correlated, values=(1.0, NAN, 3.0))
    _, chart = campaign_charts(made_summary(results=(result,)))
    (points,) = chart.panels[0].marks
    assert isinstance(points, Points)
    assert (points.x.tolist(), points.y.tolist()) == ([1.0, 3.0], [1.0, 3.0])


def test_each_panel_has_its_unit():
    """Assert that results and inputs stand in a chart with the units of the joint."""
    correlated = [Correlation("controller.k", 1.0, True)]
    results = (
        made_result(correlated, values=(1.0, 2.0, 3.0)),
        made_result(correlated, values=(1e-30, 1.0, 2.0), name="settling_time.theta1"),
    )
    summary = made_summary(results=results)
    charts = campaign_charts(
        replace(summary, manifest=summary.manifest.model_copy(update={"text": ""}))
    )
    distributions, dependence = charts
    for chart in charts:
        titles = [panel.title.splitlines() for panel in chart.panels]
        assert titles == [
            ["tracking_rms"],
            ["settling_time.theta1", "1 below 2e-12 are drawn there"],
        ]
    assert [panel.x.unit for panel in distributions.panels] == ["rad", "s"]
    assert [panel.y.unit for panel in dependence.panels] == ["rad", "s"]
    assert dependence.panels[1].y.logarithmic
    (points,) = dependence.panels[1].marks
    assert isinstance(points, Points)
    assert points.y.tolist() == [2e-12, 1.0, 2.0]
    across = dependence.panels[0].x
    assert (across.label, across.unit) == ("controller.k", "1/s")
