"""Comparison of printed output with that shown on a page."""

import re

_NUMBER = re.compile(r"[-+−]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
_RULE = re.compile(r"[─━═]+")


def agrees(shown: str, printed: str) -> bool:
    """Return whether a page shows what was printed.

    Words are compared one by one, so that widths of columns and breaks of lines do not matter, and
    ``...`` stands for any number of words. A number agrees if its last digit shown is off by at
    most one. Whole numbers below 100 are counts and must be equal.
    """
    return _matches(_words(shown), _words(printed))


def _words(text: str) -> list[str]:
    """Return the words of a text, without the rules of its tables."""
    return [word for word in text.split() if not _RULE.fullmatch(word)]


def _matches(shown: list[str], printed: list[str]) -> bool:
    """Return whether all words agree, with any number of them for each ``...``."""
    if "..." not in shown:
        return len(shown) == len(printed) and all(map(_word_agrees, shown, printed))
    first = shown.index("...")
    rest = shown[first + 1 :]
    ends = (printed[at:] for at in range(first, len(printed) - len(rest) + rest.count("...") + 1))
    return _matches(shown[:first], printed[:first]) and any(_matches(rest, end) for end in ends)


def _word_agrees(shown: str, printed: str) -> bool:
    """Return whether a word agrees, number by number."""
    if shown == printed:
        return True
    if _NUMBER.split(shown) != _NUMBER.split(printed):
        return False
    return all(map(_number_agrees, _NUMBER.findall(shown), _NUMBER.findall(printed)))


def _number_agrees(shown: str, printed: str) -> bool:
    """Return whether a number agrees to the digits shown."""
    mantissa, _, exponent = shown.partition("e")
    decimals = len(mantissa.partition(".")[2])
    value = float(shown.replace("−", "-"))
    counts = decimals == 0 and not exponent and abs(value) < 100
    unit = 0.0 if counts else 10.0 ** (int(exponent or 0) - decimals)
    # A hundredth of the last digit allows for binary rounding.
    return abs(value - float(printed.replace("−", "-"))) <= 1.01 * unit
