"""The charts of an identification: the fit, the estimates over time, excitation, joint regions."""

from collections.abc import Mapping

import numpy as np

from flexid.analysis.excitation import LOST_CONDITION, WEAK_CONDITION, Excitation
from flexid.arrays import FloatArray
from flexid.frequency.frequency_response import frequency_response
from flexid.identification.preparation.joint import joint_of
from flexid.identification.result.identification import Identification
from flexid.identification.vocabulary.evidence import ParameterEstimate
from flexid.models.parameter_kinds import PhysicalParameter
from flexid.report.bode_chart import bode_chart
from flexid.report.charts.description import (
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
from flexid.report.digits import format_with_interval
from flexid.report.free_run_chart import free_run_chart, residual_chart
from flexid.report.regions_chart import regions_chart
from flexid.stored_estimates.rebuilt import input_unit_of

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
    return free_run_chart("fit", title, result.validation, noise, "time")


def excitation_chart(result: Identification) -> Chart:
    """Singular values of each row's normalised Gram matrix, and its condition number."""
    rows = [*result.excitation.values()]
    worst = max(rows, key=lambda row: row.condition_number)
    says = (
        "Each point is a combination of a row's coefficients; its height is how well the motion "
        "excites it, relative to the best. Near the red line it is not determined. "
        f"The weakest is in the {worst.row} row, at {1.0 / worst.condition_number:.2g}"
        f"{_pair(worst)}."
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


def _pair(excitation: Excitation) -> str:
    """The confounded pair in words, where a row has one."""
    if not excitation.correlated:
        return ""
    first, second = excitation.correlated
    return f", where {first} and {second} correlate by {excitation.correlation:.2f}"


_CONVERGED = 0.5  # relative distance from the estimate at the end, within which a curve is drawn
_AROUND = 4.0  # half-widths of the interval that are shown to either side of an estimate
_FIRST = 10  # part of the observer's time, one over this, in which it may swing anywhere
_MARGIN = 0.08  # of what is shown, above and below it


def estimates_chart(result: Identification) -> Chart:
    """Each physical parameter with its interval, and the paper's observer where it arrives."""
    parameters = result.parameters.values()
    histories = observer_histories(result)
    arrived = {p.name: histories[p.name] for p in parameters if _arrives(p, histories)}
    panels = [
        _estimate_panel(p, result.observer.time, arrived.get(p.name), histories) for p in parameters
    ]
    determined = sum(p.verdict == "determined" for p in parameters)
    says = (
        f"Determined by the log: {determined} of {len(panels)}. The paper's observer, which reads "
        f"the same log once as a stream, converges to {len(arrived)} of these estimates."
    )
    title = "Physical parameters, and the paper's observer over time"
    return Chart("estimates", title, says, tuple(panels), columns=2)


def _arrives(parameter: ParameterEstimate, histories: Mapping[str, FloatArray]) -> bool:
    history = histories.get(parameter.name)
    if history is None:
        return False
    return bool(abs(history[-1] - parameter.value) <= _CONVERGED * abs(parameter.value))


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
    fixed = {c.name: c.value for c in result.coefficients.values() if c.name not in observer.names}
    columns = dict(zip(observer.names, observer.estimates.T, strict=True))
    found = {}
    for name, function in _functions(result).items():
        if not {*function.coefficients} <= {*fixed, *columns}:
            continue
        values = [
            function.value({**fixed, **{c: float(column[i]) for c, column in columns.items()}})
            for i in range(len(observer.time))
        ]
        history = np.array(values)
        if np.isfinite(history).any():
            found[name] = np.where(np.isfinite(history), history, np.nan)
    return {name: history for name, history in found.items() if np.isfinite(history[-1])}


def _functions(result: Identification) -> Mapping[str, PhysicalParameter]:
    """The function of the coefficients behind each parameter."""
    values = {name: c.value for name, c in result.coefficients.items()}
    is_torque = input_unit_of(result) == "N m"
    made = joint_of(result.model).parameters(values, input_is_torque=is_torque)
    return {function.name: function for function in made if function.name in result.parameters}
