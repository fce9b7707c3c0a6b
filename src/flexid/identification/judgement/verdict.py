"""The verdict on each number follows from the width of its interval, and from nothing else.

Whatever is doubted, the structure, model error, correlated residuals, delays, widens the interval;
a verdict reads its width.
"""

from math import isfinite

from flexid.identification.vocabulary.evidence import Verdict
from flexid.identification.vocabulary.thresholds import THRESHOLDS, Thresholds

Judged = tuple[Verdict, str]


def verdict(
    value: float,
    interval: tuple[float, float],
    effect: float = float("inf"),
    thresholds: Thresholds = THRESHOLDS,
) -> Judged:
    """Judge a number by its interval; the reason of a determined one is empty."""
    half = 0.5 * (interval[1] - interval[0])
    if not isfinite(half):
        return "undetermined", "the log holds no information on it"
    relative = half / abs(value) if value else float("inf")
    if relative <= thresholds.determined_width or effect <= thresholds.negligible_share:
        return "determined", ""
    reason = f"its interval reaches {_percent(relative)} to either side"
    return ("weak" if relative <= thresholds.weak_width else "undetermined"), reason


def _percent(share: float) -> str:
    return f"{100.0 * share:.0f} %" if share < 10.0 else "far"
