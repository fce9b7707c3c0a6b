"""The page of a comparison: what has changed, what to do next, and what that rests on."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping
from typing import Any

from rich.text import Text

from flexid.comparisons.comparison import Comparison
from flexid.comparisons.estimate_origins import inputs
from flexid.report.comparison_chart import comparison_chart
from flexid.report.comparison_summary import comparison_summary
from flexid.report.comparison_table import (
    COEFFICIENTS,
    PARAMETERS,
    differences_table,
    lead_table,
    remarks,
    settings_table,
)
from flexid.report.page.layout import (
    Answer,
    Command,
    Facts,
    Item,
    Page,
    Points,
    Section,
    Tone,
    Warned,
)

_IN_MEMORY = ("A", "B")  # labels of estimates that come from no file

_NOTES = (
    "changed: beyond chance, however many numbers are compared; perhaps changed: its own interval "
    "excludes zero, which chance does to one number in twenty",
)


def comparison_page(comparison: Comparison, command: str = "") -> Page:
    """What there is to say of a comparison."""
    a, b = comparison.labels
    return Page(
        "comparison",
        "Two estimates side by side",
        f"A: {a}; B: {b}",
        lead_table(comparison.decisive),
        (_changed(comparison), _next_step(comparison)),
        [section for section in _sections(comparison, command) if section.content],
        _NOTES,
    )


def _sections(comparison: Comparison, command: str) -> Iterator[Section]:
    yield Section("warnings", "Warnings", [*map(Warned, comparison.warnings)])
    chart = comparison_chart(comparison)
    figure: list[Item] = [chart] if chart.panels else []
    parameters = comparison.parameters
    table = differences_table(PARAMETERS, parameters)
    listed = [*figure, table, *_listed([*remarks(parameters)])]
    yield Section("values", "Both values of each parameter", listed)
    coefficients = comparison.coefficients
    if coefficients:
        table = differences_table(COEFFICIENTS, coefficients)
        listed = [table, *_listed([*remarks(coefficients)])]
        yield Section("coefficients", "Coefficients of the model", listed)
    if comparison.settings:
        yield Section("settings", "Different logs or settings", [settings_table(comparison)])
    yield Section("origin", "How to repeat it", [*_origin(comparison, command)])


def _listed(lines: list[str]) -> list[Item]:
    return [Points(lines)] if lines else []


def _changed(comparison: Comparison) -> Answer:
    """Whether anything has changed, and how surely."""
    question = "Has anything changed?"
    if comparison.logs == "same":
        question = "Do they agree on this log?"
    content = [Text(line) for line in comparison_summary(comparison)]
    return Answer(question, *_judged(comparison), content)


def _judged(comparison: Comparison) -> tuple[str, Tone]:
    if comparison.differ:
        return ("No" if comparison.logs == "same" else "Yes"), "bad"
    if comparison.lacking or not any(d.compared for d in comparison.decisive.values()):
        return "Not all of it is known", "fair"
    if comparison.logs == "same":
        return "Yes", "good"
    if comparison.having("perhaps changed"):
        return "Perhaps", "fair"
    return "Nothing is seen", "good"


def _next_step(comparison: Comparison) -> Answer:
    """What to do with that."""
    word, said = "Nothing", "To see smaller changes record longer, or move more."
    if comparison.logs == "same":
        if comparison.differ:
            word = "Look for what one model lacks"
            said = "Another log decides which of both predicts it: flexid validate."
        else:
            said = "What was done otherwise makes no difference that this log can show."
    elif comparison.differ or comparison.having("perhaps changed"):
        word = "Record B once more"
        said = (
            "With the motion of A. What has changed is seen again; what was chance, or the work of "
            "another motion, is not."
        )
    elif comparison.lacking:
        word = "Record another motion"
        said = "flexid excitation says of either log which one determines what is lacking."
    return Answer("What do I do next?", word, "", [Text(said)])


def _origin(comparison: Comparison, command: str) -> Iterator[Item]:
    if not command and comparison.labels != _IN_MEMORY:
        command = shlex.join(["flexid", "compare", *comparison.labels])
    if command:
        yield Command(command)
    facts = [("flexid", str(comparison.provenance.get("flexid_version", "unknown")))]
    for side, label in zip("AB", comparison.labels, strict=True):
        facts.append((side, label))
        facts += _logs(side, comparison.provenance.get(side.lower(), {}))
    yield Facts(facts)


def _logs(side: str, provenance: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    for log in inputs(provenance):
        yield f"log of {side}", str(log.get("file") or "data in memory")
        if log.get("sha256"):
            yield "SHA-256", str(log["sha256"])
