"""Rows of some runs of a campaign, equal on any machine and thread."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import polars as pl

from flexid.arrays import FloatArray
from flexid.errors import FlexidError
from flexid.experiments.experiment import Experiment
from flexid.models.parametric_system import ParametricSystem
from flexid.simulation.closed_loop import SIDE_BY_SIDE, loop_kernel
from flexid.simulation.ensemble import STATUS as STATUS_NAMES
from flexid.simulation.ensemble import Ensemble, simulate_ensemble, simulate_sampled_ensemble
from flexid.simulation.sampled import sampled_kernel

STATUS, ERROR, REACHED, STEPS = "status", "error", "reached", "steps"
"""Columns of every row: outcome, reason, end time in s, and number of steps or samples."""

FINISHED = STATUS_NAMES[0]
FAILED = "error"  # status of a run that raised an error, with its text as reason

_AT_ONCE = 16  # runs between two checks whether to stop
_SIDE_BY_SIDE_AT_ONCE = 4 * SIDE_BY_SIDE  # likewise for vectorised runs
_LONGEST_TEXT = 500


class Stopped(Exception):  # noqa: N818 - requested, not an error
    """Raised when runs end early because a stop was requested."""


def part_rows(
    experiment: Experiment,
    table: pl.DataFrame,  # number and values of each run, from the plan
    stopped: Callable[[], bool] = lambda: False,
) -> pl.DataFrame:
    """Return a row for each run of a part; raise `Stopped` if `stopped` returns true."""
    declaration = experiment.loop.declaration  # if compiling fails, it fails for all runs
    if experiment.sampling is None:
        loop_kernel(declaration, experiment.settings.stiff)
    else:
        sampled_kernel(declaration)
    status = [FAILED] * len(table)
    errors: list[str | None] = [None] * len(table)
    names = result_names(experiment.loop.system)
    results = np.full((len(table), len(names)), np.nan)
    varied = _varied(experiment, table, errors)
    for places in _batches(varied):
        if stopped():
            raise Stopped
        for done, ensemble in _ensembles(varied, places, errors):
            results[done] = _results([varied[place] for place in done], ensemble)
            for place, number in zip(done, ensemble.status, strict=True):
                status[place] = STATUS_NAMES[number]
    columns = [pl.Series(STATUS, status, pl.String), pl.Series(ERROR, errors, pl.String)]
    for name, values in zip(names, results.T, strict=True):
        if name == STEPS:  # NaN for a run that raised an error
            values = np.nan_to_num(values).astype(np.int64)
        columns.append(pl.Series(name, values))
    return table.hstack(columns)


def _varied(
    experiment: Experiment, table: pl.DataFrame, errors: list[str | None]
) -> dict[int, Experiment]:
    """Return the experiment of each row; rows with invalid values get an error instead."""
    varied = {}
    for place, values in enumerate(table.iter_rows(named=True)):
        del values["run"]
        try:
            varied[place] = experiment.with_values(values)
        except FlexidError as error:
            errors[place] = _reason(error)
    return varied


def _batches(varied: Mapping[int, Experiment]) -> Iterator[list[int]]:
    """Yield batches of a few runs that have the same duration and tolerance."""
    alike: dict[Any, list[int]] = {}
    for place, experiment in varied.items():
        alike.setdefault(experiment.settings, []).append(place)
    for places in alike.values():
        size = _SIDE_BY_SIDE_AT_ONCE if varied[places[0]].side_by_side else _AT_ONCE
        yield from (places[i : i + size] for i in range(0, len(places), size))


def _ensembles(
    varied: Mapping[int, Experiment], places: list[int], errors: list[str | None]
) -> Iterator[tuple[list[int], Ensemble]]:
    """Run a batch together; if that raises, run each alone, to find the failing one."""
    try:
        yield places, _ensemble([varied[place] for place in places])
    except Exception as error:  # any error: the other runs must not be lost
        if len(places) == 1:
            errors[places[0]] = _reason(error)
            return
        for place in places:
            yield from _ensembles(varied, [place], errors)


def _ensemble(runs: Sequence[Experiment]) -> Ensemble:
    loops, settings = [run.loop for run in runs], runs[0].settings
    if runs[0].sampling is not None:
        samplings = [run.sampling for run in runs if run.sampling is not None]
        return simulate_sampled_ensemble(loops, settings.duration, samplings)
    return simulate_ensemble(loops, **settings.model_dump())


def _reason(error: Exception) -> str:
    name = "" if isinstance(error, FlexidError) else f"{type(error).__name__}: "
    return " ".join(f"{name}{error}".split())[:_LONGEST_TEXT]


def result_names(system: ParametricSystem) -> list[str]:
    """Return the names of the result columns, in order."""
    return [REACHED, STEPS] + [
        f"{prefix}.{name}" if name else prefix
        for prefix, names in _blocks(system).items()
        for name in names
    ]


def _blocks(system: ParametricSystem) -> dict[str, Sequence[str]]:
    """Return for each kind of result the names that it has one column for."""
    coefficients, alone = system.coefficients, ("",)
    return {
        "final_error": coefficients,
        "relative_error": coefficients,
        "final_state": system.states,
        "settling_time": coefficients,
        "tracking_rms": alone,
        "tracking_peak": alone,
        "excitation": [row.name for row in system.rows],
        "peak_input": system.inputs,
    }


def _results(runs: Sequence[Experiment], ensemble: Ensemble) -> FloatArray:
    """Return the results, one row per run, with columns as in `result_names`."""
    truth = np.abs([run.loop.true_coefficients for run in runs])
    with np.errstate(all="ignore"):  # a coefficient of 0 has no relative error
        relative = np.abs(ensemble.final_errors) / truth
    values = vars(ensemble) | {
        "final_error": ensemble.final_errors,
        "relative_error": relative,
        "final_state": ensemble.final_states,
    }
    found = [values[prefix] for prefix in _blocks(ensemble.system)]
    return np.column_stack([ensemble.reached, ensemble.steps.astype(np.float64), *found])
