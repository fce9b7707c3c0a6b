"""Charts of logs, free runs, residuals and frequency responses."""

from collections.abc import Mapping, Sequence
from math import inf, isfinite

import numpy as np

from flexid.arrays import FloatArray
from flexid.identification.result import Identification
from flexid.identification.vocabulary.evidence import FreeRun, Validation
from flexid.models.motion import JointType, unit_of, unit_of_channel
from flexid.recording.recording import Log
from flexid.report.chart import Axis, Band, Chart, Colour, Level, Line, Mark, Panel, with_margin
from flexid.report.terminal import format_fit, value_texts
from flexid.stored_estimates.frequency_response import FrequencyResponse, Response

_MARGIN = 0.15  # share of the measured range, left free above and below
_BELOW = 0.5  # height of the panel of residuals, relative to the panel above it


def free_run_chart(
    name: str,
    title: str,
    validation: Validation,
    noise: Mapping[str, float],
    types: Sequence[JointType],  # how each joint moves
) -> Chart:
    """Return free runs and residuals by channel; panel titles report what is cut off."""
    panels = []
    for place, (channel, fit) in enumerate(validation.fit_percent.items()):
        label, unit = channel.replace("_", " "), unit_of_channel(channel, types)
        panels += _panels(label, fit, validation.runs, place, noise.get(channel), unit)
    says = (
        "The model is simulated from its initial state, over data not used for the fit. The "
        "residual below each channel should look like sensor noise."
    )
    return Chart(name, title, says, tuple(panels))


def _panels(
    label: str, fit: float, runs: Sequence[FreeRun], place: int, noise: float | None, unit: str
) -> tuple[Panel, Panel]:
    """Return the panels of a channel's motion and of its residual."""
    time = Axis("time", "s")
    measured = np.concatenate([run.measured[:, place] for run in runs])
    simulated = np.concatenate([run.simulated[:, place] for run in runs])
    span = float(np.ptp(measured))
    title = f"{label}: fit {format_fit(fit)}"
    frame = below = None
    if span > 0.0:
        errors = np.abs(simulated - measured)
        largest = float(errors.max()) if np.isfinite(errors).all() else inf
        frame = with_margin(float(measured.min()), float(measured.max()), _MARGIN)
        if not isfinite(largest):
            title += "; it diverges"
        elif ((simulated < frame[0]) | (simulated > frame[1])).any():
            title += f"; cut off, residual up to {largest:.2g} {unit}"
        below = (-span, span) if largest > span else None
    motion, residuals = [], []
    for run in runs:
        seen, predicted = run.measured[:, place], _finite(run.simulated[:, place])
        motion.append(Line("measured", run.time, seen, "grey", 2.4))
        motion.append(Line("free run of the model", run.time, predicted, "blue", 1.0))
        residuals.append(Line("residual", run.time, seen - predicted, "red", 0.7))
    levels = [] if noise is None else [-2.0 * noise, 2.0 * noise]
    quantity = [word for word in label.split() if not word.isdigit()][-1]  # of any joint
    twice = [Level("twice the encoder noise", edge, "y", "ink", "dashed") for edge in levels]
    return (
        Panel(title, time, Axis(quantity, unit, limits=frame), tuple(motion)),
        Panel(
            f"{label}: residual",
            time,
            Axis("residual", unit, limits=below),
            (*residuals, *twice),
            _BELOW,
        ),
    )


def _error(run: FreeRun, place: int) -> FloatArray:
    return run.measured[:, place] - run.simulated[:, place]


def _finite(values: FloatArray) -> FloatArray:
    return np.where(np.isfinite(values), values, np.nan)


_LONGEST_LAG = 0.1  # share of the longest run
_SIGNIFICANT = 1.96  # standard deviations of the autocorrelation of white noise


def residual_chart(validation: Validation, types: Sequence[JointType]) -> Chart:
    """Return each channel's residual, and its autocorrelation with the band of white noise."""
    longest = max(validation.runs, key=lambda run: len(run.time))
    panels = []
    for place, channel in enumerate(validation.fit_percent):
        label = channel.replace("_", " ")
        lines = [
            Line("residual", run.time, _finite(_error(run, place)), "blue", 0.7)
            for run in validation.runs
        ]
        time, below = Axis("time", "s"), Axis("residual", unit_of_channel(channel, types))
        panels.append(Panel(label, time, below, tuple(lines)))
        panels.append(_autocorrelation_panel(label, longest.time, _error(longest, place)))
    says = (
        "For white noise, 5 % of the autocorrelation lies outside the grey band. A larger share "
        "indicates a model error, or noise in the input."
    )
    title = "Residuals, and their autocorrelation"
    return Chart("residuals", title, says, tuple(panels), columns=2)


def _autocorrelation_panel(label: str, time: FloatArray, residual: FloatArray) -> Panel:
    """Return the panel of an autocorrelation, with the band of white noise."""
    lag = time[: max(2, int(_LONGEST_LAG * len(time)))] - time[0]
    band = _SIGNIFICANT / np.sqrt(len(residual))
    edges = np.full(2, band)
    marks = [
        Band("95 % of white noise", lag[[0, -1]], -edges, edges, "grey"),
        Level("", 0.0, "y", "ink"),
    ]
    if np.isfinite(residual).all():
        found = autocorrelation(residual)[: len(lag)]
        marks.append(Line("autocorrelation", lag, found, "blue"))
    y = Axis("autocorrelation", limits=(-1.05, 1.05))
    return Panel(f"{label}: autocorrelation", Axis("lag", "s"), y, tuple(marks))


def autocorrelation(values: FloatArray) -> FloatArray:
    """Return the autocorrelation at lags 0, 1, ..., shape (n,); 0 for constant values."""
    centred = values - values.mean()
    spectrum = np.abs(np.fft.rfft(centred, 2 * len(values))) ** 2
    products = np.fft.irfft(spectrum, 2 * len(values))[: len(values)]
    if products[0] <= 0.0:
        products[0] = 1.0
    return products / products[0]


def log_chart(log: Log) -> Chart:
    """Return positions, deflection and input of a log over time, with its gaps."""
    first = log.recordings[0]
    gap = np.array([np.nan])

    def joined(parts: list[FloatArray]) -> FloatArray:
        return np.concatenate([piece for part in parts for piece in (part, gap)])

    time = joined([r.time for r in log.recordings])

    def line(label: str, parts: list[FloatArray], colour: Colour) -> Line:
        return Line(label, time, joined(parts), colour)

    unit = unit_of("rad", first.joint)
    positions: list[Mark] = [line("motor", [r.motor_position for r in log.recordings], "blue")]
    panels = [("Positions", "position", unit, positions)]
    if first.link_position is not None:
        link = [r.needed_link_position for r in log.recordings]
        positions.append(line("link", link, "orange"))
        deflection = line("", [r.deflection for r in log.recordings], "green")
        panels.append(("Deflection: link minus motor", "deflection", unit, [deflection]))
    if first.input is not None:
        drive = line("", [r.needed_input for r in log.recordings], "ink")
        panels.append(("Input", "input", first.input_unit, [drive]))
    return Chart(
        "log",
        "The log as read",
        "Motor and link should move together. The deflection should look like the torque in the "
        "spring, not like noise. No channel should be flat while the others move.",
        tuple(
            Panel(title, Axis("time", "s"), Axis(label, unit), tuple(marks))
            for title, label, unit, marks in panels
        ),
    )


_DECADE_MARGIN = 0.3  # share of a decade, left free above and below the magnitudes
_COLOURS: dict[str, Colour] = {"antiresonance": "green", "resonance": "red"}
_PHASE_MARGIN = 25.0  # °, left free above and below the phases


def bode_chart(described: FrequencyResponse) -> Chart:
    """Return magnitude and phase of every response over frequency in Hz."""
    responses = described.responses[::-1]  # the motor, where the torque acts, comes first
    hertz = described.frequency
    x = Axis("frequency", "Hz", logarithmic=True, limits=(float(hertz[0]), float(hertz[-1])))
    marked = [
        Level(
            "{} {} {} Hz".format(found.name, *value_texts(found.value, *found.interval)),
            found.value,
            "x",
            _COLOURS[found.name],
            "dotted",
        )
        for found in described.characteristic
    ]
    sizes = _magnitudes(described)
    title = f"\nno band: {', '.join(described.unknown)} not determined" if described.unknown else ""
    magnitudes, phases = zip(*(_marks(described, r) for r in responses), strict=True)
    drawn = [mark.y for marks in phases for mark in marks if isinstance(mark, Line)]
    shown = np.concatenate([np.zeros(1), *drawn])
    shown = shown[np.isfinite(shown)]
    ends = float(shown.min()) - _PHASE_MARGIN, float(shown.max()) + _PHASE_MARGIN
    phase = Axis("phase", "°", limits=ends, step=90.0)
    panels: list[tuple[str, Axis, Sequence[Mark], float]] = []
    for r, marks in zip(responses, magnitudes, strict=True):
        size = Axis("magnitude", r.unit, logarithmic=True, limits=sizes)
        panels.append((f"{r.output} over {r.input}{title}", size, marks, 1.7))
    for r, marks in zip(responses, phases, strict=True):
        panels.append((f"{r.output}: phase", phase, marks, 1.1))
    return Chart(
        "bode",
        "Frequency response of the joint, for small motions",
        "The shaded band is the confidence interval at each frequency.",
        tuple(Panel(name, x, y, (*marks, *marked), height) for name, y, marks, height in panels),
        columns=len(responses),
    )


def _marks(described: FrequencyResponse, response: Response) -> tuple[list[Mark], list[Mark]]:
    """Return the marks of a response's magnitude, and of its phase."""
    hertz, band = described.frequency, f"{100 * described.level:g} % band"
    angle = np.angle(response.values)
    steady = np.unwrap(angle)  # without jumps by a full turn
    turns = steady - angle
    size: list[Mark] = []
    phase: list[Mark] = []
    if np.isfinite(response.upper).all():
        ends = np.degrees(response.behind + turns), np.degrees(response.ahead + turns)
        size.append(Band(band, hertz, response.lower, response.upper, "blue"))
        phase.append(Band(band, hertz, *ends, "blue"))
    if response.values.any():  # a zero has no logarithm
        size.append(Line("model", hertz, np.abs(response.values), "blue"))
        phase.append(Line("model", hertz, np.degrees(steady), "blue"))
    return size, phase


def _magnitudes(described: FrequencyResponse) -> tuple[float, float]:
    """Return the limits of the magnitude axis; a deep antiresonance may be cut off."""
    logarithms = np.log(described.frequency)
    evenly = np.linspace(logarithms[0], logarithms[-1], 200)
    sizes = [
        np.interp(evenly, logarithms, np.log10(np.abs(r.values)))
        for r in described.responses
        if r.values.all()
    ]
    low, high = np.quantile(np.concatenate(sizes), (0.02, 1.0)) if sizes else (-1.0, 1.0)
    return float(10 ** (low - _DECADE_MARGIN)), float(10 ** (high + _DECADE_MARGIN))


def fit_chart(result: Identification) -> Chart:
    """Return the free run over the held-out data, channel by channel, with its residual."""
    deviation = result.compliance.deflection_noise
    flexible = result.model == "flexible"  # the link alone has the motor's encoder as input
    noise = {"deflection": deviation} if flexible and 0.0 < deviation < np.inf else {}
    title = "Free run of the model over held-out data"
    return free_run_chart("fit", title, result.validation, noise, (result.joint,))
