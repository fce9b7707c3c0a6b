"""Numbers as text, with no more digits than they deserve."""

from collections.abc import Sequence
from math import floor, inf, isfinite, isnan, log10

from flexid.identification.vocabulary.evidence import Verdict
from flexid.report.terminal import Cell

_MOST = 15  # significant digits, beyond which a float's own rounding begins


def format_with_interval(
    value: float, lower: float, upper: float, digits: int = 2
) -> tuple[str, str, str]:
    """Numbers as text, with as many digits as the width of the interval justifies.

    Examples
    --------
    >>> format_with_interval(99.98731, 99.93, 100.04)
    ('99.99', '99.93', '100.04')
    >>> format_with_interval(4.1e6, 3.9e6, 4.3e6)
    ('4100000', '3900000', '4300000')
    >>> format_with_interval(31346198.4, -9e9, 9.1e9)
    ('3e+07', '-9e+09', '9e+09')
    >>> format_with_interval(31346198.4, -float("inf"), float("inf"))
    ('3e+07', '-inf', 'inf')
    """
    numbers = (value, lower, upper)
    width = upper - lower
    if isnan(width) or not isfinite(value) or width < 0.0 or width == inf:
        first, second, third = (f"{x:.1g}" for x in numbers)
    elif width == 0.0:
        first, second, third = (f"{x:.6g}" for x in numbers)
    else:
        largest = max(map(abs, numbers))
        place = max(floor(log10(width)) - digits + 1, floor(log10(largest)) - _MOST + 1)
        first, second, third = _rounded(numbers, place)
    return first, second, third


def _rounded(numbers: Sequence[float], place: int) -> tuple[str, ...]:
    """Numbers rounded to a power of ten: as usual, or all scientific where that is shorter."""
    usual = tuple(_usual(x, place) for x in numbers)
    scientific = tuple(_scientific(x, place) for x in numbers)
    return min(usual, scientific, key=lambda texts: max(map(len, texts)))


def _usual(x: float, place: int) -> str:
    if place <= 0 or x == 0.0:
        return f"{x:.{max(0, -_own_place(x, place))}f}"
    return f"{float(_scientific(x, place)):.0f}"


def _scientific(x: float, place: int) -> str:
    if x == 0.0:
        return "0"
    return f"{x:.{floor(log10(abs(x))) - _own_place(x, place)}e}"


def _own_place(x: float, place: int) -> int:
    """The last place of a number: it keeps one digit at least."""
    return min(place, floor(log10(abs(x)))) if x else place


def listed(words: Sequence[str]) -> str:
    """Words in a row, with "and" before the last.

    >>> listed(["a", "b", "c"])
    'a, b and c'
    """
    return " and ".join(filter(None, (", ".join(words[:-1]), *words[-1:])))


VERDICT_STYLES: dict[Verdict, str] = {
    "determined": "green",
    "weak": "yellow",
    "undetermined": "red",
}


def verdict_cell(verdict: Verdict) -> Cell:
    """A verdict for a table, in its colour."""
    return Cell((verdict,), VERDICT_STYLES[verdict])


def value_cells(value: float, lower: float, upper: float) -> tuple[Cell, Cell]:
    """A number and its interval for a table: two digits of the width, or one."""
    values, intervals = [], []
    for digits in (2, 1):
        shown, low, high = format_with_interval(value, lower, upper, digits)
        values.append(shown)
        intervals.append(f"[{low}, {high}]")
    return Cell(tuple(values)), Cell(tuple(intervals))
