"""The paper's loop as charts: Figures 1 to 5 of Huang (2003), Theorem 1, and a run of one's own."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from flexid.arrays import FloatArray
from flexid.estimators.excitation import LOST_CONDITION, WEAK_CONDITION
from flexid.report.chart import (
    Axis,
    Chart,
    Colour,
    Level,
    Line,
    Mark,
    Panel,
    peaks,
    whole_decades,
    with_margin,
)
from flexid.studies.readings import DURATION, TOLERANCE, UNKNOWN, SteadyRun
from flexid.studies.reproduction import Reproduction

_OF_ERRORS: tuple[Colour, ...] = ("blue", "orange", "green", "red")
_OF_ROWS: tuple[Colour, ...] = ("ink", "grey")  # one legend names errors and rows
SYMBOLS = {"theta1": "θ₁", "theta2": "θ₂", "alpha1": "α₁", "alpha2": "α₂"}
_STRETCHES = 150  # of which each shows the largest value of an error that oscillates


@dataclass(frozen=True, eq=False)
class Played:
    """What is shown of a run."""

    time: FloatArray  # (n,), in s
    tracking: FloatArray  # (n,), magnitude of the tracking error in rad
    errors: Mapping[str, FloatArray]
    final_errors: Mapping[str, tuple[float, str]]
    lyapunov: FloatArray
    moments: FloatArray  # (m,), times in s of the condition numbers
    conditions: Mapping[str, FloatArray]
    remaining_error: float  # largest tracking error in the end, in rad
    largest_torque: float  # in N m


def play_chart(run: Played | None, pinned: Played | None) -> Chart:
    """Four panels: tracking error, parameter errors, V, excitation; a pinned run is dashed."""
    tracking: list[Mark] = []
    errors: list[Mark] = []
    lyapunov: list[Mark] = []
    excitation: list[Mark] = [
        Level("weak above", WEAK_CONDITION, colour="orange", dash="dotted"),
        Level("lost above", LOST_CONDITION, colour="red", dash="dotted"),
    ]
    for played, named in ((pinned, False), (run, True)):
        if played is not None:
            error = {"tracking error": played.tracking}
            tracking.extend(_curves(played.time, error, _OF_ROWS, named=named))
            errors.extend(_curves(played.time, played.errors, _OF_ERRORS, named=named))
            lyapunov.extend(_curves(played.time, {"V": played.lyapunov}, _OF_ROWS, named=named))
            excitation.extend(_curves(played.moments, played.conditions, _OF_ROWS, named=named))
    panels = (
        ("Tracking error", "magnitude", "rad", tracking),
        ("Parameter errors over the true values", "magnitude", "", errors),
        ("V of Theorem 1", "V", "", lyapunov),
        ("Excitation over the last 2 s", "condition number", "", excitation),
    )
    return Chart(
        "play",
        "The paper's closed loop",
        "The tracking error shows what the controller can do, the parameter errors what the "
        "observer learns. V never rises while the drive is ideal. Where the condition number "
        "is large, two coefficients cannot be told apart. Dashed: the pinned run.",
        tuple(
            Panel(title, Axis("time", "s"), Axis(label, unit, True), tuple(marks))
            for title, label, unit, marks in panels
        ),
        columns=2,
    )


def _curves(
    time: FloatArray, curves: Mapping[str, FloatArray], colours: tuple[Colour, ...], *, named: bool
) -> Iterator[Line]:
    """Peaks of a run, or dashed and without a name of the pinned one; zero has no place here."""
    for (name, values), colour in zip(curves.items(), colours, strict=False):
        if not np.isnan(values).all():
            x, y = peaks(time, values, max(1, len(time) // _STRETCHES))
            label, dash = (SYMBOLS.get(name, name), "solid") if named else ("", "dashed")
            yield Line(label, x, np.where(y > 0.0, y, np.nan), colour, dash=dash)


NOISE = 1e-3 * TOLERANCE
"""The integrator's absolute tolerance: smaller parameter errors are not distinguished from zero."""

COLOURS: Mapping[str, Colour] = {"1,2,3": "blue", "1,1,3": "orange"}

_LAST = 0.5  # s
_PEAKS = 0.1  # s, of which each shows the largest parameter error
_UNITS = {"theta1": "1/s²", "theta2": "1/s²", "alpha1": "1/s²", "alpha2": "1/s"}
_MARGIN = 0.08  # of what a parameter error does after its first 50 ms, above and below it


def reproduction_charts(result: Reproduction) -> tuple[Chart, ...]:
    """figure1 to figure5 and theorem1."""
    runs = result.runs
    errors = [error_chart(runs, name, number) for number, name in enumerate(UNKNOWN, start=2)]
    return tracking_chart(runs), *errors, theorem_chart(runs)


def tracking_chart(runs: Mapping[str, SteadyRun]) -> Chart:
    """Figure 1: the tracking error over time and over its last half second.

    One row of panels per reading, for the two differ 300-fold.
    """
    panels = []
    for name, run in runs.items():
        time, error = run.run.time, run.run.tracking_error
        limit = 1.25 * run.max_tracking_error
        largest = float(np.abs(error).max())
        swing = f"; first swing {largest:.2g} rad" if largest > limit else ""
        end = run.run.between(DURATION - _LAST, DURATION)
        y = Axis("tracking error", "rad", limits=(-limit, limit))
        most = _number(run.max_tracking_error)
        title = f"gains ({name}): at most {most} rad over 20–30 s{swing}"
        whole = Line("", time, error, COLOURS[name], 0.6)
        last = Line("", time[end], error[end], COLOURS[name])
        panels.append(Panel(title, Axis("time", "s", limits=(0.0, DURATION)), y, (whole,), span=3))
        at_end = Axis("time", "s", limits=(DURATION - _LAST, DURATION))
        panels.append(Panel("last half second", at_end, y, (last,)))
    found = ", ".join(f"{_number(run.max_tracking_error)} rad" for run in runs.values())
    names = " and ".join(f"({name})" for name in runs)
    says = f"Over the last ten seconds the readings {names} track to {found}."
    return Chart("figure1", "Figure 1: tracking error", says, tuple(panels), columns=4)


def error_chart(runs: Mapping[str, SteadyRun], coefficient: str, number: int) -> Chart:
    """One of Figures 2 to 5: a parameter error over time above, its magnitude below."""
    column = UNKNOWN.index(coefficient)
    symbol, unit = SYMBOLS[coefficient], _UNITS[coefficient]
    time = Axis("time", "s", limits=(0.0, DURATION))
    whole: list[Mark] = [Level("", 0.0, "y", "ink")]
    magnitude: list[Mark] = []
    sizes = []
    for name, run in runs.items():
        error = run.run.parameter_errors[:, column]
        label, colour = f"gains ({name})", COLOURS[name]
        whole.append(Line(label, run.run.time, error, colour, 1.0))
        width = round(_PEAKS / (run.run.time[1] - run.run.time[0]))
        places, largest = peaks(run.run.time, np.abs(error), width)
        magnitude.append(Line(label, places, largest, colour))
        sizes.append(largest)
    lowest, highest = whole_decades(np.concatenate(sizes))
    if lowest < NOISE:
        lowest = 0.1 * NOISE
        magnitude.append(Level("integrator's tolerance", NOISE, "y", "grey", "dashed"))
    at_end = ", ".join(
        f"{_number(run.parameter_errors[coefficient])} with ({name})" for name, run in runs.items()
    )
    limits, cut_off = _late_values(runs, column)
    peak = Axis(f"{_PEAKS} s peaks", unit, logarithmic=True, limits=(lowest, highest))
    error_axis = Axis(f"error of {symbol}", unit, limits=limits)
    panels = (
        Panel(f"error of {symbol} at 30 s: {at_end}{cut_off}", time, error_axis, tuple(whole)),
        Panel("its size", time, peak, tuple(magnitude)),
    )
    title = f"Figure {number}: error of {symbol}"
    says = f"After 30 s the error of {symbol} in {unit} is {at_end}."
    return Chart(f"figure{number}", title, says, panels)


def _number(value: float) -> str:
    """Three digits; what the integrator's error hides is called so."""
    return f"{value:.3g}".replace("-", "−") if abs(value) > 10 * NOISE else "|·| < 1e−10"


def _late_values(runs: Mapping[str, SteadyRun], column: int) -> tuple[tuple[float, float], str]:
    """Limits of all but the first 50 ms, which would flatten the rest, and what they cut off."""
    late = np.concatenate([run.run.parameter_errors[50:, column] for run in runs.values()])
    limits = with_margin(float(late.min()), float(late.max()), _MARGIN)
    first = float(next(iter(runs.values())).run.parameter_errors[0, column])
    return limits, f"; from {_number(first)} at 0 s" if first < limits[0] else ""


def theorem_chart(runs: Mapping[str, SteadyRun]) -> Chart:
    """V along both runs."""
    values = tuple(
        Line(f"gains ({name})", run.monitor.time, run.monitor.value, COLOURS[name])
        for name, run in runs.items()
    )
    decades = whole_decades(np.concatenate([line.y for line in values]))
    time = Axis("time", "s", limits=(0.0, DURATION))
    lyapunov = Panel(
        "Lyapunov function, eq. (8): it never rises",
        time,
        Axis("V", "SI", logarithmic=True, limits=decades),
        values,
    )
    ends = " and ".join(f"{line.y[-1]:.2g}" for line in values)
    return Chart("theorem1", "Theorem 1", f"V falls to {ends} in 30 s.", (lyapunov,))
