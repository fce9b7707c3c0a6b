"""What a free run leaves of the measured motion: over time, and correlated with itself."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from flexid.identification.result import Validation
from flexid.report.style import BLUE, GREY, INK, new_figure, styled

_LONGEST_LAG = 0.1  # of the longest run
_SIGNIFICANT = 1.96  # standard deviations of the autocorrelation of white noise


@styled
def residual_figure(validation: Validation) -> Figure:
    """Residual of each channel over time, and its autocorrelation with the band of white noise."""
    channels = list(validation.fit_percent)
    figure = new_figure(height=1.9 * len(channels) + 0.6)
    axes = figure.subplots(len(channels), 2, sharex="col", squeeze=False, width_ratios=[1.6, 1.0])
    longest = max(validation.runs, key=lambda run: len(run.time))
    for place, channel in enumerate(channels):
        left, right = axes[place]
        for run in validation.runs:
            residual = _finite(run.measured[:, place] - run.simulated[:, place])
            left.plot(run.time, residual, color=BLUE, linewidth=0.7)
        left.set_title(channel.replace("_", " "))
        left.set_ylabel("residual (rad)")
        _draw_autocorrelation(
            right, longest.time, _finite(longest.measured[:, place] - longest.simulated[:, place])
        )
    axes[0, 1].set_title("autocorrelation")
    axes[-1, 0].set_xlabel("time (s)")
    axes[-1, 1].set_xlabel("lag (s)")
    figure.align_ylabels()
    return figure


def _draw_autocorrelation(ax: Axes, time: np.ndarray, residual: np.ndarray) -> None:
    lags = max(2, int(_LONGEST_LAG * len(time)))
    band = _SIGNIFICANT / np.sqrt(len(residual))
    ax.axhspan(-band, band, color=GREY, alpha=0.5, linewidth=0)  # of white noise
    ax.axhline(0.0, color=INK, linewidth=0.6)
    if np.isfinite(residual).all():
        ax.plot(time[:lags] - time[0], autocorrelation(residual)[:lags], color=BLUE)
    ax.set_ylim(-1.05, 1.05)


def autocorrelation(values: np.ndarray) -> np.ndarray:
    """Autocorrelation at lags 0, 1, ..., shape (n,); of what does not vary, 0 but at lag 0.

    Examples
    --------
    >>> autocorrelation(np.array([1.0, -1.0, 1.0, -1.0])).round(3).tolist()
    [1.0, -0.75, 0.5, -0.25]
    """
    centred = values - values.mean()
    spectrum = np.abs(np.fft.rfft(centred, 2 * len(values))) ** 2
    products = np.fft.irfft(spectrum, 2 * len(values))[: len(values)]
    if products[0] <= 0.0:
        products[0] = 1.0
    return products / products[0]


def _finite(residual: np.ndarray) -> np.ndarray:
    return np.where(np.isfinite(residual), residual, np.nan)
