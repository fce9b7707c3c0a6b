"""Figures 1 to 5 of Huang (2003) for both readings of its control law, and one on Theorem 1."""

from collections.abc import Mapping
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from flexid.report.style import BLUE, GREEN, GREY, INK, ORANGE, RED, STYLE, save
from flexid.studies.huang2003.readings import TOLERANCE, SteadyRun
from flexid.studies.huang2003.reproduction import Reproduction
from flexid.studies.huang2003.sweeps import RatePoint
from flexid.studies.huang2003.table1 import DURATION, UNKNOWN

FORMATS = ("png", "pdf")

NOISE = 1e-3 * TOLERANCE
"""The integrator's absolute tolerance: smaller parameter errors are not distinguished from zero."""

COLOURS = {"1,2,3": BLUE, "1,1,3": ORANGE}

_SYMBOLS = {"theta1": "θ₁", "theta2": "θ₂", "alpha1": "α₁", "alpha2": "α₂"}
_LAST = 0.5  # s
_UNITS = {"theta1": "1/s²", "theta2": "1/s²", "alpha1": "1/s²", "alpha2": "1/s"}


def save_reproduction_figures(result: Reproduction, directory: Path) -> None:
    """Write figure1 to figure5 and theorem1, each as PNG and PDF."""
    runs = result.runs
    with mpl.rc_context(STYLE):
        save(tracking_figure(runs), directory, "figure1", FORMATS)
        for number, coefficient in enumerate(UNKNOWN, start=2):
            save(error_figure(runs, coefficient), directory, f"figure{number}", FORMATS)
        save(theorem_figure(runs, result.rates), directory, "theorem1", FORMATS)


def _new_figure(height: float, **margins: float) -> Figure:
    """Figure with fixed margins: to find them anew for each would take as long as the drawing."""
    with mpl.rc_context({**STYLE, "figure.constrained_layout.use": False}):
        figure = Figure(figsize=(7.2, height))
    figure.subplots_adjust(left=0.125, right=0.98, **margins)
    return figure


def tracking_figure(runs: Mapping[str, SteadyRun]) -> Figure:
    """Figure 1: the tracking error over time and over its last half second.

    One line of axes per reading, for the two differ 300-fold.
    """
    figure = _new_figure(4.2, top=0.94, bottom=0.11, hspace=0.22, wspace=0.05)
    axes = figure.subplots(len(runs), 2, sharex="col", sharey="row", width_ratios=(3, 1))
    for (whole, last), (name, run) in zip(axes, runs.items(), strict=True):
        time, error = run.run.time, run.run.tracking_error
        limit = 1.25 * run.max_tracking_error
        largest = float(np.abs(error).max())
        swing = f"; first swing {largest:.2g} rad" if largest > limit else ""
        whole.plot(time, error, color=COLOURS[name], linewidth=0.6)
        whole.set_ylim(-limit, limit)
        whole.set_ylabel("tracking error (rad)")
        whole.set_title(
            f"gains ({name}): at most {_number(run.max_tracking_error)} rad over 20–30 s{swing}"
        )
        end = run.run.between(DURATION - _LAST, DURATION)
        last.plot(time[end], error[end], color=COLOURS[name])
    axes[-1, 0].set_xlabel("time (s)")
    axes[-1, 0].set_xlim(0.0, DURATION)
    axes[-1, 1].set_xlabel("time (s), last half second")
    axes[-1, 1].set_xlim(DURATION - _LAST, DURATION)
    return figure


def error_figure(runs: Mapping[str, SteadyRun], coefficient: str) -> Figure:
    """One of Figures 2 to 5: a parameter error over time above, its magnitude below."""
    figure = _new_figure(4.6, top=0.94, bottom=0.1, hspace=0.1)
    whole, magnitude = figure.subplots(2, 1, sharex=True)
    column = UNKNOWN.index(coefficient)
    for name, run in runs.items():
        time, error = run.run.time, run.run.parameter_errors[:, column]
        colour, label = COLOURS[name], f"gains ({name})"
        whole.plot(time, error, color=colour, linewidth=1.0, label=label)
        magnitude.plot(*_envelope(time, np.abs(error)), color=colour)
    symbol, unit = _SYMBOLS[coefficient], _UNITS[coefficient]
    at_end = ", ".join(
        f"{_number(run.parameter_errors[coefficient])} with ({name})" for name, run in runs.items()
    )
    whole.set_title(f"error of {symbol} at 30 s: {at_end}")
    whole.axhline(0.0, color=INK, linewidth=0.6)
    whole.set_ylabel(f"error of {symbol} ({unit})")
    whole.legend(loc="best")
    _limit_to_late_values(whole, runs, column)
    magnitude.set_yscale("log")
    lowest = magnitude.get_ylim()[0]
    if lowest < NOISE:
        magnitude.set_ylim(bottom=0.1 * NOISE)
        magnitude.axhline(NOISE, color=GREY, linestyle="--", label="integrator's tolerance")
        magnitude.legend(loc="center right")
    magnitude.set_ylabel(f"its size, 0.1 s peaks ({unit})")
    magnitude.set_xlabel("time (s)")
    magnitude.set_xlim(0.0, DURATION)
    return figure


def _number(value: float) -> str:
    """Three digits; what the integrator's error hides is called so."""
    return f"{value:.3g}".replace("-", "−") if abs(value) > 10 * NOISE else "|·| < 1e−10"


def _envelope(
    time: np.ndarray, values: np.ndarray, window: float = 0.1
) -> tuple[np.ndarray, np.ndarray]:
    """Largest value in each window, at the window's middle."""
    length = round(window / (time[1] - time[0]))
    count = len(time) // length
    blocks = values[: count * length].reshape(count, length)
    return (np.arange(count) + 0.5) * window, blocks.max(axis=1)


def _limit_to_late_values(ax: Axes, runs: Mapping[str, SteadyRun], column: int) -> None:
    """Show what happens after the first 50 ms in full; the jump before would flatten the rest."""
    late = np.concatenate([run.run.parameter_errors[50:, column] for run in runs.values()])
    margin = 0.08 * float(np.ptp(late))
    lowest = late.min() - margin
    ax.set_ylim(lowest, late.max() + margin)
    first = float(next(iter(runs.values())).run.parameter_errors[0, column])
    if first < lowest:
        ax.text(0.3, lowest + margin, f"from {_number(first)} at 0 s", color=INK, fontsize=8)


def theorem_figure(runs: Mapping[str, SteadyRun], rates: Mapping[str, list[RatePoint]]) -> Figure:
    """V along both runs, and the exponential rate over the observer's gain against its bound."""
    figure = _new_figure(5.2, top=0.95, bottom=0.09, hspace=0.42, wspace=0.18)
    grid = figure.add_gridspec(2, 2)
    _draw_lyapunov(figure.add_subplot(grid[0, :]), runs)
    for column, (row, points) in enumerate(rates.items()):
        ax = figure.add_subplot(grid[1, column])
        _draw_rates(ax, points)
        ax.set_title(f"{row} row: rate of convergence")
        if column == 0:
            ax.set_ylabel("rate (1/s)")
            ax.legend(loc="upper left")
    return figure


def _draw_lyapunov(ax: Axes, runs: Mapping[str, SteadyRun]) -> None:
    for name, run in runs.items():
        monitor = run.monitor
        ax.plot(monitor.time, monitor.value, color=COLOURS[name], label=f"gains ({name})")
    ax.set_yscale("log")
    ax.set_xlim(0.0, DURATION)
    ax.set_xlabel("time (s)")
    ax.set_ylabel("V (sum of squares, SI)")
    ax.set_title("Lyapunov function, eq. (8): it never rises")
    ax.legend(loc="lower left")


def _draw_rates(ax: Axes, points: list[RatePoint]) -> None:
    gains = [point.gain for point in points]
    ax.plot(
        gains,
        [point.averaged for point in points],
        color=GREY,
        linestyle="--",
        label="c × mean excitation",
    )
    ax.plot(
        gains,
        [point.measured for point in points],
        color=GREEN,
        marker="o",
        markersize=4,
        label="measured",
    )
    ax.plot(gains, [point.guaranteed for point in points], color=RED, label="guaranteed")
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.set_xlabel("gain c of the observer")
