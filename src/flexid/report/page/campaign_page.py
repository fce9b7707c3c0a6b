"""The page of a campaign: how its runs ended, and what matters."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Sequence

from rich.text import Text

import flexid
from flexid.campaigns.summary import Summary
from flexid.report.campaign_table import DETAILS, importance_parts, quantiles_table, status_lines
from flexid.report.charts.description import Chart
from flexid.report.page.layout import Answer, Command, Facts, Page, Points, Section

_NAMED = 3


def campaign_page(summary: Summary, charts: Sequence[Chart]) -> Page:
    """What there is to say of a campaign."""
    first, *rest = status_lines(summary)
    directory = str(summary.directory)
    command = Command(shlex.join(["flexid", "campaign", "--summary", directory]))
    facts = Facts([("flexid", flexid.__version__), ("rows", directory)])
    return Page(
        "campaign",
        f"Campaign {summary.directory.name}",
        first,
        quantiles_table(summary),
        (_finished(summary, rest), _matters(summary)),
        (
            Section("matters", "What matters", [*charts, *importance_parts(summary)]),
            Section("origin", "How to repeat it", [command, facts]),
        ),
    )


def _finished(summary: Summary, lines: Sequence[str]) -> Answer:
    done, wanted = summary.finished, summary.manifest.runs
    word = "All of them" if done == wanted else f"{done} of {wanted}"
    tone = "good" if done == wanted else "fair" if done else "bad"
    return Answer("Did the runs finish?", word, tone, [Text(line) for line in lines])


def _matters(summary: Summary) -> Answer:
    """The input that most results depend on most, and on which the first ones depend."""
    strongest = {
        result.name: max(found, key=lambda one: abs(one.value))
        for result in summary.results
        if (found := [one for one in result.correlations if one.significant])
        and not result.name.startswith(DETAILS)
    }
    question = "What matters most?"
    if not strongest:
        return Answer(question, "Nothing that was varied", "", [])
    (most, _), *_ = Counter(one.input for one in strongest.values()).most_common()
    lines = [f"{name}: {one.input} ({one.value:+.2f})" for name, one in strongest.items()]
    shown = [Text("Strongest rank correlation of each result:"), Points(lines[:_NAMED])]
    return Answer(question, most, "", shown)
