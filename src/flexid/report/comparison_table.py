"""The printed answer of a comparison."""

from collections.abc import Iterator, Mapping
from math import isfinite

from rich.text import Text

from flexid.comparisons.comparison import Comparison
from flexid.comparisons.number_difference import Difference, Outcome
from flexid.identification.vocabulary.evidence import ValueEstimate
from flexid.report.comparison_summary import comparison_summary, largest
from flexid.report.digits import value_cells
from flexid.report.terminal import Cell, Column, Part, Table, numbers

OUTCOME_COLOURS: dict[Outcome, str] = {
    "changed": "red",
    "perhaps changed": "yellow",
    "no change": "green",
    "contradictory": "red",
    "compatible": "green",
    "not determined": "yellow",
    "not compared": "",
}

PARAMETERS, COEFFICIENTS = "Physical parameters", "Coefficients"

_NONE = Cell(("–",))
_LONGEST = 60  # characters of a setting


def comparison_parts(comparison: Comparison) -> Iterator[Part]:
    """Tables and sentences of the answer."""
    for side, label in zip("AB", comparison.labels, strict=True):
        yield Text(f"{side}: {label}")
    yield Text()
    for title, differences in (
        (PARAMETERS, comparison.parameters),
        (COEFFICIENTS, comparison.coefficients),
    ):
        if differences:
            yield differences_table(title, differences)
            yield from (Text(f"  {line}") for line in remarks(differences))
            yield Text()
    if comparison.settings:
        yield settings_table(comparison)
    yield from map(Text, comparison_summary(comparison))


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
        table.add(d.name, _value(d.a), _value(d.b), d.unit, change, interval, outcome)
    return table


def lead_table(differences: Mapping[str, Difference]) -> Table:
    """What is between both values of each number, and the verdict on that in a word."""
    columns = (Column("name"), *numbers("B - A", "95 % interval"), Column("unit"))
    table = Table("What is between both", (*columns, Column("verdict")))
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
    table = Table("Made otherwise", (Column(""), Column("A"), Column("B", wraps=True)))
    for name, pair in comparison.settings.items():
        table.add(name, *map(shortened, pair))
    return table


def _value(value: ValueEstimate | None) -> Cell:
    return Cell(("none",)) if value is None else value_cells(value.value, *value.interval)[0]


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
