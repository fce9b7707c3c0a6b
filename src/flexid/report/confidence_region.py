"""Joint confidence regions: what two correlated values may be together.

Two intervals side by side suggest that every pair of values within them is possible. Where the
estimates correlate that is wrong: the region of both together is a narrow ellipse across the
rectangle of the intervals, and its long axis is the combination that the log does not determine.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.special import fdtri

from flexid.arrays import FloatArray
from flexid.identification.estimate import Fit
from flexid.identification.intervals import CONFIDENCE, interval
from flexid.report.style import BLUE, GREY, INK, ORANGE, STYLE, new_figure

_COLOURS = (BLUE, ORANGE, GREY)
_ANGLES = np.linspace(0.0, 2.0 * np.pi, 361)
_MARGIN = 0.12  # around the widest interval, as a part of it
_FARTHEST = 4.0  # times the first fit's half-width: a wider fit runs out of the picture


@dataclass(frozen=True, eq=False)
class Region:
    """The joint confidence region of two values.

    Parameters
    ----------
    pair : tuple of str
        Their names.
    centre : array, shape (2,)
        Their estimates.
    boundary : array, shape (2, n)
        The ellipse that holds both with the nominal confidence.
    intervals : tuple of tuple of float
        The interval of each by itself.
    correlation : float
        Between the two estimates.
    level : float
        The nominal confidence.
    """

    pair: tuple[str, str]
    centre: FloatArray
    boundary: FloatArray
    intervals: tuple[tuple[float, float], tuple[float, float]]
    correlation: float
    level: float


def confidence_region(fit: Fit, pair: tuple[str, str], level: float = CONFIDENCE) -> Region | None:
    """Joint region of two coefficients, (p - p̂)ᵀ C⁻¹ (p - p̂) = 2 F(2, ν).

    F is Fisher's quantile, which takes the place of χ² for a covariance that is itself estimated;
    ν is the fewer degrees of freedom of the two, less one for the second dimension (Hotelling),
    and twice F is then scaled by (ν + 1) / ν.

    Returns
    -------
    Region or None
        None if the log leaves one of the two free.
    """
    places = [fit.names.index(name) for name in pair]
    covariance = fit.covariance[np.ix_(places, places)]
    freedom = min(fit.degrees_of_freedom[i] for i in places)
    if not np.isfinite(covariance).all() or freedom <= 1.0 or min(np.diag(covariance)) <= 0.0:
        return None
    centre = np.asarray(fit.values, dtype=np.float64)[places]
    deviations = np.sqrt(np.diag(covariance))
    correlation = float(np.clip(covariance[0, 1] / np.prod(deviations), -1.0, 1.0))
    first, second = (
        interval(float(centre[j]), float(deviations[j]), fit.degrees_of_freedom[i], level)
        for j, i in enumerate(places)
    )
    # Cholesky's factor of the correlation, written out: it serves at a correlation of 1 too.
    circle = np.array([np.cos(_ANGLES), np.sin(_ANGLES)])
    across = np.sqrt(1.0 - correlation**2)
    unit = np.array([circle[0], correlation * circle[0] + across * circle[1]])
    boundary = centre[:, None] + _radius(freedom, level) * deviations[:, None] * unit
    return Region(pair, centre, boundary, (first, second), correlation, level)


def most_correlated(fit: Fit, among: Sequence[str]) -> tuple[str, str] | None:
    """The two of some coefficients whose estimates correlate most; None if there are not two."""
    names = [name for name in fit.names if name in among]
    places = [fit.names.index(name) for name in names]
    covariance = fit.covariance[np.ix_(places, places)]
    known = np.isfinite(np.diag(covariance)) & (np.diag(covariance) > 0.0)
    if np.sum(known) < 2:
        return None
    deviations = np.sqrt(np.where(known, np.diag(covariance), 1.0))
    correlations = np.abs(covariance) / np.outer(deviations, deviations)
    correlations[~known, :] = correlations[:, ~known] = 0.0
    np.fill_diagonal(correlations, -1.0)
    first, second = np.unravel_index(np.argmax(correlations), correlations.shape)
    return names[min(first, second)], names[max(first, second)]


def confidence_region_figure(
    fits: Mapping[str, Fit],
    pairs: Mapping[str, tuple[str, str]],
    units: Mapping[str, str],
    level: float = CONFIDENCE,
) -> Figure:
    """Draw the joint region of each pair, of one fit or of several beside each other.

    Parameters
    ----------
    fits : mapping of str to Fit
        By what to call them; the first is drawn to fill the picture.
    pairs : mapping of str to tuple of str
        By what to call a pair, its two names.
    units : mapping of str to str
        Units of the coefficients.
    level : float, optional
        Nominal confidence.
    """
    with mpl.rc_context(STYLE):
        figure = new_figure(height=4.0)
        axes = figure.subplots(1, max(1, len(pairs)), squeeze=False)[0]
        for ax, (row, pair) in zip(axes, pairs.items(), strict=False):
            _draw(ax, row, pair, fits, units, level)
        if not pairs:
            axes[0].set_axis_off()
        entries: dict[str, Artist] = {}
        for handle, label in (entry for ax in axes for entry in _entries(ax)):
            entries.setdefault(label, handle)
        if entries:
            figure.legend(
                list(entries.values()), list(entries), loc="outside upper right", ncols=len(entries)
            )
    return figure


def _draw(
    ax: Axes,
    row: str,
    pair: tuple[str, str],
    fits: Mapping[str, Fit],
    units: Mapping[str, str],
    level: float,
) -> None:
    regions = {
        label: region
        for label, fit in fits.items()
        if set(pair) <= set(fit.names)
        and (region := confidence_region(fit, pair, level)) is not None
    }
    for colour, label in zip(_COLOURS, fits, strict=False):
        if label in regions:
            _draw_region(ax, regions[label], label, colour)
    ax.set_xlabel(f"{pair[0]} ({units[pair[0]]})")
    ax.set_ylabel(f"{pair[1]} ({units[pair[1]]})")
    ax.ticklabel_format(useOffset=False)
    ax.locator_params(axis="x", nbins=5)
    if not regions:
        ax.set_title(f"{row}: the log leaves one of the two free", fontsize=8.5)
        return
    first = next(iter(regions.values()))
    ax.set_title(f"{row}:\ncorrelation {first.correlation:+.2f}", fontsize=8.5)
    _frame(ax, first, list(regions.values()))


def _entries(ax: Axes) -> list[tuple[Artist, str]]:
    return list(zip(*ax.get_legend_handles_labels(), strict=True))


def _draw_region(ax: Axes, region: Region, label: str, colour: str) -> None:
    (left, right), (low, high) = region.intervals
    ax.fill(*region.boundary, color=colour, alpha=0.18, linewidth=0)
    ax.plot(*region.boundary, color=colour, label=f"{label}: joint {100 * region.level:g} %")
    ax.plot(*region.centre, "o", color=colour, markersize=4, markeredgecolor=INK)
    ax.plot(
        [left, right, right, left, left],
        [low, low, high, high, low],
        color=colour,
        linestyle=":",
        linewidth=1.0,
        label="each by itself",
    )


def _frame(ax: Axes, first: Region, regions: Sequence[Region]) -> None:
    """Show the first region whole, and of wider ones as much as leaves it visible."""
    for j, limit in enumerate((ax.set_xlim, ax.set_ylim)):
        half = float(np.abs(first.boundary[j] - first.centre[j]).max())
        low = min(float(region.boundary[j].min()) for region in regions)
        high = max(float(region.boundary[j].max()) for region in regions)
        low = max(low, first.centre[j] - _FARTHEST * half) - _MARGIN * half
        high = min(high, first.centre[j] + _FARTHEST * half) + _MARGIN * half
        limit(low, high)


def _radius(degrees_of_freedom: float, level: float) -> float:
    """Radius of the region of two values in standard deviations."""
    if np.isinf(degrees_of_freedom):
        return float(np.sqrt(-2.0 * np.log(1.0 - level)))
    left = degrees_of_freedom - 1.0
    fisher = float(fdtri(2.0, left, level))
    return float(np.sqrt(2.0 * degrees_of_freedom / left * fisher))
