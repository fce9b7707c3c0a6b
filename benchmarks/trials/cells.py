"""Cells of the tables of scores."""

from math import isfinite

from benchmarks.trials.score import Share, Spread


def percent(value: float, digits: int = 2) -> str:
    """A share in percent."""
    return f"{100.0 * value:.{digits}g}" if isfinite(value) else "–"


def share(some: Share) -> str:
    """Some of many in percent."""
    return f"{some.percent:.1f} % of {some.whole}" if some.whole else "–"


def number(value: float) -> str:
    """A number."""
    return f"{value:.2f}" if isfinite(value) else "–"


def seconds(spread: Spread) -> str:
    """Median and largest time."""
    return f"{spread.middle:.1f} / {spread.largest:.1f}" if isfinite(spread.middle) else "–"


def failures(failed: int, refused: int) -> str:
    """Logs without a result."""
    return f"{failed} ({refused})" if failed else "0"
