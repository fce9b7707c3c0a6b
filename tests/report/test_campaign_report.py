"""The printed summary of a campaign, its document and its figures."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flexid.campaigns.importance import Correlation, SobolIndex
from flexid.campaigns.manifest import Manifest
from flexid.campaigns.summary import Result, Summary
from flexid.report.campaign_document import campaign_document
from flexid.report.campaign_figures import save_campaign_figures
from flexid.report.campaign_table import correlation_text, index_text, status_lines
from flexid.report.documents import to_json

NAN = float("nan")


def made_result(correlations=(), indices=(), values=(1.0, 2.0, NAN), name="tracking_rms"):
    """Return a result."""
    array = np.array(values)
    missing = int(np.isnan(array).sum())
    return Result(name, array, missing, (1.0, 1.5, 2.0), tuple(correlations), tuple(indices))


def made_summary(done=100, statuses=None, damaged=(), first_error="", results=()):
    """Return a summary of a campaign of 100 runs."""
    manifest = Manifest(
        "1.0", "0123", "4567", "sobol", 100, ("controller.k",), ("tracking",), 10, "the file"
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
    document = json.loads(to_json(campaign_document(made_summary(results=(nothing,)))))
    found = document["results"]["settling_time.theta1"]
    assert found["quantiles"] == {"0.05": None, "0.5": None, "0.95": None}
    assert (found["finite"], found["missing"]) == (0, 1)
    assert document["complete"]


def test_figures_are_drawn_of_what_varies(tmp_path):
    """Assert that constant or missing results make no panel, and nothing makes no file."""
    dull = [made_result(values=(1.0, 1.0, 1.0)), made_result(values=(NAN, NAN, NAN))]
    save_campaign_figures(made_summary(results=tuple(dull)), tmp_path)
    assert list(tmp_path.iterdir()) == []
    wide = made_result([Correlation("controller.k", 1.0, True)], values=(1e-6, 1.0, NAN))
    save_campaign_figures(made_summary(results=(*dull, made_result(), wide)), tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "dependence.png",
        "distributions.png",
    ]


def test_each_panel_has_its_unit(tmp_path, monkeypatch):
    """Assert that results and inputs stand in a figure with the units of the joint."""
    figures = {}
    monkeypatch.setattr(
        "flexid.report.campaign_figures.save",
        lambda figure, _directory, name: figures.setdefault(name, figure),
    )
    correlated = [Correlation("controller.k", 1.0, True)]
    results = (
        made_result(correlated, values=(1.0, 2.0, 3.0)),
        made_result(correlated, values=(1e-30, 1.0, 2.0), name="settling_time.theta1"),
    )
    summary = made_summary(results=results)
    save_campaign_figures(replace(summary, manifest=replace(summary.manifest, text="")), tmp_path)
    for figure in figures.values():
        first, second = (ax.get_title(loc="left") for ax in figure.axes[:2])
        assert first == "tracking_rms [rad]"
        assert second.splitlines() == ["settling_time.theta1 [s]", "1 below 2e-12 stand there"]
    assert figures["dependence"].axes[0].get_xlabel() == "controller.k [1/s]"
