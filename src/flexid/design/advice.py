"""What to add to an input so that its motion tells every coefficient.

The estimated model runs under the recorded input with one sine more, or under a multiple of the
input, and what that motion would tell is assessed like the log itself. The smallest addition after
which every coefficient counts as determined, and a margin, is the advice. Where the log does not
even yield a model that could be run, a rule of thumb takes its place.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from flexid.analysis.information import Information, segmented_information
from flexid.design.assessment import Assessment, assess
from flexid.errors import SimulationError
from flexid.estimators.samples import FloatArray, Samples
from flexid.estimators.segments import divide, first_states
from flexid.estimators.state_variable_filter import filtered_least_squares
from flexid.models.parametric_system import ParametricSystem
from flexid.recording.recording import Hold
from flexid.simulation.free_run import free_run, free_run_kernel
from flexid.simulation.linearisation import jacobian

_FREQUENCIES = 12  # tried, evenly spaced on a logarithmic scale
_LONGEST = 20.0  # s of the record that are run; the rest tells as much per second
_PERIODS = 4.0  # of the slowest sine in the record
_BEYOND_RESONANCE = 2.0  # times the fastest pole, for the fastest sine
_SAMPLES_PER_PERIOD = 20.0
_LEAST, _MOST = 1 / 16, 32.0  # size of an addition, over the input's root mean square
_STEP = 4.0  # between one amplitude and the next
_REFINEMENTS = 4  # halvings of the last step, on a logarithmic scale
_MARGIN = 1.25  # on the amplitude: the next log has other noise
# A second tone at 2.65 times the first with a fifth of its amplitude brings the condition number of
# the flexible joint of Huang (2003), Table I, near 1 at any amplitude.
_RULE_FREQUENCY, _RULE_AMPLITUDE = 2.65, 0.2


@dataclass(frozen=True)
class Addition:
    """A change of the input after which every coefficient can be told.

    Parameters
    ----------
    amplitude : float
        Of the added sine in the input's unit, or the factor on the whole input.
    angular_frequency : float
        Of the added sine in rad/s; 0 where the whole input is multiplied.
    weakest : str
        The coefficient that would then be told worst.
    relative_deviation : float
        Its predicted standard deviation over its value.
    peak_input : float
        Largest magnitude of the new input.
    peak_position, peak_deflection : float
        Largest magnitude of the link's position and of the deflection in rad, simulated.
    """

    amplitude: float
    angular_frequency: float
    weakest: str
    relative_deviation: float
    peak_input: float
    peak_position: float
    peak_deflection: float


@dataclass(frozen=True)
class Advice:
    """What to add; None where nothing of the kind suffices.

    Parameters
    ----------
    sine : Addition or None
        The smallest sine that suffices.
    multiple : Addition or None
        The smallest multiple of the input that suffices.
    largest : float
        Largest amplitude of a sine that was tried, in the input's unit; 0 if none was.
    rule : tuple of float or None
        Amplitude and angular frequency (rad/s) of a sine by rule of thumb, where the log yields no
        model to try others on.
    """

    sine: Addition | None
    multiple: Addition | None
    largest: float
    rule: tuple[float, float] | None = None


@dataclass(frozen=True, eq=False)
class Rehearsal:
    """The estimated model, ready to run under other inputs.

    Parameters
    ----------
    system : ParametricSystem
        The model.
    values : array, shape (k,)
        Its coefficients.
    noise : array, shape (n_rows,)
        Standard deviation of each position's noise.
    hold : {"zero", "linear"}
        Hold of the inputs.
    filter_rate : float
        Rate in 1/s at which the excitation is measured.
    segment_duration : float
        In s.
    input_unit : str
        Unit of the input.
    """

    system: ParametricSystem
    values: FloatArray
    noise: FloatArray
    hold: Hold
    filter_rate: float
    segment_duration: float
    input_unit: str

    def first_state(self, samples: Samples) -> FloatArray:
        """State at the start of a record."""
        return first_states(divide([samples], self.segment_duration))[0]

    def motion(self, start: FloatArray, inputs: FloatArray, sample_time: float) -> FloatArray:
        """States under an input, shape (n, n_states)."""
        coefficients = dict(zip(self.system.coefficients, self.values.tolist(), strict=True))
        return free_run(self.system, coefficients, start, inputs, sample_time, self.hold)

    def assessment(self, samples: Samples, repeats: float) -> Assessment:
        """What a motion would tell if as much of it were recorded `repeats` times."""
        segments = divide([samples], self.segment_duration)
        states = first_states(segments)
        once = segmented_information(
            self.system, self.values, segments, states, self.noise, self.hold
        )
        information = Information(
            once.names, once.values, once.matrix * repeats, once.covariance / repeats
        )
        fit = filtered_least_squares([samples], self.system, self.filter_rate, self.hold)
        return assess(information, fit, self.input_unit)


@dataclass(frozen=True, eq=False)
class _Trial:
    """A record that other inputs are tried on.

    What the model does under another input less what it does under the recorded one is added to
    the measured motion, so that an addition of nothing leaves the log as it is.
    """

    rehearsal: Rehearsal
    record: Samples
    repeats: float
    start: FloatArray
    recorded_run: FloatArray

    def __call__(self, inputs: FloatArray, amplitude: float, rate: float) -> Addition | None:
        """The addition if it suffices, else None."""
        record = self.record
        try:
            run = self.rehearsal.motion(self.start, inputs, record.sample_time)
            change = run - self.recorded_run
            samples = replace(
                record,
                positions=record.positions + change[:, ::2],
                velocities=None
                if record.velocities is None
                else record.velocities + change[:, 1::2],
                inputs=inputs,
            )
            found = self.rehearsal.assessment(samples, self.repeats)
        except SimulationError:
            return None
        if found.status != "determined":
            return None
        weakest, positions = found.weakest, samples.positions
        return Addition(
            amplitude,
            rate,
            weakest.name,
            weakest.relative_deviation,
            float(np.abs(inputs).max()),
            float(np.abs(positions[:, 0]).max()),
            float(np.abs(positions[:, 0] - positions[:, 1]).max()),
        )


def advise(rehearsal: Rehearsal, pieces: Sequence[Samples]) -> Advice:
    """Search the smallest addition after which every coefficient is determined.

    Parameters
    ----------
    rehearsal : Rehearsal
        The model, as estimated.
    pieces : sequence of Samples
        The log, with velocities.

    Returns
    -------
    Advice
    """
    record = _beginning(max(pieces, key=len))
    size = float(np.sqrt(np.mean(record.inputs**2)))
    repeats = sum(len(p) * p.sample_time for p in pieces) / (len(record) * record.sample_time)
    start = rehearsal.first_state(record)
    try:
        run = rehearsal.motion(start, record.inputs, record.sample_time)
    except SimulationError:
        return rule_of_thumb(pieces)
    trial = _Trial(rehearsal, record, repeats, start, run)
    time = record.sample_time * np.arange(len(record), dtype=np.float64)
    best = None
    for rate in _rates(rehearsal, record).tolist():
        wave = np.sin(rate * time)[:, None]
        best = (
            _smallest(
                lambda a, wave=wave, rate=rate: trial(record.inputs + a * wave, a, rate),
                _LEAST * size,
                _MOST * size if best is None else best.amplitude,
            )
            or best
        )
    multiple = _smallest(lambda a: trial(a * record.inputs, a, 0.0), 1.0, _MOST)
    return Advice(best, multiple, _MOST * size)


def _beginning(piece: Samples) -> Samples:
    """As much of a piece as is run again and again."""
    count = min(len(piece), int(_LONGEST / piece.sample_time))
    return replace(
        piece,
        positions=piece.positions[:count],
        velocities=None if piece.velocities is None else piece.velocities[:count],
        inputs=piece.inputs[:count],
    )


def rule_of_thumb(pieces: Sequence[Samples]) -> Advice:
    """A second tone beside the strongest one of the input, whatever the drive."""
    spectrum = input_spectrum(max(pieces, key=len))
    place = int(np.argmax(spectrum[1]))
    rate, amplitude = map(float, spectrum[:, place])
    return Advice(None, None, 0.0, (_RULE_AMPLITUDE * amplitude, _RULE_FREQUENCY * rate))


def input_spectrum(piece: Samples) -> FloatArray:
    """Angular frequency in rad/s and amplitude of the first input's tones, shape (2, m).

    A Hann window keeps tones that do not fit the record from spreading.
    """
    signal = piece.inputs[:, 0] - piece.inputs[:, 0].mean()
    window = np.hanning(len(signal))
    amplitudes = 2.0 * np.abs(np.fft.rfft(signal * window)) / window.sum()
    rates = 2.0 * np.pi * np.fft.rfftfreq(len(signal), piece.sample_time)
    return np.asarray((rates[1:], amplitudes[1:]), dtype=np.float64)


def _smallest(
    tried: Callable[[float], Addition | None], least: float, most: float
) -> Addition | None:
    """Raise an amplitude until it suffices, go half the way back a few times, add a margin."""
    amplitude, found = least, None
    while amplitude <= most and found is None:
        found = tried(amplitude)
        amplitude *= _STEP
    if found is None:
        return None
    enough, too_little = found.amplitude, found.amplitude / _STEP
    for _ in range(_REFINEMENTS):
        middle = float(np.sqrt(enough * too_little))
        nearer = tried(middle)
        if nearer is None:
            too_little = middle
        else:
            enough, found = middle, nearer
    return tried(_MARGIN * enough) or found


def _rates(rehearsal: Rehearsal, piece: Samples) -> FloatArray:
    """Angular frequencies in rad/s from a few periods per record to beyond the resonance."""
    kernel = free_run_kernel(rehearsal.system)
    constants = np.array(list(rehearsal.system.constants.values()), dtype=np.float64)
    resting = np.zeros(len(rehearsal.system.states))
    still = np.zeros(piece.inputs.shape[1])
    matrix = jacobian(kernel, resting, still, rehearsal.values, constants)
    duration = len(piece) * piece.sample_time
    slowest = 2.0 * np.pi * _PERIODS / duration
    poles = np.linalg.eigvals(matrix) if np.isfinite(matrix).all() else np.zeros(1)
    fastest = min(
        _BEYOND_RESONANCE * float(np.abs(np.imag(poles)).max()),
        2.0 * np.pi / (_SAMPLES_PER_PERIOD * piece.sample_time),
    )
    exponents = np.linspace(np.log(slowest), np.log(max(fastest, 4.0 * slowest)), _FREQUENCIES)
    return np.asarray(np.exp(exponents), dtype=np.float64)
