"""The page of a simulated run: whether its estimates settle, and how it moves."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from math import isfinite

from rich.text import Text

import flexid
from flexid.experiments.experiment import Experiment
from flexid.experiments.measures import SETTLED, Measures
from flexid.experiments.run_columns import is_joint
from flexid.report.charts.description import Chart
from flexid.report.page.layout import Answer, Command, Facts, Item, Page, Points, Section
from flexid.report.run_table import estimates_table, run_lines
from flexid.simulation.run import Run


def run_page(
    experiment: Experiment,
    run: Run,
    measures: Measures,
    charts: Sequence[Chart],
    command: str = "",
    log: str = "",
) -> Page:
    """What there is to say of a run."""
    answers = [_settles(measures)]
    if log and is_joint(run):
        said = Text("The log of its sensors is one like any other:")
        asked = Command(f"flexid identify {shlex.quote(log)}")
        answers.append(Answer("What do I do next?", "Identify it", "", [said, asked]))
    facts = Facts(
        [
            ("flexid", flexid.__version__),
            ("experiment", experiment.path or "in memory"),
            ("digest of the experiment", experiment.digest),
        ]
    )
    origin: list[Item] = [Command(command), facts] if command else [facts]
    return Page(
        "simulation",
        experiment.name,
        f"{run.time[-1]:g} s, {experiment.mode}",
        estimates_table(experiment, run, measures),
        answers,
        (
            Section("figures", "Motion and estimates", charts),
            Section("numbers", "The run in numbers", [Points([*run_lines(run, measures)])]),
            Section("origin", "How to repeat it", origin),
        ),
    )


def _settles(measures: Measures) -> Answer:
    """Whether the observer finds the coefficients."""
    times = measures.settling_times
    settled = {name: time for name, time in times.items() if isfinite(time)}
    word = "All of them" if len(settled) == len(times) else f"{len(settled)} of {len(times)}"
    tone = "good" if len(settled) == len(times) else "fair" if settled else "bad"
    content = [Text(f"Settled: within {100 * SETTLED:g} % of the true value until the end.")]
    if settled:
        last = max(settled, key=lambda name: settled[name])
        content.append(Text(f"The last is {last}, from {settled[last]:.3g} s on."))
    if lost := [name for name in times if name not in settled]:
        content.append(Text(f"Not settled: {', '.join(lost)}."))
    return Answer("Do the estimates settle?", word, tone, content)
