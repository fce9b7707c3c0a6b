"""Chart of a design: its input, tones, and predictions compared with other inputs."""

import numpy as np

from flexid.experiment_design.result import Design, Prediction
from flexid.report.charts.description import Axis, Chart, Colour, Level, Line, Mark, Panel, Points
from flexid.report.charts.limits import whole_decades

_COLOURS: tuple[Colour, ...] = ("blue", "orange", "green")
_APART = 0.2  # of the distance of two coefficients, between the inputs of one


def design_chart(result: Design) -> Chart:
    """Torque, positions, tones and predicted deviations."""
    panels = (
        _torque(result),
        _positions(result),
        _deflection(result),
        _tones(result),
        _deviations(result),
    )
    peak = float(np.abs(result.run.torque).max())
    others = ", ".join(f"{one.name} {_worst(one)}" for one in result.references)
    says = (
        "The coefficient that it determines the least would have a standard deviation of "
        f"{_worst(result.prediction)} at a peak torque of {peak:.3g} N m; "
        f"at the same peak, {others}."
    )
    return Chart("design", "The design", says, panels, columns=2)


def _worst(prediction: Prediction) -> str:
    """The largest deviation that an input leaves, and of which coefficient."""
    name, deviation = max(prediction.deviations.items(), key=lambda item: item[1])
    return f"{100.0 * deviation:.2g} % ({name})"


def _torque(result: Design) -> Panel:
    played = (
        "played"
        if result.drive.experiment.kind == "multisine"
        else "that the position loop asks for"
    )
    line = Line("torque", result.time, result.run.torque, "blue", 1.0)
    return Panel(f"Torque {played}", Axis("time", "s"), Axis("torque", "N m"), (line,), span=2)


def _positions(result: Design) -> Panel:
    marks: list[Mark] = [Line("link", result.time, result.run.states[:, 0], "blue")]
    if result.drive.experiment.kind == "trajectory":
        reference = result.command.reference[:, 0]
        marks.append(Line("motor reference", result.time, reference, "orange", 1.0, "dashed"))
    title = "Link position, simulated with the assumed drive"
    return Panel(title, Axis("time", "s"), Axis("position", "rad"), tuple(marks), span=2)


def _deflection(result: Design) -> Panel:
    x = result.run.states
    line = Line("deflection", result.time, x[:, 0] - x[:, 2], "blue", 1.0)
    y = Axis("deflection", "rad")
    return Panel("Deflection", Axis("time", "s"), y, (line,), 0.7, span=2)


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
