"""A comparison in a few sentences."""

from collections.abc import Iterator, Sequence
from math import isfinite

from flexid.comparisons.comparison import Comparison
from flexid.comparisons.differences import Difference
from flexid.identification.vocabulary.intervals import CONFIDENCE
from flexid.report.terminal import format_with_interval, listed


def comparison_summary(comparison: Comparison) -> Iterator[str]:
    """What has changed, how sure that is, and what it rests on."""
    compared = [d for d in comparison.decisive.values() if d.compared]
    if not compared:
        yield "Nothing can be compared: no number was estimated in both."
    elif comparison.logs == "same":
        yield _of_one_log(comparison, compared)
    else:
        yield _answer(comparison, compared)
        yield from _perhaps(comparison, compared)
    yield from _all_at_once(comparison)
    if comparison.lacking:
        yield f"Not determined in A or in B, and so not compared: {_names(comparison.lacking)}."


def largest(d: Difference) -> str:
    """The most that a difference may be, with its unit."""
    if isfinite(d.largest_percent):
        return f"{_rounded_up(d.largest_percent)} %"
    return f"{_rounded_up(d.largest)} {d.unit}"


def _rounded_up(number: float) -> str:
    """Two digits, which promise no less than the number."""
    if not isfinite(number):
        return "any"
    shown = f"{number:.2g}"
    return shown if float(shown) >= number else f"{number * 1.05:.2g}"


def _answer(comparison: Comparison, compared: Sequence[Difference]) -> str:
    changed = comparison.having("changed")
    if changed:
        listed = ", ".join(f"{d.name} by {_change(d)}" for d in changed)
        return (
            f"Changed: {listed}. That is beyond chance for {_count(compared)} together: where "
            f"nothing has changed, at most one comparison in twenty names anything."
        )
    said = f"No change is seen in {_count(compared)}"
    known = [d for d in compared if isfinite(d.largest_percent)]
    if not known:
        return f"{said}."
    worst = max(known, key=lambda d: d.largest_percent)
    return f"{said}; the largest that may hide is one of {largest(worst)} of {worst.name}."


def _perhaps(comparison: Comparison, compared: Sequence[Difference]) -> Iterator[str]:
    perhaps = comparison.having("perhaps changed")
    if perhaps:
        count = len(compared)
        missed = f"With {count} intervals that hold 95 % each, one or more misses"
        if count == 1:
            missed = "An interval that holds 95 % misses"
        yield (
            f"Perhaps changed: {_names(perhaps)}. {missed} by chance in up to about "
            f"{100.0 * (1.0 - CONFIDENCE**count):.0f} % of comparisons; a third log would tell."
        )


def _of_one_log(comparison: Comparison, compared: Sequence[Difference]) -> str:
    contradictory = comparison.having("contradictory")
    begin = "Both estimates are of the same logs, so the drive cannot have changed."
    if contradictory:
        return (
            f"{begin} Yet {_names(contradictory)} {_differ(contradictory)} by more than both "
            f"intervals allow: at least one of the two models is wrong."
        )
    return f"{begin} {_count(compared)} {_differ(compared)} by no more than both intervals allow."


def _differ(differences: Sequence[Difference]) -> str:
    return "differ" if len(differences) > 1 else "differs"


def _all_at_once(comparison: Comparison) -> Iterator[str]:
    together = comparison.together
    if together is None:
        return
    count, chance = len(together.names), together.probability
    shown = f"{chance:.2g}" if chance >= 1e-4 else "less than 0.0001"
    begin = f"All {count} coefficients that both have, at once: chance makes a difference as large"
    end = ""
    if together.significant:
        end = "; it is not the same drive as before"
        if not comparison.having("changed"):
            end += ", though no number shows it by itself"
    elif not comparison.having("changed"):
        end = "; nothing speaks against one and the same drive"
    yield f"{begin} with probability {shown}{end}."


def _change(difference: Difference) -> str:
    relative = isfinite(difference.percent)
    value = difference.percent if relative else difference.value
    ends = difference.percent_interval if relative else difference.interval
    shown, low, high = format_with_interval(value, *ends)
    return f"{shown} [{low}, {high}] {'%' if relative else difference.unit}"


def _count(compared: Sequence[Difference]) -> str:
    return f"{len(compared)} number{'s' if len(compared) > 1 else ''}"


def _names(differences: Sequence[Difference]) -> str:
    return listed([d.name for d in differences])
