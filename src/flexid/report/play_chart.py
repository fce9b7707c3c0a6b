"""A run of the paper's closed loop beside another: errors, V and excitation over time."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from flexid.analysis.excitation import LOST_CONDITION, WEAK_CONDITION
from flexid.arrays import FloatArray
from flexid.report.charts.decimate import peaks
from flexid.report.charts.description import Axis, Chart, Colour, Level, Line, Mark, Panel

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
            x, y = _peaks(played.time, played.tracking)
            tracking.append(_line("tracking error", x, y, "ink", named=named))
            errors.extend(_curves(played.time, played.errors, _OF_ERRORS, named=named))
            lyapunov.extend(_curves(played.time, {"V": played.lyapunov}, _OF_ROWS, named=named))
            excitation.extend(_curves(played.moments, played.conditions, _OF_ROWS, named=named))
    time = Axis("time", "s")
    return Chart(
        "play",
        "The paper's closed loop",
        "The tracking error shows what the controller can do, the parameter errors what the "
        "observer learns. V never rises while the drive is ideal. Where the condition number "
        "is large, two coefficients cannot be told apart. Dashed: the pinned run.",
        (
            Panel("Tracking error", time, Axis("magnitude", "rad", True), tuple(tracking)),
            Panel(
                "Parameter errors over the true values",
                time,
                Axis("magnitude", "", True),
                tuple(errors),
            ),
            Panel("V of Theorem 1", time, Axis("V", "", True), tuple(lyapunov)),
            Panel(
                "Excitation over the last 2 s",
                time,
                Axis("condition number", "", True),
                tuple(excitation),
            ),
        ),
        columns=2,
    )


def _peaks(time: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    return peaks(time, values, max(1, len(time) // _STRETCHES))


def _curves(
    time: FloatArray,
    curves: Mapping[str, FloatArray],
    colours: tuple[Colour, ...],
    *,
    named: bool,
) -> Iterator[Line]:
    for (name, values), colour in zip(curves.items(), colours, strict=False):
        if np.isnan(values).all():
            continue
        x, y = _peaks(time, values)
        yield _line(SYMBOLS.get(name, name), x, y, colour, named=named)


def _line(label: str, x: FloatArray, y: FloatArray, colour: Colour, *, named: bool) -> Line:
    """A line of the run, or dashed and without a name of the pinned one; zero has no place here."""
    shown = np.where(y > 0.0, y, np.nan)
    return Line(label if named else "", x, shown, colour, dash="solid" if named else "dashed")
