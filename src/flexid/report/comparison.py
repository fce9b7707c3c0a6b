"""A comparison as tables, JSON, a figure and a page."""

import shlex
from collections.abc import Iterator, Mapping, Sequence
from math import isfinite
from typing import Any

import numpy as np

from flexid.arrays import plain
from flexid.comparisons.comparison import Comparison
from flexid.comparisons.differences import Difference, Outcome
from flexid.identification.vocabulary.evidence import ValueEstimate
from flexid.report.chart import Axis, Chart, Colour, Level, Line, Mark, Panel, Points
from flexid.report.comparison_summary import comparison_summary, largest
from flexid.report.identification import COEFFICIENTS, PARAMETERS
from flexid.report.page import Answer, Bullets, Item, Page, Presenter, Section, Tone, sections_of
from flexid.report.terminal import Cell, Column, Part, Table, numbers, value_cells

OUTCOME_COLOURS: dict[Outcome, str] = {
    "changed": "red",
    "perhaps changed": "yellow",
    "no change": "green",
    "contradictory": "red",
    "compatible": "green",
    "not determined": "yellow",
    "not compared": "",
}

_NONE = Cell(("–",))
_LONGEST = 60  # characters of a setting


def parts(comparison: Comparison) -> Iterator[Part]:
    """Tables and sentences of the answer."""
    for side, label in zip("AB", comparison.labels, strict=True):
        yield f"{side}: {label}"
    yield ""
    for title, differences in (
        (PARAMETERS, comparison.parameters),
        (COEFFICIENTS, comparison.coefficients),
    ):
        if differences:
            yield differences_table(title, differences)
            yield from (f"  {line}" for line in remarks(differences))
            yield ""
    if comparison.settings:
        yield settings_table(comparison)
    yield from comparison_summary(comparison)


def differences_table(title: str, differences: Mapping[str, Difference]) -> Table:
    """Both values of each number, what is between them, and the verdict on that."""
    columns = (
        Column("name"),
        *numbers("A", "B"),
        Column("unit", spare=2),
        Column("B - A", right=True, spare=1),  # in the middle of its interval
        *numbers("95 % interval"),
        Column("verdict"),
    )
    table = Table(title, columns)
    for d in differences.values():
        change, interval = _change(d)
        outcome = Cell(outcome_texts(d), OUTCOME_COLOURS[d.outcome])
        a, b = (value_cells(v.value, *v.interval)[0] if v else "none" for v in (d.a, d.b))
        table.add(d.name, a, b, d.unit, change, interval, outcome)
    return table


def lead_table(differences: Mapping[str, Difference]) -> Table:
    """What is between both values of each number, and the verdict on that in a word."""
    columns = (Column("name"), *numbers("B - A", "95 % interval"), Column("unit"))
    table = Table("Differences", (*columns, Column("verdict")))
    for d in differences.values():
        relative = isfinite(d.percent)
        shown = (d.percent, *d.percent_interval) if relative else (d.value, *d.interval)
        change, interval = value_cells(*shown) if d.compared else (_NONE, _NONE)
        verdict = Cell((d.outcome,), OUTCOME_COLOURS[d.outcome])
        table.add(d.name, change, interval, "%" if relative else d.unit, verdict)
    return table


def remarks(differences: Mapping[str, Difference]) -> Iterator[str]:
    """Why something is not compared, or what stands for a number that one model does without."""
    for d in differences.values():
        if d.reason and d.a is not None and d.b is not None:
            yield f"{d.name}: {d.reason}"
        elif d.without and d.compared:
            sides = " and ".join(d.without)
            yield f"{d.name}: {sides} does without it; what it could be there is compared"


def settings_table(comparison: Comparison) -> Table:
    """What was asked for, chosen or used otherwise."""
    table = Table("Different logs or settings", (Column(""), Column("A"), Column("B", wraps=True)))
    for name, pair in comparison.settings.items():
        table.add(name, *map(shortened, pair))
    return table


def _change(d: Difference) -> tuple[Cell, Cell]:
    """Difference and interval: in per cent, or in the unit where that says nothing."""
    if not d.compared:
        return Cell(("",)), Cell(("",))
    if isfinite(d.percent):
        change, interval = value_cells(d.percent, *d.percent_interval)
        return change.with_unit("%"), interval.with_unit("%")
    change, interval = value_cells(d.value, *d.interval)
    bare = interval.texts[-1]  # the verdict has the unit as well
    return change.with_unit(d.unit), Cell((*interval.with_unit(d.unit).texts, bare))


def outcome_texts(d: Difference) -> tuple[str, ...]:
    """The verdict in words, and in fewer where there is no room."""
    if d.outcome != "no change":
        return (d.outcome,)
    bound = largest(d)
    return f"no change larger than {bound}", f"same to {bound}"


def shortened(text: str) -> str:
    """A setting as far as a table has room for it."""
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 1]}…"


_COLUMNS = 2
_DRAWN: dict[str, Colour] = {"green": "green", "yellow": "orange", "red": "red"}
_MARGIN = 0.06  # of what is shown, to either side


def charts(comparison: Comparison) -> tuple[Chart]:
    """Both values with their intervals, a panel for each number, relative to A's value."""
    panels = (_panel(d) for d in comparison.decisive.values() if d.compared)
    chart = Chart(
        "comparison",
        f"A: {shortened(comparison.labels[0])}; B: {shortened(comparison.labels[1])}",
        "Each panel has one number of both estimates with its 95 % interval, relative to A's "
        "value; its title says what the difference may be.",
        tuple(panel for panel in panels if panel is not None),
        columns=_COLUMNS,
        linked=False,
    )
    return (chart,)


def _panel(d: Difference) -> Panel | None:
    """One number of both estimates; None if it is too large to be drawn."""
    assert d.a is not None
    assert d.b is not None
    relative = isfinite(d.percent)
    of_b: Colour = _DRAWN[OUTCOME_COLOURS[d.outcome]]
    marks: list[Mark] = [Level("", 0.0, "x", "grey", "dotted")] if relative else []
    of_a, of_other = (_numbers(value, d.a if relative else None) for value in (d.a, d.b))
    marks += [*_interval(0.0, "blue", *of_a), *_interval(1.0, of_b, *of_other)]
    low, high = min(*of_a, *of_other), max(*of_a, *of_other)
    margin = _MARGIN * (high - low)
    if not isfinite(margin):
        return None
    outcome = f"no change larger than {largest(d)}" if d.outcome == "no change" else d.outcome
    return Panel(
        f"{d.name}\n{outcome}",
        Axis(
            "relative to A" if relative else d.name,
            "%" if relative else d.unit,
            limits=(low - margin, high + margin),
        ),
        Axis("", categories=("A", "B")),
        tuple(marks),
    )


def _numbers(value: ValueEstimate, relative_to: ValueEstimate | None) -> tuple[float, ...]:
    """A value and the ends of its interval, in per cent or as they are."""
    numbers = (value.value, *value.interval)
    if relative_to is None:
        return numbers
    return tuple(100.0 * (x - relative_to.value) / abs(relative_to.value) for x in numbers)


def _interval(place: float, colour: Colour, value: float, low: float, high: float) -> list[Mark]:
    ends, at = np.array([low, high]), np.array([place, place])
    return [
        Line("", ends, at, colour, width=2.5),
        Points("", np.array([value]), np.array([place]), colour, size=6.0),
    ]


_IN_MEMORY = ("A", "B")  # labels of estimates that come from no file

_NOTES = (
    "changed: beyond chance, however many numbers are compared; perhaps changed: its own interval "
    "excludes zero, which chance does to one number in twenty",
)


def page(
    comparison: Comparison, charts: Sequence[Chart], command: str = "", _out: str = ""
) -> Page:
    """What there is to say of a comparison."""
    a, b = comparison.labels
    if not command and comparison.labels != _IN_MEMORY:
        command = shlex.join(["flexid", "compare", a, b])
    question = (
        "Do they agree on this log?" if comparison.logs == "same" else "Has anything changed?"
    )
    sections, facts = _sections(comparison, charts), _facts(comparison)
    return Page(
        "comparison",
        "Two estimates side by side",
        f"A: {a}; B: {b}",
        lead_table(comparison.decisive),
        (
            Answer(question, *_judged(comparison), [*comparison_summary(comparison)]),
            _next_step(comparison),
        ),
        sections_of(comparison.warnings, sections, command, facts),
        _NOTES,
    )


def _sections(comparison: Comparison, charts: Sequence[Chart]) -> Iterator[Section]:
    figure = [chart for chart in charts if chart.panels]
    both = [*figure, *_both_values(PARAMETERS, comparison.parameters)]
    yield Section("values", "Both values of each parameter", both)
    if comparison.coefficients:
        both = [*_both_values(COEFFICIENTS, comparison.coefficients)]
        yield Section("coefficients", "Coefficients of the model", both)
    if comparison.settings:
        yield Section("settings", "Different logs or settings", [settings_table(comparison)])


def _both_values(title: str, differences: Mapping[str, Difference]) -> Iterator[Item]:
    yield differences_table(title, differences)
    if lines := [*remarks(differences)]:
        yield Bullets(lines)


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
            said = "The different settings make no difference that this log can show."
    elif comparison.differ or comparison.having("perhaps changed"):
        word = "Record B once more"
        said = (
            "With the motion of A. What has changed is seen again; what was chance, or the work of "
            "another motion, is not."
        )
    elif comparison.lacking:
        word = "Record another motion"
        said = "flexid excitation says of either log which one determines what is lacking."
    return Answer("What do I do next?", word, "", [said])


def _facts(comparison: Comparison) -> Iterator[tuple[str, str]]:
    yield "flexid", str(comparison.provenance.get("flexid_version", "unknown"))
    for side, label in zip("AB", comparison.labels, strict=True):
        yield side, label
        for log in comparison.provenance.get(side.lower(), {}).get("inputs", ()):
            yield f"log of {side}", str(log.get("file") or "data in memory")
            if log.get("sha256"):
                yield "SHA-256", str(log["sha256"])


def document(comparison: Comparison) -> dict[str, Any]:
    """Differences with their intervals and outcomes, for JSON."""
    return {
        "agree": comparison.agree,
        "differ": comparison.differ,
        "a": comparison.labels[0],
        "b": comparison.labels[1],
        "models": comparison.models,
        "logs": comparison.logs,
        "parameters": _differences(comparison.parameters),
        "coefficients": _differences(comparison.coefficients),
        "together": comparison.together,
        "settings": {name: {"a": a, "b": b} for name, (a, b) in comparison.settings.items()},
        "summary": [*comparison_summary(comparison)],
        "warnings": comparison.warnings,
        "provenance": comparison.provenance,
    }


def _differences(differences: Mapping[str, Difference]) -> dict[str, Any]:
    found = {}
    for name, difference in differences.items():
        made = plain(difference)
        del made["name"]
        found[name] = made | {"difference": made.pop("value")}
    return found


PRESENTER = Presenter(parts, document, charts, page)
