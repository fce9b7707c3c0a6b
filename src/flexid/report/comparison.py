"""A comparison as tables, sentences and JSON."""

from collections.abc import Iterator, Mapping, Sequence
from math import isfinite
from typing import Any

from rich.text import Text

from flexid.arrays import plain
from flexid.identification.vocabulary.evidence import CONFIDENCE
from flexid.identification.vocabulary.thresholds import THRESHOLDS
from flexid.report.identification import COEFFICIENTS, PARAMETERS
from flexid.report.terminal import Part, Table, listed, number, numbers, value_texts
from flexid.stored_estimates.comparison import Comparison, Difference, Outcome

OUTCOME_COLOURS: dict[Outcome, str] = {
    "changed": "red",
    "perhaps changed": "yellow",
    "no change": "green",
    "contradictory": "red",
    "compatible": "green",
    "not determined": "yellow",
    "not compared": "",
}


def parts(comparison: Comparison) -> Iterator[Part]:
    """Return tables and sentences of the result."""
    for side, label in zip("AB", comparison.labels, strict=True):
        yield f"{side}: {label}"
    yield ""
    columns = ("name", *numbers("A", "B", "B - A, 95 % interval"), "verdict")
    for title, differences in (
        (PARAMETERS, comparison.parameters),
        (COEFFICIENTS, comparison.coefficients),
    ):
        if differences:
            table = Table(title, columns)
            for d in differences.values():
                a, b = (value_texts(v.value, *v.interval)[0] if v else "none" for v in (d.a, d.b))
                interval = "{1} {2}".format(*_change(d)) if d.compared else ""
                table.add(d.name, a, b, interval, outcome_text(d))
            yield table
            yield from (f"  {line}" for line in remarks(differences))
            yield ""
    yield from comparison_summary(comparison)


def remarks(differences: Mapping[str, Difference]) -> Iterator[str]:
    """Return why a number is not compared, or that a bound replaces an excluded term."""
    for d in differences.values():
        if d.reason and d.a is not None and d.b is not None:
            yield f"{d.name}: {d.reason}"
        elif d.without and d.compared:
            sides = " and ".join(d.without)
            yield f"{d.name}: excluded in {sides}; its bound there is compared"


def outcome_text(d: Difference) -> Text:
    """Return the verdict as text; "cannot tell" if the bound on a change exceeds the value."""
    if d.outcome != "no change":
        return Text(d.outcome, OUTCOME_COLOURS[d.outcome])
    if d.largest_percent > 100.0 * THRESHOLDS.weak_width:
        return Text("cannot tell", OUTCOME_COLOURS["not determined"])
    return Text(f"same to {largest(d)}", OUTCOME_COLOURS["no change"])


def comparison_summary(comparison: Comparison) -> Iterator[str]:
    """Return sentences on what has changed, and with what confidence."""
    compared = [d for d in comparison.decisive.values() if d.compared]
    if not compared:
        yield "Nothing can be compared: no number was estimated in both."
    elif comparison.logs == "same":
        yield _of_one_log(comparison, compared)
    else:
        yield _changes(comparison, compared)
        if perhaps := comparison.having("perhaps changed"):
            share = 100.0 * (1.0 - CONFIDENCE ** len(compared))
            yield (
                f"Perhaps changed: {_names(perhaps)}. Among {_count(compared)}, chance gives such "
                f"a difference in up to about {share:.0f} % of comparisons; a third log can decide."
            )
    if comparison.lacking:
        yield f"Not determined in A or in B, and so not compared: {_names(comparison.lacking)}."


def largest(d: Difference) -> str:
    """Return the bound on the size of a difference, with its unit."""
    if isfinite(d.largest_percent):
        return f"{_rounded_up(d.largest_percent)} %"
    return f"{_rounded_up(d.largest)} {d.unit}"


def _rounded_up(value: float) -> str:
    """Return two digits that are at least as large as the number."""
    if not isfinite(value):
        return "any"
    shown = number(value, 2)
    return shown if float(shown) >= value else number(1.05 * value, 2)


def _changes(comparison: Comparison, compared: Sequence[Difference]) -> str:
    changed = comparison.having("changed")
    if changed:
        by = ", ".join(f"{d.name} by {' '.join(_change(d))}" for d in changed)
        return (
            f"Changed: {by}. This is beyond chance for {_count(compared)} together: if "
            f"nothing has changed, at most 5 % of comparisons report a change."
        )
    unchanged = f"No change was found in {_count(compared)}"
    known = [d for d in compared if isfinite(d.largest_percent)]
    if not known:
        return f"{unchanged}."
    worst = max(known, key=lambda d: d.largest_percent)
    return f"{unchanged}; the largest that may be hidden is {largest(worst)} of {worst.name}."


def _of_one_log(comparison: Comparison, compared: Sequence[Difference]) -> str:
    contradictory = comparison.having("contradictory")
    begin = "Both estimates are of the same logs, so the drive cannot have changed."
    if contradictory:
        return (
            f"{begin} Yet {_names(contradictory)} {_differ(contradictory)} by more than both "
            f"intervals allow: at least one of the two models is wrong."
        )
    return f"{begin} {_count(compared)} {_differ(compared)} by no more than both intervals allow."


def _differ(differences: Sequence[Difference]) -> str:
    return "differ" if len(differences) > 1 else "differs"


def _change(d: Difference) -> tuple[str, str, str]:
    """Return a difference, its interval and their unit."""
    if isfinite(d.percent):
        return *value_texts(d.percent, *d.percent_interval), "%"
    return *value_texts(d.value, *d.interval), d.unit


def _count(compared: Sequence[Difference]) -> str:
    return f"{len(compared)} number{'s' if len(compared) > 1 else ''}"


def _names(differences: Sequence[Difference]) -> str:
    return listed([d.name for d in differences])


def heading(comparison: Comparison) -> tuple[str, str]:
    """Return the title, and the labels of both estimates."""
    a, b = comparison.labels
    return "Comparison of two estimates", f"A: {a}; B: {b}"


def document(comparison: Comparison) -> dict[str, Any]:
    """Return differences with their intervals and outcomes, for JSON."""
    return {
        "agree": comparison.agree,
        "differ": comparison.differ,
        "a": comparison.labels[0],
        "b": comparison.labels[1],
        "models": comparison.models,
        "logs": comparison.logs,
        "parameters": _differences(comparison.parameters),
        "coefficients": _differences(comparison.coefficients),
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
