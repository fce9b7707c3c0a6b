"""What a log shows of a frequency response by itself: spectra by Welch's method, no model.

Positions are differenced first: a drive's positions hold so much more power at low frequencies than
at high ones that it would leak there. The differencing is divided out again, and so are the hold
of the input between samples and the delays that were found, which belong to the log and not to
the joint.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexid.arrays import FloatArray
from flexid.frequency.linear_joint import SHOWN
from flexid.identification.result.identification import Identification
from flexid.recording.recording import Hold, Recording

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
    averages: int  # number of segments, with those that overlap


@dataclass(frozen=True, eq=False)
class _Spectra:
    """Averaged spectra of an input u and an output y, each (n,), and how many were averaged."""

    frequency: FloatArray
    of_input: FloatArray
    of_output: FloatArray
    between: NDArray[np.complex128]
    averages: int


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
            spectra = [
                _spectra(*_differenced(r, result, channel), sample_time, length)
                for r in alike
                if len(r) > length
            ]
            if spectra:
                found.append(_estimate(output, _averaged(spectra), result, sample_time))
    return tuple(found)


def _differenced(
    recording: Recording, result: Identification, channel: str
) -> tuple[FloatArray, FloatArray]:
    """Input and output, shape (n - 1,) each; a position as its differences over the samples."""
    output = np.diff(getattr(recording, channel)) / recording.sample_time
    if not SHOWN[result.model].by_force:
        return np.diff(recording.motor_position) / recording.sample_time, output
    return recording.needed_input[1:], output


def _spectra(u: FloatArray, y: FloatArray, sample_time: float, length: int) -> _Spectra:
    from scipy.signal import csd, welch  # half a second, for whoever asks

    rate = 1.0 / sample_time
    frequency, of_input = welch(u, rate, nperseg=length)
    _, of_output = welch(y, rate, nperseg=length)
    _, between = csd(u, y, rate, nperseg=length)
    averages = 1 + (len(u) - length) // (length - length // 2)
    return _Spectra(frequency, of_input, of_output, np.asarray(between, np.complex128), averages)


def _averaged(spectra: Sequence[_Spectra]) -> _Spectra:
    total = sum(s.averages for s in spectra)
    shares = [s.averages / total for s in spectra]
    return _Spectra(
        spectra[0].frequency,
        np.sum([w * s.of_input for w, s in zip(shares, spectra, strict=True)], axis=0),
        np.sum([w * s.of_output for w, s in zip(shares, spectra, strict=True)], axis=0),
        np.sum([w * s.between for w, s in zip(shares, spectra, strict=True)], axis=0),
        total,
    )


def _estimate(
    output: str, spectra: _Spectra, result: Identification, sample_time: float
) -> SpectralEstimate:
    inside = (spectra.frequency > 0.0) & (spectra.frequency < _HIGHEST * 0.5 / sample_time)
    inside &= (spectra.of_input > 0.0) & (spectra.of_output > 0.0)
    frequency = spectra.frequency[inside]
    u, y, between = spectra.of_input[inside], spectra.of_output[inside], spectra.between[inside]
    jw = 2j * np.pi * frequency
    alignment = result.choices.alignment
    late = alignment.link_delay.value if output.startswith("link") else 0.0
    values = between / u
    if SHOWN[result.model].by_force:
        late += alignment.input_delay.value
        values *= jw * sample_time / -np.expm1(-jw * sample_time)
        values /= _held(result.choices.hold, frequency, sample_time)
    return SpectralEstimate(
        output,
        frequency,
        values * np.exp(jw * late),
        np.abs(between) ** 2 / (u * y),
        spectra.averages,
    )


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
