"""Joint confidence regions of parameters, as a chart."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from flexid.identification.result.identification import Identification
from flexid.identification.vocabulary.estimate import Estimate, Fit
from flexid.identification.vocabulary.intervals import CONFIDENCE
from flexid.report.charts.description import Axis, Chart, Line, Panel, Points
from flexid.report.charts.limits import with_margin
from flexid.report.confidence_region import Region, confidence_region, most_correlated

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
