"""Figures of a simulated run: the motion, and what the observer makes of it."""

from pathlib import Path
from textwrap import fill

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from flexid.experiments.measures import SETTLED
from flexid.experiments.run_columns import coefficient_unit, is_joint
from flexid.report.style import BLUE, GREY, INK, ORANGE, STYLE, new_figure, save
from flexid.simulation.run import Run

_MOST_POINTS = 20_000


def save_run_figures(name: str, run: Run, directory: Path) -> None:
    """Write motion.png and estimates.png."""
    with mpl.rc_context(STYLE):
        save(motion_figure(name, run), directory, "motion")
        save(observer_figure(name, run), directory, "estimates")


def motion_figure(name: str, run: Run) -> Figure:
    """Reference and tracked state, the error between them, and the inputs."""
    figure = new_figure(height=5.6)
    _title(figure, name)
    motion, error, drive = figure.subplots(3, 1, sharex=True)
    shown = _shown(run)
    time = run.time[shown]
    tracked = run.loop.controller.tracked
    angle = " (rad)" if is_joint(run) else ""
    state = run.states[shown, run.loop.system.states.index(tracked)]
    motion.plot(time, run.reference[shown, 0], color=GREY, linewidth=2.4, label="reference")
    motion.plot(time, state, color=BLUE, linewidth=1.0, label=_tracked(run))
    motion.set_ylabel(f"{_tracked(run)}{angle}")
    error.plot(time, run.tracking_error[shown], color=ORANGE)
    error.set_ylabel(f"tracking error{angle}")
    _leave_out_transient(error, run.tracking_error)
    for place, symbol in enumerate(run.loop.system.inputs):
        label = "motor torque" if is_joint(run) else symbol
        drive.plot(time, run.inputs[shown, place], label=label, **_colour(place))
    drive.set_ylabel("motor torque (N m)" if is_joint(run) else "inputs")
    _leave_out_transient(drive, run.inputs)
    drive.set_xlabel("time (s)")
    handles, labels = motion.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower right", ncols=2)
    return figure


def observer_figure(name: str, run: Run) -> Figure:
    """Every estimate over time, with the true value and the band in which it counts as settled."""
    names = run.loop.system.coefficients
    columns = 2 if len(names) > 1 else 1
    lines = -(-len(names) // columns)
    figure = new_figure(height=1.7 * lines + 0.7)
    _title(figure, name)
    axes = figure.subplots(lines, columns, sharex=True, squeeze=False)
    shown = _shown(run)
    for place, (ax, coefficient) in enumerate(zip(axes.flat, names, strict=False)):
        true = run.loop.coefficients[coefficient]
        band = SETTLED * abs(true)
        ax.axhspan(true - band, true + band, color=BLUE, alpha=0.15, linewidth=0, label="±5 %")
        ax.axhline(true, color=INK, linewidth=1.0, label="true")
        ax.plot(run.time[shown], run.estimates[shown, place], color=ORANGE, label="observer")
        ax.set_title(coefficient)
        ax.set_ylabel(coefficient_unit(run, coefficient))
    for ax in axes.flat[len(names) :]:
        ax.set_visible(False)
    for ax in axes.flat[max(0, len(names) - columns) : len(names)]:
        ax.set_xlabel("time (s)")
        ax.tick_params(labelbottom=True)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower right", ncols=3)
    return figure


def _title(figure: Figure, name: str) -> None:
    """What the file says, in as many lines as it takes; a $ in it is no formula."""
    figure.suptitle(fill(name, 75), fontsize=10, parse_math=False)


def _shown(run: Run) -> slice:
    """Samples that are drawn: a figure has no room for a million."""
    return slice(None, None, -(-len(run.time) // _MOST_POINTS))


def _tracked(run: Run) -> str:
    tracked = run.loop.controller.tracked
    return "link position" if is_joint(run) and tracked == "x1" else tracked


def _colour(place: int) -> dict[str, str]:
    return {"color": BLUE} if place == 0 else {}


def _leave_out_transient(ax: Axes, values: np.ndarray) -> None:
    """Keep a few samples from hiding all the rest."""
    size = np.abs(values)
    usual = 1.3 * float(np.quantile(size, 0.99))
    if 0.0 < 4.0 * usual < float(size.max()):
        ax.set_ylim(-usual, usual)
        ax.set_title(f"beyond the frame: up to {size.max():.3g}", fontsize=8)
