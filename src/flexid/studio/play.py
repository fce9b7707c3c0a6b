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


_PANELS: tuple[tuple[str, str, str, tuple[Colour, ...]], ...] = (
    ("Tracking error", "magnitude", "rad", _OF_ROWS),
    ("Parameter errors over the true values", "magnitude", "", _OF_ERRORS),
    ("V of Theorem 1", "V", "", _OF_ROWS),
    ("Excitation over the last 2 s", "condition number", "", _OF_ROWS),
)
"""Title, label and unit of the axis, and colours of each panel."""

_LIMITS = (
    Level("weak above", WEAK_CONDITION, colour="orange", dash="dotted"),
    Level("lost above", LOST_CONDITION, colour="red", dash="dotted"),
)


@dataclass(frozen=True, eq=False)
class Played:
    """Curves and figures of a run."""

    # of each panel: times in s, (n,), and curves over them by name, (n,)
    curves: tuple[tuple[FloatArray, Mapping[str, FloatArray]], ...]
    figures: Mapping[str, str]  # by label, with units


def play_chart(run: Played | None, pinned: Played | None) -> Chart:
    """Draw tracking error, parameter errors, V and excitation; a pinned run is dashed."""
    panels = []
    for place, (title, label, unit, colours) in enumerate(_PANELS):
        marks: list[Mark] = [*_LIMITS] if label == "condition number" else []
        for played, named in ((pinned, False), (run, True)):
            if played is not None:
                marks += _curves(*played.curves[place], colours, named=named)
        panels.append(Panel(title, Axis("time", "s"), Axis(label, unit, True), tuple(marks)))
    return Chart(
        "play",
        "The paper's closed loop",
        "The tracking error shows the controller's performance, the parameter errors the "
        "observer's. V never rises while the drive is ideal. Where the condition number "
        "is large, the motion does not separate two coefficients. Dashed: the pinned run.",
        tuple(panels),
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

    rows: tuple[tuple[str, ...], ...]  # label, value of the run, value of the pinned run
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
    figure = fragment("figure.html", chart=play_chart(*runs))
    shown = [{} if run is None else run.figures for run in runs]
    labels = dict.fromkeys(label for figures in shown for label in figures)
    rows = ((label, *(figures.get(label, "") for figures in shown)) for label in labels)
    return PlayedRuns(tuple(rows), tuple(problems), figure, perf_counter() - begun)


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
    lyapunov = 0.5 * np.sum(fewer.parameter_errors**2, axis=1)
    moments, conditions = _conditions(
        fewer.time, {history.row: history.regressors for history in row_histories(fewer)}
    )
    figures = {"tracking error": f"{np.abs(run.tracking_error[steady]).max():.2g} rad"}
    for i, name in enumerate(names):
        unit = coefficient_unit(run, name)
        final = f"{100 * errors[-1, i]:.2g} %" if true[i] else f"{absolute[-1, i]:.2g} {unit}"
        figures[f"error of {SYMBOLS[name]}"] = final
    figures["V over its first value"] = f"{lyapunov[-1] / lyapunov[0]:.2g}"
    figures |= {f"condition number, {row}": f"{c[-1]:.3g}" for row, c in conditions.items()}
    figures["largest torque in all 30 s"] = f"{np.abs(run.inputs).max():.3g} N m"
    return Played(
        (
            (fewer.time, {"tracking error": np.abs(fewer.tracking_error)}),
            (fewer.time, dict(zip(names, errors.T, strict=True))),
            (fewer.time, {"V": lyapunov}),
            (moments, conditions),
        ),
        figures,
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
