"""Figures of a campaign: how every result is distributed, and on what it depends most."""

from collections.abc import Callable
from math import ceil
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, NullFormatter

from flexid.arrays import FloatArray
from flexid.campaigns.summary import Result, Summary
from flexid.experiments.units import Units
from flexid.report.campaign_table import DETAILS
from flexid.report.style import BLUE, GREY, ORANGE, STYLE, new_figure, save

_COLUMNS = 3
_BINS = 40
_MOST_POINTS = 3000
_LOGARITHMIC_FROM = 30.0  # ratio of the largest value to the smallest
_SMALLEST = 1e-12  # share of the largest value below which all values are drawn alike


def save_campaign_figures(summary: Summary, directory: Path) -> None:
    """Write distributions.png and dependence.png, where there is something to draw."""
    shown = [result for result in summary.results if _drawable(result)]
    if not shown:
        return
    units = Units(summary.manifest.text)
    with mpl.rc_context(STYLE):
        title = f"{summary.finished} finished runs; lines: 5, 50 and 95 % of them"
        save(_panels(title, shown, units, _draw_distribution), directory, "distributions")
        depending = [result for result in shown if _strongest(result) is not None]
        if depending:

            def draw(ax: Axes, result: Result) -> str:
                return _draw_dependence(ax, result, summary, units)

            title = "Each result against the input that matters most for it"
            save(_panels(title, depending, units, draw), directory, "dependence")


def _drawable(result: Result) -> bool:
    finite = result.values[np.isfinite(result.values)]
    varies = len(finite) > 1 and bool(np.ptp(finite) > 0.0)
    return varies and not result.name.startswith(DETAILS)


def _panels(
    title: str, results: list[Result], units: Units, draw: Callable[[Axes, Result], str]
) -> Figure:
    """One panel for each result; what `draw` says of it stands below its name and unit."""
    rows = ceil(len(results) / _COLUMNS)
    figure = new_figure(height=0.6 + 1.75 * rows)
    figure.suptitle(title, fontsize=9)
    axes = figure.subplots(rows, _COLUMNS, squeeze=False).ravel()
    for ax, result in zip(axes, results, strict=False):
        said = draw(ax, result)
        ax.set_title(_with_unit(result.name, units.of_result(result.name)) + said, fontsize=8.5)
    for ax in axes[len(results) :]:
        ax.set_axis_off()
    return figure


def _with_unit(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit else name


def _draw_distribution(ax: Axes, result: Result) -> str:
    values = result.values[np.isfinite(result.values)]
    said = ""
    if _logarithmic(values):
        said = _said_of_small(values)
        values = np.maximum(values, _SMALLEST * values.max())
        edges = np.geomspace(values.min(), values.max(), _BINS)
        _log_axis(ax, "x", values)
    else:
        edges = np.linspace(values.min(), values.max(), _BINS)
        ax.xaxis.set_major_locator(MaxNLocator(3))  # labels may be long
    ax.hist(values, edges, color=BLUE)
    for value, style in zip(result.quantiles, (":", "-", ":"), strict=True):
        ax.axvline(value, color=ORANGE, linestyle=style, linewidth=1.2)
    ax.set_yticks([])
    ax.grid(visible=False)
    return said


def _draw_dependence(ax: Axes, result: Result, summary: Summary, units: Units) -> str:
    name = _strongest(result)
    assert name is not None
    values, inputs = result.values[:_MOST_POINTS], summary.inputs[name][:_MOST_POINTS]
    there = np.isfinite(values)
    values, inputs = values[there], inputs[there]
    said = ""
    if _logarithmic(values):
        said = _said_of_small(values)
        values = np.maximum(values, _SMALLEST * values.max())
        _log_axis(ax, "y", values)
    if _logarithmic(inputs):
        _log_axis(ax, "x", inputs)
    size = 14.0 if len(values) < 200 else 4.0
    ax.scatter(inputs, values, s=size, color=BLUE, alpha=0.6 if size > 5 else 0.35, linewidths=0)
    ax.set_xlabel(_with_unit(name, units.of_value(name)), fontsize=8, color=GREY)
    return said


def _said_of_small(values: FloatArray) -> str:
    """What a title says of values too small to be drawn where they are."""
    edge = _SMALLEST * values.max()
    few = int(np.sum(values < edge))
    return f"\n{few} below {edge:.0e} stand there" if few else ""


def _strongest(result: Result) -> str | None:
    """The input that matters most, if one does."""
    if result.indices:
        return result.indices[0].input
    significant = [one.input for one in result.correlations if one.significant]
    return significant[0] if significant else None


def _logarithmic(values: FloatArray) -> bool:
    return bool(values.min() > 0.0 and values.max() > _LOGARITHMIC_FROM * values.min())


def _log_axis(ax: Axes, which: str, values: FloatArray) -> None:
    """A logarithmic axis over whole decades, so that there are labels."""
    lowest, highest = np.floor(np.log10(values.min())), np.ceil(np.log10(values.max()))
    axis = ax.xaxis if which == "x" else ax.yaxis
    limit = ax.set_xlim if which == "x" else ax.set_ylim
    (ax.set_xscale if which == "x" else ax.set_yscale)("log")
    limit(10.0**lowest, 10.0**highest)
    axis.set_minor_formatter(NullFormatter())
