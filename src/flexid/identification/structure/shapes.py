"""Terms whose constants follow from the log: ripple, Stribeck friction, a spring that bends.

Cogging, the teeth of a gear and an uneven commutation act on the motor as a sine of its position.
What least squares of the motor's row leaves, summed over the position, shows in its spectrum how
many periods such a sine may have in a turn, unless there are but a few in the whole motion.
Friction falls off its static value as the motor moves. A spring has another stiffness beyond some
deflection, as catalogues of gears have it.

A term of that kind joins the model where the usual terms leave more than noise, with the constant
that promises to explain most of it; from there the fit finds both.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from operator import itemgetter

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import ConvergenceError
from flexid.estimators.samples import side_by_side
from flexid.identification.full_model.fits_by_length import (
    FOLLOWED,
    FitsByLength,
    explained_by,
    leaves_more,
    promised,
    sampled,
    turning,
)
from flexid.identification.full_model.fitting import fit_by_length
from flexid.identification.full_model.model import Data, Fitted, Structure
from flexid.identification.full_model.starting import least_squares_start
from flexid.identification.preparation.joint import Joint
from flexid.identification.structure.gap import about_its_own_centre, as_wide_as_its_gap
from flexid.identification.vocabulary import Progress
from flexid.identification.vocabulary.evidence import Estimate
from flexid.identification.vocabulary.thresholds import Thresholds
from flexid.models.flexible_joint import (
    BEND_DEFLECTION,
    RIPPLE_NUMBER,
    SHAPE_TERMS,
    SOUGHT_CONSTANTS,
    SPRING,
    SPRING_CENTRE,
    STRIBECK_VELOCITY,
)

_AROUND = np.linspace(-0.4, 0.4, 5)  # of the resolution


@dataclass(frozen=True)
class SoughtShape:
    """A term with a constant that is sought."""

    words: str  # what it describes
    coefficients: frozenset[str]  # of the term, those that follow from others and the constant too
    constant: str  # the constant's name in the model
    # constants that a structure and its data speak for; none where nothing moves
    candidates: Callable[[Structure, Data], list[float]]
    # how far apart two constants are, near that of a joint, which its data distinguish at a glance
    resolution: Callable[[Joint, Data], float]
    # what a constant has to exceed, to be seen beside a fit
    least: Callable[[Fitted], float] = lambda _: 0.0

    def of(self, structure: Structure) -> float:
        """The constant of a structure."""
        return structure.joint.first[self.constant]

    def put(self, structure: Structure, value: float) -> Structure:
        """The structure with another constant."""
        return replace(structure, joint=structure.joint.with_widths({self.constant: value}))

    def is_seen_in(self, fitted: Fitted) -> bool:
        """Whether the constant of a fit is large enough to be seen."""
        return self.of(fitted.structure) > self.least(fitted)

    def is_in(self, fitted: Fitted) -> bool:
        """Whether a fit has the term, its coefficients sought or given."""
        structure = fitted.structure
        leading = (self.coefficients & structure.joint.shapes) - structure.joint.ties.keys()
        return bool(leading - structure.absent)


def fit_with_shape(
    shape: SoughtShape,
    by_length: FitsByLength,
    before: Fitted,
    chosen: Sequence[Fitted],
    progress: Progress,
    thresholds: Thresholds,
) -> FitsByLength | None:
    """Fit a joint with a term more where one without leaves more than noise.

    Returns none where the term hardly helps, or something else does so better.
    """
    full = by_length.found[-1].structure
    if shape.coefficients.isdisjoint(full.joint.shapes):
        return None
    progress(shape.words)
    floor = thresholds.noise_floor(by_length.found[0].excess)
    for promise, structure in _promising(shape, sampled(before), full):
        if promise < thresholds.shape_promise:
            continue
        way = before.by_name
        first = explained_by(before, structure, way, floor, thresholds, shape.is_seen_in)
        if first is not None:
            worse = leaves_more(first, chosen, thresholds)
            return None if worse else _fit_longer(first, by_length, thresholds)
    return None


def fit_requested_shape(
    shape: SoughtShape, by_length: FitsByLength, progress: Progress, thresholds: Thresholds
) -> FitsByLength:
    """Fit a joint with a term more whatever it explains, since somebody asked for it.

    A log that hardly shows the term says nothing of its constant, which then stays: from where the
    motion does not reach, it would let the coefficients be anything.
    """
    progress(shape.words)
    before = turning(by_length.found, thresholds) or by_length.found[-1]
    promising = [*_promising(shape, before, by_length.found[-1].structure)]
    if not promising:
        raise ConvergenceError(
            "prediction error", f"nothing moves that would show {shape.words}: drop the term"
        )
    promise, structure = max(promising, key=itemgetter(0))
    if promise < thresholds.shape_promise:
        held = {shape.constant: shape.of(structure)}
        structure = replace(structure, fixed={**structure.fixed, **held})
    (first,) = fit_by_length(structure, before.data, before.by_name, [before.problem.segments])
    return _fit_longer(first, by_length, thresholds)


def _fit_longer(first: Fitted, by_length: FitsByLength, thresholds: Thresholds) -> FitsByLength:
    """Fits over longer segments, with the hold that suits the log."""
    return by_length.with_term([first, *by_length.longer(first, thresholds)], thresholds)


def _promising(
    shape: SoughtShape, before: Fitted, full: Structure
) -> Iterator[tuple[float, Structure]]:
    """Structures with the term and the constants that promise most, the most promising first."""
    structure = replace(full, absent=full.absent - shape.coefficients)
    structure = structure.with_hold(before.structure.timing.hold)
    constants = shape.candidates(before.structure, before.data)
    constants = [value for value in constants if value > shape.least(before)]
    promises = side_by_side(lambda value: _promised(before, shape.put(structure, value)), constants)
    promising = zip(promises, constants, strict=True)
    most = sorted(promising, key=itemgetter(0), reverse=True)[:FOLLOWED]
    for _, value in most:
        yield max(_near(shape, before, structure, value), key=itemgetter(0))


def _promised(before: Fitted, structure: Structure) -> float:
    return promised(before, structure, before.by_name)


def _near(
    shape: SoughtShape, before: Fitted, structure: Structure, value: float
) -> list[tuple[float, Structure]]:
    """What constants within the resolution promise, and structures with them."""
    resolution = shape.resolution(shape.put(structure, value).joint, before.data)
    constants = (value + _AROUND * resolution).tolist()
    near = [shape.put(structure, away) for away in constants if away > shape.least(before)]
    return side_by_side(lambda own: (_promised(before, own), own), near)


_MOTOR = 1  # row and position
_RATES = (60.0, 200.0)  # 1/s, of the filters of least squares
_PEAKS = 4  # of a spectrum
_LARGEST = {"revolute": 500.0, "prismatic": 2e3 * np.pi}  # periods in a turn; in 2π m, of 1 mm each
_FASTEST = 0.5  # rad in a sampling interval, at the motor's usual velocity
_FEW = (1.0, 1.75, 2.5, 3.25, 4.0)  # periods in the range of the motion, which make no sharp peak
_FEWEST = 1.0  # periods in the range of the motion: fewer are any slow function of the position
_FINER = 8  # times the resolution of a spectrum
_BINS = 8  # in a period of the largest number
_MOST_BINS = 2**18  # of a spectrum, however many turns there are
# Stribeck velocities, of the motor's root mean square; and of one, to the next one that the data
# distinguish at a glance.
_VELOCITIES, _NEXT_VELOCITY = (0.005, 0.01, 0.02, 0.04, 0.08, 0.16, 0.32, 0.64), 0.8
# Bends, of the deflection's standard deviation; counted from its mean, which a preload moves.
_DEFLECTIONS, _NEXT_DEFLECTION = (0.0, 0.3, 0.5, 0.7, 1.0, 1.4, 2.0), 0.4
_LEAST_DEFLECTION = 0.2  # the same: a bend at less passes for friction
_BENDS = (*SHAPE_TERMS["bent_spring"].link, *SHAPE_TERMS["bent_spring"].motor)
_SLACK = 0.01  # of the stiffness beyond the bend: of what is so soft below it nothing is known


def _apart_in_number(_: Joint, data: Data) -> float:
    """Difference of two numbers of periods in a turn: one period over the whole motion."""
    return 2.0 * np.pi / _range(data)


def _range(data: Data) -> float:
    """How far the motor moved, in rad."""
    positions = [recording.positions[:, _MOTOR] for recording in data.samples]
    return float(max(p.max() for p in positions) - min(p.min() for p in positions))


def numbers(structure: Structure, data: Data) -> list[float]:
    """Periods in a turn of which what least squares leaves may have some."""
    if not _range(data) > 0.0:
        return []
    apart = _apart_in_number(structure.joint, data)
    found = [few * apart for few in _FEW]
    for number in (peak for rate in _RATES for peak in _peaks(structure, data, rate)):
        if all(abs(number - other) > 0.5 * apart for other in found):
            found.append(number)
    return found


def _peaks(structure: Structure, data: Data, rate: float) -> list[float]:
    """Where the spectrum of what the motor's row leaves, by the position, has its largest peaks."""
    velocities = [structure.joint.both_sides(s)[1][:, _MOTOR] for s in data.samples]
    speed = float(np.sqrt(np.mean(np.concatenate(velocities) ** 2)))
    largest = _LARGEST[structure.joint.type]
    fastest = _FASTEST / max(speed * data.samples[0].sample_time, _FASTEST / largest)
    most = min(fastest, _MOST_BINS / _BINS * _apart_in_number(structure.joint, data))
    bin_width = 2.0 * np.pi / (_BINS * most)
    lowest = min(s.positions[:, _MOTOR].min() for s in data.samples)
    left = np.zeros(int(_range(data) / bin_width) + 1)
    row = least_squares_start(structure, data, rate)[1].rows[_MOTOR]
    residual, first = row.left_hand_side - row.fitted, 0
    for recording in data.samples:
        positions = recording.positions[1:-1, _MOTOR]
        own = residual[first : first + len(positions)]
        first += len(positions)
        back = _backwards(own, float(np.exp(-rate * recording.sample_time)))
        places = ((positions - lowest) / bin_width).astype(np.int64)
        left += np.bincount(places, weights=back, minlength=len(left))
    padded = _FINER * len(left)
    power = np.abs(np.fft.rfft(left, padded)) ** 2
    number = 2.0 * np.pi * np.arange(len(power)) / (padded * bin_width)
    usable = (number <= most) & (number >= _FEWEST * _apart_in_number(structure.joint, data))
    inner = np.flatnonzero((power[1:-1] > power[:-2]) & (power[1:-1] >= power[2:])) + 1
    inner = inner[usable[inner]]
    return number[inner[np.argsort(-power[inner])][:_PEAKS]].tolist()


def _backwards(signal: FloatArray, pole: float) -> FloatArray:
    """A signal backwards through the filter that delayed it: what it holds acts where it arose."""
    padded = 2 * len(signal)
    turns = np.exp(-2j * np.pi * np.arange(padded // 2 + 1) / padded)
    response = ((1.0 - pole) / (1.0 - pole * turns)) ** 2
    spectrum = np.fft.rfft(signal, padded) * response.conj()
    return np.fft.irfft(spectrum, padded)[: len(signal)]


RIPPLE = SoughtShape(
    "ripple of the torque",
    frozenset(SHAPE_TERMS["torque_ripple"].coefficients),
    RIPPLE_NUMBER,
    numbers,
    _apart_in_number,
)
"""Ripple, and the number of its periods in a turn."""


def _apart_in_velocity(joint: Joint, _: Data) -> float:
    """Difference of two Stribeck velocities, in rad/s: it grows with the velocity itself."""
    return _NEXT_VELOCITY * joint.first[STRIBECK_VELOCITY]


def velocities(structure: Structure, data: Data) -> list[float]:
    """Velocities in rad/s over which static friction may fall off."""
    sides = (structure.joint.both_sides(recording)[1] for recording in data.samples)
    usual = float(np.sqrt(np.mean(np.concatenate([v[:, _MOTOR] for v in sides]) ** 2)))
    return [share * usual for share in _VELOCITIES] if usual > 0.0 else []


def _lost_in_a_sample(fitted: Fitted) -> float:
    """Velocity in rad/s that dry friction alone takes from the motor between two samples.

    A friction that falls off over less changes faster than the log was sampled.
    """
    sample_time = max(samples.sample_time for samples in fitted.data.samples)
    return abs(fitted.by_name.get("alpha_coulomb", 0.0)) * sample_time


STRIBECK = SoughtShape(
    "friction that falls off its static value",
    frozenset(SHAPE_TERMS["motor_stribeck"].coefficients),
    STRIBECK_VELOCITY,
    velocities,
    _apart_in_velocity,
    _lost_in_a_sample,
)
"""Stribeck friction of the motor, and its velocity."""


def _deflection(joint: Joint, data: Data) -> tuple[float, float]:
    """Mean of the deflection, and its standard deviation, in rad."""
    every = joint.deflections(data.samples)
    return float(np.mean(every)), float(np.std(every))


def _apart_in_deflection(joint: Joint, data: Data) -> float:
    """Difference of two deflections at which a spring may bend, in rad."""
    return _NEXT_DEFLECTION * _deflection(joint, data)[1]


def deflections(structure: Structure, data: Data) -> list[float]:
    """Deflections at which the spring may bend, in rad."""
    mean, usual = _deflection(structure.joint, data)
    if not usual > 0.0:
        return []
    mean -= structure.joint.extended.constants[SPRING_CENTRE]
    tried = {abs(mean) + way * share * usual for share in _DEFLECTIONS for way in (-1.0, 1.0)}
    return sorted(deflection for deflection in tried if deflection >= _LEAST_DEFLECTION * usual)


BEND = SoughtShape(
    "a spring that bends",
    frozenset(SHAPE_TERMS["bent_spring"].coefficients),
    BEND_DEFLECTION,
    deflections,
    _apart_in_deflection,
)
"""A bent spring, and the deflection at which it bends."""


def is_slack(fitted: Fitted) -> bool:
    """Whether a bent spring has hardly any stiffness below its bend, as one with play has."""
    values = {**fitted.structure.fixed, **fitted.by_name}
    springs = zip(map(values.get, SPRING), map(values.get, _BENDS), strict=True)
    known = [(below, more) for below, more in springs if below is not None and more is not None]
    return bool(known) and all(below <= _SLACK * (below + more) for below, more in known)


SOUGHT = (STRIBECK, RIPPLE, BEND)
"""Terms that join the model by themselves, each with a constant that is sought."""

SOUGHT_COEFFICIENTS = frozenset(c for shape in SOUGHT for c in shape.coefficients)
"""Their coefficients."""


def settled(fitted: Fitted) -> Fitted:
    """A fit whose play is as wide as its gap, and whose spring is about its own centre."""
    return as_wide_as_its_gap(about_its_own_centre(fitted))


def sought_constants(
    estimate: Estimate, structure: Structure
) -> dict[str, tuple[float, float, float]]:
    """Value, standard deviation and degrees of freedom of each constant that was sought.

    Of one that was held nothing is known.
    """
    held = SOUGHT_CONSTANTS & structure.fixed.keys()
    found = {name: (structure.fixed[name], np.inf, 0.0) for name in sorted(held)}
    return found | {name: estimate.of(name) for name in estimate.names if name in SOUGHT_CONSTANTS}
