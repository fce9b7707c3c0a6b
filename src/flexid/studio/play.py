"""Room for experiments with the paper's closed loop: sliders, and a pinned run to compare."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import FlexidError, SimulationError
from flexid.estimators.excitation import LOST_CONDITION, WEAK_CONDITION
from flexid.report.chart import Axis, Chart, Colour, Level, Line, Mark, Panel, peaks
from flexid.report.reproduction import SYMBOLS
from flexid.studies.runs import DURATION
from flexid.studio.choices import READINGS, SLIDERS, TABLE1, PlayChoices, Slider, read_play

if TYPE_CHECKING:
    from flexid.simulation.closed_loop import Run
    from flexid.studio.window import Window


_LAST = 5.0  # s at the end, in which the remaining tracking error is measured
_WINDOW = 2.0  # s over which excitation is measured
_POINTS = 120  # at which the excitation is drawn
_SAMPLES = 3001  # drawn in a figure
_RELATIVE, _ABSOLUTE = 1e-5, 1e-9  # tolerances, tight enough for errors that vanish
_MOST_STEPS = 400_000  # of the integrator: about half a second of computing


_OF_ERRORS: tuple[Colour, ...] = ("blue", "orange", "green", "red")
_OF_ROWS: tuple[Colour, ...] = ("ink", "grey")  # distinct, as one legend has both
_PEAKS = 150  # parts of a curve, each drawn by its largest value, as errors oscillate


@dataclass(frozen=True, eq=False)
class Played:
    """Curves and figures of a run."""

    time: FloatArray  # (n,), in s
    tracking: FloatArray  # (n,), magnitude of the tracking error in rad
    errors: Mapping[str, FloatArray]  # (n,), over the true value
    final_errors: Mapping[str, tuple[float, str]]  # with units
    lyapunov: FloatArray  # (n,), V of Theorem 1
    moments: FloatArray  # (m,), times in s of the condition numbers
    conditions: Mapping[str, FloatArray]  # (m,), by row
    remaining_error: float  # largest tracking error in the last 5 s, in rad
    largest_torque: float  # in N m


def play_chart(run: Played | None, pinned: Played | None) -> Chart:
    """Draw tracking error, parameter errors, V and excitation; a pinned run is dashed."""
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
        "The tracking error shows the controller's performance, the parameter errors the "
        "observer's. V never rises while the drive is ideal. Where the condition number "
        "is large, the motion does not separate two coefficients. Dashed: the pinned run.",
        tuple(
            Panel(title, Axis("time", "s"), Axis(label, unit, True), tuple(marks))
            for title, label, unit, marks in panels
        ),
        columns=2,
    )


def _curves(
    time: FloatArray, curves: Mapping[str, FloatArray], colours: tuple[Colour, ...], *, named: bool
) -> Iterator[Line]:
    """Yield a run's peaks as lines, dashed if unnamed; a logarithmic axis leaves out zeros."""
    for (name, values), colour in zip(curves.items(), colours, strict=False):
        if not np.isnan(values).all():
            x, y = peaks(time, values, max(1, len(time) // _PEAKS))
            label, dash = (SYMBOLS.get(name, name), "solid") if named else ("", "dashed")
            yield Line(label, x, np.where(y > 0.0, y, np.nan), colour, dash=dash)


@dataclass(frozen=True)
class PlayedRuns:
    """Results of a run and of the pinned run."""

    rows: tuple[tuple[str, str, str], ...]  # label, value of the run, value of the pinned run
    problems: tuple[str, ...]  # why a run has no values
    figure: str  # chart of both runs, as HTML
    seconds: float  # computing time in s


def play(chosen: PlayChoices, pinned: PlayChoices | None) -> PlayedRuns:
    """Simulate a loop and a pinned one, and return their results."""
    from flexid.studio.window import fragment

    begun = perf_counter()
    runs: list[Played | None] = []
    problems = []
    for choices, which in ((chosen, "This run"), (pinned, "The pinned run")):
        try:
            runs.append(None if choices is None else _cached_run(choices))
        except SimulationError as error:
            runs.append(None)
            why = error.reason.partition(":")[0]  # without its advice, which does not apply here
            problems.append(f"{which} stops at {error.time:.3g} s: {why}. Move a slider back.")
    run, pin = runs
    figure = fragment("figure.html", chart=play_chart(run, pin))
    return PlayedRuns(_rows(run, pin), tuple(problems), figure, perf_counter() - begun)


@lru_cache(maxsize=32)
def _cached_run(choices: PlayChoices) -> Played:
    """Simulate a run; the latest runs are cached."""
    sampling = choices.sampling
    if sampling is None:
        from flexid.simulation.closed_loop import simulate

        step = DURATION / (_SAMPLES - 1)
        run = simulate(choices.loop, DURATION, step, _RELATIVE, _ABSOLUTE, _MOST_STEPS)
    else:
        from flexid.simulation.sampled import simulate_sampled

        run = simulate_sampled(choices.loop, DURATION, sampling)
    return _measured(run)


def _measured(run: Run) -> Played:
    """Return the curves and figures of a run."""
    from flexid.experiments.measures import coefficient_unit
    from flexid.simulation.lyapunov import row_histories

    steady = run.between(DURATION - _LAST, DURATION)
    series = ("time", "states", "inputs", "estimates", "parameter_errors", "tracking_error")
    step = max(1, len(run.time) // _SAMPLES)  # enough for the page
    thinned: dict[str, Any] = {name: getattr(run, name)[::step] for name in series}
    fewer = replace(run, **thinned, measured=None)
    true = run.loop.true_coefficients
    names = run.loop.system.coefficients
    absolute = np.abs(fewer.parameter_errors)
    errors = absolute / np.where(true, np.abs(true), np.nan)
    final = {
        name: (100 * errors[-1, i], "%")
        if true[i]
        else (absolute[-1, i], coefficient_unit(run, name))
        for i, name in enumerate(names)
    }
    moments, conditions = _conditions(
        fewer.time, {history.row: history.regressors for history in row_histories(fewer)}
    )
    return Played(
        fewer.time,
        np.abs(fewer.tracking_error),
        dict(zip(names, errors.T, strict=True)),
        final,
        0.5 * np.sum(fewer.parameter_errors**2, axis=1),
        moments,
        conditions,
        float(np.abs(run.tracking_error[steady]).max()),
        float(np.abs(run.inputs).max()),
    )


def _conditions(
    time: FloatArray, regressors: Mapping[str, FloatArray]
) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Return the condition number of each row's normalised Gram matrix in a sliding window."""
    width = int(_WINDOW / (time[1] - time[0]))
    ends = np.unique(np.linspace(width, len(time) - 1, _POINTS).astype(int))
    found = {}
    for row, r in regressors.items():
        products = np.einsum("ij,ik->ijk", r, r)
        sums = np.concatenate([np.zeros((1, *products.shape[1:])), np.cumsum(products, axis=0)])
        gram = sums[ends + 1] - sums[ends + 1 - width]
        scale = np.sqrt(np.einsum("ijj->ij", gram))
        scale[scale == 0.0] = 1.0
        values = np.linalg.eigvalsh(gram / (scale[:, :, None] * scale[:, None, :]))
        found[row] = values[:, -1] / np.maximum(values[:, 0], np.finfo(float).tiny)
    return time[ends], found


def _rows(run: Played | None, pin: Played | None) -> tuple[tuple[str, str, str], ...]:
    """Return the table of both runs as texts: label, run, pinned run."""

    def row(label: str, text: Any) -> tuple[str, str, str]:
        return label, "" if run is None else text(run), "" if pin is None else text(pin)

    names = run.errors if run is not None else () if pin is None else pin.errors
    return (
        row("tracking error", lambda r: f"{r.remaining_error:.2g} rad"),
        *(
            row(
                f"error of {SYMBOLS[name]}",
                lambda r, n=name: "{:.2g} {}".format(*r.final_errors[n]),
            )
            for name in names
        ),
        row("V over its first value", lambda r: f"{r.lyapunov[-1] / r.lyapunov[0]:.2g}"),
        *(
            row(f"condition number, {name}", lambda r, n=name: f"{r.conditions[n][-1]:.3g}")
            for name in ("link", "motor")
        ),
        row("largest torque in all 30 s", lambda r: f"{r.largest_torque:.3g} N m"),
    )


ROOM = "play"


class PlayRoom:
    """Play room of one window; its page stores the choices and the pinned run."""

    def __init__(self, window: Window) -> None:
        self._window = window
        self._values: object = {}  # latest values from the page
        self._is_open = False

    def open(self, values: Mapping[str, object]) -> None:
        """Start with the values in an address."""
        self._values = values

    async def enter(self) -> None:
        """Show the room, with its controls the first time."""
        begins, self._is_open = not self._is_open, True
        await self._start(with_controls=begins)

    async def on_play(self, values: object, _target: object) -> None:
        """Simulate with the sliders' values, and the pinned run."""
        self._values = values
        await self._start()

    async def on_reset(self, _values: object, _target: object) -> None:
        """Reset all values to Table I."""
        self._values = {}
        await self._start(with_controls=True)

    async def _start(self, *, with_controls: bool = False) -> None:
        window, values, refused = self._window, self._values, ""
        try:
            chosen = read_play(values)
            alone = isinstance(values, Mapping) and values.get("pin") == "none"
            pinned = None if alone else read_play(values, "pin.")
        except FlexidError as error:
            refused = str(error)
            if not with_controls:
                await window.show("play-problem", "problem.html", text=refused)
                await window.tell("played")
                return
            chosen = pinned = TABLE1  # the address is invalid
        if with_controls:
            groups: dict[str, list[Slider]] = {}
            for slider in SLIDERS:
                groups.setdefault(slider.group, []).append(slider)
            shown = {"chosen": chosen, "readings": READINGS, "groups": groups}
            await window.show("play-readings", "play_readings.html", **shown)
            await window.show("play-controls", "play_controls.html", **shown)
        window.start("play", self._play(chosen, pinned, refused), "play-problem")

    async def _play(self, chosen: PlayChoices, pinned: PlayChoices | None, refused: str) -> None:
        window = self._window
        try:
            found: PlayedRuns = await window.brief(window.offer.play, play, chosen, pinned)
            problems = (refused, *found.problems) if refused else found.problems
            await window.show("play-problem", "play_problems.html", problems=problems)
            await window.show("play-figures", "play_figures.html", found=found)
            await window.show("play-charts", "drawn.html", figure=found.figure)
        except Exception:
            await window.tell("played")  # the page waits for this before its next request
            raise
        await window.tell("played")
