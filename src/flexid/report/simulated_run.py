"""A simulated run as tables, JSON, figures and time series."""

from collections.abc import Iterator
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

import flexid
from flexid.arrays import FloatArray
from flexid.experiments.experiment import Experiment
from flexid.experiments.measures import (
    SETTLED,
    Measures,
    coefficient_unit,
    is_joint,
    log_columns,
    run_columns,
)
from flexid.recording.frame import write_parquet
from flexid.report.chart import Axis, Band, Chart, Colour, Level, Line, Panel
from flexid.report.terminal import UNIT, Part, Table, number, numbers
from flexid.simulation.closed_loop import Run


def parts(experiment: Experiment, run: Run, measures: Measures) -> Iterator[Part]:
    """Return tables and sentences of the result."""
    length = f"{run.time[-1]:g} s {experiment.mode}"
    spent = (f"{count} {name.replace('_', ' ')}" for name, count in run.statistics.items())
    yield f"{experiment.name}: {length}, {', '.join(spent)}"
    yield estimates_table(experiment, run, measures)
    angle = " rad" if is_joint(run) else ""
    yield (
        f"Tracking error: {measures.tracking_rms:.4g}{angle} root mean square, "
        f"{measures.tracking_peak:.4g}{angle} at most"
    )
    if is_joint(run):
        yield f"Motor torque: {max(measures.peak_inputs.values()):.4g} N m at most"
    else:
        peaks = ", ".join(f"{name} {peak:.4g}" for name, peak in measures.peak_inputs.items())
        yield f"Inputs: {peaks} at most"
    for row, excitation in measures.excitation.items():
        yield f"Excitation, {row} row: condition number {excitation.condition_number:.3g}"


def estimates_table(experiment: Experiment, run: Run, measures: Measures) -> Table:
    """Return initial and final estimates of the observer, with their errors."""
    headings = ("true", "initial", "final", "error", f"within {100 * SETTLED:.0f} %")
    table = Table("Estimates of the observer", ("coefficient", *numbers(*headings), UNIT))
    for place, (name, error) in enumerate(measures.final_errors.items()):
        true, settled = experiment.loop.coefficients[name], measures.settling_times[name]
        table.add(
            name,
            number(true, 6),
            number(experiment.loop.initial_estimates.get(name, 0.0), 6),
            number(float(run.estimates[-1, place]), 6),
            number(100 * error / true, 3, "%") if true else number(error, 3),
            f"from {settled:.3g} s" if isfinite(settled) else "never",
            coefficient_unit(run, name),
        )
    return table


_COLOURS: tuple[Colour, ...] = ("blue", "orange", "green", "red", "grey")  # of the inputs
_USUAL = 0.99  # share of the samples that a panel always shows
_BEYOND = 4.0  # ratio of peak to usual size from which the panel cuts off the peak


def charts(experiment: Experiment, run: Run, _measures: Measures) -> tuple[Chart, Chart]:
    """Return the charts of the motion and of the estimates."""
    return motion_chart(experiment.name, run), observer_chart(experiment.name, run)


def motion_chart(name: str, run: Run) -> Chart:
    """Return reference and tracked state, the tracking error, and the inputs."""
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
        Line(
            "motor torque" if joint else symbol,
            run.time,
            run.inputs[:, i],
            _COLOURS[i % len(_COLOURS)],
        )
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
    says = "A few extreme samples may be cut off; the title of the panel then gives the peak."
    return Chart("motion", f"{name}: motion", says, panels)


def observer_chart(name: str, run: Run) -> Chart:
    """Return every estimate over time, with the true value and the band of settling."""
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
    says = "An estimate has settled once it stays within the band around the true value."
    columns = 2 if len(panels) > 1 else 1
    return Chart("estimates", f"{name}: estimates", says, tuple(panels), columns)


def _frame(values: FloatArray) -> tuple[tuple[float, float] | None, str]:
    """Return limits that cut off a few extreme samples, and a note for the title."""
    size = np.abs(values)
    largest, usual = float(size.max()), 1.3 * float(np.quantile(size, _USUAL))
    if 0.0 < _BEYOND * usual < largest:
        return (-usual, usual), f"; cut off: up to {largest:.3g}"
    return None, ""


def write_data(
    _experiment: Experiment, run: Run, _measures: Measures, directory: Path, csv: bool
) -> None:
    """Write run.parquet and log.parquet, and if requested the same series as CSV."""
    for name, columns in {"run": run_columns(run), "log": log_columns(run)}.items():
        table = pl.DataFrame(columns)
        write_parquet(table, directory / f"{name}.parquet")
        if csv:
            table.write_csv(directory / f"{name}.csv")


def heading(experiment: Experiment, run: Run, _measures: Measures) -> tuple[str, str]:
    """Return the name of the experiment, and the duration."""
    return experiment.name, f"{run.time[-1]:g} s, {experiment.mode}"


def document(experiment: Experiment, run: Run, measures: Measures) -> dict[str, Any]:
    """Return the figures of the run, for JSON."""
    true = experiment.loop.coefficients
    return {
        "name": experiment.name,
        "status": "finished",
        "reached": float(run.time[-1]),
        "coefficients": {
            name: {
                "true": true[name],
                "initial": experiment.loop.initial_estimates.get(name, 0.0),
                "final": float(run.estimates[-1, place]),
                "final_error": measures.final_errors[name],
                "settling_time": measures.settling_times[name],
            }
            for place, name in enumerate(experiment.loop.system.coefficients)
        },
        "final_states": measures.final_states,
        "tracking_rms": measures.tracking_rms,
        "tracking_peak": measures.tracking_peak,
        "peak_inputs": measures.peak_inputs,
        "excitation": {row: e.document for row, e in measures.excitation.items()},
        "statistics": run.statistics,
        "provenance": {
            "flexid_version": flexid.__version__,
            "experiment": experiment.path,
            "experiment_digest": experiment.digest,
            "mode": experiment.mode,
            "settings": experiment.settings.model_dump(),
            "tables": experiment.tables.model_dump(),
        },
    }
