"""Figure of a design: what is played, its tones, and what it determines beside other inputs."""

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from flexid.experiment_design.result import Design
from flexid.report.style import BLUE, GREEN, GREY, ORANGE, STYLE, new_figure, save


def save_design_figure(result: Design, directory: Path) -> None:
    """Write design.png."""
    with mpl.rc_context(STYLE):
        save(design_figure(result), directory, "design")


def design_figure(result: Design) -> Figure:
    """Torque, positions, tones and predicted deviations."""
    figure = new_figure(height=7.4)
    grid = figure.add_gridspec(4, 2, height_ratios=(1, 1, 0.7, 1.3))
    torque = figure.add_subplot(grid[0, :])
    _draw_torque(torque, result)
    _draw_positions(figure.add_subplot(grid[1, :], sharex=torque), result)
    _draw_deflection(figure.add_subplot(grid[2, :], sharex=torque), result)
    _draw_tones(figure.add_subplot(grid[3, 0]), result)
    _draw_deviations(figure.add_subplot(grid[3, 1]), result)
    return figure


def _draw_torque(ax: Axes, result: Design) -> None:
    ax.plot(result.time, result.run.torque, color=BLUE, linewidth=1.0)
    ax.set_ylabel("torque (N m)")
    played = "played" if result.drive.kind == "multisine" else "that the position loop asks for"
    ax.set_title(f"Torque {played}")


def _draw_positions(ax: Axes, result: Design) -> None:
    ax.plot(result.time, result.run.states[:, 0], color=BLUE, label="link")
    if result.drive.kind == "trajectory":
        reference = result.command.reference[:, 0]
        ax.plot(result.time, reference, "--", color=ORANGE, linewidth=1.0, label="motor reference")
        ax.legend(loc="upper right", ncols=2)
    ax.set_ylabel("position (rad)")
    ax.set_title("Link position of the drive as believed")


def _draw_deflection(ax: Axes, result: Design) -> None:
    x = result.run.states
    ax.plot(result.time, x[:, 0] - x[:, 2], color=BLUE, linewidth=1.0)
    ax.set_xlabel("time (s)")
    ax.set_ylabel("rad")
    ax.set_title("Deflection")


def _draw_tones(ax: Axes, result: Design) -> None:
    unit = "N m" if result.drive.kind == "multisine" else "rad"
    ax.vlines(result.angular_frequencies, 0.0, result.amplitudes, color=BLUE)
    ax.plot(result.angular_frequencies, result.amplitudes, "o", color=BLUE)
    ax.axvline(result.drive.resonance, color=GREY, linestyle="--", linewidth=1.0)
    ax.set_xscale("log")
    ax.xaxis.set_minor_formatter(NullFormatter())
    ax.set_ylim(bottom=0.0)
    ax.set_xlabel("angular frequency (rad/s)")
    ax.set_ylabel(f"amplitude ({unit})")
    ax.set_title("Tones; dashed: the resonance")


def _draw_deviations(ax: Axes, result: Design) -> None:
    inputs = (result.prediction, *result.references)
    names = list(result.prediction.deviations)
    places = np.arange(len(names))
    for shift, (one, colour) in enumerate(zip(inputs, (BLUE, ORANGE, GREEN), strict=True)):
        values = [100.0 * one.deviations[name] for name in names]
        ax.plot(values, places + 0.2 * (shift - 1), "o", color=colour, label=one.name)
    ax.set_xscale("log")
    lowest, highest = np.log10(ax.get_xlim())
    ax.set_xlim(10.0 ** np.floor(lowest), 10.0 ** np.ceil(highest))  # whole decades have labels
    ax.set_yticks(places, names)
    ax.invert_yaxis()
    ax.xaxis.set_minor_formatter(NullFormatter())
    ax.set_xlabel("predicted standard deviation (%)")
    ax.set_title("At the same peak torque")
    ax.legend(loc="upper center", bbox_to_anchor=(0.4, -0.3), ncols=3)
