"""A design as tables, JSON, a figure, and the file that a drive can play."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from flexid.experiment_design.design import Design
from flexid.experiment_design.drive import DOUBT
from flexid.report.chart import Axis, Chart, Colour, Level, Line, Mark, Panel, Points, whole_decades
from flexid.report.page import Presenter
from flexid.report.terminal import Column, Part, Table, number, numbers

_UNITS = {"torque": "N m", "velocity": "rad/s", "position": "rad", "deflection": "rad"}


def parts(result: Design) -> Iterator[Part]:
    """Tables and sentences of the answer."""
    yield _predictions(result)
    yield _limits(result)
    wanted = result.drive.experiment
    broken = [p.name for p in result.references if not p.within_limits]
    if broken:
        yield f"Beyond the limits at this torque: {', '.join(broken)}."
    tones = ", ".join(f"{rate:.3g}" for rate in result.angular_frequencies)
    what = "torque" if wanted.kind == "multisine" else "motor position"
    yield f"Tones of the {what}: {tones} rad/s; {wanted.duration:g} s; seed {result.seed}."
    yield (
        f"The input was scaled by {result.scale:.3g}, so that every drive whose parameters are off "
        f"by {100 * DOUBT:.0f} % keeps to the limits."
    )


def _predictions(result: Design) -> Table:
    inputs = (result.prediction, *result.references)
    worst = Column(f"±{100 * DOUBT:.0f} %, worst drive")
    columns = (Column("coefficient"), *numbers(*(one.name for one in inputs)), worst)
    wanted = result.drive.experiment
    how = f"{wanted.criterion}-optimal {wanted.kind}"
    title = f"Predicted standard deviations, {how}, equal peak torque"
    table = Table(title, columns)
    for name in result.prediction.deviations:
        extreme = result.largest_deviations[name]
        table.add(
            name,
            *(_percent(one.deviations[name]) for one in inputs),
            f"{100 * extreme.value:.3g} % ({extreme.case})",
        )
    table.add("worst", *(_percent(one.worst) for one in inputs))
    table.add("criterion E", *(_percent(one.e_deviation) for one in inputs))
    table.add("criterion D", *(_percent(one.d_deviation) for one in inputs))
    table.add("torque, peak", *(number(one.peaks["torque"], 3, "N m") for one in inputs))
    table.add("torque, rms", *(number(one.torque_rms, 3, "N m") for one in inputs))
    within = (result.prediction, *result.kept_references)
    table.add("within limits", *(_percent(one.worst) for one in within))
    return table


def _limits(result: Design) -> Table:
    share = Column(f"±{100 * DOUBT:.0f} %, worst drive")
    table = Table("Limits", (Column("channel"), *numbers("limit", "peak"), share))
    for channel, unit in _UNITS.items():
        extreme = result.largest_use[channel]
        table.add(
            channel,
            number(getattr(result.drive.limits, channel), 3, unit),
            number(result.prediction.peaks[channel], 3, unit),
            f"{100 * extreme.value:.0f} % ({extreme.case})",
        )
    return table


def _percent(share: float) -> str:
    return number(100 * share, 3, "%")


_COLOURS: tuple[Colour, ...] = ("blue", "orange", "green")
_APART = 0.2  # of the distance of two coefficients, between the inputs of one


def charts(result: Design) -> tuple[Chart]:
    """Torque, positions, tones and predicted deviations."""
    says = (
        "What the drive is to do, and how well it would determine each coefficient, next to other "
        "inputs of the same peak torque."
    )
    panels = (*_over_time(result), _tones(result), _deviations(result))
    return (Chart("design", "The design", says, panels, columns=2),)


def _over_time(result: Design) -> Iterator[Panel]:
    """Torque, position and deflection."""
    x, time = result.run.states, Axis("time", "s")
    position: list[Mark] = [Line("link", result.time, x[:, 0], "blue")]
    played = "played"
    if result.drive.experiment.kind == "trajectory":
        played = "that the position loop asks for"
        reference = result.command.reference[:, 0]
        position.append(Line("motor reference", result.time, reference, "orange", 1.0, "dashed"))
    torque = Line("torque", result.time, result.run.torque, "blue", 1.0)
    yield Panel(f"Torque {played}", time, Axis("torque", "N m"), (torque,), span=2)
    title = "Link position, simulated with the assumed drive"
    yield Panel(title, time, Axis("position", "rad"), tuple(position), span=2)
    deflection = Line("deflection", result.time, x[:, 0] - x[:, 2], "blue", 1.0)
    yield Panel("Deflection", time, Axis("deflection", "rad"), (deflection,), 0.7, span=2)


def _tones(result: Design) -> Panel:
    unit = "N m" if result.drive.experiment.kind == "multisine" else "rad"
    rates, sizes = result.angular_frequencies, result.amplitudes
    resonance = result.drive.resonance
    ends = whole_decades(np.append(rates, resonance))
    return Panel(
        "Tones",
        Axis("angular frequency", "rad/s", logarithmic=True, limits=ends),
        Axis("amplitude", unit, limits=(0.0, 1.1 * float(sizes.max()))),
        (
            Level("resonance of the drive", resonance, "x", "grey", "dashed"),
            Points("tones", rates, sizes, "ink", 6.0, stems=True),
        ),
        1.3,
    )


def _deviations(result: Design) -> Panel:
    inputs = (result.prediction, *result.references)
    names = tuple(result.prediction.deviations)
    places = np.arange(float(len(names)))
    marks, shown = [], []
    for shift, (one, colour) in enumerate(zip(inputs, _COLOURS, strict=True)):
        values = np.array([100.0 * one.deviations[name] for name in names])
        marks.append(Points(one.name, values, places + _APART * (shift - 1), colour, 6.0))
        shown.append(values)
    decades = whole_decades(np.concatenate(shown))
    return Panel(
        "Predictions at the same peak torque",
        Axis("predicted standard deviation", "%", logarithmic=True, limits=decades),
        Axis("", categories=names),
        tuple(marks),
        1.3,
    )


_DIGITS = 10  # significant; a drive has fewer


def save_command(result: Design, directory: Path, _csv: bool = False) -> None:
    """Write command.csv: the torque to play, or the reference with the torque to be expected."""
    pl.DataFrame(command_columns(result)).write_csv(directory / "command.csv")


def command_columns(result: Design) -> dict[str, np.ndarray]:
    """What a drive can play, by name with unit."""
    columns = {"time [s]": result.time}
    if result.drive.experiment.kind == "trajectory":
        columns["motor_position_reference [rad]"] = result.command.reference[:, 0]
        columns["motor_velocity_reference [rad/s]"] = result.command.reference[:, 1]
    columns["motor_torque [N m]"] = result.run.torque
    return {name: _rounded(values) for name, values in columns.items()}


def _rounded(values: np.ndarray) -> np.ndarray:
    size = float(np.abs(values).max()) or 1.0
    return np.round(values, max(0, _DIGITS - 1 - int(np.floor(np.log10(size))))) + 0.0


def heading(result: Design) -> tuple[str, str]:
    """What is designed."""
    wanted = result.drive.experiment
    article = "An" if wanted.criterion == "E" else "A"
    return f"{article} {wanted.criterion}-optimal {wanted.kind}", f"{wanted.duration:g} s"


def document(result: Design) -> dict[str, Any]:
    """A design and what it would determine, for JSON."""
    cosines, sines = np.split(result.weights, 2)
    return {
        "drive": result.drive.document(),
        "coefficients": result.drive.coefficients,
        "tones": {
            "angular_frequencies": result.angular_frequencies,
            "cosines": cosines,
            "sines": sines,
        },
        "position_loop_gains": result.command.gains,
        "prediction": result.prediction,
        "references": result.references,
        "references_within_limits": result.kept_references,
        "largest_use": result.largest_use,
        "largest_deviations": result.largest_deviations,
        "scale": result.scale,
        "supported": result.supported,
        "seed": result.seed,
        "provenance": result.provenance,
    }


PRESENTER = Presenter(heading, parts, document, charts, write_data=save_command)
