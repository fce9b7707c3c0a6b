"""Some runs of a campaign, from their values to their rows; the same on any machine and thread."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import polars as pl

from flexid.arrays import FloatArray
from flexid.errors import FlexidError
from flexid.experiments import Experiment
from flexid.experiments.measures import run_columns
from flexid.models.parametric_system import ParametricSystem
from flexid.simulation.closed_loop import SIDE_BY_SIDE, loop_kernel
from flexid.simulation.ensemble import STATUS as STATUS_NAMES
from flexid.simulation.ensemble import (
    Ensemble,
    simulate_ensemble,
    simulate_sampled_ensemble,
)
from flexid.simulation.sampled import sampled_kernel

STATUS, ERROR, REACHED, STEPS = "status", "error", "reached", "steps"
"""Columns that every row has: what became of the run, why, its end in s, steps or samples."""

FINISHED = STATUS_NAMES[0]
FAILED = "error"
"""Status of a run that could not be made at all; its text says why."""

_AT_ONCE = 16  # runs between two looks at whether to stop
_SIDE_BY_SIDE_AT_ONCE = 4 * SIDE_BY_SIDE  # the same of those that are quicker together
_LONGEST_TEXT = 500


class Stopped(Exception):  # noqa: N818 - no error: it was asked for
    """The runs were asked to stop before their end."""


class Part(NamedTuple):
    """Some runs: what any worker, a thread or a machine, is given."""

    number: int
    table: pl.DataFrame  # number and values of each run, from the plan
    keep: tuple[str, ...]  # which results to keep


class PartResult(NamedTuple):
    """What came of a part."""

    number: int
    rows: pl.DataFrame  # one for each run
    series: pl.DataFrame | None  # time series of the finished runs, where these are kept


def run_part(
    experiment: Experiment, part: Part, stopped: Callable[[], bool] = lambda: False
) -> PartResult:
    """Run a part; `stopped` is asked every few runs, and ends it with `Stopped`."""
    declaration = experiment.loop.declaration  # of no run, if its kernel cannot be made
    if experiment.sampling is None:
        loop_kernel(declaration, experiment.settings.stiff)
    else:
        sampled_kernel(declaration)
    rows = part_rows(experiment, part.table, part.keep, stopped)
    if "time_series" not in part.keep:
        return PartResult(part.number, rows, None)
    tables = [*_series(experiment, rows, stopped)]
    nothing = pl.DataFrame(schema={"run": pl.Int64})
    return PartResult(part.number, rows, pl.concat(tables) if tables else nothing)


def _series(
    experiment: Experiment, rows: pl.DataFrame, stopped: Callable[[], bool]
) -> Iterator[pl.DataFrame]:
    """Time series of each finished run, with its number.

    The runs are made once more: measures are taken at the integrator's own steps, series at the
    samples.
    """
    inputs = rows.columns[1 : rows.columns.index(STATUS)]
    for values in rows.filter(pl.col(STATUS) == FINISHED).select("run", *inputs).to_dicts():
        if stopped():
            raise Stopped
        number = values.pop("run")
        try:
            run = experiment.with_values(values).run()
        except Exception:  # too long for the memory: its row is there, and others follow
            continue
        columns = pl.DataFrame(run_columns(run))
        yield columns.select(pl.lit(number, pl.Int64).alias("run"), pl.all())


def part_rows(
    experiment: Experiment,
    table: pl.DataFrame,
    keep: Sequence[str],
    stopped: Callable[[], bool] = lambda: False,
) -> pl.DataFrame:
    """A row for each run of a part."""
    status = [FAILED] * len(table)
    errors: list[str | None] = [None] * len(table)
    names = result_names(experiment.loop.system, keep)
    results = np.full((len(table), len(names)), np.nan)
    varied = _varied(experiment, table, errors)
    for places in _batches(varied):
        if stopped():
            raise Stopped
        for done, ensemble in _ensembles(varied, places, errors):
            results[done] = _results([varied[place] for place in done], ensemble, keep)
            for place, number in zip(done, ensemble.status, strict=True):
                status[place] = STATUS_NAMES[number]
    columns = [pl.Series(STATUS, status, pl.String), pl.Series(ERROR, errors, pl.String)]
    for name, values in zip(names, results.T, strict=True):
        if name == STEPS:  # none of a run that could not be made
            values = np.nan_to_num(values).astype(np.int64)
        columns.append(pl.Series(name, values))
    return table.hstack(columns)


def _varied(
    experiment: Experiment, table: pl.DataFrame, errors: list[str | None]
) -> dict[int, Experiment]:
    """The experiment of each row; without those whose values are not allowed."""
    varied = {}
    for place, values in enumerate(table.iter_rows(named=True)):
        del values["run"]
        try:
            varied[place] = experiment.with_values(values)
        except FlexidError as error:
            errors[place] = _text(error)
    return varied


def _batches(varied: Mapping[int, Experiment]) -> Iterator[list[int]]:
    """Few runs at a time, all of the same length and tolerance."""
    alike: dict[Any, list[int]] = {}
    for place, experiment in varied.items():
        alike.setdefault(experiment.settings, []).append(place)
    for places in alike.values():
        size = _SIDE_BY_SIDE_AT_ONCE if varied[places[0]].side_by_side else _AT_ONCE
        yield from (places[i : i + size] for i in range(0, len(places), size))


def _ensembles(
    varied: Mapping[int, Experiment], places: list[int], errors: list[str | None]
) -> Iterator[tuple[list[int], Ensemble]]:
    """The runs of a batch together; if that fails, each by itself, to find the one at fault."""
    try:
        yield places, _ensemble([varied[place] for place in places])
    except Exception as error:  # of any kind: the other runs must not be lost
        if len(places) == 1:
            errors[places[0]] = _text(error)
            return
        for place in places:
            yield from _ensembles(varied, [place], errors)


def _ensemble(runs: Sequence[Experiment]) -> Ensemble:
    loops, settings = [run.loop for run in runs], runs[0].settings
    if runs[0].sampling is not None:
        samplings = [run.sampling for run in runs if run.sampling is not None]
        return simulate_sampled_ensemble(loops, settings.duration, samplings)
    return simulate_ensemble(loops, **settings.model_dump())


def _text(error: Exception) -> str:
    name = "" if isinstance(error, FlexidError) else f"{type(error).__name__}: "
    return " ".join(f"{name}{error}".split())[:_LONGEST_TEXT]


def result_names(system: ParametricSystem, keep: Sequence[str]) -> list[str]:
    """Names of the columns with results, in their order."""
    return [REACHED, STEPS] + [
        f"{prefix}.{name}" if name else prefix
        for prefix, names in _blocks(system, keep).items()
        for name in names
    ]


def result_schema(system: ParametricSystem, keep: Sequence[str]) -> dict[str, pl.DataType]:
    """Columns that `part_rows` adds to the plan's, in their order."""
    of_all: dict[str, pl.DataType] = {STATUS: pl.String(), ERROR: pl.String()}
    numbers = {name: pl.Float64() for name in result_names(system, keep)}
    return of_all | numbers | {STEPS: pl.Int64()}


def _blocks(system: ParametricSystem, keep: Sequence[str]) -> dict[str, Sequence[str]]:
    """What each kept result is called, and of what there is one value each."""
    coefficients, alone = system.coefficients, ("",)
    blocks: dict[str, dict[str, Sequence[str]]] = {
        "final_errors": {"final_error": coefficients, "relative_error": coefficients},
        "final_states": {"final_state": system.states},
        "settling_time": {"settling_time": coefficients},
        "tracking": {"tracking_rms": alone, "tracking_peak": alone},
        "excitation": {"excitation": [row.name for row in system.rows]},
        "peak_input": {"peak_input": system.inputs},
    }
    kept = (block for name, block in blocks.items() if name in keep)
    return {prefix: names for block in kept for prefix, names in block.items()}


def _results(runs: Sequence[Experiment], ensemble: Ensemble, keep: Sequence[str]) -> FloatArray:
    """Results of some runs, one row each, in the order of `result_names`."""
    truth = np.abs([run.loop.true_coefficients for run in runs])
    with np.errstate(all="ignore"):  # a coefficient of 0 has no relative error
        relative = np.abs(ensemble.final_errors) / truth
    values = vars(ensemble) | {
        "final_error": ensemble.final_errors,
        "relative_error": relative,
        "final_state": ensemble.final_states,
    }
    kept = [values[prefix] for prefix in _blocks(ensemble.system, keep)]
    return np.column_stack([ensemble.reached, ensemble.steps.astype(np.float64), *kept])
