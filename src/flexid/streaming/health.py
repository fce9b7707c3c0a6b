"""Health of an online estimation; `Health` has the values of ``flexid_health`` in C."""

import math
from collections.abc import Sequence
from enum import IntEnum
from typing import NamedTuple


class Health(IntEnum):
    """State of an online estimation; of several that apply, the highest value counts."""

    CONVERGING = 0  # no fault, but the intervals are still wide
    CONVERGED = 1  # the intervals of spring and inertias are narrow
    NOT_EXCITED = 2  # the motion so far does not determine all coefficients
    INCONSISTENT = 3  # the latest motion contradicts the estimates, or they contradict each other
    SENSOR_FAULT = 4  # a sensor or its connection does not work

    @property
    def words(self) -> str:
        """Text for a report, such as ``"not excited"``."""
        return self.name.lower().replace("_", " ")


class Limits(NamedTuple):
    """Limits that decide the health."""

    # Length of the recent window, in time constants of the filter. Equations farther apart have
    # independent noise.
    window: float = 10.0
    # Share of unusable samples in the recent window that means a sensor fault. A connection that
    # loses one sample in ten still transmits most of the motion.
    bad_share: float = 0.2
    # Mean square of the innovations, over that of the left-hand sides, that is no contradiction:
    # unmodelled effects of a tenth of the acceleration are common.
    slack: float = 0.01
    # Mean square of the innovations, over the usual one, that is no contradiction. Noise alone
    # gives less than two; a larger motion also increases the model's error.
    unusual: float = 10.0
    # Time constants of motion after which poor excitation explains an undetermined coefficient.
    patience: float = 40.0
    # Mean time between gaps, in time constants, too short to determine anything: a stream at 1 kHz
    # that loses one sample in 15 (0.3) gives no equation, and with one in 100 (2) it converges.
    undisturbed: float = 1.0
    # Largest half-width of an interval, over the value, of a determined number, as in
    # `flexid.Thresholds`.
    width: float = 0.2
    # Difference between filters, over the value, above which they contradict each other.
    disagreement: float = 1.0
    # Difference from the reference estimate, over the combined half-width of both intervals, above
    # which the drive departs: four standard deviations.
    departure: float = 2.0
    # Least departure over the value: another estimator or another motion often changes a value by
    # 5 % if the model has an error.
    least_departure: float = 0.1


LIMITS = Limits()


class Width(NamedTuple):
    """Uncertainty of a coefficient that every drive of the kind has."""

    name: str
    value: float
    half_width: float  # of the interval; infinite if there is no interval
    disagreement: float  # largest difference between filters


class Recent(NamedTuple):
    """Mean squares of a row's equations, in the recent window and before it."""

    row: str
    error: float  # innovations in the window
    power: float  # left-hand sides in the window
    usual_error: float  # residuals of all earlier equations
    usual_power: float  # left-hand sides of all earlier equations


class Evidence(NamedTuple):
    """Figures that decide the health."""

    bad_share: float  # share of unusable samples in the recent window
    bad_cause: str  # their most frequent cause
    is_stuck: bool  # whether an encoder stands still while the other one moves
    settled: float  # duration of the motion used so far, in time constants of the filter
    determined: bool  # whether the data determine every coefficient
    open_direction: Sequence[str]  # coefficients that the motion separates worst
    widths: Sequence[Width]  # of spring and inertias
    changed: str  # the contradiction that restarted the estimation; empty if there was none
    contradicted: str = ""  # a known value or a reference value that the stream contradicts
    between: float = math.inf  # mean time between interruptions, in time constants of the filter


class Judgement(NamedTuple):
    """Health of an estimation, with the reason as a sentence."""

    health: Health
    reason: str


def contradicts(recent: Recent) -> bool:
    """Return whether a row's latest innovations contradict its estimates."""
    larger = max(1.0, recent.power / recent.usual_power) if recent.usual_power > 0.0 else 1.0
    allowed = LIMITS.slack * recent.power + LIMITS.unusual * recent.usual_error * larger
    return recent.error > allowed


def judge(evidence: Evidence) -> Judgement:
    """Return the health of an estimation and its reason."""
    if evidence.is_stuck:
        return Judgement(
            Health.SENSOR_FAULT,
            "an encoder stands still while the other one moves: check its plug and its coupling",
        )
    if evidence.bad_share > LIMITS.bad_share:
        return Judgement(
            Health.SENSOR_FAULT,
            f"{100 * evidence.bad_share:.0f} % of the latest samples cannot be used, mostly "
            f"because {evidence.bad_cause}: check the sensors and the line",
        )
    negative = [width for width in evidence.widths if width.value + width.half_width < 0.0]
    if evidence.determined and negative:
        return Judgement(
            Health.INCONSISTENT,
            f"{negative[0].name} is negative, which is impossible for a spring or inertia: check "
            f"the signs of torque and positions",
        )
    widest = max(evidence.widths, key=_relative_width)
    narrow = evidence.determined and _relative_width(widest) <= LIMITS.width
    if evidence.changed and not narrow:
        return Judgement(Health.INCONSISTENT, evidence.changed)
    patient = evidence.settled > LIMITS.patience
    if not evidence.determined:
        if evidence.between < LIMITS.undisturbed:
            return Judgement(
                Health.NOT_EXCITED if patient else Health.CONVERGING,
                "samples are lost so often that nothing can be determined between the gaps: send "
                "every sample",
            )
        if not patient:
            return Judgement(Health.CONVERGING, "too few samples so far to determine anything")
        confused = " and ".join(evidence.open_direction) or widest.name
        return Judgement(
            Health.NOT_EXCITED,
            f"the motion so far does not separate {confused}: move more, or differently; if that "
            f"does not help, check the gear ratio and the units",
        )
    apart = max(evidence.widths, key=_relative_disagreement)
    if patient and _relative_disagreement(apart) > LIMITS.disagreement:
        return Judgement(
            Health.INCONSISTENT,
            f"slow and fast motion disagree on {apart.name} by "
            f"{100 * _relative_disagreement(apart):.0f} %: the model lacks a term, "
            f"or a channel is late or has the wrong sign",
        )
    if patient and evidence.contradicted:
        return Judgement(Health.INCONSISTENT, evidence.contradicted)
    if not narrow:
        return Judgement(
            Health.CONVERGING,
            f"{widest.name} is known within {_percent(_relative_width(widest))} so far",
        )
    within = f"within {_percent(_relative_width(widest))}"
    if len(evidence.widths) == 1:
        return Judgement(Health.CONVERGED, f"{widest.name} is known {within}")
    return Judgement(
        Health.CONVERGED, f"spring and inertias are known {within}, {widest.name} least precisely"
    )


def _relative_width(width: Width) -> float:
    return width.half_width / abs(width.value) if width.value else float("inf")


def _relative_disagreement(width: Width) -> float:
    return width.disagreement / abs(width.value) if width.value else 0.0


def _percent(share: float) -> str:
    if share < 0.01:
        return f"{100 * share:.2g} %"
    return f"{100 * share:.0f} %" if share < 10.0 else "no bounds"
