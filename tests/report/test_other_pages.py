"""The pages of a run, a campaign and the paper."""

from dataclasses import replace
from pathlib import Path

import pytest

from flexid.experiments import read_experiment
from flexid.experiments.measures import measure
from flexid.report import reproduction as reproduced
from flexid.report import simulated_run
from flexid.report.page import Command, page_html
from flexid.report.reproduction_charts import reproduction_charts

FOLDER = Path(__file__).parents[2] / "experiments"
NAN = float("nan")


@pytest.fixture(scope="module")
def simulated():
    """Return a short experiment, its run and that in numbers."""
    experiment = read_experiment(FOLDER / "huang2003.toml").with_values({"run.duration": 1.0})
    run = experiment.run()
    return experiment, run, measure(run)


@pytest.mark.parametrize(
    ("late", "word", "tone"),
    [(0, "All of them", "good"), (3, "1 of 4", "fair"), (4, "0 of 4", "bad")],
)
def test_a_run_says_which_estimates_settle(simulated, late, word, tone):
    """Assert that all, some and none have their word and tone, and the late ones are named."""
    experiment, run, measures = simulated
    names = list(measures.settling_times)
    times = {name: NAN if place < late else 0.1 for place, name in enumerate(names)}
    page = simulated_run.page(experiment, run, replace(measures, settling_times=times), ())
    answer = page.answers[0]
    assert (answer.word, answer.tone) == (word, tone)
    said = [str(item) for item in answer.content]
    assert (f"Not settled: {', '.join(names[:late])}." in said) == (late > 0)


def test_a_run_is_on_its_page(simulated):
    """Assert that the HTML has the table, the figures, the lines and the commands."""
    experiment, run, measures = simulated
    charts = simulated_run.charts(experiment, run, measures)
    made = page_html(
        simulated_run.page(experiment, run, measures, charts, "flexid simulate x", "a b")
    )
    assert made.count('class="chart wide"') == 2
    for text in ("theta1", "Tracking error:", "flexid simulate x", experiment.digest):
        assert text in made
    assert "flexid identify &#39;a b/log.parquet&#39;" in made


def test_the_paper_is_on_its_page(reproduction):
    """Assert that every claim has its verdict, and the figures are there."""
    charts = reproduction_charts(reproduction)
    page = reproduced.page(reproduction, charts)
    shown = [row[1].at(0) for row in page.lead.rows if row]
    assert shown == [claim.verdict for claim in reproduction.claims]
    hold = shown.count("holds")
    assert page.answers[0].word == f"{hold} of {len(shown)}"
    assert page.answers[1].word == "(1,2,3)"
    assert page.sections[-1].content[0] == Command("flexid reproduce")
    made = page_html(page)
    assert made.count('class="chart wide"') == len(charts)
    assert len(made) < 1_000_000
