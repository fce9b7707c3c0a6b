"""A design as tables, JSON, a figure, and the torque command as CSV."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from flexid.experiment_design.design import Design
from flexid.experiment_design.drive import DOUBT
from flexid.models.motion import unit_of
from flexid.report.chart import Axis, Chart, Line, Panel
from flexid.report.terminal import Part, Table, number, numbers

_WORST = f"±{100 * DOUBT:.0f} %, worst drive"
_UNITS = {"torque": "N m", "velocity": "rad/s", "position": "rad", "deflection": "rad"}


def _units(result: Design) -> dict[str, str]:
    """Return the unit of each channel."""
    return {channel: unit_of(unit, result.drive.joint) for channel, unit in _UNITS.items()}


def parts(result: Design) -> Iterator[Part]:
    """Return tables and sentences of the result."""
    yield _predictions(result)
    yield _limits(result)
    wanted = result.drive.experiment
    tones = ", ".join(f"{rate:.3g}" for rate in result.angular_frequencies)
    yield f"Tones of the torque: {tones} rad/s; {wanted.duration:g} s; seed {result.seed}."
    yield (
        f"The input was scaled by {result.scale:.3g}, so that drives whose parameters are off by "
        f"{100 * DOUBT:.0f} % stay within the limits."
    )


def _predictions(result: Design) -> Table:
    found = result.prediction
    columns = ("coefficient", *numbers("design"), _WORST)
    table = Table("Predicted standard deviations", columns)
    for name, deviation in found.deviations.items():
        extreme = result.largest_deviations[name]
        table.add(name, _percent(deviation), f"{100 * extreme.value:.3g} % ({extreme.case})")
    table.add("worst", _percent(found.worst))
    table.add("worst combination", _percent(found.e_deviation))
    table.add("torque, rms", number(found.torque_rms, 3, _units(result)["torque"]))
    return table


def _limits(result: Design) -> Table:
    table = Table("Limits", ("channel", *numbers("limit", "peak"), _WORST))
    for channel, unit in _units(result).items():
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


def charts(result: Design) -> tuple[Chart]:
    """Return torque, position and deflection over time."""
    x, time, units = result.run.states, Axis("time", "s"), _units(result)
    position = Line("link", result.time, x[:, 0], "blue")
    torque = Line("torque", result.time, result.run.torque, "blue", 1.0)
    deflection = Line("deflection", result.time, x[:, 0] - x[:, 2], "blue", 1.0)
    title = "Link position, simulated with the assumed drive"
    panels = (
        Panel("Torque command", time, Axis("torque", units["torque"]), (torque,)),
        Panel(title, time, Axis("position", units["position"]), (position,)),
        Panel("Deflection", time, Axis("deflection", units["deflection"]), (deflection,), 0.7),
    )
    says = "The torque command, and the simulated response with the assumed parameters."
    return (Chart("design", "Designed torque and simulated motion", says, panels),)


_DIGITS = 10  # significant digits, more than a drive resolves


def write_data(result: Design, directory: Path, _csv: bool = False) -> None:
    """Write command.csv: the torque command over time."""
    torque = f"motor_torque [{_units(result)['torque']}]"
    columns = {"time [s]": result.time, torque: result.run.torque}
    for name, values in columns.items():
        size = float(np.abs(values).max()) or 1.0
        places = max(0, _DIGITS - 1 - int(np.floor(np.log10(size))))
        columns[name] = np.round(values, places) + 0.0
    pl.DataFrame(columns).write_csv(directory / "command.csv")


def heading(result: Design) -> tuple[str, str]:
    """Return the title, and the duration."""
    return "The designed torque", f"{result.drive.experiment.duration:g} s"


def document(result: Design) -> dict[str, Any]:
    """Return a design and its predictions, for JSON."""
    cosines, sines = np.split(result.weights, 2)
    return {
        "drive": result.drive.document(),
        "coefficients": result.drive.coefficients,
        "tones": {
            "angular_frequencies": result.angular_frequencies,
            "cosines": cosines,
            "sines": sines,
        },
        "prediction": result.prediction,
        "largest_use": result.largest_use,
        "largest_deviations": result.largest_deviations,
        "scale": result.scale,
        "supported": result.supported,
        "seed": result.seed,
        "provenance": result.provenance,
    }
