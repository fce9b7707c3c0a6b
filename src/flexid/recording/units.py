"""Units of columns in common spellings, and their conversion to SI units."""

import re
import tomllib
from functools import cache
from pathlib import Path

from flexid.models.motion import unit_of

_DECLARED = tomllib.loads(Path(__file__).with_name("units.toml").read_text(encoding="utf-8"))
# By the SI unit of a column: units that a message suggests.
EXAMPLES: dict[str, list[str]] = _DECLARED["examples"]
_USUAL, _COUNTS = {*_DECLARED["usual"]}, {*_DECLARED["counts"]}
_KNOWN = {  # by unit: its factor, the SI unit, and its spellings in lower case
    unit: (factor, si, words)
    for si, units in _DECLARED["units"].items()
    for unit, (factor, words) in units.items()
}
_BY_SPELLING = {word: unit for unit, (*_, words) in _KNOWN.items() for word in words.split("|")}
_PER_SECOND = {"rads": "rad/s", "degs": "deg/s"}  # for velocities
_MILLI = {  # units whose m must be in lower case, since M is mega
    *("ms", "mrad", "mdeg", "mrad/s", "mN m", "mm", "mm/s", "mN", "mV", "mA"),
}
_SYMBOLS = {"s", "V", "A", "N", "°", "º"}  # symbols of one character, case-sensitive
_TURNING = {"rad": "position", "rad/s": "velocity", "N m": "torque"}
_SLIDING = {unit_of(unit, "prismatic"): measured for unit, measured in _TURNING.items()}
_MEASURED = {**_TURNING, **_SLIDING, "A": "current", "V": "voltage"}
_SHARES = {"%", "‰", "percent", "permille", "pct", "promille"}
_RATED = re.compile(r"\s*[%‰]|.*\b(rated|nominal|nenn\w*)\b", re.IGNORECASE)
_GRAD = {"grad", "gon"}
# Factors below one, as in 0.01 deg or 1e-3 rad; a larger one may be a range, as in 3.3 V.
_MULTIPLE = re.compile(r"(0?\.\d{1,9}|\d[eE]-\d) ?([^\W\d].*)")
DOTS = "\u22c5\u2219\u2022"  # dot operator, bullet operator, bullet: for the middle dot


class UnitError(Exception):
    """A unit is unknown or measures another quantity; the text states what to write instead."""


def is_usual(text: str) -> bool:
    """Whether a text is a unit of any quantity, in a common spelling."""
    is_known = text in _USUAL or text.lower() in _GRAD
    return is_known or (len(text) > 1 and _spelled(text) is not None)


def unit_of_word(text: str) -> str | None:
    """Return the unit that the last word of a name denotes, such as ``deg`` in ``q_link_deg``.

    >>> unit_of_word("Nm"), unit_of_word("counts"), unit_of_word("m"), unit_of_word("v")
    ('N m', 'counts', None, None)
    """
    if is_relative(text) or text.lower() in {*_PER_SECOND, *_GRAD}:
        return text
    is_unit = text in _SYMBOLS or (len(text) > 1 and text != "meter")  # may be an instrument
    return _spelled(text) if is_unit else None


def is_relative(unit: str) -> bool:
    """Whether a unit depends on the encoder or the drive: counts, percent, or per mille."""
    return unit.lower() in _COUNTS or _is_share(unit)


def _is_share(unit: str) -> bool:
    return unit.lower() in _SHARES or _RATED.match(unit) is not None


def _spelled(text: str) -> str | None:
    """Unit that a text spells, with any sign between its parts; None if it spells none."""
    parts = re.sub(f"[·*{DOTS}]", " ", text.lower().rstrip(".")).split()
    unit = _BY_SPELLING.get(" ".join(parts))
    return None if unit in _MILLI and not text.startswith("m") else unit


def quantity_of(unit: str) -> str | None:
    """Return the quantity that a unit measures, such as ``"position"`` for degrees, or None."""
    if unit.lower() in _COUNTS:
        return "position"
    return _MEASURED.get(_in_si(unit)[1])


def is_of_a_slide(unit: str) -> bool:
    """Return whether a unit is one of linear motion, in m, m/s or N."""
    return _in_si(unit)[1] in _SLIDING


@cache
def scale_to_si(text: str, si_units: tuple[str, ...]) -> tuple[float, str]:
    """Return the factor of a unit in a file, and its SI unit, which must be in `si_units`."""
    if text.lower() in _COUNTS and (positions := {"rad", "m"} & {*si_units}):
        counted = EXAMPLES[max(positions)][-1]
        raise UnitError(
            f"the unit [{text}] depends on the encoder: write unit = '{counted}' and scale = "
            f"'1/4096', for 4096 counts in one, in a column map"
        )
    if _is_share(text):
        raise UnitError(
            f"the unit [{text}] is relative: write {_accepted(si_units)} as the unit, "
            f"and a hundredth or a thousandth of the rated value as the scale, in a column map"
        )
    if text.lower() in _GRAD and "rad" in si_units:
        raise UnitError(
            f"the unit [{text}] may mean degrees, or gon of which 400 are a turn: write [deg], or "
            f"unit = 'turn' and scale = '1/400' in a column map"
        )
    factor, si_unit = _in_si(_PER_SECOND.get(text.lower(), text) if "rad/s" in si_units else text)
    if si_unit in si_units:
        return factor, si_unit
    if unit_of(si_unit, "prismatic") in {*si_units} & {*_SLIDING}:
        raise UnitError(
            f"the unit [{text}] is one of rotation, but another column or the arm's file states "
            f"that this joint slides: correct one, or write the lead of a motor that turns in a "
            f"column map, as 0.005 for 5 mm in a turn"
        )
    if si_unit in _SLIDING and {*si_units} & {*_TURNING}:
        raise UnitError(
            f"the unit [{text}] is one of linear motion, but this joint turns: write one of an "
            f"angle or a torque, or joint = 'prismatic' in a column map; for an arm, slides in its "
            f"file"
        )
    raise UnitError(
        f"the unit [{text}] is not known for this column: write {_accepted(si_units)}, or the unit "
        f"and a scale in a column map"
    )


def _in_si(text: str) -> tuple[float, str]:
    """Factor of a unit and its SI unit; 0 and an empty text if the unit is unknown."""
    multiple = _MULTIPLE.fullmatch(text)
    if multiple is not None:
        factor, si_unit = _in_si(multiple[2])
        return float(multiple[1]) * factor, si_unit
    known = _spelled(text.replace("º", "°"))
    return _KNOWN[known][:2] if known else (0.0, "")


def _accepted(si_units: tuple[str, ...]) -> str:
    """Accepted units, for a message."""
    return " or ".join(", ".join(f"[{unit}]" for unit in EXAMPLES[si]) for si in si_units)
