"""A run of the paper's closed loop for the page: numbers and figures, in a moment."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

from flexid.errors import SimulationError
from flexid.report.reproduction_charts import SYMBOLS, Played, play_chart

if TYPE_CHECKING:
    from collections.abc import Mapping

    from flexid.arrays import FloatArray
    from flexid.identification.vocabulary.progress import Progress
    from flexid.report.charts.svg import Drawn
    from flexid.simulation.run import Run
    from flexid.studio.play_choices import PlayChoices

DURATION = 30.0  # s, as in the paper
_LAST = 5.0  # s over which errors count as those that remain
_WINDOW = 2.0  # s over which excitation is measured
_POINTS = 120  # of the excitation over time
_SAMPLES = 3001  # of a figure
_RELATIVE, _ABSOLUTE = 1e-5, 1e-9  # tolerances: the errors that vanish keep their digits
_MOST_STEPS = 400_000  # about half a second


@dataclass(frozen=True)
class PlayedRuns:
    """A run and a pinned one."""

    rows: tuple[tuple[str, str, str], ...]  # what is measured, of the run and of the pinned one
    problems: tuple[str, ...]  # why a run has no figures
    figure: Drawn  # both
    seconds: float  # how long it took


def play(
    _: Progress, chosen: PlayChoices, pinned: PlayChoices | None, window: str = "wide"
) -> PlayedRuns:
    """Simulate a loop, and say what came of it beside a pinned one."""
    from flexid.report.charts.svg import drawn

    begun = perf_counter()
    runs: list[Played | None] = []
    problems = []
    for choices, which in ((chosen, "This run"), (pinned, "The pinned run")):
        try:
            runs.append(None if choices is None else _played(choices))
        except SimulationError as error:
            runs.append(None)
            why = error.reason.partition(":")[0]  # what it advises is not to be had here
            problems.append(f"{which} stops at {error.time:.3g} s: {why}. Move a slider back.")
    run, pin = runs
    figure = drawn(play_chart(run, pin), (window,))
    return PlayedRuns(_rows(run, pin), tuple(problems), figure, perf_counter() - begun)


def _played(choices: PlayChoices) -> Played:
    """A run, from what was played before if it was."""
    pairs = tuple(sorted(choices.pairs.items()))
    return _remembered(pairs)


@lru_cache(maxsize=32)
def _remembered(pairs: tuple[tuple[str, str], ...]) -> Played:
    from flexid.studio.play_choices import read_play

    choices = read_play(dict(pairs))
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
    """What is shown of a run."""
    from flexid.analysis.histories import row_histories
    from flexid.experiments.measures import coefficient_unit

    steady = run.between(DURATION - _LAST, DURATION)
    fewer = _every(run, max(1, len(run.time) // _SAMPLES))
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


def _every(run: Run, step: int) -> Run:
    """Every so many samples of a run, of which the page shows no more."""
    return replace(
        run,
        time=run.time[::step],
        states=run.states[::step],
        inputs=run.inputs[::step],
        estimates=run.estimates[::step],
        parameter_errors=run.parameter_errors[::step],
        tracking_error=run.tracking_error[::step],
        measured=None,
    )


def _conditions(
    time: FloatArray, regressors: Mapping[str, FloatArray]
) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Condition number of each row's normalised Gram matrix over the last seconds, over time."""
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
    """What is measured, as texts."""

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
