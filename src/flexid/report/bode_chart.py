"""The frequency response of a joint as a Bode plot: model with band, and what the log shows."""

from collections.abc import Sequence

import numpy as np

from flexid.arrays import FloatArray
from flexid.frequency.frequency_response import Frequency, FrequencyResponse, Response
from flexid.report.chart import (
    Axis,
    Band,
    Chart,
    Colour,
    Level,
    Line,
    Mark,
    Panel,
    Points,
)
from flexid.report.terminal import format_with_interval

_COHERENT = 0.8  # above which the spectral estimate is drawn strongly
_SIDE = 0.3  # of a decade, left free above and below the magnitudes
_COLOURS: dict[str, Colour] = {"antiresonance": "green", "resonance": "red"}
_BESIDE = 25.0  # °, left free above and below the phases
_HEIGHTS = (1.7, 1.1, 0.65)


def bode_chart(described: FrequencyResponse) -> Chart:
    """Magnitude in physical units, phase and coherence of every response over frequency in Hz."""
    responses = described.responses[::-1]  # the motor, where the torque acts, comes first
    hertz = described.frequency
    x = Axis("frequency", "Hz", logarithmic=True, limits=(float(hertz[0]), float(hertz[-1])))
    marked = [
        Level(_with_interval(found), found.value, "x", _COLOURS[found.name], "dotted")
        for found in described.characteristic
    ]
    sizes = _magnitudes(described)
    title = f"\nno band: {', '.join(described.unknown)} not determined" if described.unknown else ""
    panels = [
        Panel(
            f"{response.output} over {response.input}{title}",
            x,
            Axis("magnitude", response.unit, logarithmic=True, limits=sizes),
            (*_magnitude(described, response), *marked),
            _HEIGHTS[0],
        )
        for response in responses
    ]
    phases = [_phase(described, response) for response in responses]
    phase = Axis("phase", "°", limits=_degrees(phases), step=90.0)
    panels += [
        Panel(f"{response.output}: phase", x, phase, (*marks, *marked), _HEIGHTS[1])
        for response, marks in zip(responses, phases, strict=True)
    ]
    if any(response.measured for response in responses):
        panels += [
            Panel(
                f"{response.output}: coherence",
                x,
                Axis("coherence", "–", limits=(0.0, 1.05)),
                (
                    *(
                        Line("coherence", e.frequency, e.coherence, "orange", 0.8)
                        for e in response.measured
                    ),
                    *marked,
                ),
                _HEIGHTS[2],
            )
            for response in responses
        ]
    return Chart(
        "bode",
        "Frequency response of the joint, for small motions",
        _says(described),
        tuple(panels),
        columns=len(responses),
    )


def _magnitude(described: FrequencyResponse, response: Response) -> list[Mark]:
    hertz = described.frequency
    marks: list[Mark] = []
    for estimate in response.measured:
        size = np.abs(estimate.values)
        for strong, label, faint in _by_coherence(estimate.coherence):
            marks.append(
                Points(label, estimate.frequency[strong], size[strong], "orange", 3.0, faint)
            )
    if np.isfinite(response.upper).all():
        label = f"{100 * described.level:g} % band"
        marks.append(Band(label, hertz, response.lower, response.upper, "blue"))
    if response.values.any():  # a zero has no logarithm
        marks.append(Line("model", hertz, np.abs(response.values), "blue"))
    return marks


def _phase(described: FrequencyResponse, response: Response) -> list[Mark]:
    hertz = described.frequency
    angle = np.angle(response.values)
    steady = np.unwrap(angle)  # without jumps by a full turn
    turns = steady - angle
    marks: list[Mark] = []
    for estimate in response.measured:
        nearest = np.interp(np.log(estimate.frequency), np.log(hertz), steady)
        degrees = np.degrees(nearest + np.angle(estimate.values * np.exp(-1j * nearest)))
        strong, label, faint = _by_coherence(estimate.coherence)[1]
        marks.append(
            Points(label, estimate.frequency[strong], degrees[strong], "orange", 3.0, faint)
        )
    if np.isfinite(response.upper).all():
        ends = np.degrees(response.behind + turns), np.degrees(response.ahead + turns)
        marks.append(Band(f"{100 * described.level:g} % band", hertz, *ends, "blue"))
    if response.values.any():
        marks.append(Line("model", hertz, np.degrees(steady), "blue"))
    return marks


def _degrees(phases: Sequence[Sequence[Mark]]) -> tuple[float, float]:
    """Ends of the axis of phases: those of all models and of what the log shows."""
    drawn = [mark.y for marks in phases for mark in marks if isinstance(mark, Line | Points)]
    shown = np.concatenate([np.zeros(1), *drawn])
    shown = shown[np.isfinite(shown)]
    return float(shown.min()) - _BESIDE, float(shown.max()) + _BESIDE


def _by_coherence(coherence: FloatArray) -> tuple[tuple[np.ndarray, str, bool], ...]:
    """What is drawn faintly, and what is not, with labels."""
    return (
        (coherence < _COHERENT, "where its coherence is low", True),
        (coherence >= _COHERENT, "log, spectral estimate", False),
    )


def _magnitudes(described: FrequencyResponse) -> tuple[float, float]:
    """Ends of the axis of magnitudes, which the bottom of an antiresonance does not decide."""
    logarithms = np.log(described.frequency)
    evenly = np.linspace(logarithms[0], logarithms[-1], 200)
    sizes = [
        np.interp(evenly, logarithms, np.log10(np.abs(r.values)))
        for r in described.responses
        if r.values.all()
    ]
    low, high = np.quantile(np.concatenate(sizes), (0.02, 1.0)) if sizes else (-1.0, 1.0)
    return float(10 ** (low - _SIDE)), float(10 ** (high + _SIDE))


def _with_interval(found: Frequency) -> str:
    shown, low, high = format_with_interval(found.value, *found.interval)
    return f"{found.name} {shown} [{low}, {high}] Hz"


def _says(described: FrequencyResponse) -> str:
    """What is characteristic of the joint, and what to compare."""
    found = " and ".join(map(_with_interval, described.characteristic))
    said = f"The joint has {found}. " if found else ""
    if any(response.measured for response in described.responses):
        return said + "Where the coherence is high, the log's own points should lie on the model."
    return said + "The band is what the log leaves open at each frequency."
