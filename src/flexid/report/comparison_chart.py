"""The figure of a comparison, as a chart."""

from math import isfinite

import numpy as np

from flexid.comparisons.comparison import Comparison
from flexid.comparisons.number_difference import Difference, Outcome
from flexid.identification.vocabulary.evidence import ValueEstimate
from flexid.report.charts.description import Axis, Chart, Colour, Level, Line, Mark, Panel, Points
from flexid.report.comparison_table import largest, shortened

_COLUMNS = 2
_MARGIN = 0.06  # of what is shown, to either side
_COLOURS: dict[Outcome, Colour] = {
    "changed": "red",
    "contradictory": "red",
    "perhaps changed": "orange",
}


def comparison_chart(comparison: Comparison) -> Chart:
    """Both values with their intervals, a panel for each number, relative to A's value."""
    panels = (_panel(d) for d in comparison.decisive.values() if d.compared)
    return Chart(
        "comparison",
        f"A: {shortened(comparison.labels[0])}; B: {shortened(comparison.labels[1])}",
        "Each panel has one number of both estimates with its 95 % interval, relative to A's "
        "value; its title says what the difference may be.",
        tuple(panel for panel in panels if panel is not None),
        columns=_COLUMNS,
        linked=False,
    )


def _panel(d: Difference) -> Panel | None:
    """One number of both estimates; None if it is too large to be drawn."""
    assert d.a is not None
    assert d.b is not None
    relative = isfinite(d.percent)
    of_b = _COLOURS.get(d.outcome, "green")
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
