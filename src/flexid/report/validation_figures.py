"""Figure of a validation: measured and predicted motion, and what is between them."""

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from flexid.identification.validate_estimate import EstimateValidation
from flexid.report.identification_table import format_fit
from flexid.report.style import BLUE, GREY, ORANGE, RED, STYLE, new_figure, save

_MARGIN = 0.15  # of the measured range, above and below it


def save_validation_figure(result: EstimateValidation, directory: Path) -> None:
    """Write validation.png."""
    with mpl.rc_context(STYLE):
        save(validation_figure(result), directory, "validation")


def validation_figure(result: EstimateValidation) -> Figure:
    """Free run over each log, channel by channel, with the residual below."""
    channels = list(result.fit_percent)
    figure = new_figure(height=2.6 * len(channels) + 0.4)
    axes = figure.subplots(
        2 * len(channels), 1, sharex=True, height_ratios=[2.0, 1.0] * len(channels)
    )
    for place, channel in enumerate(channels):
        _draw(axes[2 * place], axes[2 * place + 1], result, place, channel)
    handles, labels = axes[0].get_legend_handles_labels()
    more = axes[1].get_legend_handles_labels()
    first = {**dict(zip(labels, handles, strict=True)), **dict(zip(more[1], more[0], strict=True))}
    figure.legend(first.values(), first.keys(), loc="outside upper right", ncols=4)
    axes[-1].set_xlabel("time (s)")
    figure.align_ylabels()
    return figure


def _draw(ax: Axes, below: Axes, result: EstimateValidation, place: int, channel: str) -> None:
    label = channel.replace("_", " ")
    measured = np.concatenate([run.measured[:, place] for run in result.runs])
    residuals = []
    for run in result.runs:
        seen, predicted = run.measured[:, place], run.simulated[:, place]
        predicted = np.where(np.isfinite(predicted), predicted, np.nan)
        residuals.append(seen - predicted)
        ax.plot(run.time, seen, color=GREY, linewidth=2.4, label="measured")
        ax.plot(run.time, predicted, color=BLUE, linewidth=1.0, label="free run of the estimate")
        below.plot(run.time, seen - predicted, color=RED, linewidth=0.7, label="residual")
    margin = _MARGIN * np.ptp(measured)
    if margin > 0.0:
        ax.set_ylim(measured.min() - margin, measured.max() + margin)
        largest = float(np.nanmax(np.abs(np.concatenate(residuals)), initial=0.0))
        if largest > np.ptp(measured):
            below.set_ylim(-np.ptp(measured), np.ptp(measured))
    noise = result.noise[channel]
    for edge in (-2.0 * noise, 2.0 * noise):
        below.axhline(
            edge, color=ORANGE, linestyle="--", linewidth=0.8, label="twice the sensor's noise"
        )
    ax.set_title(f"{label}: fit {format_fit(result.fit_percent[channel])}")
    ax.set_ylabel("rad")
    below.set_ylabel("residual (rad)")
