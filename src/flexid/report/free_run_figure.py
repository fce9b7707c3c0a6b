"""Measured motion, a model's free run, and what is between them: one look for every command."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from flexid.identification.result import FreeRun
from flexid.report.identification_table import format_fit
from flexid.report.style import BLUE, GREY, ORANGE, RED, new_figure

_MARGIN = 0.15  # of the measured range, above and below it


def free_run_figure(
    fit_percent: Mapping[str, float],
    runs: Sequence[FreeRun],
    noise: Mapping[str, float],
    time_label: str,
) -> Figure:
    """Free runs channel by channel, with the residual below each; what is cut off is said.

    Parameters
    ----------
    fit_percent : mapping of str to float
        Fit by channel.
    runs : sequence of FreeRun
        One for each stretch of data.
    noise : mapping of str to float
        Standard deviation of a channel's sensor in rad, where it is known.
    time_label : str
        Of the axis at the bottom.
    """
    channels = list(fit_percent)
    figure = new_figure(height=2.6 * len(channels) + 0.4)
    axes = figure.subplots(
        2 * len(channels), 1, sharex=True, height_ratios=[2.0, 1.0] * len(channels)
    )
    for place, channel in enumerate(channels):
        label = channel.replace("_", " ")
        title = f"{label}: fit {format_fit(fit_percent[channel])}"
        _draw(axes[2 * place], axes[2 * place + 1], runs, place, title, noise.get(channel))
    entries = {
        label: handle
        for ax in axes[:2]
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True)
    }
    figure.legend(list(entries.values()), list(entries), loc="outside upper right", ncols=4)
    axes[-1].set_xlabel(time_label)
    figure.align_ylabels()
    return figure


def _draw(
    ax: Axes, below: Axes, runs: Sequence[FreeRun], place: int, title: str, noise: float | None
) -> None:
    measured = np.concatenate([run.measured[:, place] for run in runs])
    simulated = np.concatenate([run.simulated[:, place] for run in runs])
    for run in runs:
        seen, predicted = run.measured[:, place], run.simulated[:, place]
        predicted = np.where(np.isfinite(predicted), predicted, np.nan)
        ax.plot(run.time, seen, color=GREY, linewidth=2.4, label="measured")
        ax.plot(run.time, predicted, color=BLUE, linewidth=1.0, label="free run of the model")
        below.plot(run.time, seen - predicted, color=RED, linewidth=0.7, label="residual")
    span = float(np.ptp(measured))
    beyond = np.abs(np.where(np.isfinite(simulated), simulated - measured, np.inf))
    largest = float(beyond.max(initial=0.0))
    if span > 0.0:
        ax.set_ylim(measured.min() - _MARGIN * span, measured.max() + _MARGIN * span)
        outside = (simulated < ax.get_ylim()[0]) | (simulated > ax.get_ylim()[1])
        if not np.isfinite(largest):
            title += "; it diverges"
        elif outside.any():
            title += f"; beyond the frame, by up to {largest:.2g} rad"
        if largest > span:
            below.set_ylim(-span, span)
    if noise is not None:
        for edge in (-2.0 * noise, 2.0 * noise):
            below.axhline(
                edge, color=ORANGE, linestyle="--", linewidth=0.8, label="twice the sensor's noise"
            )
    ax.set_title(title)
    ax.set_ylabel("rad")
    below.set_ylabel("residual (rad)")
