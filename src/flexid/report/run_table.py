"""The printed answer of a simulation."""

from collections.abc import Iterator
from math import isfinite

from rich.text import Text

from flexid.experiments.experiment import Experiment
from flexid.experiments.measures import SETTLED, Measures
from flexid.experiments.run_columns import coefficient_unit, is_joint
from flexid.report.terminal import Column, Part, Table, number, numbers
from flexid.simulation.run import Run


def run_parts(experiment: Experiment, run: Run, measures: Measures) -> Iterator[Part]:
    """Tables and sentences of the answer."""
    length = f"{run.time[-1]:g} s {experiment.mode}"
    yield Text(f"{experiment.name}: {length}, {_statistics(run)}")
    yield estimates_table(experiment, run, measures)
    yield from map(Text, run_lines(run, measures))


def run_lines(run: Run, measures: Measures) -> Iterator[str]:
    """Tracking, inputs and excitation, a line each."""
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
    """Where the observer's estimates begin and end."""
    headings = ("true", "initial", "final", "error", f"within {100 * SETTLED:.0f} %")
    columns = (Column("coefficient"), *numbers(*headings), Column("unit"))
    table = Table("Estimates of the observer", columns)
    for place, (name, error) in enumerate(measures.final_errors.items()):
        true = experiment.loop.coefficients[name]
        table.add(
            name,
            number(true, 6),
            number(experiment.loop.initial_estimates.get(name, 0.0), 6),
            number(float(run.estimates[-1, place]), 6),
            number(100 * error / true, 3, "%") if true else number(error, 3),
            _settled(measures.settling_times[name]),
            coefficient_unit(run, name),
        )
    return table


def _settled(time: float) -> str:
    return f"from {time:.3g} s" if isfinite(time) else "never"


def _statistics(run: Run) -> str:
    return ", ".join(f"{count} {name.replace('_', ' ')}" for name, count in run.statistics.items())
