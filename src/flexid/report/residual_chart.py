"""What a free run leaves of the measured motion: over time, and correlated with itself."""

import numpy as np

from flexid.arrays import FloatArray
from flexid.identification.vocabulary.evidence import FreeRun, Validation
from flexid.report.charts.description import Axis, Band, Chart, Level, Line, Panel

_LONGEST_LAG = 0.1  # of the longest run
_SIGNIFICANT = 1.96  # standard deviations of the autocorrelation of white noise


def residual_chart(validation: Validation) -> Chart:
    """Residual of each channel over time, and its autocorrelation with the band of white noise."""
    longest = max(validation.runs, key=lambda run: len(run.time))
    panels, outside = [], []
    for place, channel in enumerate(validation.fit_percent):
        label = channel.replace("_", " ")
        lines = [
            Line("residual", run.time, _residual(run, place), "blue", 0.7)
            for run in validation.runs
        ]
        time, below = Axis("time", "s"), Axis("residual", "rad")
        panels.append(Panel(label, time, below, tuple(lines)))
        repeated, share = _autocorrelation_panel(label, longest.time, _residual(longest, place))
        panels.append(repeated)
        if np.isfinite(share):
            outside.append(f"{100.0 * share:.0f} % of the {label}'s")
    found = f": here {', '.join(outside)}" if outside else ""
    says = (
        "Of white noise, a twentieth of the autocorrelation lies outside the grey band"
        f"{found}. A larger share shows a model error, or noise of the input."
    )
    title = "Residuals, and their autocorrelation"
    return Chart("residuals", title, says, tuple(panels), columns=2)


def _autocorrelation_panel(
    label: str, time: FloatArray, residual: FloatArray
) -> tuple[Panel, float]:
    """The autocorrelation, and the share of it beyond lag 0 that white noise would not have."""
    lag = time[: max(2, int(_LONGEST_LAG * len(time)))] - time[0]
    band = _SIGNIFICANT / np.sqrt(len(residual))
    edges = np.full(2, band)
    marks = [
        Band("95 % of white noise", lag[[0, -1]], -edges, edges, "grey"),
        Level("", 0.0, "y", "ink"),
    ]
    share = np.nan
    if np.isfinite(residual).all():
        found = autocorrelation(residual)[: len(lag)]
        marks.append(Line("autocorrelation", lag, found, "blue"))
        share = float(np.mean(np.abs(found[1:]) > band))
    y = Axis("autocorrelation", limits=(-1.05, 1.05))
    return Panel(f"{label}: autocorrelation", Axis("lag", "s"), y, tuple(marks)), share


def autocorrelation(values: FloatArray) -> FloatArray:
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


def _residual(run: FreeRun, place: int) -> FloatArray:
    residual = run.measured[:, place] - run.simulated[:, place]
    return np.where(np.isfinite(residual), residual, np.nan)
