"""Charts of a campaign: how every result is distributed, and on what it depends most."""

import numpy as np

from flexid.arrays import FloatArray
from flexid.campaigns.summary import Result, Summary
from flexid.experiments.units import Units
from flexid.report.campaign_table import DETAILS
from flexid.report.charts.description import Axis, Chart, Dash, Level, Line, Panel, Points
from flexid.report.charts.limits import whole_decades

_COLUMNS = 3
_BINS = 40
_MOST_POINTS = 3000
_MANY = 200  # points, from which on each is small and faint
_LOGARITHMIC_FROM = 30.0  # ratio of the largest value to the smallest
_SMALLEST = 1e-12  # share of the largest value below which all values are drawn alike
_LINES: tuple[tuple[str, Dash], ...] = (("5 %", "dotted"), ("median", "solid"), ("95 %", "dotted"))


def campaign_charts(summary: Summary) -> tuple[Chart, ...]:
    """Distributions and dependence, where there is something to draw."""
    shown = [result for result in summary.results if _drawable(result)]
    depending = [result for result in shown if _strongest(result) is not None]
    units = Units(summary.manifest.text)
    charts = []
    if shown:
        charts.append(_distributions(summary, shown, units))
    if depending:
        charts.append(_dependence(summary, depending, units))
    return tuple(charts)


def _drawable(result: Result) -> bool:
    finite = result.values[np.isfinite(result.values)]
    varies = len(finite) > 1 and bool(np.ptp(finite) > 0.0)
    return varies and not result.name.startswith(DETAILS)


def _distributions(summary: Summary, results: list[Result], units: Units) -> Chart:
    panels = tuple(_distribution(result, units.of_result(result.name)) for result in results)
    first = results[0]
    low, _, high = first.quantiles
    unit = units.of_result(first.name)
    says = (
        f"In nine of ten runs {first.name} is between {low:.3g} and {high:.3g}"
        f"{f' {unit}' if unit not in ('', '1') else ''}; the dotted lines are these limits for "
        "each result, the full line its median."
    )
    title = f"Distributions of the results of {summary.finished} finished runs"
    return Chart("distributions", title, says, panels, _COLUMNS, linked=False)


def _dependence(summary: Summary, results: list[Result], units: Units) -> Chart:
    panels = tuple(_cloud(result, summary, units) for result in results)
    strongest = "; ".join(f"{result.name}: {_strongest(result)}" for result in results[:3])
    says = f"The input that matters most for each result is below it ({strongest})."
    title = "Each result against the input that matters most for it"
    return Chart("dependence", title, says, panels, _COLUMNS, linked=False)


def _distribution(result: Result, unit: str) -> Panel:
    """Counts of a result, and its quantiles."""
    values, said, limits = _scaled(result.values[np.isfinite(result.values)])
    spread = np.geomspace if limits else np.linspace
    edges = spread(values.min(), values.max(), _BINS)
    counts, _ = np.histogram(values, edges)
    heights = np.concatenate([[0.0], np.repeat(counts.astype(np.float64), 2), [0.0]])
    marks = (
        Line("runs", np.repeat(edges, 2), heights, "blue", 0.8, filled=True),
        *(
            Level(label, value, "x", "orange", dash)
            for value, (label, dash) in zip(result.quantiles, _LINES, strict=True)
        ),
    )
    x = Axis(result.name, unit, logarithmic=limits is not None, limits=limits)
    y = Axis("runs", limits=(0.0, 1.08 * float(counts.max())))
    return Panel(result.name + said, x, y, marks)


def _cloud(result: Result, summary: Summary, units: Units) -> Panel:
    """A result over its strongest input, run by run."""
    name = _strongest(result)
    assert name is not None
    values, inputs = result.values[:_MOST_POINTS], summary.inputs[name][:_MOST_POINTS]
    there = np.isfinite(values)
    values, said, limits = _scaled(values[there])
    inputs = inputs[there]
    across = whole_decades(inputs) if _logarithmic(inputs) else None
    many = len(values) >= _MANY
    points = Points("runs", inputs, values, "blue", 3.0 if many else 3.7, faint=many)
    return Panel(
        result.name + said,
        Axis(name, units.of_value(name), logarithmic=across is not None, limits=across),
        Axis("value", units.of_result(result.name), logarithmic=limits is not None, limits=limits),
        (points,),
    )


def _scaled(values: FloatArray) -> tuple[FloatArray, str, tuple[float, float] | None]:
    """Values as they are drawn, what is said of small ones, and whole decades if they need them."""
    if not _logarithmic(values):
        return values, "", None
    edge = _SMALLEST * values.max()
    few = int(np.sum(values < edge))
    values = np.maximum(values, edge)
    return values, f"\n{few} below {edge:.0e} are drawn there" if few else "", whole_decades(values)


def _strongest(result: Result) -> str | None:
    """The input that matters most, if one does."""
    if result.indices:
        return result.indices[0].input
    significant = [one.input for one in result.correlations if one.significant]
    return significant[0] if significant else None


def _logarithmic(values: FloatArray) -> bool:
    return bool(values.min() > 0.0 and values.max() > _LOGARITHMIC_FROM * values.min())
