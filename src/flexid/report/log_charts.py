"""A log as it was read: its channels over time."""

from flexid.arrays import FloatArray
from flexid.recording.recording import Log
from flexid.report.charts.description import Axis, Chart, Colour, Line, Mark, Panel


def log_chart(log: Log) -> Chart:
    """Positions, deflection and input of a log over time, cut where the log has gaps."""
    import numpy as np

    first = log.recordings[0]
    gap = np.array([np.nan])

    def joined(parts: list[FloatArray]) -> FloatArray:
        return np.concatenate([piece for part in parts for piece in (part, gap)])

    time = joined([r.time for r in log.recordings])

    def line(label: str, parts: list[FloatArray], colour: Colour) -> Line:
        return Line(label, time, joined(parts), colour)

    positions: list[Mark] = [line("motor", [r.motor_position for r in log.recordings], "blue")]
    panels = []
    if first.link_position is not None:
        link = [r.needed_link_position for r in log.recordings]
        positions.append(line("link", link, "orange"))
        deflection = line("", [r.deflection for r in log.recordings], "green")
        panels.append(("Deflection: link minus motor", "angle", "rad", (deflection,)))
    if first.input is not None:
        drive = line("", [r.needed_input for r in log.recordings], "ink")
        panels.append(("Input", "input", first.input_unit, (drive,)))
    return Chart(
        "log",
        "The log as read",
        "Motor and link should move together. The deflection should look like the torque in the "
        "spring, not like noise. No channel should be flat while the others move.",
        tuple(
            Panel(title, Axis("time", "s"), Axis(label, unit), marks)
            for title, label, unit, marks in [
                ("Positions", "angle", "rad", tuple(positions)),
                *panels,
            ]
        ),
    )
