"""A run of the paper's closed loop beside another: errors, V and excitation over time."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from flexid.analysis.excitation import LOST_CONDITION, WEAK_CONDITION
from flexid.arrays import FloatArray
from flexid.report.charts.decimate import peaks
from flexid.report.charts.description import Axis, Chart, Colour, Level, Line, Mark, Panel

_COLOURS: tuple[Colour, ...] = ("blue", "orange", "green", "red", "ink", "grey")
SYMBOLS = {"theta1": "θ₁", "theta2": "θ₂", "alpha1": "α₁", "alpha2": "α₂"}
_STRETCHES = 150  # of which each shows the largest value of an error that oscillates


@dataclass(frozen=True, eq=False)
class Played:
    """What is shown of a run.

    Parameters
    ----------
    time : (n,) ndarray
        In s.
    tracking : (n,) ndarray
        Magnitude of the tracking error in rad.
    errors : mapping of str to (n,) ndarray
        Magnitude of each parameter error over the true value; nan where that is zero.
    final_errors : mapping of str to (float, str)
        What remains of each, with its unit: % of the true value, or where that is zero the
        coefficient's own.
    lyapunov : (n,) ndarray
        V of Huang (2003), eq. (8).
    moments : (m,) ndarray
        Times in s of the condition numbers.
    conditions : mapping of str to (m,) ndarray
        Condition number of each row's normalised Gram matrix.
    remaining_error : float
        Largest tracking error in the end, in rad.
    largest_torque : float
        In N m.
    """

    time: FloatArray
    tracking: FloatArray
    errors: Mapping[str, FloatArray]
    final_errors: Mapping[str, tuple[float, str]]
    lyapunov: FloatArray
    moments: FloatArray
    conditions: Mapping[str, FloatArray]
    remaining_error: float
    largest_torque: float


def play_chart(run: Played | None, pinned: Played | None) -> Chart:
    """Four panels: tracking error, parameter errors, V, excitation; a pinned run is dashed.

    Parameters
    ----------
    run, pinned : Played or None
        None where there is none, or it diverged.

    Returns
    -------
    Chart
    """
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
            errors.extend(_curves(played.time, played.errors, named=named))
            lyapunov.extend(_curves(played.time, {"V": played.lyapunov}, named=named))
            excitation.extend(_curves(played.moments, played.conditions, named=named))
    time = Axis("time", "s")
    return Chart(
        "play",
        "The paper's closed loop",
        "The tracking error shows what the controller can do, the parameter errors what the "
        "observer learns. V never rises while the drive is ideal, and where the condition number "
        "is large, two coefficients look alike. Dashed: the pinned run.",
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


def _curves(time: FloatArray, curves: Mapping[str, FloatArray], *, named: bool) -> Iterator[Line]:
    for (name, values), colour in zip(curves.items(), _COLOURS, strict=False):
        if np.isnan(values).all():
            continue
        x, y = _peaks(time, values)
        yield _line(SYMBOLS.get(name, name), x, y, colour, named=named)


def _line(label: str, x: FloatArray, y: FloatArray, colour: Colour, *, named: bool) -> Line:
    """A line of the run, or dashed and without a name of the pinned one; zero has no place here."""
    shown = np.where(y > 0.0, y, np.nan)
    return Line(label if named else "", x, shown, colour, dash="solid" if named else "dashed")
