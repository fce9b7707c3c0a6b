"""Scores of a family of trials from the records of its logs, without flexid."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite, pi, remainder
from statistics import median
from typing import Any

import numpy as np

CORE = ("gravity_torque", "link_inertia", "motor_inertia", "joint_stiffness")
"""Core parameters, which every user needs; gravity if it acts."""

ANGLES = {
    "gravity_angle": "gravity_torque",
    "eccentricity_angle": "eccentricity",
    "ripple_angle": "torque_ripple",
    "transmission_error_angle": "transmission_error",
    "second_transmission_error_angle": "second_transmission_error",
}
"""Parameters that are angles, with the amplitude that belongs to each."""

CONSTANTS = frozenset({"stribeck_velocity", "ripple_number", "error_number", "bend_deflection"})
"""Constants of regressors, which are not scored."""

WRONG = 0.01
"""Least error of a wrong value, relative to the truth, or in rad for an angle."""

Record = Mapping[str, Any]


@dataclass(frozen=True)
class Claim:
    """A reported interval with its truth.

    Parameters
    ----------
    kind : {"kept", "removed", "delay"}
        Parameter of the model, parameter of a removed term, or delay.
    name : str
    value, low, high, truth : float
    status : str
        Verdict; empty for a removed parameter.
    """

    kind: str
    name: str
    value: float
    low: float
    high: float
    status: str
    truth: float

    @property
    def holds(self) -> bool:
        """Whether the interval contains the truth; False if an end is NaN."""
        return bool(self.low <= self.truth <= self.high)

    @property
    def error(self) -> float:
        """Relative error, or in rad for an angle; infinite if the truth is zero."""
        off = abs(self.value - self.truth)
        if self.name in ANGLES:
            return off
        return off / abs(self.truth) if self.truth else float("inf")

    @property
    def confidently_wrong(self) -> bool:
        """Whether the value is determined, its interval wrong, and its error more than `WRONG`.

        A parameter that does not act has no relative error; its interval counts for coverage only.
        """
        acts = self.truth != 0.0 or self.name in ANGLES
        wrong = not self.holds and self.error > WRONG
        return self.kind == "kept" and self.status == "determined" and acts and wrong


def claims(record: Record) -> Iterator[Claim]:
    """Yield all reported intervals of a log; none if there is no result.

    A delay that was not estimated is left out, as is an angle whose amplitude has no truth.
    """
    truth = record["truth"]
    kinds = (("kept", "estimates"), ("removed", "removed"), ("delay", "delays"))
    for kind, key in kinds:
        for name, (value, low, high, *status) in record.get(key, {}).items():
            if name in CONSTANTS or (name in ANGLES and ANGLES[name] not in truth):
                continue
            verdict = status[0] if status else ""
            if kind == "delay" and verdict in ("given", "unknown"):
                continue
            own = truth.get(name, 0.0)
            if name in ANGLES:  # the nearest equivalent angle
                own = value + remainder(own - value, 2.0 * pi)
            yield Claim(kind, name, value, low, high, verdict, own)


def core_names(record: Record) -> list[str]:
    """Return the names of the core parameters that a drive has."""
    return [name for name in CORE if record["truth"].get(name)]


@dataclass(frozen=True)
class Share:
    """Count of a total."""

    part: int
    whole: int

    @property
    def percent(self) -> float:
        """Share in percent; NaN if the total is zero."""
        return 100.0 * self.part / self.whole if self.whole else float("nan")


@dataclass(frozen=True)
class Spread:
    """Median, 90th percentile and maximum of numbers; NaN of no numbers."""

    middle: float
    high: float
    largest: float


@dataclass(frozen=True)
class FamilyScore:
    """Score of a family's logs.

    Parameters
    ----------
    family : str
    in_class : bool
    logs, failed, refused : int
        Numbers of logs, of those without a result, and of these with an error message for users.
    wrong_core, wrong : int
        Numbers of logs with a confidently wrong core parameter, or any such parameter.
    coverage : mapping of str to Share
        Intervals that contain the truth: ``all`` (parameters kept and removed, and delays),
        ``determined``, ``core`` (of the determined), ``removed`` and ``delay``.
    coverage_deviation : float
        Standard error of the share ``all``, from the spread between logs, as the intervals of one
        log are correlated.
    core_determined : Share
        Core parameters reported as determined, of all.
    error : Spread
        Relative errors of the determined core parameters.
    given_error, least_squares_error : Spread
        Errors of the same parameters with the structure given, and by plain least squares.
    sharpness : float
        Median ratio of the widths of determined core parameters' intervals to those with the
        structure given.
    seconds : Spread
    missed, extra : mapping of str to int
        Acting terms that were not chosen, and chosen terms that do not act, with numbers of logs.
    wrong_hold : int
        Number of logs with a wrong hold.
    """

    family: str
    in_class: bool
    logs: int
    failed: int
    refused: int
    wrong_core: int
    wrong: int
    coverage: Mapping[str, Share]
    coverage_deviation: float
    core_determined: Share
    error: Spread
    given_error: Spread
    least_squares_error: Spread
    sharpness: float
    seconds: Spread
    missed: Mapping[str, int]
    extra: Mapping[str, int]
    wrong_hold: int


def score(records: Sequence[Record]) -> FamilyScore:
    """Return the score of a family's logs."""
    found = [record for record in records if "error" not in record]
    of_logs = [list(claims(record)) for record in found]
    every = [claim for of_log in of_logs for claim in of_log]
    kept = [claim for claim in every if claim.kind == "kept"]
    determined = [claim for claim in kept if claim.status == "determined"]
    core = [claim for claim in determined if claim.name in CORE and claim.truth]
    removed = [claim for claim in every if claim.kind == "removed"]
    delays = [claim for claim in every if claim.kind == "delay"]
    missed, extra = _term_mistakes(found)
    given, least, widths = _against_given(found, of_logs)
    return FamilyScore(
        family=records[0]["family"],
        in_class=records[0]["in_class"],
        logs=len(records),
        failed=len(records) - len(found),
        refused=sum(bool(record.get("refused")) for record in records),
        wrong_core=sum(
            any(claim.confidently_wrong and claim.name in CORE for claim in of_log)
            for of_log in of_logs
        ),
        wrong=sum(any(claim.confidently_wrong for claim in of_log) for of_log in of_logs),
        coverage={
            "all": _containing(every),
            "determined": _containing(determined),
            "core": _containing(core),
            "removed": _containing(removed),
            "delay": _containing(delays),
        },
        coverage_deviation=_deviation([_containing(of_log) for of_log in of_logs]),
        core_determined=Share(len(core), sum(len(core_names(record)) for record in records)),
        error=spread([claim.error for claim in core]),
        given_error=spread(given),
        least_squares_error=spread(least),
        sharpness=median(widths) if widths else float("nan"),
        seconds=spread([record["seconds"] for record in found]),
        missed=missed,
        extra=extra,
        wrong_hold=sum(record["hold"] != record["chosen"]["hold"] for record in found),
    )


def spread(values: Sequence[float]) -> Spread:
    """Return median, 90th percentile and maximum."""
    if not values:
        return Spread(float("nan"), float("nan"), float("nan"))
    middle, high, largest = np.quantile(values, (0.5, 0.9, 1.0))
    return Spread(float(middle), float(high), float(largest))


def scores(records: Sequence[Record]) -> list[FamilyScore]:
    """Return a score per family, those in the model class first, and failures first."""
    families = dict.fromkeys(record["family"] for record in records)
    found = [score([r for r in records if r["family"] == family]) for family in families]
    return sorted(found, key=_badness, reverse=True)


def _badness(of_family: FamilyScore) -> tuple[bool, float, float, float]:
    held = of_family.coverage["determined"]
    missed = held.whole - held.part
    return (
        of_family.in_class,
        of_family.wrong / of_family.logs,
        of_family.failed / of_family.logs,
        missed / max(held.whole, 1),
    )


def _containing(some: Sequence[Claim]) -> Share:
    return Share(sum(claim.holds for claim in some), len(some))


def _deviation(of_logs: Sequence[Share]) -> float:
    """Return the standard error of a share between logs; NaN for fewer than two logs."""
    whole = sum(share.whole for share in of_logs)
    if len(of_logs) < 2 or whole == 0:
        return float("nan")
    mean = sum(share.part for share in of_logs) / whole
    squares = sum((share.part - mean * share.whole) ** 2 for share in of_logs)
    return float((squares * len(of_logs) / (len(of_logs) - 1)) ** 0.5 / whole)


def _against_given(
    found: Sequence[Record], of_logs: Sequence[Sequence[Claim]]
) -> tuple[list[float], list[float], list[float]]:
    """Return core errors with the structure given and by least squares, and ratios of widths."""
    errors, least, widths = [], [], []
    for record, of_log in zip(found, of_logs, strict=True):
        for claim in of_log:
            if claim.name not in CORE or claim.status != "determined" or not claim.truth:
                continue
            if claim.name in record.get("least_squares", {}):
                value = record["least_squares"][claim.name]
                least.append(abs(value / claim.truth - 1.0))
            given = record.get("given", {}).get(claim.name)
            if given is None or isinstance(given, str):
                continue
            value, low, high = given[:3]
            errors.append(abs(value / claim.truth - 1.0))
            ratio = (claim.high - claim.low) / (high - low) if high > low else float("nan")
            if isfinite(ratio):
                widths.append(ratio)
    return errors, least, widths


def _term_mistakes(found: Sequence[Record]) -> tuple[dict[str, int], dict[str, int]]:
    missed: Counter[str] = Counter()
    extra: Counter[str] = Counter()
    for record in found:
        true = set(record["terms"])
        chosen = set(record["chosen"]["terms"])
        missed.update(sorted(true - chosen))
        extra.update(sorted(chosen - true))
    return dict(missed.most_common()), dict(extra.most_common())
