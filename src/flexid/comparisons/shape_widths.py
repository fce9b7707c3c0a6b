"""Constants of shapes that two estimates took: widths, chosen for each log, and the like.

The amplitude of a shape, such as that of Stribeck friction, goes with its width: of the same drive
another width gives another amplitude. The width of play follows from the gap itself, and other gaps
have other widths.
"""

from collections.abc import Mapping, Sequence
from functools import cache

from flexid.identification.result.identification import Identification
from flexid.identification.vocabulary.evidence import ValueEstimate
from flexid.models.flexible_joint import (
    BACKLASH_WIDTH,
    RIPPLE_NUMBER,
    RIPPLE_ORIGIN,
    SHAPE_TERMS,
    SHAPES,
)

ALIKE = 2.0
"""Ratio of two widths beyond which what rests on them is not compared."""

_WHEREVER = frozenset({"torque_ripple"})  # however a ripple counts
# Beyond which ripples are different ones; whole turns from which their angles count are or are not.
_ALIKE = {RIPPLE_NUMBER: 1.02, RIPPLE_ORIGIN: 1.0 + 1e-9}


@cache
def _constants() -> Sequence[tuple[str, str]]:
    """Coefficients that have a width, and the constant that it is."""
    regressors = [r for t in SHAPE_TERMS.values() for r in (*t.link.items(), *t.motor.items())]
    return [(c, shape) for c, r in regressors for shape in SHAPES if shape in r]


def used_widths(estimate: Identification) -> Mapping[str, float]:
    """Constants of shapes that something in an estimate rests on, by name."""
    used = {shape for c, shape in _constants() if c in estimate.coefficients}
    return {name: width for name, width in estimate.choices.shapes.items() if name in used}


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
