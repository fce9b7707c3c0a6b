"""Figures of an identification: the fit, the estimates over time, excitation, joint regions."""

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from flexid.analysis.excitation import LOST_CONDITION, WEAK_CONDITION, Excitation
from flexid.identification.estimate import Estimate
from flexid.identification.frequency_response import frequency_response
from flexid.identification.intervals import CONFIDENCE
from flexid.identification.result import Identification
from flexid.report.bode_figure import bode_figure
from flexid.report.confidence_region import confidence_region_figure, most_correlated
from flexid.report.free_run_figure import free_run_figure
from flexid.report.parameter_figures import estimates_figure, parameter_estimate
from flexid.report.style import BLUE, ORANGE, RED, STYLE, new_figure, save

_FLOOR = 1e-7  # below which a relative singular value is drawn as this

_PAIRS = (
    ("joint_stiffness", "link_inertia"),
    ("joint_stiffness", "motor_inertia"),
    ("joint_stiffness_per_link_inertia", "joint_stiffness_per_motor_inertia"),
)


def save_identification_figures(result: Identification, directory: Path) -> None:
    """Write fit, estimates, excitation, bode, and regions where two are estimated, as PNG."""
    with mpl.rc_context(STYLE):
        save(fit_figure(result), directory, "fit")
        save(estimates_figure(result), directory, "estimates")
        save(excitation_figure(result), directory, "excitation")
        save(bode_figure(frequency_response(result, result.recordings)), directory, "bode")
        regions = regions_figure(result)
        if regions is not None:
            save(regions, directory, "regions")


def regions_figure(result: Identification, level: float = CONFIDENCE) -> Figure | None:
    """Joint confidence regions of physical parameters; None where no two were estimated."""
    found = parameter_estimate(result)
    pairs = correlated_pairs(found)
    if not pairs:
        return None
    units = {name: result.parameters[name].unit for name in found.names}
    fits = {result.choices.estimator.replace("-", " "): found}
    return confidence_region_figure(fits, pairs, units, level)


def correlated_pairs(estimate: Estimate) -> dict[str, tuple[str, str]]:
    """Two pairs of parameters at most: stiffness and inertias, else those that correlate most."""
    wanted = [pair for pair in _PAIRS if {*pair} <= {*estimate.names}]
    pairs = [pair for pair in wanted if most_correlated(estimate, pair) is not None]
    if not pairs:
        pair = most_correlated(estimate, estimate.names)
        pairs = [] if pair is None else [pair]
    return {f"{first} and {second}": (first, second) for first, second in pairs[:2]}


def fit_figure(result: Identification) -> Figure:
    """Free run of the model over the held-out data, channel by channel, and its residual."""
    validation = result.validation
    label = "time (s), data kept out of the fit"
    return free_run_figure(validation.fit_percent, validation.runs, {}, label)


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
