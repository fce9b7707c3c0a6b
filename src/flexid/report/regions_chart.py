"""Joint confidence regions: their joint confidence regions."""

from collections.abc import Mapping, Sequence

import numpy as np

from flexid.identification.result.identification import Identification
from flexid.identification.vocabulary.estimate import Estimate, Fit
from flexid.identification.vocabulary.intervals import CONFIDENCE
from flexid.report.charts.description import Axis, Chart, Colour, Line, Mark, Panel, Points
from flexid.report.charts.limits import with_margin
from flexid.report.confidence_region import Region, confidence_region, most_correlated

_COLOURS: tuple[Colour, ...] = ("blue", "orange", "grey")
_MARGIN = 0.06  # of what is shown, on either side of it
_FARTHEST = 4.0  # times the first fit's half-width: a wider fit runs out of the picture
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
    fits = {result.choices.estimator.replace("-", " "): found}
    return confidence_regions_chart(fits, pairs, units, level)


def confidence_regions_chart(
    fits: Mapping[str, Fit],
    pairs: Sequence[tuple[str, str]],
    units: Mapping[str, str],
    level: float = CONFIDENCE,
) -> Chart:
    """The joint region of each pair, of one fit or of several beside each other."""
    panels, correlated = [], []
    for pair in pairs:
        regions = {
            label: region
            for label, fit in fits.items()
            if {*pair} <= {*fit.names}
            and (region := confidence_region(fit, pair, level)) is not None
        }
        panels.append(_panel(pair, regions, [*fits], units))
        for region in [*regions.values()][:1]:
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
    pair: tuple[str, str],
    regions: Mapping[str, Region],
    labels: Sequence[str],
    units: Mapping[str, str],
) -> Panel:
    """The regions of a pair, each in the colour of its fit."""
    first, second = pair
    marks: list[Mark] = []
    for colour, label in zip(_COLOURS, labels, strict=False):
        if label in regions:
            marks += _region_marks(regions[label], label, colour)
    title = f"{first} and {second}:\n"
    limits = (None, None)
    if regions:
        drawn = [*regions.values()]
        title += f"correlation {drawn[0].correlation:+.2f}"
        limits = _limits(drawn, 0), _limits(drawn, 1)
    else:
        title += "the log leaves one of the two free"
    x = Axis(first, units[first], limits=limits[0])
    y = Axis(second, units[second], limits=limits[1])
    return Panel(title, x, y, tuple(marks), _HEIGHT)


def _region_marks(region: Region, label: str, colour: Colour) -> tuple[Mark, ...]:
    (left, right), (low, high) = region.intervals
    joint = f"{label}: joint {100 * region.level:g} %"
    around = np.array([left, right, right, left, left]), np.array([low, low, high, high, low])
    return (
        Line(joint, region.boundary[0], region.boundary[1], colour, filled=True),
        Line("each by itself", *around, colour, 1.0, "dotted"),
        Points("", region.centre[:1], region.centre[1:], colour),
    )


def _limits(regions: Sequence[Region], j: int) -> tuple[float, float]:
    """Show the first region whole, and of wider ones as much as leaves it visible."""
    first = regions[0]
    centre = float(first.centre[j])
    half = float(np.abs(first.boundary[j] - centre).max())
    low = min(float(region.boundary[j].min()) for region in regions)
    high = max(float(region.boundary[j].max()) for region in regions)
    low, high = max(low, centre - _FARTHEST * half), min(high, centre + _FARTHEST * half)
    return with_margin(low, high, _MARGIN)


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
