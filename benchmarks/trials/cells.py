"""Cells of the score tables."""

from math import isfinite

from benchmarks.trials.score import Share, Spread


def percent(value: float, digits: int = 2) -> str:
    """Print a share in percent."""
    return f"{100.0 * value:.{digits}g}" if isfinite(value) else "–"


def share(some: Share) -> str:
    """Print a count of a total with its percentage."""
    return f"{some.percent:.1f} % of {some.whole}" if some.whole else "–"


def number(value: float) -> str:
    """Print a number."""
    return f"{value:.2f}" if isfinite(value) else "–"


def seconds(spread: Spread) -> str:
    """Print median and largest time in s."""
    return f"{spread.middle:.1f} / {spread.largest:.1f}" if isfinite(spread.middle) else "–"


def failures(failed: int, refused: int) -> str:
    """Print the number of logs without a result."""
    return f"{failed} ({refused})" if failed else "0"
