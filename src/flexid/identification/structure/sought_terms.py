"""Terms that are sought one by one: of ripple, transmission, friction, springs and scales.

Most have a constant that is sought with them.

Cogging, gear teeth and uneven commutation act on the motor as a sine of its position. The residuals
of the motor's row are summed over the position. Their spectrum shows the number of periods in a
turn, unless the whole motion has only a few. A gear's error of angle acts likewise on the link
through the spring, once and twice per turn of the gear's input. Stribeck friction falls from its
static value as the motor moves. With presliding, friction follows a reversal only along a path. A
bent spring has another stiffness beyond some deflection, as in gear catalogues.
"""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from flexid.arrays import FloatArray
from flexid.identification.full_model.amplifier import shows_saturation
from flexid.identification.full_model.model import Data, Fitted, Structure
from flexid.identification.full_model.starting import least_squares_start
from flexid.identification.preparation.joint import Joint
from flexid.identification.structure.gap import with_other_damping
from flexid.identification.structure.shapes import ANY, SoughtShape
from flexid.identification.vocabulary.evidence import Estimate
from flexid.models.flexible_joint import (
    BEND_DEFLECTION,
    ERROR_NUMBER,
    HARDENING,
    HYSTERESIS,
    HYSTERESIS_GRIP,
    PRESLIDING_GRIP,
    RIPPLE_NUMBER,
    SATURATION,
    SHAPE_TERMS,
    SOUGHT_CONSTANTS,
    SPRING,
    SPRING_CENTRE,
    STRIBECK_EXPONENT,
    STRIBECK_VELOCITY,
)

_LINK, _MOTOR = 0, 1  # indices of rows and positions
_BY_LINK = frozenset({"link"})  # what disturbs the motor may look like the term in its balance
_RATES = (60.0, 200.0)  # 1/s, of the filters of least squares
_PEAKS = 4  # most peaks of a spectrum that are tried
_LARGEST = {"revolute": 500.0, "prismatic": 2e3 * np.pi}  # periods per turn, or per 2π m (1 mm)
_FASTEST = 0.5  # largest phase in rad per sample, at the motor's usual velocity
_FEW = (1.0, 1.75, 2.5, 3.25, 4.0)  # periods in the range of motion, too few for a sharp peak
_FEWEST = 1.0  # least periods in the range of motion; fewer are any slow function of the position
_FINER = 8  # zero-padding of a spectrum
_BINS = 8  # position bins in a period of the largest number
_MOST_BINS = 2**18  # of a spectrum
# Stribeck velocities over the motor's root mean square velocity.
_VELOCITIES = (0.005, 0.01, 0.02, 0.04, 0.08, 0.16, 0.32, 0.64, 1.28, 2.56)
_LARGEST_VELOCITY = 3.0  # of Stribeck over the motor's largest: friction falls by 0.1 up to there
# Reaches of presliding over the range of the motor's motion.
_REACHES = (1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2)
# Difference of a velocity or a grip to the next clearly distinguishable one, over itself.
_NEXT_ON_SCALE = 0.8
# Grips of the spring's hysteresis over the one that suits the motion; difference to the next.
_GRIPS, _NEXT_GRIP = (0.25, 0.5, 1.0, 2.0, 4.0), 0.2
# Bends over the deflection's standard deviation, counted from its mean, which a preload shifts.
_DEFLECTIONS, _NEXT_DEFLECTION = (0.0, 0.3, 0.5, 0.7, 1.0, 1.4, 2.0), 0.4
_LEAST_DEFLECTION = 0.2  # least bend, likewise: a smaller one looks like friction
_SCALE = SHAPE_TERMS["scale_error"]
_LARGEST_SCALE_ERROR = 0.1  # share of the motor's angle in the deflection
_BENDS = (*SHAPE_TERMS["bent_spring"].link, *SHAPE_TERMS["bent_spring"].motor)
# Stiffness below the bend over that beyond it, up to which the bend looks like play; among
# disturbances play of 1 to 3 mrad had up to 0.05.
_SLACK, _NEARLY_SLACK = 0.01, 0.1


def _apart_in_number(joint: Joint, data: Data) -> float:
    """Return the resolution of the periods per turn: one over the whole motion, inf at rest."""
    moved = _range(joint, data)
    return 2.0 * np.pi / moved if moved > 0.0 else np.inf


def _least_number(fitted: Fitted) -> float:
    """Return the least number of periods per turn that no slow function of the angle looks like."""
    return _FEW[-1] * _apart_in_number(fitted.structure.joint, fitted.data)


def _range(joint: Joint, data: Data) -> float:
    """Return the range of the motor's motion in rad."""
    positions = [joint.both_sides(recording)[0][:, _MOTOR] for recording in data.samples]
    return float(max(p.max() for p in positions) - min(p.min() for p in positions))


def numbers(structure: Structure, data: Data) -> list[float]:
    """Return candidate numbers of a ripple's periods in a turn, by the motor's residuals."""
    apart = _apart_in_number(structure.joint, data)
    if not np.isfinite(apart):
        return []
    few = [number * apart for number in _FEW]
    return _distinct([*few, *_all_peaks(structure, data, _MOTOR)], apart)


def error_numbers(structure: Structure, data: Data) -> list[float]:
    """Return candidate numbers of a transmission error's periods, by the link's residuals.

    A peak may be the second harmonic.
    """
    apart = _apart_in_number(structure.joint, data)
    if not np.isfinite(apart):
        return []
    peaks = _all_peaks(structure, data, _LINK)
    return _distinct([number for peak in peaks for number in (peak, 0.5 * peak)], apart)


def _distinct(numbers: Sequence[float], apart: float) -> list[float]:
    """Return the numbers that differ by more than half the resolution from all before."""
    found: list[float] = []
    for number in numbers:
        if all(abs(number - before) > 0.5 * apart for before in found):
            found.append(number)
    return found


def _all_peaks(structure: Structure, data: Data, side: int) -> list[float]:
    """Return the peaks in a row's residuals with each filter of least squares."""
    return [peak for rate in _RATES for peak in _peaks(structure, data, rate, side)]


def _peaks(structure: Structure, data: Data, rate: float, side: int) -> list[float]:
    """Return the largest peaks of the spectrum, over position, of a row's residuals."""
    joint = structure.joint
    motions = [joint.both_sides(samples) for samples in data.samples]
    places = [positions[:, _MOTOR] for positions, _ in motions]
    velocities = [velocities[:, _MOTOR] for _, velocities in motions]
    speed = float(np.sqrt(np.mean(np.concatenate(velocities) ** 2)))
    largest = _LARGEST[joint.type]
    fastest = _FASTEST / max(speed * data.samples[0].sample_time, _FASTEST / largest)
    most = min(fastest, _MOST_BINS / _BINS * _apart_in_number(joint, data))
    bin_width = 2.0 * np.pi / (_BINS * most)
    lowest = min(place.min() for place in places)
    left = np.zeros(int(_range(joint, data) / bin_width) + 1)
    row = least_squares_start(structure, data, rate)[1].rows[side]
    residual, first = row.left_hand_side - row.fitted, 0
    for recording, place in zip(data.samples, places, strict=True):
        positions = place[1:-1]
        own = residual[first : first + len(positions)]
        first += len(positions)
        back = _backwards(own, float(np.exp(-rate * recording.sample_time)))
        bins = ((positions - lowest) / bin_width).astype(np.int64)
        left += np.bincount(bins, weights=back, minlength=len(left))
    padded = _FINER * len(left)
    power = np.abs(np.fft.rfft(left, padded)) ** 2
    number = 2.0 * np.pi * np.arange(len(power)) / (padded * bin_width)
    usable = (number <= most) & (number >= _FEWEST * _apart_in_number(structure.joint, data))
    inner = np.flatnonzero((power[1:-1] > power[:-2]) & (power[1:-1] >= power[2:])) + 1
    inner = inner[usable[inner]]
    return number[inner[np.argsort(-power[inner])][:_PEAKS]].tolist()


def _backwards(signal: FloatArray, pole: float) -> FloatArray:
    """Return a signal filtered backwards, to undo the delay of the forward filter."""
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
    # One with fewer periods in the range of motion looks like gravity or an error of scales.
    is_plausible=lambda fitted: abs(fitted.by_name[RIPPLE_NUMBER]) >= _least_number(fitted),
)
"""Ripple, and the number of its periods in a turn."""

TRANSMISSION = SoughtShape(
    "error of the transmission",
    frozenset(SHAPE_TERMS["transmission_error"].coefficients),
    ERROR_NUMBER,
    error_numbers,
    _apart_in_number,
    _least_number,
    shown_in=_BY_LINK,
)
"""Error of the transmission, and the number of its periods in a turn.

With few periods in the motion it would look like any function of the position. The link of a real
arm without a gear seemed to have 4.7 periods per turn.
"""


def _apart_in_velocity(joint: Joint, _: Data) -> float:
    """Return the resolution of Stribeck velocities in rad/s, proportional to the velocity."""
    return _NEXT_ON_SCALE * joint.first[STRIBECK_VELOCITY]


def velocities(structure: Structure, data: Data) -> list[float]:
    """Return candidate Stribeck velocities in rad/s."""
    sides = (structure.joint.both_sides(recording)[1] for recording in data.samples)
    usual = float(np.sqrt(np.mean(np.concatenate([v[:, _MOTOR] for v in sides]) ** 2)))
    return [share * usual for share in _VELOCITIES] if usual > 0.0 else []


def _lost_in_a_sample(fitted: Fitted) -> float:
    """Return the change of velocity in rad/s by dry friction alone between two samples."""
    # Friction with a smaller Stribeck velocity would change faster than the log was sampled.
    sample_time = max(samples.sample_time for samples in fitted.data.samples)
    return abs(fitted.by_name.get("alpha_coulomb", 0.0)) * sample_time


def _falls(fitted: Fitted) -> bool:
    """Whether Stribeck friction falls, and by a tenth at least within the motor's velocities."""
    # Otherwise it stands for Coulomb friction, and its velocity grows without a limit.
    sides = (fitted.structure.joint.both_sides(samples)[1] for samples in fitted.data.samples)
    largest = max(float(np.abs(velocities[:, _MOTOR]).max()) for velocities in sides)
    velocity = abs(fitted.structure.joint.first[STRIBECK_VELOCITY])
    slow = velocity > _LARGEST_VELOCITY * largest and STRIBECK.is_in(fitted)
    return fitted.by_name.get("alpha_stribeck", np.inf) > 0.0 and not slow


STRIBECK = SoughtShape(
    "friction that falls off its static value",
    frozenset(SHAPE_TERMS["motor_stribeck"].coefficients),
    STRIBECK_VELOCITY,
    velocities,
    _apart_in_velocity,
    _lost_in_a_sample,
    laws=({STRIBECK_EXPONENT: 2.0}, {STRIBECK_EXPONENT: 1.0}),
    rare_laws=({STRIBECK_EXPONENT: 0.5},),
    is_possible=_falls,
    looks_like=frozenset(SHAPE_TERMS["motor_drag"].coefficients),
)
"""Stribeck friction of the motor, and its velocity."""


def grips(structure: Structure, data: Data) -> list[float]:
    """Return candidates of the grip of presliding in 1/rad, one over its reach."""
    moved = _range(structure.joint, data)
    return [1.0 / (share * moved) for share in _REACHES] if moved > 0.0 else []


def _is_resolved(fitted: Fitted) -> bool:
    """Whether presliding acts along a path longer than the encoder's noise.

    Along a shorter one it describes the sampled direction of motion. With presliding, friction that
    rises with the speed is a wrong minimum.
    """
    grip = fitted.structure.joint.first[PRESLIDING_GRIP]
    return STRIBECK.is_possible(fitted) and grip * float(fitted.data.noise[-1]) < 1.0


PRESLIDING = SoughtShape(
    "presliding friction",
    frozenset(SHAPE_TERMS["motor_presliding"].coefficients),
    PRESLIDING_GRIP,
    grips,
    lambda joint, _: _NEXT_ON_SCALE * joint.first[PRESLIDING_GRIP],
    in_place_of=STRIBECK.coefficients,
    is_possible=_is_resolved,
)
"""Presliding of the motor's friction, and one over the path along which friction reverses."""


def _deflection(joint: Joint, data: Data) -> tuple[float, float]:
    """Return mean and standard deviation of the deflection in rad."""
    every = joint.deflections(data.samples)
    return float(np.mean(every)), float(np.std(every))


def _apart_in_deflection(joint: Joint, data: Data) -> float:
    """Return the resolution of the deflection at which a spring bends, in rad."""
    return _NEXT_DEFLECTION * _deflection(joint, data)[1]


def deflections(structure: Structure, data: Data) -> list[float]:
    """Return candidate deflections in rad at which the spring may bend."""
    mean, usual = _deflection(structure.joint, data)
    if not usual > 0.0:
        return []
    mean -= structure.joint.constants[SPRING_CENTRE]
    tried = {abs(mean) + sign * share * usual for share in _DEFLECTIONS for sign in (-1.0, 1.0)}
    return sorted(deflection for deflection in tried if deflection >= _LEAST_DEFLECTION * usual)


def spring_grips(structure: Structure, data: Data) -> list[float]:
    """Return candidates of the grip of the spring's hysteresis in 1/rad, one over its reach."""
    usual = structure.joint.first[HYSTERESIS_GRIP]
    moves = _deflection(structure.joint, data)[1] > 0.0
    return [share * usual for share in _GRIPS] if moves else []


def _brakes(fitted: Fitted) -> bool:
    """Whether hysteresis brakes, along a path shorter than the range of the deflection.

    Along a longer one it acts like the spring, and follows a drift of the deflection.
    """
    values, grip = fitted.by_name, fitted.by_name.get(HYSTERESIS_GRIP)
    if any(values.get(name, 0.0) < 0.0 for name in HYSTERESIS):  # it would mean a gap
        return False
    if grip is None:  # it is still fixed
        return True
    return grip * float(np.ptp(fitted.structure.joint.deflections(fitted.data.samples))) > 1.0


HYSTERETIC = SoughtShape(
    "hysteresis of the spring",
    HYSTERESIS,
    HYSTERESIS_GRIP,
    spring_grips,
    lambda joint, _: _NEXT_GRIP * joint.first[HYSTERESIS_GRIP],
    shown_in=_BY_LINK,
    is_possible=_brakes,
)
"""Hysteresis of the spring, and one over the deflection along which its friction reverses."""

BEND = SoughtShape(
    "a spring that bends",
    frozenset(SHAPE_TERMS["bent_spring"].coefficients),
    BEND_DEFLECTION,
    deflections,
    _apart_in_deflection,
    in_place_of=HARDENING,
    is_plausible=lambda fitted: not is_slack(fitted, _NEARLY_SLACK),
)
"""A bent spring, and the deflection at which it bends."""


def is_slack(fitted: Fitted, share: float = _SLACK) -> bool:
    """Whether a bent spring has hardly any stiffness below its bend, like a spring with play."""
    values = fitted.all_values
    springs = zip(map(values.get, SPRING), map(values.get, _BENDS), strict=True)
    known = [(below, more) for below, more in springs if below is not None and more is not None]
    return bool(known) and all(below <= share * (below + more) for below, more in known)


def reflected(values: Mapping[str, float]) -> dict[str, float]:
    """Return equivalent values with a positive bend and Stribeck velocity.

    The velocity counts by its size. A bend at -b of the stiffness B is one at b of the stiffness -B
    with a spring that is stiffer by 2 B.
    """
    found = dict(values)
    found[STRIBECK_VELOCITY] = abs(values.get(STRIBECK_VELOCITY, 0.0))
    pairs = zip(SPRING, _BENDS, strict=True)
    known = [(values[k], values[b]) for k, b in pairs if {k, b} <= values.keys() and values[k]]
    if known and values.get(BEND_DEFLECTION, 0.0) < 0.0:
        share = known[0][1] / known[0][0]
        found |= {name: (1.0 + 2.0 * share) * values[name] for name in {*SPRING} & values.keys()}
        found |= {name: -values[name] for name in {*_BENDS, BEND_DEFLECTION} & values.keys()}
    return {name: found[name] for name in values}


SATURATING = SoughtShape(
    "a torque that saturates",
    SATURATION,
    candidates=lambda _, data: [ANY] if shows_saturation(data) else [],
)
"""Saturation of the torque at large inputs, if the input shows it."""

LOADED = SoughtShape(
    "friction that grows with the load",
    frozenset(SHAPE_TERMS["load_friction"].coefficients),
    is_possible=lambda fitted: fitted.by_name.get("alpha_load", np.inf) > 0.0,
)
"""Friction of the motor in proportion to the torque of the spring."""

PROGRESSIVE = SoughtShape(
    "a spring that stiffens",
    frozenset(SHAPE_TERMS["progressive_spring"].coefficients),
    in_place_of=HARDENING,
)
"""A spring whose stiffness grows with its deflection."""

PARALLEL = SoughtShape(
    "a spring to the base",
    frozenset(SHAPE_TERMS["parallel_spring"].coefficients),
    shown_in=_BY_LINK,
)
"""A spring between the link and the base, such as a cable."""


def _with_two_encoders(structure: Structure, data: Data) -> list[float]:
    """Return a candidate if the log may show different scales of two encoders."""
    # In the link's balance alone they are a spring to the base.
    return [] if structure.joint.kind == "link" or data.relative_to else [ANY]


def _is_small(fitted: Fitted) -> bool:
    """Whether two encoders differ in scale by little; more is a soft joint, or another motion."""
    values = fitted.all_values
    pairs = zip(SPRING, (*_SCALE.link, *_SCALE.motor), strict=True)
    return all(
        abs(values.get(error, 0.0)) <= _LARGEST_SCALE_ERROR * abs(values.get(spring, np.inf))
        for spring, error in pairs
    )


SCALES = SoughtShape(
    "an error of scales",
    frozenset(SHAPE_TERMS["scale_error"].coefficients),
    candidates=_with_two_encoders,
    shown_in=_BY_LINK,
    is_possible=_is_small,
)
"""Different scales of the two encoders, or a wrong gear ratio."""

SOUGHT = (PROGRESSIVE, STRIBECK, RIPPLE, BEND, SCALES, PARALLEL, TRANSMISSION, PRESLIDING)
"""Terms that are tried one by one, mostly with a constant that is sought.

A required term is sought likewise, except hysteresis: it is fitted with the usual terms, from the
grip that suits the motion.
"""

SOUGHT_COEFFICIENTS = frozenset(c for shape in SOUGHT for c in shape.coefficients)
"""Coefficients of the terms in `SOUGHT`."""

LINEAR = frozenset(
    c for shape in (LOADED, SATURATING, *SOUGHT) if not shape.constant for c in shape.coefficients
)
"""Coefficients of the terms that are sought without a constant."""


def with_other_laws(structure: Structure) -> Iterator[Structure]:
    """Yield the structure with each other usual law of its terms that have several."""
    for shape in SOUGHT:
        if not shape.coefficients - {shape.constant} <= structure.absent:
            yield from shape.with_other_laws(structure, rare=False)
    yield from with_other_damping(structure)


def sought_constants(
    estimate: Estimate, structure: Structure
) -> dict[str, tuple[float, float, float]]:
    """Return value, standard deviation and degrees of freedom of each sought constant.

    A constant that was held fixed has an infinite standard deviation.
    """
    held = SOUGHT_CONSTANTS & structure.fixed.keys()
    found = {name: (structure.fixed[name], np.inf, 0.0) for name in sorted(held)}
    return found | {name: estimate.of(name) for name in estimate.names if name in SOUGHT_CONSTANTS}
