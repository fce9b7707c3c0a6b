"""What a rig may do that its log does not show, and by how much it may move each value.

A fit with disturbances allows for what comes and goes. Scales, encoders and amplifiers err in the
same way all the time, so that nothing in the log tells their errors from other parameters. Each
doubt says by how much the values may be off, as directions of errors, shape (k, m): the covariance
grows by the directions times their transpose.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from flexid.arrays import FloatArray
from flexid.estimators.channel_timing import INPUT
from flexid.identification.full_model.model import Fitted
from flexid.identification.vocabulary.evidence import Estimate, balance_of
from flexid.models import flexible_joint as declared

CALIBRATION = 0.002  # of a value, standard deviation: no scale of a rig is known better
_FURTHER_MODES = 0.003  # of a link's inertia: by its next bending mode it looks heavier
_CABLE = 0.03  # of the spring's torque, that a cable adds: it pulls the link back as gravity does
ECCENTRICITY = 5e-4  # rad: 0.03 degrees, once per turn, of encoders in good joints
GAUGE = 0.02  # of the scale of a deflection's sensor: strain gauges are calibrated to 3 or 4 %
_DEAD_ZONE = 0.02  # of the gain of an amplifier, which a dead zone of 1 % of its range takes away
_LAG = 2e-3  # s: time constants of coils and current loops are hardly longer, whatever the delay
# Of what a balance leaves unexplained, the part that may look like any one of its terms, for each
# unit of the share that it is: the more there is, the less of it is chance.
_LIKE_A_TERM = 0.4
_LIKE_A_FRICTION = 0.7  # the same of a friction: another law looks most like the laws we have
# The same of the acceleration itself, by which all of a balance looks lighter or heavier. Errors of
# inertias were 0.8 of the share's square on 24 elastic drives with one encoder, and 1.3 and 2 times
# on motors whose share was 0.05 to 0.1 and 0.1 to 0.2, among them those with other reasons.
LIKE_THE_ACCELERATION = 1.0

LINK_GRAVITY = frozenset(
    c for term in ("gravity", "gravity_cosine") for c in declared.TERMS[term].link
)
_VISCOUS = declared.coefficients_of("motor_viscous")


class Repeat(NamedTuple):
    """A fit to part of a log, or to another band of it."""

    values: FloatArray  # (k,)
    variances: FloatArray  # (k,)


@dataclass(frozen=True, eq=False)
class Doubted:
    """A fit, and what the doubts look at."""

    fitted: Fitted  # of k values
    sizes: dict[str, float]  # what one unit of each coefficient moves, over its row's acceleration
    shares: dict[str, float]  # what each balance leaves unexplained, over its acceleration
    input_unit: str
    # (k,): by how much the values change where the deflection's sensor shows 1 % more, if any
    by_gauge: FloatArray | None
    # (k, 3): by how much errors once per turn that the log allows move gravity
    by_eccentricity: FloatArray | None = None
    by_noise: FloatArray | None = None  # (k,): by how much more noise of the input changes them
    by_play: float = 0.0  # share by which the spring is stiffer if it has play after all
    by_lag: FloatArray | None = None  # (k,): error where the delay may be a lag

    @property
    def longest_lag(self) -> float:
        """Time constant in s of a lag in place of the input's whole delay, before it or after.

        An input that acts before it was logged was low-passed on its way into the log.
        """
        timing = self.fitted.structure.timing
        delay = self.fitted.by_name.get(INPUT, timing.delays.get(INPUT, 0.0))
        return float(np.clip(delay, -_LAG, _LAG))

    @property
    def none(self) -> FloatArray:
        """No direction of an error."""
        return np.zeros((len(self.fitted.names), 0))

    def diagonal(self, of: Callable[[str, float], float]) -> FloatArray:
        """Directions of errors that are independent, from name and value of each."""
        fitted = self.fitted
        named = zip(fitted.names, fitted.values.tolist(), strict=True)
        return np.diag([of(name, value) for name, value in named])

    def common(self, factor: float, balance: str) -> FloatArray:
        """Direction of an error by which all coefficients of a balance grow by a factor."""
        delays = self.fitted.structure.timing.sought
        own = [balance_of(name) == balance and name not in delays for name in self.fitted.names]
        return factor * np.where(own, self.fitted.values, 0.0)[:, None]


Doubt = Callable[[Doubted], FloatArray]


def calibration(doubted: Doubted) -> FloatArray:
    """No sensor's scale is known better."""
    return doubted.diagonal(lambda _, value: CALIBRATION * value)


def further_modes(doubted: Doubted) -> FloatArray:
    """A link that bends looks heavier towards its next mode."""
    return doubted.common(_FURTHER_MODES, "link")


def cable(doubted: Doubted) -> FloatArray:
    """A cable pulls the link back as gravity does."""
    return doubted.diagonal(lambda name, _: _CABLE * _per_size(doubted, name, LINK_GRAVITY))


def eccentric_encoders(doubted: Doubted) -> FloatArray:
    """Two encoders that err once per turn look like gravity through the spring."""
    if doubted.by_eccentricity is None:
        return doubted.none
    return doubted.by_eccentricity


def scales_apart(doubted: Doubted) -> FloatArray:
    """Where the scales of two encoders differ, the spring pulls the link back as gravity does."""
    share = doubted.fitted.data.scales_apart
    pull = abs(doubted.fitted.by_name.get("theta2", 0.0))
    return doubted.diagonal(
        lambda name, value: share * (abs(value) + pull * (name in LINK_GRAVITY))
    )


def gauge_scale(doubted: Doubted) -> FloatArray:
    """A deflection's sensor has a scale that nothing else shows.

    Where it hardly changes a spring, the log says nothing of the deflection that is shown.
    """
    if doubted.by_gauge is None:
        return doubted.none
    springs = np.array([name in declared.SPRING for name in doubted.fitted.names])
    least = np.where(springs, np.abs(doubted.fitted.values), 0.0)
    change = 100.0 * doubted.by_gauge
    grown = np.where(np.signbit(change), -1.0, 1.0) * np.maximum(np.abs(change), least)
    return GAUGE * grown[:, None]


def coil_lag(doubted: Doubted) -> FloatArray:
    """A voltage's delay may be the lag of the motor's coil, of which the back-EMF has no part.

    With a time constant τ in place of a delay, viscous friction α over inertia makes the inertia
    look smaller by the share α τ.
    """
    values = doubted.fitted.by_name
    viscous = sum(value for name, value in values.items() if name in _VISCOUS)
    if doubted.input_unit != "V":
        return doubted.none
    # Anything between none and all of the delay: a uniform distribution about half of it.
    coil = max(doubted.longest_lag, 0.0)
    return doubted.common(abs(viscous) * coil / np.sqrt(3.0), "motor")


def lag(doubted: Doubted) -> FloatArray:
    """A delay may be a lag, behind which an input has lost some of its size.

    At the resonance ω a lag τ passes 1 / sqrt(1 + (ω τ)²), a delay all. Of every two delays one is
    a delay; how much of the other is a lag is anything between none and all.
    """
    if doubted.by_lag is not None:
        return doubted.by_lag[:, None]
    mean_square = 0.5 * 0.2  # of (τ / delay)², half of which are 0
    phase = declared.resonance(doubted.fitted.by_name) * doubted.longest_lag
    lost = min(0.5 * phase**2 * np.sqrt(mean_square), 1.0)
    return doubted.diagonal(lambda name, value: lost * value * (name == "beta1"))


def dead_zone(doubted: Doubted) -> FloatArray:
    """An amplifier passes less of a small voltage than of a large one."""
    gain = _DEAD_ZONE * (doubted.input_unit == "V")
    return doubted.diagonal(lambda name, value: gain * value * (name == "beta1"))


def play(doubted: Doubted) -> FloatArray:
    """A spring with play looks softer than it is, and often like one that hardens."""
    # Anything between none and all of it: a uniform distribution.
    share = doubted.by_play / np.sqrt(3.0)
    springs = np.array([name in declared.SPRING for name in doubted.fitted.names])
    return share * np.where(springs, doubted.fitted.values, 0.0)[:, None]


def noise_of_the_input(doubted: Doubted) -> FloatArray:
    """What moves a motor beyond its torque may be noise of the torque's sensor, in part or all."""
    if doubted.by_noise is None:
        return doubted.none
    # Anything between none and all of it: a uniform distribution.
    return doubted.by_noise[:, None] / np.sqrt(3.0)


def looks_like_a_term(doubted: Doubted) -> FloatArray:
    """What a balance leaves unexplained may look like any one of its terms in part."""

    def deviation(name: str, _: float) -> float:
        size = doubted.sizes.get(name, 0.0)  # a delay has none
        share = doubted.shares[balance_of(name)] if size else 0.0
        friction = name.partition("[")[0] in declared.DISSIPATIVE
        return like_a_term(share, friction=friction) * share / size if size else 0.0

    return doubted.diagonal(deviation)


def looks_like_the_acceleration(doubted: Doubted) -> FloatArray:
    """What a balance leaves unexplained makes all of it look heavier or lighter in part."""
    shares = doubted.shares.items()
    return np.hstack(
        [doubted.common(LIKE_THE_ACCELERATION * share**2, balance) for balance, share in shares]
    )


def like_a_term(share: float, *, friction: bool) -> float:
    """Part of an unexplained share of a balance that may look like one of its terms."""
    return _LIKE_A_FRICTION if friction else _LIKE_A_TERM * share


LIKE_PLAY = "its spring looks like one with play"
HEAVIER = "what no term describes makes its balance heavier or lighter"
LIKE_A_TERM = "what no term describes may look like it"
OF_A_BAND = "it depends on the band of the log that is fitted"
HIDDEN = "a term that the model does without may hide behind it"
OF_A_HALF = "the halves of the log disagree"

DOUBTS: Mapping[Doubt, str] = {
    calibration: "",
    further_modes: "the link may bend",
    cable: "a cable may pull as gravity does",
    eccentric_encoders: "encoders that err once per turn may look like it",
    scales_apart: "the scales of the encoders contradict each other",
    gauge_scale: "nothing shows the scale of the deflection's sensor",
    coil_lag: "the delay of the voltage may be a lag of the coil",
    lag: "the delay of the input may be a lag",
    dead_zone: "the amplifier may have a dead zone",
    play: LIKE_PLAY,
    noise_of_the_input: "the input's noise may be that of its sensor",
    looks_like_a_term: LIKE_A_TERM,
    looks_like_the_acceleration: HEAVIER,
}
"""Of a fit with disturbances, and what is said where one makes most of an interval."""

OF_AN_EXACT_FIT: tuple[Doubt, ...] = (scales_apart, lag)
"""Of an exact fit: gravity makes up for a scale that is wrong by little, a delay for a lag."""

OF_A_VOLTAGE: tuple[Doubt, ...] = (calibration, further_modes, coil_lag, dead_zone)
"""Of an exact fit of a voltage: an amplifier's errors hide in the noise of two encoders."""


def between_bands(own: Repeat, others: Sequence[Repeat]) -> FloatArray:
    """What is not random differs between bands of the log: a direction for each, shape (k, n)."""
    found = np.zeros((len(own.values), len(others)))
    for column, other in zip(found.T, others, strict=True):
        with np.errstate(invalid="ignore"):  # of what neither knows
            by_chance = np.abs(other.variances - own.variances)
        column[:] = _beyond_chance(other.values - own.values, by_chance) / np.sqrt(len(others))
    return found


def between_halves(first: Repeat, second: Repeat) -> FloatArray:
    """What is not random differs between the halves of the log: its direction, shape (k, 1).

    The whole log is about their mean, each weighted by what it knows: a half that is mostly rest
    may give any value, and has no part in the whole.
    """
    variances = first.variances + second.variances
    with np.errstate(invalid="ignore"):  # of what a half does not know at all
        share = np.sqrt(first.variances) * np.sqrt(second.variances) / variances
        share = np.nan_to_num(share)  # at most a half, where both know as much
        by_chance = share**2 * variances
    return _beyond_chance(share * (first.values - second.values), by_chance)[:, None]


def _beyond_chance(difference: FloatArray, variance: FloatArray) -> FloatArray:
    """The part of differences that is more than chance, with their signs."""
    square = difference**2 - np.where(np.isfinite(variance), variance, np.inf)
    return np.sign(difference) * np.sqrt(np.maximum(square, 0.0))


def covariance_of(directions: FloatArray) -> FloatArray:
    """Covariance, shape (k, k), of independent errors along directions, shape (k, m)."""
    return directions @ directions.T


def widened(
    estimate: Estimate, errors: Iterable[tuple[FloatArray, str]]
) -> tuple[Estimate, dict[str, str]]:
    """The estimate with errors that are independent, and what makes most of each variance.

    Each is its covariance, shape (k, k), and a few words.
    """
    every = [*errors]
    for covariance, _ in every:
        estimate = estimate.widened(covariance)
    said = dict.fromkeys(estimate.names, "")
    for covariance, words in every:
        most = np.diag(covariance) > 0.5 * np.diag(estimate.covariance)
        said |= dict.fromkeys(np.array(estimate.names)[most].tolist(), words)
    return estimate, said


def _per_size(doubted: Doubted, name: str, of: frozenset[str]) -> float:
    size = doubted.sizes.get(name, 0.0)
    return 1.0 / size if size and name in of else 0.0
