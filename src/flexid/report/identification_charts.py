"""The charts of an identification: the fit, the estimates over time, excitation, joint regions.

Two intervals side by side suggest that every pair of values within them is possible. Where the
estimates correlate that is wrong: the region of both together is a narrow ellipse across the
rectangle of the intervals, and its long axis is the combination that the log does not determine.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.special import fdtri

from flexid.analysis.excitation import LOST_CONDITION, WEAK_CONDITION, Excitation
from flexid.arrays import FloatArray
from flexid.frequency.frequency_response import frequency_response
from flexid.identification.preparation.joint import joint_of
from flexid.identification.result.identification import Identification
from flexid.identification.vocabulary.estimate import Estimate
from flexid.identification.vocabulary.evidence import ParameterEstimate, slopes_of
from flexid.identification.vocabulary.intervals import CONFIDENCE, checked_level, interval
from flexid.report.chart import (
    VERDICT_COLOURS,
    Axis,
    Band,
    Chart,
    Level,
    Line,
    Mark,
    Panel,
    Points,
    with_margin,
)
from flexid.report.response_charts import bode_chart, free_run_chart, residual_chart
from flexid.report.terminal import format_with_interval

_ANGLES = np.linspace(0.0, 2.0 * np.pi, 361)


@dataclass(frozen=True, eq=False)
class Region:
    """The joint confidence region of two values."""

    centre: FloatArray  # their estimates
    boundary: FloatArray  # the ellipse that holds both with the nominal confidence
    intervals: tuple[tuple[float, float], tuple[float, float]]  # the interval of each by itself
    correlation: float  # between the two estimates
    level: float  # the nominal confidence


def confidence_region(
    fit: Estimate, pair: tuple[str, str], level: float = CONFIDENCE
) -> Region | None:
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
    radius = np.sqrt(-2.0 * np.log(1.0 - level))  # in standard deviations
    if np.isfinite(freedom):
        left = freedom - 1.0
        radius = np.sqrt(2.0 * freedom / left * float(fdtri(2.0, left, level)))
    circle = np.array([np.cos(_ANGLES), np.sin(_ANGLES)])
    across = np.sqrt(1.0 - correlation**2)
    unit = np.array([circle[0], correlation * circle[0] + across * circle[1]])
    boundary = centre[:, None] + radius * deviations[:, None] * unit
    return Region(centre, boundary, (first, second), correlation, level)


_REGION_MARGIN = 0.06  # of what is shown, on either side of it
_REGION_HEIGHT = 1.8
_PAIRS = (
    ("joint_stiffness", "link_inertia"),
    ("joint_stiffness", "motor_inertia"),
    ("joint_stiffness_per_link_inertia", "joint_stiffness_per_motor_inertia"),
)


def regions_chart(result: Identification, level: float = CONFIDENCE) -> Chart | None:
    """Joint confidence regions of stiffness and inertias; None where no two were estimated."""
    checked_level(level)
    fit = parameter_estimate(result)
    pairs = [pair for pair in _PAIRS if {*pair} <= {*fit.names}]
    regions = {pair: confidence_region(fit, pair, level) for pair in pairs}
    panels = [_panel(pair, region, result) for pair, region in regions.items() if region]
    if not panels:
        return None
    says = (
        f"Both values of a pair lie in the ellipse with {100 * level:g} % confidence. A narrow, "
        "tilted ellipse: the log determines a combination of the two better than either of them."
    )
    title = "Joint confidence regions"
    return Chart("regions", title, says, tuple(panels), len(panels), linked=False)


def _panel(pair: tuple[str, str], region: Region, result: Identification) -> Panel:
    """The region of a pair, with the interval of each by itself."""
    x_edge, y_edge = region.boundary
    (left, right), (low, high) = region.intervals
    around = np.array([left, right, right, left, left]), np.array([low, low, high, high, low])
    marks = (
        Line(f"joint {100 * region.level:g} %", x_edge, y_edge, "blue", filled=True),
        Line("each by itself", *around, "blue", 1.0, "dotted"),
        Points("", region.centre[:1], region.centre[1:], "blue"),
    )
    x, y = (
        Axis(
            name,
            result.parameters[name].unit,
            limits=with_margin(float(ends.min()), float(ends.max()), _REGION_MARGIN),
        )
        for name, ends in zip(pair, region.boundary, strict=True)
    )
    title = f"{pair[0]} and {pair[1]}:\ncorrelation {region.correlation:+.2f}"
    return Panel(title, x, y, marks, _REGION_HEIGHT)


def parameter_estimate(result: Identification) -> Estimate:
    """The physical parameters that were estimated, with their common covariance."""
    names = [name for name, p in result.parameters.items() if p.slopes and np.isfinite(p.std)]
    fit = result.fit
    slopes = slopes_of([result.parameters[name] for name in names], fit.names)
    finite = np.where(np.isfinite(fit.covariance), fit.covariance, 0.0)
    covariance = slopes @ finite @ slopes.T
    values = np.array([result.parameters[name].value for name in names])
    freedom = tuple(result.parameters[name].degrees_of_freedom for name in names)
    return Estimate(tuple(names), values, covariance, freedom)


_FLOOR = 1e-7  # below which a relative singular value is drawn as this
_HEIGHT = 1.4


def identification_charts(result: Identification) -> tuple[Chart, ...]:
    """All that the result has the data for: a loaded one has no time series."""
    charts = []
    if result.validation.runs:
        charts += [fit_chart(result), residual_chart(result.validation)]
    if len(result.observer.time):
        charts.append(estimates_chart(result))
    charts += [
        excitation_chart(result),
        bode_chart(frequency_response(result, result.recordings)),
        regions_chart(result),
    ]
    return tuple(chart for chart in charts if chart is not None)


def fit_chart(result: Identification) -> Chart:
    """Free run of the model over the held-out data, channel by channel, and its residual."""
    deviation = result.compliance.deflection_noise
    flexible = result.model == "flexible"  # a link's deflection has no noise of the motor's encoder
    noise = {"deflection": deviation} if flexible and 0.0 < deviation < np.inf else {}
    title = "Free run of the model over data kept out of the fit"
    return free_run_chart("fit", title, result.validation, noise)


def excitation_chart(result: Identification) -> Chart:
    """Singular values of each row's normalised Gram matrix, and its condition number."""
    rows = [*result.excitation.values()]
    says = (
        "Each point is a combination of a row's coefficients; its height is how well the motion "
        "excites it, relative to the best. Near the red line it is not determined."
    )
    title = "Excitation: singular values of each row"
    return Chart(
        "excitation", title, says, tuple(map(_excitation_panel, rows)), len(rows), linked=False
    )


def _excitation_panel(excitation: Excitation) -> Panel:
    relative = excitation.singular_values / excitation.singular_values[0]
    places = np.arange(1.0, len(relative) + 1.0)
    title = f"{excitation.row} row: condition number {excitation.condition_number:.3g}"
    if excitation.correlated:
        pair = " and ".join(excitation.correlated)
        title += f"\n{pair} correlate by {excitation.correlation:.2f}"
    return Panel(
        title,
        Axis("direction, best excited first", limits=(0.5, len(relative) + 0.5), step=1.0),
        Axis("singular value over the largest", "–", logarithmic=True, limits=(_FLOOR, 3.0)),
        (
            Points("", places, np.maximum(relative, _FLOOR), "blue", 6.0, stems=True),
            Level("weak below", 1.0 / WEAK_CONDITION, "y", "orange", "dashed"),
            Level("lost below", 1.0 / LOST_CONDITION, "y", "red", "dashed"),
        ),
        _HEIGHT,
    )


_CONVERGED = 0.5  # relative distance from the estimate at the end, within which a curve is drawn
_AROUND = 4.0  # half-widths of the interval that are shown to either side of an estimate
_FIRST = 10  # part of the observer's time, one over this, in which it may swing anywhere
_MARGIN = 0.08  # of what is shown, above and below it


def estimates_chart(result: Identification) -> Chart:
    """Each physical parameter with its interval, and the paper's observer where it arrives."""
    parameters = result.parameters.values()
    histories = observer_histories(result)
    arrived = {
        p.name: history
        for p in parameters
        if (history := histories.get(p.name)) is not None
        and abs(history[-1] - p.value) <= _CONVERGED * abs(p.value)
    }
    panels = [
        _estimate_panel(p, result.observer.time, arrived.get(p.name), histories) for p in parameters
    ]
    says = (
        "Each estimate with its interval, and the paper's observer, which reads the same log once "
        f"as a stream: it converges to {len(arrived)} of these {len(panels)}."
    )
    title = "Physical parameters, and the paper's observer over time"
    return Chart("estimates", title, says, tuple(panels), columns=2)


def _estimate_panel(
    parameter: ParameterEstimate,
    time: FloatArray,
    history: FloatArray | None,
    histories: Mapping[str, FloatArray],
) -> Panel:
    """A parameter, its interval, and the observer's history if that arrives."""
    value, (lower, upper) = parameter.value, parameter.interval
    shown, low, high = format_with_interval(value, lower, upper)
    width = f" [{low}, {high}]" if lower < upper else f" ({parameter.reason or 'fixed'})"
    title = f"{parameter.name}, {parameter.verdict}\n{shown}{width}"
    marks: list[Mark] = []
    if np.isfinite([lower, upper]).all():
        ends = np.full(2, lower), np.full(2, upper)
        marks.append(Band("95 % interval", time[[0, -1]], *ends, "blue"))
    if history is not None:
        marks.append(Line("paper's observer", time, history, "orange"))
    elif parameter.name in histories:
        title += "; observer ends elsewhere"
    marks.append(Level("estimate", value, "y", "ink"))
    frame, cut_off = _frame(parameter, history)
    return Panel(
        title + ("; start cut off" if cut_off else ""),
        Axis("time", "s", limits=(float(time[0]), float(time[-1]))),
        Axis("value", parameter.unit, limits=frame),
        tuple(marks),
        colour=VERDICT_COLOURS[parameter.verdict],
    )


def _frame(
    parameter: ParameterEstimate, history: FloatArray | None
) -> tuple[tuple[float, float], bool]:
    """Limits of the value, and whether they cut the beginning of the history off."""
    value, (lower, upper) = parameter.value, parameter.interval
    half = max(value - lower, upper - value) if np.isfinite([lower, upper]).all() else 0.0
    around = max(_AROUND * half, 0.02 * abs(value)) or 1.0
    edges = [value - around, value + around]
    if history is not None:
        usual = history[len(history) // _FIRST :]
        edges += [0.0, float(np.nanmin(usual)), float(np.nanmax(usual))]
    low, high = with_margin(min(edges), max(edges), _MARGIN)
    cut_off = history is not None and bool(np.nanmin(history) < low or np.nanmax(history) > high)
    return (low, high), cut_off


def observer_histories(result: Identification) -> dict[str, FloatArray]:
    """Physical parameters as the observer has them, by name, those that its coefficients give."""
    observer = result.observer
    values = {c.name: c.value for c in result.coefficients.values()}
    fixed = {name: value for name, value in values.items() if name not in observer.names}
    steps = [dict(zip(observer.names, row, strict=True)) for row in observer.estimates.tolist()]
    is_torque = result.input_unit == "N m"
    found = {}
    for function in joint_of(result.model).parameters(values, input_is_torque=is_torque):
        given = {*function.coefficients} <= {*fixed, *observer.names}
        if function.name in result.parameters and given:
            history = np.array([function.value({**fixed, **step}) for step in steps])
            if np.isfinite(history[-1:]).any():
                found[function.name] = np.where(np.isfinite(history), history, np.nan)
    return found
