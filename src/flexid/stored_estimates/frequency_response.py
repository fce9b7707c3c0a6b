"""The frequency response of a joint: of the model with its band, and of a log by itself.

What a log shows by itself are spectra by Welch's method, without a model. Positions are differenced
first: a drive's positions hold so much more power at low frequencies than at high ones that it
would leak there. The differencing is divided out again, and so are the hold of the input between
samples and the delays that were found, which belong to the log and not to the joint.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexid.arrays import FloatArray
from flexid.errors import SettingError
from flexid.identification.result.identification import Identification
from flexid.identification.vocabulary.intervals import (
    CONFIDENCE,
    Interval,
    checked_level,
    logarithmic_interval,
)
from flexid.models.motion import unit_of
from flexid.recording.recording import Hold, Recording
from flexid.stored_estimates.linear_joint import (
    SHOWN,
    ComplexArray,
    LinearJoint,
    linear_joint,
    response_band,
)

_SEGMENTS = 8  # that a log is cut into; with those that overlap by half, 15 are averaged
_SHORTEST = 64  # samples of a segment, below which there is nothing to see
_HIGHEST = 0.8  # of the Nyquist frequency; beyond, the hold is too far from what the formula says


@dataclass(frozen=True, eq=False)
class SpectralEstimate:
    """A frequency response as a log shows it."""

    output: str  # as in Response
    frequency: FloatArray  # (n,): Hz, evenly spaced
    values: NDArray[np.complex128]  # (n,): in the unit of Response
    # (n,): share of the output's power that follows the input linearly, 0 to 1
    coherence: FloatArray


def spectral_estimates(
    recordings: Sequence[Recording], result: Identification
) -> tuple[SpectralEstimate, ...]:
    """Spectral estimates of a joint's frequency responses, by output and sample time.

    A feedback from the noise of an output to the input, as a controller makes it, is in them: where
    the coherence is low they show the controller's inverse rather than the joint.
    """
    found = []
    for sample_time in sorted({r.sample_time for r in recordings}):
        alike = [r for r in recordings if r.sample_time == sample_time]
        samples = max(len(r) for r in alike)
        length = max(_SHORTEST, samples // _SEGMENTS)
        for output, channel in SHOWN[result.model].outputs.items():
            moved = [_differenced(r, result, channel) for r in alike if len(r) > length]
            if moved:
                found.append(_estimate(output, moved, length, result, sample_time))
    return tuple(found)


def _differenced(
    recording: Recording, result: Identification, channel: str
) -> tuple[FloatArray, FloatArray]:
    """Input and output, shape (n - 1,) each; a position as its differences over the samples."""
    output = np.diff(getattr(recording, channel)) / recording.sample_time
    if not SHOWN[result.model].by_force:
        return np.diff(recording.motor_position) / recording.sample_time, output
    return recording.needed_input[1:], output


def spectra(u: FloatArray, y: FloatArray, length: int) -> ComplexArray:
    """Spectra of input, of output, and between them, in one unit, shape (3, n)."""
    # As csd of scipy.signal, which takes half a second to import, but for the unit.
    window = np.hanning(length + 1)[:-1]
    step = length - length // 2
    lines = []
    for signal in (u, y):
        parts = np.lib.stride_tricks.sliding_window_view(signal, length)[::step]
        lines.append(np.fft.rfft(window * (parts - parts.mean(axis=1, keepdims=True))))
    of_u, of_y = lines
    pairs = ((of_u, of_u), (of_y, of_y), (of_u, of_y))
    return np.array([np.mean(first.conj() * second, axis=0) for first, second in pairs])


def _estimate(
    output: str,
    moved: Sequence[tuple[FloatArray, FloatArray]],  # input and output of each recording
    length: int,
    result: Identification,
    sample_time: float,
) -> SpectralEstimate:
    counts = [1 + (len(u) - length) // (length - length // 2) for u, _ in moved]
    each = [spectra(u, y, length) for u, y in moved]
    mean = sum(n / sum(counts) * part for n, part in zip(counts, each, strict=True))
    of_input, of_output, between = np.asarray(mean)
    frequency: FloatArray = np.fft.rfftfreq(length, sample_time).astype(np.float64)
    inside = (frequency > 0.0) & (frequency < _HIGHEST * 0.5 / sample_time)
    inside &= (of_input.real > 0.0) & (of_output.real > 0.0)
    frequency, between = frequency[inside], between[inside]
    u, y = of_input.real[inside], of_output.real[inside]
    jw = 2j * np.pi * frequency
    alignment = result.choices.alignment
    late = alignment.link_delay.value if output.startswith("link") else 0.0
    values = between / u
    if SHOWN[result.model].by_force:
        late += alignment.input_delay.value
        values *= jw * sample_time / -np.expm1(-jw * sample_time)
        values /= _held(result.choices.hold, frequency, sample_time)
    coherence = np.abs(between) ** 2 / (u * y)
    return SpectralEstimate(output, frequency, values * np.exp(jw * late), coherence)


def _held(hold: Hold, frequency: FloatArray, sample_time: float) -> NDArray[np.complex128]:
    """What becomes of a sampled input between the samples, over the samples themselves."""
    cycles = frequency * sample_time
    if hold == "zero":
        held = np.sinc(cycles) * np.exp(-1j * np.pi * cycles)
    elif hold == "linear":
        held = np.sinc(cycles) ** 2
    else:
        held = np.ones_like(cycles)
    return np.asarray(held, dtype=np.complex128)


_POINTS = 400  # of the curves, evenly on the logarithm
_NEAR_PEAK = np.geomspace(1e-5, 0.2, 40)  # and near a peak, however narrow it is
_AROUND = 20.0  # how far the curves go, times what is characteristic, where no log says


@dataclass(frozen=True)
class Frequency:
    """A frequency that is characteristic of the joint, with its interval."""

    # "antiresonance", of the link while the motor is held, where the motor does not follow its
    # torque; or "resonance", of link and motor against each other
    name: str
    value: float  # Hz, of the joint without its damping
    interval: Interval  # Hz


@dataclass(frozen=True, eq=False)
class Response:
    """What one output does under the input; arrays are (n,)."""

    output: str  # "motor velocity", "link velocity"; "link position" of the link alone
    input: str  # "torque", "current", "voltage" or "motor position"
    unit: str  # of the magnitude
    values: ComplexArray
    lower: FloatArray  # ends of the magnitude's interval; 0 where the log leaves something free,
    upper: FloatArray  # and infinite
    behind: (
        FloatArray  # ends of the phase's interval in rad, on the branch of the angle of `values`
    )
    ahead: FloatArray
    # what the log shows by itself, one for each sample time; empty without a log
    measured: tuple[SpectralEstimate, ...]


@dataclass(frozen=True, eq=False)
class FrequencyResponse:
    """Frequency responses of an identified joint.

    Parameters
    ----------
    model : {"flexible", "link", "rigid"}
        Which joint.
    frequency : array, shape (n,)
        In Hz.
    responses : tuple of Response
        One for each position of the model.
    characteristic : tuple of Frequency
        Antiresonance and resonance, as far as the joint has them.
    level : float
        Nominal coverage of the intervals.
    unknown : tuple of str
        Coefficients that the log does not determine: because of them there is no band.
    """

    model: str
    frequency: FloatArray
    responses: tuple[Response, ...]
    characteristic: tuple[Frequency, ...]
    level: float
    unknown: tuple[str, ...]

    def __repr__(self) -> str:
        outputs = ", ".join(response.output for response in self.responses)
        low, high = self.frequency[0], self.frequency[-1]
        count = len(self.frequency)
        return f"<FrequencyResponse: {outputs}; {count} frequencies, {low:.3g} to {high:.3g} Hz>"


def frequency_response(
    result: Identification,
    recordings: Sequence[Recording] = (),
    *,
    frequency: ArrayLike | None = None,
    position: float | None = None,
    level: float = CONFIDENCE,
) -> FrequencyResponse:
    """Frequency responses of an identified joint for small motions, with confidence bands.

    They are those of the joint itself: how the input is held between samples, and the delays that
    were found, are taken out of what the log shows. A friction that slides is constant, and has no
    part in them.
    """
    joint = linear_joint(result, position)
    characteristic = _characteristic(joint, checked_level(level))
    measured = spectral_estimates(recordings, result)
    chosen = _chosen(characteristic, recordings) if frequency is None else frequency
    hertz = np.atleast_1d(np.asarray(chosen, dtype=np.float64))
    if hertz.ndim != 1 or not hertz.size or not (np.isfinite(hertz) & (hertz > 0.0)).all():
        raise SettingError("frequency", "must be numbers of Hz above 0, one or more")
    omega = 2.0 * np.pi * hertz
    bands = response_band(joint, omega, level)
    positions = joint.positions(omega)
    input_name, unit = _input(joint, result)
    responses = []
    for row, name in enumerate(joint.shown.outputs):
        values = positions[:, row] * (1j * omega if joint.shown.by_force else 1.0)
        size, angle = np.abs(values), np.angle(values)
        lower, upper, behind, ahead = bands[:, :, row]
        moves = bool(size.all())
        responses.append(
            Response(
                name,
                input_name,
                unit,
                values,
                size * lower,
                size * upper if moves else np.full(len(size), np.inf),
                angle + behind,
                angle + ahead,
                tuple(estimate for estimate in measured if estimate.output == name),
            )
        )
    return FrequencyResponse(
        result.model, hertz, tuple(responses), characteristic, level, joint.unknown
    )


def _input(joint: LinearJoint, result: Identification) -> tuple[str, str]:
    """Name of the input, and the unit of a response to it."""
    if not joint.shown.by_force:
        return "motor position", "{0}/{0}".format(unit_of("rad", result.joint))
    names = {"N m": "torque", "N": "force", "A": "current", "V": "voltage"}
    per_input = result.coefficients["beta1"].unit.partition("/s^2")[2]
    name = names.get(result.input_unit, "input")
    return name, unit_of("rad/s", result.joint) + per_input


def _characteristic(joint: LinearJoint, level: float) -> tuple[Frequency, ...]:
    """Antiresonance and resonance, by the delta method on their logarithms."""
    found = []
    # Gravity's own slow swing is no resonance of the joint.
    for name, rows in joint.shown.characteristic.items():
        stiffness = joint.stiffness[:, :rows, :rows]
        matrix = -(stiffness[0] + np.tensordot(joint.values, stiffness[1:], 1))
        squares, right = (np.asarray(part, np.complex128) for part in np.linalg.eig(matrix))
        place = int(np.argmax(squares.real))
        square = float(squares[place].real)
        if square <= 0.0 or squares[place].imag != 0.0:
            continue  # coefficients that no spring has
        left = np.linalg.inv(right)[place]
        slopes = -np.array([(left @ part @ right[:, place]).real for part in stiffness[1:]])
        std = float(np.linalg.norm(slopes @ joint.deviations)) / (2.0 * square)
        if slopes[joint.free].any():
            std = np.inf
        value = float(np.sqrt(square)) / (2.0 * np.pi)
        ends = logarithmic_interval(value, std * value, joint.degrees_of_freedom, level)
        found.append(Frequency(name, value, ends))
    return tuple(found)


def _chosen(characteristic: Sequence[Frequency], recordings: Sequence[Recording]) -> FloatArray:
    """Frequencies in Hz over all that is of interest."""
    own = [f.value for f in characteristic] or [1.0]
    low, high = min(own) / _AROUND, max(own) * _AROUND
    if recordings:
        low = min(low, max(1.0 / (len(r) * r.sample_time) for r in recordings) * 4.0)
        high = min(high, max(0.5 / r.sample_time for r in recordings))
    evenly = np.geomspace(low, max(high, 2.0 * low), _POINTS)
    near = [f * (1.0 + side * _NEAR_PEAK) for f in own for side in (-1.0, 1.0)]
    every = np.unique(np.concatenate((evenly, *near)))
    return every[(every >= evenly[0]) & (every <= evenly[-1])]
