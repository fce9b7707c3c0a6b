"""Figures of physical parameters: over time as the observer finds them, and in pairs."""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from flexid.identification.estimate import Estimate
from flexid.identification.result import Identification, ParameterEstimate
from flexid.models.physical import (
    PhysicalParameter,
    link_parameters,
    physical_parameters,
    rigid_parameters,
)
from flexid.report.digits import format_with_interval
from flexid.report.style import BLUE, INK, ORANGE, STATUS_COLOURS, new_figure

_CONVERGED = 0.5  # relative distance from the estimate at the end, within which a curve is drawn
_MOST_POINTS = 2000
_AROUND = 4.0  # half-widths of the interval that are shown to either side of an estimate
_FIRST = 10  # part of the observer's time, one over this, in which it may swing anywhere
_MARGIN = 0.08  # of what is shown, above and below it
_SAME = 1e-6  # relative difference of a parameter to the function that gives it


def estimates_figure(result: Identification) -> Figure:
    """Each physical parameter with its interval, and the paper's observer where it arrives."""
    parameters = list(result.parameters.values())
    histories = observer_histories(result)
    lines = -(-len(parameters) // 2)
    figure = new_figure(height=1.75 * lines + 0.6)
    axes = figure.subplots(lines, 2, squeeze=False).ravel()
    for ax, parameter in zip(axes, parameters, strict=False):
        _draw_estimate(ax, parameter, result, histories.get(parameter.name))
    for ax in axes[len(parameters) :]:
        ax.set_axis_off()
    entries = {
        label: handle
        for ax in axes
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True)
    }
    figure.legend(list(entries.values()), list(entries), loc="outside upper right", ncols=3)
    figure.supxlabel("time (s)", fontsize=9)
    return figure


def _draw_estimate(
    ax: Axes, parameter: ParameterEstimate, result: Identification, history: np.ndarray | None
) -> None:
    value, (lower, upper) = parameter.value, parameter.interval
    shown, low, high = format_with_interval(value, lower, upper)
    width = f" [{low}, {high}]" if lower < upper else f" ({parameter.reason or 'fixed'})"
    title = f"{parameter.name}\n{shown}{width}"
    time = result.observer.time
    near = history is not None and abs(history[-1] - value) <= _CONVERGED * abs(value)
    if near and history is not None:
        step = -(-len(time) // _MOST_POINTS)
        ax.plot(time[::step], history[::step], color=ORANGE, label="paper's observer")
    elif history is not None:
        title += "; the observer does not arrive"
    ax.axhline(value, color=INK, linewidth=1.0, label="estimate")
    finite = np.isfinite([lower, upper]).all()
    if finite:
        ax.axhspan(lower, upper, color=BLUE, alpha=0.25, linewidth=0, label="95 % interval")
    half = max(value - lower, upper - value) if finite else 0.0
    around = max(_AROUND * half, 0.02 * abs(value)) or 1.0
    edges = [value - around, value + around]
    if near and history is not None:
        usual = history[len(history) // _FIRST :]
        edges += [0.0, float(np.nanmin(usual)), float(np.nanmax(usual))]
        margin = _MARGIN * (max(edges) - min(edges))
        if np.nanmax(history) > max(edges) + margin or np.nanmin(history) < min(edges) - margin:
            title += "; first tenth cut off"
    margin = _MARGIN * (max(edges) - min(edges))
    ax.set_ylim(min(edges) - margin, max(edges) + margin)
    ax.set_xlim(time[0], time[-1])
    ax.set_title(title, color=STATUS_COLOURS[parameter.verdict], fontsize=8)
    ax.set_ylabel(parameter.unit)


def observer_histories(result: Identification) -> dict[str, np.ndarray]:
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
    """The function behind each parameter; of those that each log has its own of, none."""
    values = {name: c.value for name, c in result.coefficients.items()}
    found = {}
    makers = (physical_parameters, rigid_parameters)
    tables = [make(values, torque) for make in makers for torque in (True, False)]
    for function in (
        function for table in (*tables, link_parameters(values)) for function in table
    ):
        stated = result.parameters.get(function.name)
        if stated is None:
            continue
        apart = abs(function.value(values) - stated.value)
        if apart <= _SAME * abs(stated.value):
            found[function.name] = function
    return found


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
