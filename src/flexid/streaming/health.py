"""How well an estimation next to a drive is; `Health` has the values of ``flexid_health`` in C."""

from collections.abc import Sequence
from enum import IntEnum
from typing import NamedTuple


class Health(IntEnum):
    """How an estimation is; the worst that holds, from the last to the first."""

    CONVERGING = 0  # nothing is wrong, and the intervals are still wide
    CONVERGED = 1  # the intervals of spring and inertias are narrow
    NOT_EXCITED = 2  # the motion so far leaves something open: move more, or otherwise
    INCONSISTENT = 3  # the latest motion contradicts the estimates, or these each other
    SENSOR_FAULT = 4  # a sensor, or the line from it, does not work

    @property
    def words(self) -> str:
        """As it is printed: ``"not excited"``."""
        return self.name.lower().replace("_", " ")


class Limits(NamedTuple):
    """What the health is decided by."""

    # Time constants of the filter, the span of what is called recent: equations farther apart share
    # no noise.
    window: float = 10.0
    # Of the recent samples that could not be used, from which on it is no accident: a line that
    # loses one sample in ten still leaves most of the motion.
    bad_share: float = 0.2
    # Unpredicted part of the recent left-hand sides' mean square that contradicts nothing: what
    # models leave out makes a tenth of an acceleration here and there.
    slack: float = 0.01
    # And how many times what is usually left unexplained: noise alone makes less than two, and
    # where the motion is larger than usual, so is what the model leaves out.
    unusual: float = 10.0
    # Time constants of motion after which what is still open is open because of the motion.
    patience: float = 40.0
    # Half of an interval over the value, up to which a number is determined, as in
    # `flexid.Thresholds`.
    width: float = 0.2
    # Difference between filters over the value, from which on they contradict each other.
    disagreement: float = 1.0
    # Difference from an estimate made before, over both half intervals together, from which on it
    # is no chance: four standard deviations.
    departure: float = 2.0
    # And over the value: what models leave out makes 5 % here and there, with another estimator or
    # another motion.
    least_departure: float = 0.1


LIMITS = Limits()


class Width(NamedTuple):
    """A coefficient that every drive of the kind has: half its interval, over its value."""

    name: str
    value: float
    half_width: float  # of the interval; infinite where there is none
    disagreement: float  # largest difference between filters


class Recent(NamedTuple):
    """What a row did in the recent window, in the mean squares of its equations."""

    row: str
    error: float  # of the innovations
    power: float  # of the left-hand sides
    usual_error: float  # of what is unexplained in all that was learnt
    usual_power: float  # of all left-hand sides that were learnt from


class Evidence(NamedTuple):
    """What the health is judged by."""

    bad_share: float  # share of the recent samples that could not be used
    bad_cause: str  # why most of these could not
    is_stuck: bool  # whether an encoder stands still while the other one moves
    settled: float  # time constants of the filter for which motion has been learnt from
    determined: bool  # whether the data determine every coefficient
    open_direction: Sequence[str]  # coefficients that are confused most
    widths: Sequence[Width]  # of spring and inertias
    changed: str  # what contradicted the estimates before they began again; empty if nothing did
    contradicted: str = ""  # what is known, or was estimated before, and is otherwise now


class Judgement(NamedTuple):
    """How an estimation is, and why, in a sentence."""

    health: Health
    reason: str


def contradicts(recent: Recent) -> bool:
    """Whether a row's latest motion contradicts what was learnt of it."""
    larger = max(1.0, recent.power / recent.usual_power) if recent.usual_power > 0.0 else 1.0
    allowed = LIMITS.slack * recent.power + LIMITS.unusual * recent.usual_error * larger
    return recent.error > allowed


def judge(evidence: Evidence) -> Judgement:
    """Judge an estimation."""
    if evidence.is_stuck:
        return Judgement(
            Health.SENSOR_FAULT,
            "an encoder stands still while the other one moves: check its plug and its coupling",
        )
    if evidence.bad_share > LIMITS.bad_share:
        return Judgement(
            Health.SENSOR_FAULT,
            f"{100 * evidence.bad_share:.0f} % of the latest samples cannot be used, most of them "
            f"since {evidence.bad_cause}: check the sensors and the line",
        )
    negative = [width for width in evidence.widths if width.value + width.half_width < 0.0]
    if evidence.determined and negative:
        return Judgement(
            Health.INCONSISTENT,
            f"{negative[0].name} comes out negative, which a spring or inertia cannot be: check "
            f"the signs of torque and positions",
        )
    widest = max(evidence.widths, key=_relative_width)
    narrow = evidence.determined and _relative_width(widest) <= LIMITS.width
    if evidence.changed and not narrow:
        return Judgement(Health.INCONSISTENT, evidence.changed)
    patient = evidence.settled > LIMITS.patience
    if not evidence.determined:
        if not patient:
            return Judgement(Health.CONVERGING, "too few samples so far to determine anything")
        confused = " and ".join(evidence.open_direction) or widest.name
        return Judgement(
            Health.NOT_EXCITED,
            f"the motion so far does not separate {confused}: move more, or differently",
        )
    apart = max(evidence.widths, key=_relative_disagreement)
    if patient and _relative_disagreement(apart) > LIMITS.disagreement:
        return Judgement(
            Health.INCONSISTENT,
            f"slow and fast motion disagree on {apart.name} by "
            f"{100 * _relative_disagreement(apart):.0f} %: the model leaves something out, "
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
        Health.CONVERGED, f"spring and inertias are known, {widest.name} the least, {within}"
    )


def _relative_width(width: Width) -> float:
    return width.half_width / abs(width.value) if width.value else float("inf")


def _relative_disagreement(width: Width) -> float:
    return width.disagreement / abs(width.value) if width.value else 0.0


def _percent(share: float) -> str:
    if share < 0.01:
        return f"{100 * share:.2g} %"
    return f"{100 * share:.0f} %" if share < 10.0 else "no bounds"
