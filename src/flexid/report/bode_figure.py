"""The frequency response of a joint as a Bode plot: model with band, and what the log shows."""

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator

from flexid.identification.frequency_response import FrequencyResponse, Response
from flexid.report.digits import format_with_interval
from flexid.report.style import BLUE, GREEN, ORANGE, RED, new_figure, styled

_COHERENT = 0.8  # above which the spectral estimate is drawn strongly
_SIDE = 0.3  # of a decade, left free above and below the magnitudes
_COLOURS = {"antiresonance": GREEN, "resonance": RED}


@styled
def bode_figure(described: FrequencyResponse) -> Figure:
    """Magnitude in physical units, phase and coherence of every response over frequency in Hz."""
    responses = described.responses[::-1]  # the motor, where the torque acts, comes first
    measured = any(r.measured for r in responses)
    lines = 3 if measured else 2
    figure = new_figure(width=3.6 * max(2, len(responses)), height=2.0 * lines + 1.0)
    heights = [1.5, 1.0, 0.6][:lines]
    axes = figure.subplots(
        lines, len(responses), sharex=True, sharey="row", squeeze=False, height_ratios=heights
    )
    for column, response in enumerate(responses):
        _draw_response(axes[:, column], described, response)
        _mark(axes[:, column], described)
        axes[-1, column].set_xlabel("frequency (Hz)")
    axes[0, 0].set_ylim(*_magnitudes(described))
    units = {r.unit: None for r in responses}
    axes[0, 0].set_ylabel(f"magnitude ({', '.join(units)})")
    axes[1, 0].set_ylabel("phase (°)")
    if measured:
        axes[2, 0].set_ylabel("coherence (–)")
        axes[2, 0].set_ylim(0.0, 1.05)
    axes[0, 0].set_xlim(described.frequency[0], described.frequency[-1])
    figure.align_ylabels()
    handles, labels = _entries(axes[0])
    figure.legend(handles, labels, loc="outside upper left", ncols=3)
    return figure


def _draw_response(axes: np.ndarray, described: FrequencyResponse, response: Response) -> None:
    magnitude, phase = axes[0], axes[1]
    hertz = described.frequency
    angle = np.angle(response.values)
    steady = np.unwrap(angle)  # without jumps by a full turn
    turns = steady - angle
    for estimate in response.measured:
        f, sure = estimate.frequency, estimate.coherence
        nearest = np.interp(np.log(f), np.log(hertz), steady)
        degrees = np.degrees(nearest + np.angle(estimate.values * np.exp(-1j * nearest)))
        for strong, label, alpha in (
            (sure < _COHERENT, "where its coherence is low", 0.2),
            (sure >= _COHERENT, "log, spectral estimate", 1.0),
        ):
            style = {"color": ORANGE, "alpha": alpha, "linestyle": "none", "marker": "o"}
            style |= {"markersize": 3.0, "markeredgewidth": 0}
            magnitude.plot(f[strong], np.abs(estimate.values[strong]), label=label, **style)
        phase.plot(f[strong], degrees[strong], **style)
        axes[2].plot(f, sure, color=ORANGE, linewidth=0.8)
    if np.isfinite(response.upper).all():
        label = f"{100 * described.level:g} % band"
        shade = {"color": BLUE, "alpha": 0.3, "linewidth": 0}
        magnitude.fill_between(hertz, response.lower, response.upper, label=label, **shade)
        ends = np.degrees(response.behind + turns), np.degrees(response.ahead + turns)
        phase.fill_between(hertz, *ends, **shade)
    if response.values.any():  # a zero has no logarithm
        magnitude.plot(hertz, np.abs(response.values), color=BLUE, label="model")
        phase.plot(hertz, np.degrees(steady), color=BLUE)
    magnitude.set_xscale("log")
    magnitude.set_yscale("log")
    phase.yaxis.set_major_locator(MultipleLocator(90))
    title = f"{response.output} over {response.input}"
    if described.unknown:
        title += f"\nno band: {', '.join(described.unknown)} not determined"
    magnitude.set_title(title)


def _magnitudes(described: FrequencyResponse) -> tuple[float, float]:
    """Ends of the axis of magnitudes, which the bottom of an antiresonance does not decide."""
    logarithms = np.log(described.frequency)
    evenly = np.linspace(logarithms[0], logarithms[-1], 200)
    sizes = [
        np.interp(evenly, logarithms, np.log10(np.abs(r.values)))
        for r in described.responses
        if r.values.all()
    ]
    low, high = np.quantile(np.concatenate(sizes), (0.02, 1.0)) if sizes else (-1.0, 1.0)
    return 10 ** (low - _SIDE), 10 ** (high + _SIDE)


def _mark(axes: np.ndarray, described: FrequencyResponse) -> None:
    """Vertical lines where antiresonance and resonance are."""
    for found in described.characteristic:
        shown, low, high = format_with_interval(found.value, *found.interval)
        style = {"color": _COLOURS[found.name], "linestyle": ":", "linewidth": 1.0}
        for place, ax in enumerate(axes):
            label = "" if place else f"{found.name} {shown} [{low}, {high}] Hz"
            ax.axvline(found.value, label=label, **style)


def _entries(axes: np.ndarray) -> tuple[list[Artist], list[str]]:
    """Entries of the legend, each once."""
    found = {
        label: handle
        for ax in axes
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True)
    }
    return list(found.values()), list(found)
