"""Where two estimates come from: shared logs, doubts of both, and constants of shapes."""

from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from typing import Any, Literal, NamedTuple

from flexid.arms.result import ArmIdentification
from flexid.identification.result import Identification
from flexid.identification.vocabulary.evidence import ValueEstimate
from flexid.models.flexible_joint import (
    BACKLASH_WIDTH,
    RIPPLE_NUMBER,
    RIPPLE_ORIGIN,
    SHAPE_TERMS,
    WIDTHS,
)

Either = Identification | ArmIdentification

Sharing = Literal["different", "some shared", "same"]
"""Whether two estimates were made from the same logs."""


_POSITIONS = ("motor_position", "link_position", "deflection")


class _Log(NamedTuple):
    """A file, and the columns of its positions: it may hold several axes."""

    sha256: str
    columns: frozenset[str]

    def is_of(self, other: "_Log") -> bool:
        """Whether both hold one axis' noise; where columns are not named, one file is one axis."""
        apart = self.columns and other.columns and not self.columns & other.columns
        return self.sha256 == other.sha256 and not apart


def shared_logs(a: Mapping[str, Any], b: Mapping[str, Any]) -> Sharing:
    """Whether the provenances of two estimates name the same axes of the same files."""
    first, second = _named_logs(a), _named_logs(b)
    in_both = [
        any(log.is_of(other) for other in others)
        for logs, others in ((first, second), (second, first))
        for log in logs
    ]
    if not any(in_both):
        return "different"
    return "same" if all(in_both) else "some shared"


def doubts(a: Either, b: Either, logs: Sharing) -> Iterator[str]:
    """What limits a comparison, a sentence each."""
    if a.model != b.model:
        yield (
            f"A is of {_JOINTS[a.model]} and B of {_JOINTS[b.model]}: only what has the same "
            f"name, meaning and unit in both is compared"
        )
    if logs == "some shared":
        yield (
            "some logs are in both estimates, which therefore err alike: the intervals allow for "
            "the worst of that, and a change may be missed"
        )
    unnamed = [side for side, e in (("A", a), ("B", b)) if not _named_logs(e.provenance)]
    if unnamed:
        yield (
            f"{' and '.join(unnamed)} does not say which logs it was made from: they are taken for "
            f"different ones"
        )
    common = [name for name in _known(a) if name in _known(b)]
    if common:
        yield (
            f"both rest on what was said of {' and '.join(common)}: if that has changed, other "
            f"values seem to have changed in its stead"
        )
    unexplained = [side for side, e in (("A", a), ("B", b)) if _is_unexplained(e)]
    if unexplained and logs != "same":
        yield (
            f"in {' and '.join(unexplained)} the residuals hold something that no term describes. "
            f"It may look like a change where the motions differ: compare logs of the same motion"
        )
    for side, estimate in (("A", a), ("B", b)):
        yield from (f"{side}: {warning}" for warning in estimate.warnings)


_JOINTS = {
    "flexible": "a flexible joint",
    "link": "a link alone",
    "rigid": "a rigid joint",
    "arm": "an arm",
}


def _is_unexplained(estimate: Either) -> bool:
    return estimate.disturbances is not None if estimate.model == "arm" else estimate.unexplained


def _named_logs(provenance: Mapping[str, Any]) -> set[_Log]:
    found = set()
    for log in provenance.get("inputs", ()):
        of_positions = (log.get("columns", {}).get(channel) for channel in _POSITIONS)
        columns = frozenset(c for origin in of_positions if origin for c in origin["columns"])
        if log.get("sha256"):
            found.add(_Log(str(log["sha256"]), columns))
    return found


def _known(estimate: Either) -> Mapping[str, Any]:
    return estimate.provenance.get("settings", {}).get("known", {})


ALIKE = 2.0
"""Ratio of two widths beyond which what rests on them is not compared."""

_WHEREVER = frozenset({"torque_ripple"})  # however a ripple counts
# Beyond which ripples are different ones; whole turns from which their angles count are or are not.
_ALIKE = {RIPPLE_NUMBER: 1.02, RIPPLE_ORIGIN: 1.0 + 1e-9}


@cache
def _constants() -> Sequence[tuple[str, str]]:
    """Coefficients that have a width, and the constant that it is."""
    regressors = [r for t in SHAPE_TERMS.values() for r in (*t.link.items(), *t.motor.items())]
    # Where encoders have their zeros, and so the middle of a play, is a matter of each log.
    return [(c, shape) for c, r in regressors for shape in WIDTHS if shape in r]


def unlike_width(a: Identification, b: Identification) -> Mapping[tuple[str, str], str]:
    """Why what rests on a coefficient cannot be compared, by coefficient and constant."""
    found = {}
    for coefficient, shape in _constants():
        first, second = (estimate.choices.shapes.get(shape) for estimate in (a, b))
        if first is None or second is None:
            continue
        alike = _ALIKE.get(shape, ALIKE)
        if _apart(first, second, alike) and not (_own_width(shape, a) and _own_width(shape, b)):
            found[coefficient, shape] = (
                f"it rests on a {shape} of {first:.5g} in A and of {second:.5g} in B, which was "
                f"chosen for each log"
            )
    return found


def _apart(first: float, second: float, alike: float) -> bool:
    least, most = sorted((abs(first), abs(second)))
    return most > alike * least or first * second < 0.0


def _own_width(shape: str, estimate: Identification) -> bool:
    """Whether a width is that of the estimate's own gap, not one that was chosen."""
    gap = estimate.parameters.get("half_backlash")
    if shape != BACKLASH_WIDTH or gap is None:
        return False
    return not _apart(gap.value, estimate.choices.shapes[shape], ALIKE)


def reason_of(unlike: Mapping[tuple[str, str], str], *values: ValueEstimate | None) -> str:
    """Why values of one number cannot be compared; empty where no width speaks against it."""
    there = [value for value in values if value is not None]
    rested_on = {c for value in there for c in value.slopes}
    wherever = {value.name for value in there} <= _WHEREVER
    for (coefficient, shape), reason in unlike.items():
        if coefficient in rested_on and not (shape == RIPPLE_ORIGIN and wherever):
            return reason
    return ""
