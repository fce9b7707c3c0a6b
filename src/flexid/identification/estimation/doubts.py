"""Doubts: systematic errors that a log does not show, and their effect on each value.

A fit with disturbances allows for errors that vary in time. Errors of scales, encoders and
amplifiers are constant, so the log cannot tell them from other parameters. Each doubt is a function
that returns the possible errors of the values as directions, shape (k, m). These directions times
their transpose are added to the covariance.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from flexid.arrays import FloatArray
from flexid.estimators.channel_timing import INPUT
from flexid.identification.estimation.model_error import (
    behind_a_dead_zone,
    by_other_laws,
    lagged,
)
from flexid.identification.full_model.model import Fitted
from flexid.identification.vocabulary.evidence import Estimate, balance_of
from flexid.models import flexible_joint as declared

CALIBRATION = 0.002  # standard deviation over the value: no scale of a rig is known better
_FURTHER_MODES = 0.003  # of a link's inertia, which the next bending mode increases
CABLE = 0.03  # torque of a cable, which acts like gravity, over the link's acceleration
ECCENTRICITY = 5e-4  # rad: 0.03 degrees, error of good encoders once per turn
GAUGE = 0.02  # of the scale of a deflection sensor: strain gauges are calibrated to 3 or 4 %
_LONGEST_COIL = 2e-3  # s: time constants of coils are hardly longer
# Standard deviation of a hysteresis torque and its reach over their values, if the law is not
# Dahl's, and of friction that falls. Errors were 1 to 37 % in seven logs after Bouc and Wen.
ANOTHER_LAW = 0.15
# Part of a balance's unexplained acceleration that may look like one of its terms, over the
# unexplained share. A larger share is less likely to be chance.
_LIKE_A_TERM = 0.4
_LIKE_A_FRICTION = 0.7  # the part that may look like a friction, at any share
# Factor of the squared unexplained share that may look like the acceleration, and so like inertia.
# Errors of inertias were 0.8 of the squared share on 24 elastic drives with one encoder. They were
# 1.3 and 2 times on motors with a share of 0.05 to 0.1 and 0.1 to 0.2, partly for other reasons.
LIKE_THE_ACCELERATION = 1.0

LINK_GRAVITY = frozenset(
    c for term in ("gravity", "gravity_cosine") for c in declared.TERMS[term].link
)
LINK_CABLE = frozenset(declared.SHAPE_TERMS["parallel_spring"].link)
LINK_STATICS = LINK_GRAVITY | LINK_CABLE | {*declared.TERMS["link_offset"].link}
_PARALLEL = frozenset(declared.SHAPE_TERMS["parallel_spring"].coefficients)
_SCALE = declared.SHAPE_TERMS["scale_error"]
_MOTOR_SPRINGS = frozenset(motor for motor, *_ in declared.TIES.values()) | {declared.SPRING[1]}
_VISCOUS = declared.coefficients_of("motor_viscous")
_LOADED = declared.SHAPE_TERMS["load_friction"].motor
# Powers of the motor encoder's scale in coefficients; of all others it is one.
_POWERS = dict.fromkeys(_VISCOUS, 0.0)
_POWERS |= dict.fromkeys(declared.SHAPE_TERMS["motor_drag"].motor, -1.0)


class Repeat(NamedTuple):
    """Fit to a part of a log, or to another band of it."""

    values: FloatArray  # (k,)
    variances: FloatArray  # (k,)


@dataclass(frozen=True, eq=False)
class Doubted:
    """Fit with the quantities that the doubts depend on."""

    fitted: Fitted  # fit of k values
    sizes: dict[str, float]  # effect of one unit of each coefficient over its row's acceleration
    shares: dict[str, float]  # unexplained over whole acceleration of each balance
    is_voltage: bool  # whether the input is a voltage, or was computed from one
    by_play: float = 0.0  # relative increase of the stiffness if the spring has play

    @property
    def none(self) -> FloatArray:
        """Directions for no error, shape (k, 0)."""
        return no_errors(self.fitted)

    def diagonal(self, of: Callable[[str, float], float]) -> FloatArray:
        """Return directions of independent errors, each from a name and a value."""
        fitted = self.fitted
        named = zip(fitted.names, fitted.values.tolist(), strict=True)
        return np.diag([of(name, value) for name, value in named])

    def common(self, factor: float, balance: str) -> FloatArray:
        """Return the direction that scales all coefficients of a balance."""
        return factor * _of_balance(self.fitted, balance)[:, None]


def no_errors(fitted: Fitted) -> FloatArray:
    """Return directions for no error of a fit's values, shape (k, 0)."""
    return np.zeros((len(fitted.names), 0))


Doubt = Callable[[Doubted], FloatArray]


def calibration(doubted: Doubted) -> FloatArray:
    """Return errors of all values by the scales of the sensors."""
    return doubted.diagonal(lambda _, value: CALIBRATION * value)


def further_modes(doubted: Doubted) -> FloatArray:
    """Return errors of the link by its next bending mode, which increases its inertia."""
    return doubted.common(_FURTHER_MODES, "link")


def scales_apart(doubted: Doubted) -> FloatArray:
    """Return errors by different scales of two encoders, mainly of gravity, through the spring.

    If the model has the difference, it remains open which encoder is right.
    """
    names = {*doubted.fitted.names}
    if not _PARALLEL.isdisjoint(names) and declared.SPRING[1] in names:
        return doubted.none  # the motor's balance has shown which of both it is
    if not names.isdisjoint(_SCALE.coefficients):
        return _either_scale(doubted)
    share = doubted.fitted.data.scales_apart
    pull = abs(doubted.fitted.by_name.get("theta2", 0.0))
    return doubted.diagonal(
        lambda name, value: share * (abs(value) + pull * (name in LINK_GRAVITY))
    )


def _either_scale(doubted: Doubted) -> FloatArray:
    """Return errors by the scale of the motor's encoder, of the link's, and of a geared torque.

    If the motor's encoder reads too much, torques seem to accelerate the motor more, but not those
    in proportion to its velocity. If the link's does, the spring seems softer. A wrong gear ratio
    also scales the torque.
    """
    fitted, (error,) = doubted.fitted, _SCALE.motor
    values = fitted.all_values
    spring = values.get(declared.SPRING[1], 0.0)
    if error not in values or spring == 0.0:
        return doubted.none
    share = values[error] / spring / np.sqrt(3.0)
    powers = [_POWERS.get(name, 1.0) for name in fitted.names]
    springs = np.isin(fitted.names, [*_MOTOR_SPRINGS, *_LOADED])
    gain = np.isin(fitted.names, "beta1")
    motor = _of_balance(fitted, "motor")
    return share * motor[:, None] * np.column_stack((powers, springs, gain))


def coil_lag(doubted: Doubted) -> FloatArray:
    """Return errors of the motor if a voltage's delay is a lag of the coil, without back-EMF.

    The lag is uniformly distributed between zero and the whole delay, or half a sample if that is
    longer, since the channels may be sampled that far apart.
    """
    if not doubted.is_voltage:
        return doubted.none
    values, timing = doubted.fitted.by_name, doubted.fitted.structure.timing
    delay = values.get(INPUT, timing.delays.get(INPUT, 0.0))
    least = 0.5 * max(recording.sample_time for recording in doubted.fitted.data.recordings)
    coil = min(max(delay, least), _LONGEST_COIL)
    return coil_error(doubted.fitted, coil)[:, None]


def coil_error(fitted: Fitted, lag: float) -> FloatArray:
    """Return the error of each value, shape (k,), by a coil whose back-EMF is neglected.

    With a time constant τ and viscous friction α over inertia, of which all may be back-EMF, the
    inertia looks smaller by the share α τ. The standard deviation is that of an even distribution.
    """
    viscous = sum(value for name, value in fitted.by_name.items() if name in _VISCOUS)
    return abs(viscous) * lag / np.sqrt(3.0) * _of_balance(fitted, "motor")


def _of_balance(fitted: Fitted, balance: str) -> FloatArray:
    """Return the coefficients of a balance among a fit's values, shape (k,); the others are 0."""
    # Delays and constants of terms, such as velocities, are no coefficients.
    others = {*fitted.structure.timing.sought, *fitted.structure.joint.nonlinear.values()}
    own = [balance_of(name) == balance and name not in others for name in fitted.names]
    return np.where(own, fitted.values, 0.0)


def lag(doubted: Doubted) -> FloatArray:
    """Return errors if the input's delay is a first-order lag, which reduces the input."""
    return lagged(doubted.fitted)[:, None]


def dead_zone(doubted: Doubted) -> FloatArray:
    """Return errors by an amplifier's dead zone, which reduces voltages."""
    return behind_a_dead_zone(doubted.fitted)[:, None] if doubted.is_voltage else doubted.none


def play(doubted: Doubted) -> FloatArray:
    """Return errors of a spring with play, which looks softer, and often like a hardening one."""
    # Uniformly distributed between no play and all of it.
    share = doubted.by_play / np.sqrt(3.0)
    springs = np.array([name in declared.SPRING for name in doubted.fitted.names])
    return share * np.where(springs, doubted.fitted.values, 0.0)[:, None]


def gear_efficiency(doubted: Doubted) -> FloatArray:
    """Return errors of the spring if a gear loses more torque in one direction of its power.

    With the shares μ₁ and μ₂ of the torque lost in driving and being driven, the friction of the
    load is their mean μ. The other half of their difference looks like a stiffer spring. Equal
    efficiencies η have μ₁ = 1/η - 1 and μ₂ = 1 - η, so the difference is about μ².
    """
    values = doubted.fitted.by_name
    if not values.get("alpha1") or "alpha_load" not in values:
        return doubted.none
    share = 0.5 * (values["alpha_load"] / values["alpha1"]) ** 2
    springs = np.array([name in _MOTOR_SPRINGS for name in doubted.fitted.names])
    return share * np.where(springs, doubted.fitted.values, 0.0)[:, None]


def another_law(doubted: Doubted) -> FloatArray:
    """Return errors of a hysteresis by a law other than Dahl's: its torque and reach grow alike.

    What such a law leaves unexplained of the link's acceleration may be the spring's.
    """
    inverse = declared.HYSTERESIS_GRIP  # of the reach
    share = dict.fromkeys(declared.HYSTERESIS, ANOTHER_LAW) | {inverse: -ANOTHER_LAW}
    values = doubted.fitted.by_name
    left = float(doubted.shares.get("link", 0.0) / np.sqrt(3.0)) if inverse in values else 0.0
    springs = dict.fromkeys(declared.SPRING, left)
    both = (share, springs)
    names = doubted.fitted.names
    return np.array([[by.get(name, 0.0) * values[name] for by in both] for name in names])


def term_law(doubted: Doubted) -> FloatArray:
    """Return errors if a term follows a law between its own and another usual one."""
    return by_other_laws(doubted.fitted) / np.sqrt(3.0)


def looks_like_a_term(doubted: Doubted) -> FloatArray:
    """Return errors if a balance's unexplained acceleration looks in part like one of its terms."""

    def deviation(name: str, _: float) -> float:
        size = doubted.sizes.get(name, 0.0)  # zero for a delay
        share = doubted.shares[balance_of(name)] if size else 0.0
        friction = name.partition("[")[0] in declared.DISSIPATIVE
        return like_a_term(share, friction=friction) * share / size if size else 0.0

    return doubted.diagonal(deviation)


def looks_like_the_acceleration(doubted: Doubted) -> FloatArray:
    """Return errors if a balance's unexplained acceleration looks in part like its inertia."""
    shares = doubted.shares.items()
    return np.hstack(
        [doubted.common(LIKE_THE_ACCELERATION * share**2, balance) for balance, share in shares]
    )


def like_a_term(share: float, *, friction: bool) -> float:
    """Return the part of a balance's unexplained share that may look like one of its terms."""
    return _LIKE_A_FRICTION if friction else _LIKE_A_TERM * share


LIKE_PLAY = "its spring may have play"
HEAVIER = "an effect that no term describes may look like inertia of its balance"
LIKE_A_TERM = "an effect that no term describes may look like it"
OF_A_BAND = "it depends on the frequency band that is fitted"
HIDDEN = "a removed term may act in its place"
OF_A_HALF = "the halves of the log disagree"
OF_A_LOG = "the logs disagree"
_CLEARLY = 3.0  # standard deviations by which values of two logs hardly differ by chance
OF_A_LAW = "friction or damping may follow another law"

DOUBTS: Mapping[Doubt, str] = {
    calibration: "",
    further_modes: "the link may bend",
    gear_efficiency: "the gear may lose more torque in one direction",
    scales_apart: "the scales of the encoders contradict each other",
    coil_lag: "the delay of the input may be a lag of the coil",
    lag: "the delay of the input may be a lag",
    dead_zone: "the amplifier may have a dead zone",
    play: LIKE_PLAY,
    another_law: "its hysteresis may follow another law",
    term_law: OF_A_LAW,
    looks_like_a_term: LIKE_A_TERM,
    looks_like_the_acceleration: HEAVIER,
}
"""Doubts of any fit with disturbances, each with its text as the main cause of an interval."""

OF_AN_EXACT_FIT: tuple[Doubt, ...] = (scales_apart, gear_efficiency, lag, term_law)
"""Doubts of an exact fit: gravity may hide a scale error, a delay a lag, a law another one."""

OF_A_VOLTAGE: tuple[Doubt, ...] = (calibration, further_modes, coil_lag, dead_zone)
"""Further doubts of an exact fit with a voltage, whose amplifier has errors within the noise."""


def between_bands(own: Repeat, others: Sequence[Repeat]) -> FloatArray:
    """Return differences between bands beyond chance, one direction per band, shape (k, n)."""
    found = np.zeros((len(own.values), len(others)))
    for column, other in zip(found.T, others, strict=True):
        with np.errstate(invalid="ignore"):  # infinite variances in both
            by_chance = np.abs(other.variances - own.variances)
        column[:] = _beyond_chance(other.values - own.values, by_chance) / np.sqrt(len(others))
    return found


def between_halves(whole: FloatArray, first: Repeat, second: Repeat) -> FloatArray:
    """Return the difference between the log's halves beyond chance, shape (k, 1).

    The estimate of the whole log, shape (k,), is about the mean of the halves, weighted by their
    information. A half that is mostly rest may give any value, but hardly affects the whole. A half
    in which the drive changes may affect it far more than its information suggests.
    """
    variances, difference = first.variances + second.variances, first.values - second.values
    better = np.where(first.variances <= second.variances, first.values, second.values)
    with np.errstate(invalid="ignore", divide="ignore"):  # infinite variance, equal values
        share = np.sqrt(first.variances) * np.sqrt(second.variances) / variances
        share = np.nan_to_num(share)  # 1/2 for equal variances, otherwise less
        apart = np.nan_to_num(np.abs((whole - better) / difference), posinf=0.0)
        share = np.maximum(share, np.minimum(apart, 1.0))
        by_chance = share**2 * variances
    return _beyond_chance(share * difference, by_chance)[:, None]


def between_logs(whole: FloatArray, logs: Sequence[Repeat]) -> FloatArray:
    """Return differences of m logs from the whole, (k,), beyond chance, as directions, (k, m).

    Logs count by their information, so a log of little motion hardly counts. One that clearly
    differs shows another state of the drive, and counts as much as the others.
    """
    values, variances = (np.array(each) for each in zip(*logs, strict=True))
    information, difference = 1.0 / variances, values - whole
    differs = difference**2 > _CLEARLY**2 * variances
    total = np.maximum(information.sum(axis=0), np.finfo(float).tiny)
    shares = np.where(differs, 1.0 / len(logs), information / total)
    return (np.sqrt(shares) * _beyond_chance(difference, variances)).T


def _beyond_chance(difference: FloatArray, variance: FloatArray) -> FloatArray:
    """Return the part of differences beyond chance, with their signs."""
    square = difference**2 - np.where(np.isfinite(variance), variance, np.inf)
    return np.sign(difference) * np.sqrt(np.maximum(square, 0.0))


def covariance_of(directions: FloatArray) -> FloatArray:
    """Return the covariance, shape (k, k), of independent errors along directions (k, m)."""
    return directions @ directions.T


def widened(
    estimate: Estimate, errors: Iterable[tuple[FloatArray, str]]
) -> tuple[Estimate, dict[str, str]]:
    """Return the estimate widened by independent errors, and the main cause of each variance.

    Each error is a covariance, shape (k, k), and its text.
    """
    every = [*errors]
    for covariance, _ in every:
        estimate = estimate.widened(covariance)
    causes = dict.fromkeys(estimate.names, "")
    for covariance, words in every:
        most = np.diag(covariance) > 0.5 * np.diag(estimate.covariance)
        causes |= dict.fromkeys(np.array(estimate.names)[most].tolist(), words)
    return estimate, causes
