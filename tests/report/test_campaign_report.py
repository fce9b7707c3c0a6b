"""The printed summary of a campaign, its document and its charts."""

import numpy as np
from made_campaign import NAN, made_of, made_summary

from flexid.campaigns.summary import Correlation, Result
from flexid.library.simulate import CampaignResult
from flexid.report.campaign import charts as campaign_charts
from flexid.report.chart import Level, Line, Points


def test_the_document_is_json():
    """Assert that numbers that JSON does not have become null."""
    nothing = Result("settling_time.theta1", np.array([NAN]), 1, (NAN, NAN, NAN), ())
    document = CampaignResult(made_summary(results=(nothing,))).document
    found = document["results"]["settling_time.theta1"]
    assert found["quantiles"] == {"0.05": None, "0.5": None, "0.95": None}
    assert (found["finite"], found["missing"]) == (0, 1)
    assert document["complete"]


def test_a_distribution_counts_every_run():
    """Assert that the area of a histogram is the number of runs, with its quantiles as levels."""
    values = np.random.default_rng(4).uniform(1.0, 2.0, 500)
    (chart,) = campaign_charts(made_summary(results=(made_of(values=values),)))
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
    result = made_of(correlated, values=(1.0, NAN, 3.0))
    _, chart = campaign_charts(made_summary(results=(result,)))
    (points,) = chart.panels[0].marks
    assert isinstance(points, Points)
    assert (points.x.tolist(), points.y.tolist()) == ([1.0, 3.0], [1.0, 3.0])
