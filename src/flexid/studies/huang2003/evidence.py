"""A claim and the numbers that decide it."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

Relation = Literal["<=", ">="]

Verdict = Literal["holds", "does not hold", "depends on the reading"]


@dataclass(frozen=True)
class Finding:
    """One number that decides a claim for one subject."""

    # what was looked at: a reading such as "1,2,3"; "any" where readings do not matter
    subject: str
    quantity: str  # what was measured
    value: float  # what came out
    relation: Relation  # how the value has to compare for the claim to hold
    limit: float  # with what
    unit: str = "1"  # unit of value and limit; dimensionless if left out

    @property
    def holds(self) -> bool:
        """Whether the claim holds for this subject; never for a value that is not a number."""
        return self.value <= self.limit if self.relation == "<=" else self.value >= self.limit


def findings(
    quantity: str, values: Mapping[str, float], relation: Relation, limit: float, unit: str = "1"
) -> tuple[Finding, ...]:
    """The same quantity of several subjects."""
    return tuple(Finding(name, quantity, x, relation, limit, unit) for name, x in values.items())


@dataclass(frozen=True)
class Claim:
    """A statement of the paper and what decides it."""

    key: str  # short name
    source: str  # where the paper makes it
    statement: str  # what it says, in our words
    findings: tuple[Finding, ...]  # one per subject

    @property
    def verdict(self) -> Verdict:
        """Whether all findings, none, or only some bear the claim out."""
        outcomes = {finding.holds for finding in self.findings}
        if len(outcomes) > 1:
            return "depends on the reading"
        return "holds" if outcomes == {True} else "does not hold"
