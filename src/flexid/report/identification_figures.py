"""Figures of an identification: the fit, the estimates over time, excitation, joint regions."""

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from flexid.analysis.excitation import LOST_CONDITION, WEAK_CONDITION, Excitation
from flexid.identification.intervals import CONFIDENCE
from flexid.identification.result import CoefficientEstimate, Identification
from flexid.report.confidence_region import confidence_region_figure, most_correlated
from flexid.report.identification_table import format_fit
from flexid.report.style import BLUE, GREEN, GREY, INK, ORANGE, RED, STYLE, new_figure, save

_FLOOR = 1e-7  # below which a relative singular value is drawn as this

_COLOURS = {"determined": GREEN, "weak": ORANGE, "undetermined": RED}


def save_identification_figures(result: Identification, directory: Path) -> None:
    """Write fit.png, estimates.png, excitation.png, and regions.png where two are estimated."""
    with mpl.rc_context(STYLE):
        save(fit_figure(result), directory, "fit")
        save(estimates_figure(result), directory, "estimates")
        save(excitation_figure(result), directory, "excitation")
        regions = regions_figure(result)
        if regions is not None:
            save(regions, directory, "regions")


def regions_figure(result: Identification, level: float = CONFIDENCE) -> Figure | None:
    """Joint confidence regions at some level; None where no two coefficients were estimated."""
    pairs = correlated_pairs(result)
    if not pairs:
        return None
    units = {name: c.unit for name, c in result.coefficients.items()}
    fits = {result.choices.estimator.replace("-", " "): result.fit}
    return confidence_region_figure(fits, pairs, units, level)


def correlated_pairs(result: Identification) -> dict[str, tuple[str, str]]:
    """By row, the two coefficients whose estimates correlate most; rows with less are left out."""
    found = {
        row: most_correlated(result.fit, excitation.coefficients)
        for row, excitation in result.excitation.items()
    }
    return {row: pair for row, pair in found.items() if pair is not None}


def fit_figure(result: Identification) -> Figure:
    """Free run of the model over the held-out data, channel by channel."""
    figure = new_figure(height=2.0 * len(result.validation.fit_percent))
    names = tuple(result.validation.fit_percent)
    axes = figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
    for channel, name in enumerate(names):
        ax: Axes = axes[channel]
        for run in result.validation.runs:
            measured, simulated = run.measured[:, channel], run.simulated[:, channel]
            ax.plot(run.time, measured, color=GREY, linewidth=2.4, label="measured")
            ax.plot(run.time, simulated, color=BLUE, linewidth=1.0, label="free run of the model")
        spread = np.concatenate([run.measured[:, channel] for run in result.validation.runs])
        margin = 0.15 * np.ptp(spread)
        ax.set_ylim(spread.min() - margin, spread.max() + margin)
        label = name.replace("_", " ")
        ax.set_ylabel(f"{label} (rad)")
        ax.set_title(f"{label}: fit {format_fit(result.validation.fit_percent[name])}")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles[:2], labels[:2], loc="outside upper right", ncols=2)
    axes[-1].set_xlabel("time (s), data kept out of the fit")
    return figure


def estimates_figure(result: Identification) -> Figure:
    """The paper's observer over time beside the estimate and its interval."""
    names = result.observer.names
    columns = 2
    lines = -(-len(names) // columns)
    figure = new_figure(height=1.7 * lines + 0.5)
    axes = figure.subplots(lines, columns, sharex=True, squeeze=False)
    for ax, name in zip(axes.flat, names, strict=False):
        _draw_estimate(ax, result, name)
    for ax in axes.flat[len(names) :]:
        ax.set_visible(False)
    for ax in axes.flat[max(0, len(names) - columns) : len(names)]:
        ax.set_xlabel("time (s)")
        ax.tick_params(labelbottom=True)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=3)
    return figure


def _draw_estimate(ax: Axes, result: Identification, name: str) -> None:
    c = _estimate(result, name)
    history = result.observer.estimates[:, result.observer.names.index(name)]
    ax.plot(result.observer.time, history, color=ORANGE, label="paper's observer, constant gain")
    ax.axhline(c.value, color=INK, linewidth=1.0, label="estimate")
    if np.all(np.isfinite(c.interval)):
        ax.axhspan(*c.interval, color=BLUE, alpha=0.25, linewidth=0, label="95 % interval")
    ax.set_title(f"{c.name}: {c.verdict}", color=_COLOURS[c.verdict])
    ax.set_ylabel(c.unit)


def _estimate(result: Identification, name: str) -> CoefficientEstimate:
    """A coefficient's estimate; of one that each log has its own of, the last log's.

    The observer does not tell logs apart and ends with the last one.
    """
    if name in result.coefficients:
        return result.coefficients[name]
    own = [c for c in result.coefficients.values() if c.name.partition("[")[0] == name]
    return own[-1]


def excitation_figure(result: Identification) -> Figure:
    """Singular values of each row's normalised Gram matrix, and its condition number."""
    figure = new_figure(height=3.4)
    axes = figure.subplots(1, len(result.excitation), sharey=True, squeeze=False)[0]
    for ax, excitation in zip(axes, result.excitation.values(), strict=True):
        _draw_excitation(ax, excitation)
    axes[0].set_ylabel("singular value over the largest (–)")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=2)
    return figure


def _draw_excitation(ax: Axes, excitation: Excitation) -> None:
    relative = excitation.singular_values / excitation.singular_values[0]
    places = np.arange(1, len(relative) + 1)
    ax.stem(places, np.maximum(relative, _FLOOR), linefmt=BLUE, markerfmt="o", basefmt=" ")
    ax.axhline(1 / WEAK_CONDITION, color=ORANGE, linestyle="--", label="weak below")
    ax.axhline(1 / LOST_CONDITION, color=RED, linestyle="--", label="lost below")
    ax.set_yscale("log")
    ax.set_ylim(_FLOOR, 3)
    ax.set_xlim(0.5, len(relative) + 0.5)
    ax.set_xticks(places)
    ax.set_xlabel("direction, best excited first")
    title = f"{excitation.row} row: condition number {excitation.condition_number:.3g}"
    if excitation.correlated:
        pair = " and ".join(excitation.correlated)
        title += f"\n{pair} correlate by {excitation.correlation:.2f}"
    ax.set_title(title)
