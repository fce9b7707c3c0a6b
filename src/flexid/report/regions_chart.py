"""Joint confidence regions: what two correlated values may be together, as a chart.

Two intervals side by side suggest that every pair of values within them is possible. Where the
estimates correlate that is wrong: the region of both together is a narrow ellipse across the
rectangle of the intervals, and its long axis is the combination that the log does not determine.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import fdtri

from flexid.arrays import FloatArray
from flexid.identification.result.identification import Identification
from flexid.identification.vocabulary.estimate import Estimate, Fit
from flexid.identification.vocabulary.intervals import CONFIDENCE, interval
from flexid.report.charts.description import Axis, Chart, Line, Panel, Points, with_margin

_ANGLES = np.linspace(0.0, 2.0 * np.pi, 361)


@dataclass(frozen=True, eq=False)
class Region:
    """The joint confidence region of two values."""

    centre: FloatArray  # their estimates
    boundary: FloatArray  # the ellipse that holds both with the nominal confidence
    intervals: tuple[tuple[float, float], tuple[float, float]]  # the interval of each by itself
    correlation: float  # between the two estimates
    level: float  # the nominal confidence


def confidence_region(fit: Fit, pair: tuple[str, str], level: float = CONFIDENCE) -> Region | None:
    """Joint region of two coefficients, (p - p̂)ᵀ C⁻¹ (p - p̂) = 2 F(2, ν).

    F is Fisher's quantile, which takes the place of χ² for a covariance that is itself estimated;
    ν is the fewer degrees of freedom of the two, less one for the second dimension (Hotelling),
    and twice F is then scaled by (ν + 1) / ν.
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
    return Region(centre, boundary, (first, second), correlation, level)


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


def _radius(degrees_of_freedom: float, level: float) -> float:
    """Radius of the region of two values in standard deviations."""
    if np.isinf(degrees_of_freedom):
        return float(np.sqrt(-2.0 * np.log(1.0 - level)))
    left = degrees_of_freedom - 1.0
    fisher = float(fdtri(2.0, left, level))
    return float(np.sqrt(2.0 * degrees_of_freedom / left * fisher))


_MARGIN = 0.06  # of what is shown, on either side of it
_HEIGHT = 1.8
_PAIRS = (
    ("joint_stiffness", "link_inertia"),
    ("joint_stiffness", "motor_inertia"),
    ("joint_stiffness_per_link_inertia", "joint_stiffness_per_motor_inertia"),
)


def regions_chart(result: Identification, level: float = CONFIDENCE) -> Chart | None:
    """Joint confidence regions of physical parameters; None where no two were estimated."""
    found = parameter_estimate(result)
    pairs = correlated_pairs(found)
    if not pairs:
        return None
    units = {name: result.parameters[name].unit for name in found.names}
    label = result.choices.estimator.replace("-", " ")
    return confidence_regions_chart(label, found, pairs, units, level)


def confidence_regions_chart(
    label: str,
    fit: Fit,
    pairs: Sequence[tuple[str, str]],
    units: Mapping[str, str],
    level: float = CONFIDENCE,
) -> Chart:
    """The joint region of each pair."""
    panels, correlated = [], []
    for pair in pairs:
        region = confidence_region(fit, pair, level)
        panels.append(_panel(pair, region, label, units))
        if region is not None:
            correlated.append(f"{pair[0]} and {pair[1]} by {region.correlation:+.2f}")
    says = (
        f"Both values of a pair lie in the ellipse with {100 * level:g} % confidence. A narrow, "
        "tilted ellipse: the log determines a combination of the two better than either of them."
    )
    if correlated:
        says += f" The estimates correlate: {', '.join(correlated)}."
    title = "Joint confidence regions"
    columns = max(1, len(panels))
    return Chart("regions", title, says, tuple(panels), columns, linked=False)


def _panel(
    pair: tuple[str, str], region: Region | None, label: str, units: Mapping[str, str]
) -> Panel:
    """The region of a pair, with the interval of each by itself."""
    first, second = pair
    x, y = (Axis(name, units[name]) for name in pair)
    title = f"{first} and {second}:\n"
    if region is None:
        return Panel(f"{title}the log leaves one of the two free", x, y, (), _HEIGHT)
    x_edge, y_edge = region.boundary
    (left, right), (low, high) = region.intervals
    around = np.array([left, right, right, left, left]), np.array([low, low, high, high, low])
    marks = (
        Line(f"{label}: joint {100 * region.level:g} %", x_edge, y_edge, "blue", filled=True),
        Line("each by itself", *around, "blue", 1.0, "dotted"),
        Points("", region.centre[:1], region.centre[1:], "blue"),
    )
    x, y = (
        replace(axis, limits=with_margin(float(ends.min()), float(ends.max()), _MARGIN))
        for axis, ends in zip((x, y), region.boundary, strict=True)
    )
    return Panel(f"{title}correlation {region.correlation:+.2f}", x, y, marks, _HEIGHT)


def correlated_pairs(estimate: Estimate) -> tuple[tuple[str, str], ...]:
    """Two pairs of parameters at most: stiffness and inertias, else those that correlate most."""
    wanted = [pair for pair in _PAIRS if {*pair} <= {*estimate.names}]
    pairs = [pair for pair in wanted if most_correlated(estimate, pair) is not None]
    if not pairs:
        pair = most_correlated(estimate, estimate.names)
        pairs = [] if pair is None else [pair]
    return tuple(pairs[:2])


def parameter_estimate(result: Identification) -> Estimate:
    """The physical parameters that were estimated, with their common covariance."""
    names = [name for name, p in result.parameters.items() if p.slopes and np.isfinite(p.std)]
    fit = result.fit
    place = {name: i for i, name in enumerate(fit.names)}
    slopes = np.zeros((len(names), len(fit.names)))
    for i, name in enumerate(names):
        for coefficient, slope in result.parameters[name].slopes.items():
            slopes[i, place[coefficient]] = slope
    finite = np.where(np.isfinite(fit.covariance), fit.covariance, 0.0)
    covariance = slopes @ finite @ slopes.T
    values = np.array([result.parameters[name].value for name in names])
    freedom = tuple(result.parameters[name].degrees_of_freedom for name in names)
    return Estimate(tuple(names), values, covariance, freedom)
