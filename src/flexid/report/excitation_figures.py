"""Figure of what a log can tell: widths of intervals, and where the input has its power."""

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from flexid.experiment_design.excitation_report import ExcitationReport
from flexid.identification.judgement import THRESHOLDS
from flexid.report.style import (
    BLUE,
    GREY,
    INK,
    ORANGE,
    RED,
    STATUS_COLOURS,
    STYLE,
    new_figure,
    save,
)

_UNKNOWN = 10.0  # drawn for a width that is infinite
_FLOOR = 1e-3  # of the spectrum, over its largest amplitude


def save_excitation_figure(report: ExcitationReport, directory: Path) -> None:
    """Write excitation.png."""
    with mpl.rc_context(STYLE):
        save(excitation_figure(report), directory, "excitation")


def excitation_figure(report: ExcitationReport) -> Figure:
    """Widths of intervals on the left, the input's tones on the right."""
    figure = new_figure(height=3.6)
    left, right = figure.subplots(1, 2)
    _draw_widths(left, report)
    _draw_spectrum(right, report)
    return figure


def _draw_widths(ax: Axes, report: ExcitationReport) -> None:
    coefficients = [c for c in report.assessment.coefficients.values() if c.std > 0.0]
    places = np.arange(len(coefficients))
    shown = np.minimum([c.width for c in coefficients], _UNKNOWN)
    alone = np.array([c.width_alone for c in coefficients])
    alone = np.where(np.isnan(alone), shown, np.minimum(alone, _UNKNOWN))
    colours = [STATUS_COLOURS[c.verdict] for c in coefficients]
    ax.hlines(places, alone, shown, color=GREY, linewidth=1.5, zorder=1)
    ax.scatter(alone, places, color=GREY, s=18, label="if all others were known", zorder=2)
    ax.scatter(shown, places, color=colours, s=36, label="as it is", zorder=3)
    ax.axvline(THRESHOLDS.determined_width, color=ORANGE, linestyle="--", linewidth=1.0)
    ax.axvline(THRESHOLDS.weak_width, color=RED, linestyle="--", linewidth=1.0)
    ax.set_xscale("log")
    ax.set_yticks(places, [c.name for c in coefficients])
    ax.invert_yaxis()
    clipped = ", cut off at 10" if (shown >= _UNKNOWN).any() else ""
    ax.set_xlabel(f"half the 95 % interval over the value (–){clipped}")
    ax.set_title("Intervals; lines: weak, undetermined")
    ax.legend(loc="upper center", bbox_to_anchor=(0.4, -0.2), ncols=2)


def _draw_spectrum(ax: Axes, report: ExcitationReport) -> None:
    rates, amplitudes = report.spectrum
    shown = amplitudes > _FLOOR * amplitudes.max()
    last = np.flatnonzero(shown).max(initial=0)
    ax.plot(rates[: last + 1], amplitudes[: last + 1], color=BLUE, label="input of the log")
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.set_ylim(_FLOOR * amplitudes.max(), 3.0 * amplitudes.max())
    advice = report.advice
    tone = None
    if advice is not None and advice.sine is not None:
        tone = (advice.sine.amplitude, advice.sine.angular_frequency)
    elif advice is not None:
        tone = advice.rule
    if tone is not None:
        ax.plot([tone[1]], [tone[0]], "D", color=INK, label="add this")
    lowest, highest = np.log10(ax.get_xlim())
    ax.set_xlim(10.0 ** np.floor(lowest), 10.0 ** np.ceil(highest))  # whole decades have labels
    ax.xaxis.set_minor_formatter(NullFormatter())
    ax.set_xlabel("angular frequency (rad/s)")
    ax.set_ylabel(f"amplitude ({report.input_unit})")
    ax.set_title("Tones of the input")
    ax.legend(loc="upper center", bbox_to_anchor=(0.4, -0.2), ncols=2)
