"""Charts of a simulated run: the motion, and what the observer makes of it."""

import numpy as np

from flexid.arrays import FloatArray
from flexid.experiments.measures import SETTLED
from flexid.experiments.run_columns import coefficient_unit, is_joint
from flexid.report.charts.description import Axis, Band, Chart, Colour, Level, Line, Panel
from flexid.simulation.run import Run

_COLOURS: tuple[Colour, ...] = ("blue", "orange", "green", "red", "grey")  # of the inputs
_USUAL = 0.99  # share of the samples that has to be seen
_BEYOND = 4.0  # times what is usual, from which on a few samples are left out of the frame


def run_charts(name: str, run: Run) -> tuple[Chart, Chart]:
    """The motion, and the estimates."""
    return motion_chart(name, run), observer_chart(name, run)


def motion_chart(name: str, run: Run) -> Chart:
    """Reference and tracked state, the error between them, and the inputs."""
    joint, tracked = is_joint(run), run.loop.controller.tracked
    label = "link position" if joint and tracked == "x1" else tracked
    unit = "rad" if joint else ""
    state = run.states[:, run.loop.system.states.index(tracked)]
    time = Axis("time", "s")
    motion = (
        Line("reference", run.time, run.reference[:, 0], "grey", 2.4),
        Line(label, run.time, state, "blue", 1.0),
    )
    error = (Line("tracking error", run.time, run.tracking_error, "orange"),)
    drive = tuple(
        Line("motor torque" if joint else symbol, run.time, run.inputs[:, i], _colour(i))
        for i, symbol in enumerate(run.loop.system.inputs)
    )
    kept, away = _frame(run.tracking_error)
    driven, beyond = _frame(run.inputs)
    panels = (
        Panel(f"Reference and {label}", time, Axis(label, unit), motion),
        Panel(f"Tracking error{away}", time, Axis("error", unit, limits=kept), error),
        Panel(
            f"{'Motor torque' if joint else 'Inputs'}{beyond}",
            time,
            Axis("torque" if joint else "inputs", "N m" if joint else "", limits=driven),
            drive,
        ),
    )
    half = 0.5 * float(run.time[-1])
    largest = run.largest_tracking_error(half, float(run.time[-1]))
    said = f"{largest:.3g} {unit}".rstrip()
    says = f"In the second half of the run the tracking error stays within {said}."
    return Chart("motion", name, says, panels)


def observer_chart(name: str, run: Run) -> Chart:
    """Every estimate over time, with the true value and the band in which it counts as settled."""
    panels = []
    for place, coefficient in enumerate(run.loop.system.coefficients):
        true = run.loop.coefficients[coefficient]
        band = SETTLED * abs(true)
        edges = np.full(2, true - band), np.full(2, true + band)
        marks = (
            Band(f"±{100 * SETTLED:g} %", run.time[[0, -1]], *edges, "blue"),
            Level("true", true, "y", "ink"),
            Line("observer", run.time, run.estimates[:, place], "orange"),
        )
        y = Axis("estimate", coefficient_unit(run, coefficient))
        panels.append(Panel(coefficient, Axis("time", "s"), y, marks))
    says = (
        f"At the end {_settled(run)} of {len(panels)} estimates are in the band of the true value."
    )
    return Chart("estimates", name, says, tuple(panels), columns=2 if len(panels) > 1 else 1)


def _settled(run: Run) -> int:
    """How many estimates end within the band of their true values."""
    true = run.loop.coefficients
    errors = run.final_errors()
    return sum(abs(error) <= SETTLED * abs(true[name]) for name, error in errors.items())


def _colour(place: int) -> Colour:
    return _COLOURS[place % len(_COLOURS)]


def _frame(values: FloatArray) -> tuple[tuple[float, float] | None, str]:
    """Limits in which a few samples do not hide all the rest, and what is said of them."""
    size = np.abs(values)
    largest, usual = float(size.max()), 1.3 * float(np.quantile(size, _USUAL))
    if 0.0 < _BEYOND * usual < largest:
        return (-usual, usual), f"; beyond the frame: up to {largest:.3g}"
    return None, ""
