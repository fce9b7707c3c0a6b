"""Scores of realistic trials from the records of their logs, without flexid."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from statistics import NormalDist, median
from typing import Any

from benchmarks.trials.score import Claim, Share, Spread, spread

FAR_OFF = 0.05
"""Least error of a wrong core value, relative to the truth."""

_TWO_SIDED = NormalDist().inv_cdf(0.975)  # standard errors to either side of a 95 % interval
_MEDIAN = NormalDist().inv_cdf(0.75)  # median distance from the mean, in standard deviations

Record = Mapping[str, Any]


@dataclass(frozen=True)
class RealisticScore:
    """Score of a family's realistic logs.

    Parameters
    ----------
    family : str
    logs, failed, refused : int
        Numbers of logs, of those without a result, and of these with an error message for users.
    determined : Share
        Determined intervals that contain the truth, of parameters with a defined truth.
    core : Share
        The same for core parameters.
    core_determined : Share
        Core parameters reported as determined, of all.
    half_width : float
        Median half-width of a determined core interval, relative to the truth.
    error_ratio : float
        Spread of the errors of determined core parameters over their standard errors: 1 if the
        intervals have the correct width, more if they are too narrow.
    wrong : Share
        Logs with a determined core parameter outside its interval and with an error over `FAR_OFF`.
    seconds : Spread
    """

    family: str
    logs: int
    failed: int
    refused: int
    determined: Share
    core: Share
    core_determined: Share
    half_width: float
    error_ratio: float
    wrong: Share
    seconds: Spread


def claims(record: Record) -> Iterator[Claim]:
    """Yield the estimates of one log that have a defined truth."""
    truth = record["truth"]
    for name, (value, low, high, status) in record.get("estimates", {}).items():
        if name in truth:
            yield Claim("kept", name, value, low, high, status, truth[name])


def score(family: str, records: Sequence[Record]) -> RealisticScore:
    """Return the score of some logs.

    Parameters
    ----------
    family : str
        Name of the family.
    records : sequence of Record
    """
    found = [record for record in records if "error" not in record]
    of_logs = [(record["core"], list(_determined(record))) for record in found]
    every = [claim for _, of_log in of_logs for claim in of_log]
    core_of_logs = [[claim for claim in of_log if claim.name in core] for core, of_log in of_logs]
    core = [claim for of_log in core_of_logs for claim in of_log]
    wide = [claim for claim in core if claim.high > claim.low]
    distances = [abs(claim.value - claim.truth) / _standard_error(claim) for claim in wide]
    widths = [0.5 * (claim.high - claim.low) / abs(claim.truth) for claim in wide]
    return RealisticScore(
        family=family,
        logs=len(records),
        failed=len(records) - len(found),
        refused=sum(bool(record.get("refused")) for record in records),
        determined=_held(every),
        core=_held(core),
        core_determined=Share(len(core), sum(len(record["core"]) for record in records)),
        half_width=median(widths) if widths else float("nan"),
        error_ratio=median(distances) / _MEDIAN if distances else float("nan"),
        wrong=Share(sum(any(map(_is_wrong, of_log)) for of_log in core_of_logs), len(records)),
        seconds=spread([record["seconds"] for record in found]),
    )


def scores(records: Sequence[Record]) -> list[RealisticScore]:
    """Return a score per family, and one of all."""
    families = dict.fromkeys(record["family"] for record in records)
    found = [score(name, [r for r in records if r["family"] == name]) for name in families]
    return [*found, score("all", records)] if len(found) > 1 else found


def _determined(record: Record) -> Iterator[Claim]:
    return (claim for claim in claims(record) if claim.status == "determined")


def _standard_error(claim: Claim) -> float:
    return (claim.high - claim.low) / (2.0 * _TWO_SIDED)


def _is_wrong(claim: Claim) -> bool:
    return not claim.holds and claim.error > FAR_OFF


def _held(some: Sequence[Claim]) -> Share:
    return Share(sum(claim.holds for claim in some), len(some))
