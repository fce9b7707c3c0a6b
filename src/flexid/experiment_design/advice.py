"""What to add to an input so that its motion determines every coefficient.

The identified model runs under the recorded input with one sine more, or under a multiple of the
input, and what that motion would determine is judged like the log itself. The smallest addition
after which every coefficient counts as determined, and a margin, is the advice. Where the log does
not even yield a model that could be run, or where it is not the motion that is lacking, the advice
is a sentence.

What another input would tell is computed from the model's motion as the prediction error sees it:
with the delays that are sought, over segments of the same length, in noise as large as the log's
residuals. On the log itself that gives a standard deviation which the identification's exceeds, as
residuals are correlated and no model is right; by that factor the prediction for another input is
made larger, too.
"""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from flexid.analysis.excitation import information_at
from flexid.arrays import FloatArray
from flexid.errors import SimulationError
from flexid.estimators.channel_timing import INPUT
from flexid.estimators.samples import Samples
from flexid.estimators.segmented_motion import Point, SegmentedMotion
from flexid.estimators.segments import Segments, divide, first_states
from flexid.identification.estimation.excitations import row_sizes
from flexid.identification.full_model.fitting import motion_at
from flexid.identification.full_model.model import LINK, Data, Structure
from flexid.identification.full_model.starting import least_squares_start
from flexid.identification.judgement.estimates import verdict
from flexid.identification.result.identification import Identification
from flexid.identification.structure.validation import following_states
from flexid.identification.vocabulary.evidence import CoefficientEstimate, Verdict
from flexid.identification.vocabulary.intervals import POSITIVE, interval
from flexid.identification.vocabulary.thresholds import THRESHOLDS
from flexid.stored_estimates.structure import structure_of, values_of


@dataclass(frozen=True)
class Outlook:
    """What a motion would tell."""

    widths: Mapping[str, float]  # half the predicted 95 % intervals over the values
    verdicts: Mapping[str, Verdict]

    @property
    def enough(self) -> bool:
        """Whether every coefficient would be determined."""
        return all(verdict == "determined" for verdict in self.verdicts.values())

    @property
    def weakest(self) -> str:
        """The coefficient with the widest interval."""
        return max(self.widths, key=lambda name: self.widths[name])


@dataclass(frozen=True, eq=False)
class Rehearsal:
    """A model as identified, and the log that other inputs are tried on."""

    result: Identification
    data: Data  # all that was measured
    noise: FloatArray  # (n_rows,): standard deviation of each position's residual

    @cached_property
    def _longest(self) -> int:
        """Place of the longest recording, whose beginning is the record."""
        return max(range(len(self.data.samples)), key=lambda i: len(self.data.samples[i]))

    @cached_property
    def record(self) -> Samples:
        """As much of the longest recording as is run again and again."""
        recording = self.data.samples[self._longest]
        count = min(len(recording), int(_LONGEST / recording.sample_time))
        return replace(
            recording,
            positions=recording.positions[:count],
            velocities=None,
            inputs=recording.inputs[:count],
        )

    @cached_property
    def values(self) -> Mapping[str, float]:
        """Coefficients, of the log that the record comes from."""
        return values_of(self.result, self.data.groups[self._longest])

    @cached_property
    def structure(self) -> Structure:
        """The model."""
        return structure_of(self.result, self.values, given=self.result.given)

    @property
    def fastest(self) -> float:
        """Angular frequency in rad/s of the joint's resonance, or else of the pendulum."""
        p = self.values
        squares = (
            p.get("theta2", 0.0) + p.get("alpha1", 0.0),
            p.get("theta1", 0.0),
            p.get("gamma1", 0.0),
        )
        return float(np.sqrt(max(0.0, *squares)))

    @property
    def repeats(self) -> float:
        """Length of all recordings over that of the record."""
        return self.data.duration / (len(self.record) * self.record.sample_time)

    def change(self, inputs: FloatArray) -> FloatArray:
        """What other inputs change about the positions, shape (n, n_rows), by the model."""
        return self._run(inputs) - self._recorded

    def outlook(self, change: FloatArray, inputs: FloatArray) -> Outlook:
        """What a changed motion would tell if as much of it were recorded as there was in all."""
        factors = self._factors
        moved = first_states(divide([replace(self.record, positions=change)], self._duration))
        states = self._states.copy()
        states[:, : moved.shape[1]] += moved  # what a model remembers of its path stays
        deviations = self._deviations(states, inputs)
        return self._judged({name: factors[name] * std for name, std in deviations.items()})

    @cached_property
    def _duration(self) -> float:
        return self.result.choices.segment_duration or self.data.duration

    @cached_property
    def _states(self) -> FloatArray:
        """States at the start of each segment of the log."""
        segments = divide([self.record], self._duration)
        problem, point = self._motion(segments)
        return following_states(problem, point.values, segments)

    def _motion(
        self, segments: Segments, sought: Collection[str] = ()
    ) -> tuple[SegmentedMotion, Point]:
        """The model over segments, and where to begin; of what is sought, delays are, too."""
        timing = self.structure.timing
        delays = tuple(name for name in (INPUT, LINK) if name in sought)
        structure = replace(self.structure, timing=replace(timing, sought=delays))
        data = replace(self.data, noise=self.noise, groups=())
        return motion_at(structure, data, segments, {**timing.delays, **self.values}, None)

    def _run(self, inputs: FloatArray) -> FloatArray:
        """Positions under an input from the start of the record on."""
        whole = divide([replace(self.record, inputs=inputs)], self.data.duration)
        problem, point = self._motion(whole)
        equations = problem.equations(replace(point, initial_states=self._states[:1]), "nothing")
        if not np.isfinite(equations.cost):
            raise SimulationError("the model's motion diverges: see its coefficients", 0.0)
        return problem.on_time(point.values) - equations.residuals

    @cached_property
    def _recorded(self) -> FloatArray:
        return self._run(self.record.inputs)

    @cached_property
    def _of_the_log(self) -> dict[str, float]:
        return self._deviations(self._states, self.record.inputs)

    @cached_property
    def _factors(self) -> dict[str, float]:
        """Standard deviations of the identification over the prediction for its own log."""
        found = {}
        for name, predicted in self._of_the_log.items():
            estimate = self._estimate(name)
            factor = estimate.std / predicted if predicted > 0.0 else np.inf
            found[name] = factor if np.isfinite(factor) and factor > 0.0 else np.nan
        usable = [factor for factor in found.values() if np.isfinite(factor)]
        middle = float(np.median(usable)) if usable else 1.0
        return {name: f if np.isfinite(f) else middle for name, f in found.items()}

    def _estimate(self, name: str) -> CoefficientEstimate:
        coefficients = self.result.coefficients
        own = f"{name}[{self.data.groups[self._longest] + 1}]"
        return coefficients[own if own in coefficients else name]

    def _deviations(self, states: FloatArray, inputs: FloatArray) -> dict[str, float]:
        """Standard deviations of the coefficients in white noise, segments starting from states."""
        segments = divide([replace(self.record, inputs=inputs)], self._duration)
        problem, point = self._motion(segments, self.result.fit.names)
        point = replace(point, initial_states=states)
        information = information_at(problem, point)
        deviations = information.standard_deviations / np.sqrt(self.repeats)
        by_name = dict(zip(information.names, deviations.tolist(), strict=True))
        return {name: by_name[name] for name in self.structure.unknowns(()).names}

    @cached_property
    def _sizes(self) -> dict[str, float]:
        """What each coefficient that may be absent does to its row in the log."""
        joint, rate = self.structure.joint, self.result.choices.filter_rate
        sizes = row_sizes(least_squares_start(self.structure, self.data, rate)[1].rows)
        return {name: size for name, size in sizes.items() if name in joint.optional}

    def _judged(self, deviations: Mapping[str, float]) -> Outlook:
        fit = self.result.fit
        freedom = dict(zip(fit.names, fit.degrees_of_freedom, strict=True))
        least = min((f for f in freedom.values() if f > 0.0), default=1.0)
        widths, verdicts = {}, {}
        for name, std in deviations.items():
            now = self._estimate(name)
            of_fit = freedom.get(now.name, least)
            ends = interval(now.value, std, of_fit if of_fit > 0.0 else least)
            half = 0.5 * (ends[1] - ends[0])
            effect = half * self._sizes[name] if name in self._sizes else np.inf
            verdicts[name], _ = verdict(now.value, ends, effect)
            widths[name] = half / abs(now.value) if now.value else np.inf
        return Outlook(widths, verdicts)


_FREQUENCIES = 12  # tried, evenly spaced on a logarithmic scale
_LONGEST = 20.0  # s of the record that are run; the rest holds as much information per second
_PERIODS = 4.0  # of the slowest sine in the record
_BEYOND_RESONANCE = 2.0  # times the fastest pole, for the fastest sine
_SAMPLES_PER_PERIOD = 20.0
_LEAST, _MOST = 1 / 16, 32.0  # size of an addition, over the input's root mean square
_STEP = 4.0  # between one amplitude and the next
_REFINEMENTS = 4  # halvings of the last step, on a logarithmic scale
_MARGIN = 1.25  # on amplitude or length: the next log has other noise
_FARTHEST = 10.0  # times the log's own reach, or turns: beyond, the model is not trusted
_MOST_TIMES = 100.0  # the length of the log
# This brings the condition number of the joint of Huang (2003), Table I, near 1.
_NO_MODEL = (
    "The log yields no model to try inputs on. As a rule, add a second tone at 2.65 times the "
    "frequency of the strongest one and a fifth of its amplitude, record 5 s or more, look again"
)


@dataclass(frozen=True)
class Addition:
    """A change of the input after which every coefficient would be determined."""

    amplitude: float  # of the added sine in the input's unit, or the factor on the input
    angular_frequency: float  # of the added sine in rad/s; 0 for a factor on the input
    weakest: str  # the coefficient that would be known worst
    width: float  # half its predicted 95 % interval over its value
    peak_input: float  # magnitude
    peak_position: float  # rad, of the first row: the link's, where there are two encoders
    peak_deflection: float  # rad


@dataclass(frozen=True)
class Advice:
    """What to add; None where nothing of the kind suffices."""

    sine: Addition | None = None  # smallest that suffices
    multiple: Addition | None = None  # smallest that suffices
    longer: float | None = None  # s of the same motion that suffice
    largest: float = 0.0  # amplitude of a sine that was tried, in the input's unit; 0 for none
    caution: str = ""  # a sentence on what no addition mends; or empty


def _sufficient(
    rehearsal: Rehearsal, inputs: FloatArray, amplitude: float, rate: float
) -> Addition | None:
    """A change of the inputs as an addition, if it suffices.

    What the model does under another input less what it does under the recorded one is added to
    the measured motion, so that an addition of nothing leaves the log as it is.
    """
    try:
        change = rehearsal.change(inputs)
        found = rehearsal.outlook(change, inputs)
    except SimulationError:
        return None
    if not found.enough:
        return None
    own = rehearsal.record.positions
    positions = own + change
    if np.abs(positions).max() > _FARTHEST * max(2.0 * np.pi, float(np.abs(own).max())):
        return None
    return Addition(
        amplitude,
        rate,
        found.weakest,
        found.widths[found.weakest],
        float(np.abs(inputs[:, 0]).max()),
        float(np.abs(positions[:, 0]).max()),
        float(np.abs(positions[:, 0] - positions[:, -1]).max()),
    )


def advise(result: Identification, data: Data, noise: FloatArray) -> Advice | None:
    """Say what to add to the input of a log, with the noise of each position, shape (n_rows,)."""
    lacking = [c for c in result.coefficients.values() if c.verdict != "determined"]
    if not lacking:
        return None
    impossible = any(n in POSITIVE and c.value <= 0.0 for n, c in result.coefficients.items())
    if impossible or not all(np.isfinite(c.std) for c in lacking):
        return Advice(caution=_NO_MODEL)  # guessed values do not predict other motions
    if all(verdict(c.value, c.interval)[0] == "determined" for c in lacking):
        return Advice(caution=f"Another input does not help: {lacking[0].reason}")
    rehearsal = Rehearsal(result, data, noise)
    try:
        advice = _tried(rehearsal)
    except SimulationError:
        return Advice(caution=_NO_MODEL)
    return replace(advice, caution=_caution(result))


def _tried(rehearsal: Rehearsal) -> Advice:
    """The smallest additions that suffice."""
    record = rehearsal.record
    size = float(np.sqrt(np.mean(record.inputs[:, 0] ** 2)))
    time = record.sample_time * np.arange(len(record), dtype=np.float64)
    best = None
    for rate in _rates(rehearsal).tolist():
        wave = np.sin(rate * time)[:, None]
        if rehearsal.structure.joint.kind == "link":  # whose inputs are a position and its velocity
            wave = np.hstack((wave, rate * np.cos(rate * time)[:, None]))
        best = (
            _smallest(
                lambda a, wave=wave, rate=rate: _sufficient(
                    rehearsal, record.inputs + a * wave, a, rate
                ),
                _LEAST * size,
                _MOST * size if best is None else best.amplitude,
            )
            or best
        )
    multiple = _smallest(lambda a: _sufficient(rehearsal, a * record.inputs, a, 0.0), 1.0, _MOST)
    return Advice(best, multiple, _longer(rehearsal), _MOST * size)


def _longer(rehearsal: Rehearsal) -> float | None:
    """Seconds of the same motion that suffice; a wrong model stays wrong however long."""
    if rehearsal.result.model_error.share > 0.0:
        return None
    still = np.zeros_like(rehearsal.record.positions)
    now = rehearsal.outlook(still, rehearsal.record.inputs)
    lacking = [width for name, width in now.widths.items() if now.verdicts[name] != "determined"]
    times = _MARGIN * (max(lacking, default=0.0) / THRESHOLDS.determined_width) ** 2
    return times * rehearsal.data.duration if 1.0 < times <= _MOST_TIMES else None


def _caution(result: Identification) -> str:
    """What widens the intervals though the motion would do."""
    if result.unexplained:
        return (
            "The residuals show a part of the drive that no term here describes. It widens the "
            "intervals too: another motion narrows them less than predicted"
        )
    return ""


def _smallest(
    tried: Callable[[float], Addition | None], least: float, most: float
) -> Addition | None:
    """Raise an amplitude until it suffices, go half the way back a few times, add a margin."""
    amplitude, found = least, None
    while amplitude <= most and found is None:
        found = tried(amplitude)
        amplitude *= _STEP
    if found is None or found.amplitude == least:
        return found
    enough, too_little = found.amplitude, found.amplitude / _STEP
    for _ in range(_REFINEMENTS):
        middle = float(np.sqrt(enough * too_little))
        nearer = tried(middle)
        if nearer is None:
            too_little = middle
        else:
            enough, found = middle, nearer
    return tried(_MARGIN * enough) or found


def _rates(rehearsal: Rehearsal) -> FloatArray:
    """Angular frequencies in rad/s from a few periods per record to beyond the resonance."""
    record = rehearsal.record
    slowest = 2.0 * np.pi * _PERIODS / (len(record) * record.sample_time)
    fastest = min(
        _BEYOND_RESONANCE * rehearsal.fastest,
        2.0 * np.pi / (_SAMPLES_PER_PERIOD * record.sample_time),
    )
    exponents = np.linspace(np.log(slowest), np.log(max(fastest, 4.0 * slowest)), _FREQUENCIES)
    return np.asarray(np.exp(exponents), dtype=np.float64)
