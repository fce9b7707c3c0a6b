"""Units of columns, as people write them."""

from __future__ import annotations

import re
from functools import cache
from math import pi

from flexid.models.motion import unit_of

# The SI unit of every quantity a column may hold, with what a user may write instead.
EXAMPLES = {
    "s": ("s", "ms", "us"),
    "rad": ("rad", "deg", "turn"),
    "rad/s": ("rad/s", "deg/s", "rpm"),
    "N m": ("N m", "mN m"),
    "m": ("m", "mm", "um"),
    "m/s": ("m/s", "mm/s"),
    "N": ("N", "kN"),
    "V": ("V", "mV"),
    "A": ("A", "mA"),
}
_KNOWN = {  # by unit: its factor, the SI unit, and how people write it, in small letters
    "s": (1.0, "s", "s|sec|secs|second|seconds|sek|秒"),
    "ms": (1e-3, "s", "ms|msec|msecs|millis|millisecond|milliseconds|毫秒"),
    "us": (1e-6, "s", "us|µs|μs|usec|usecs|micros|microsecond|microseconds|微秒"),
    "ns": (1e-9, "s", "ns|nsec|nsecs|nanosec|nanoseconds"),
    "rad": (1.0, "rad", "rad|radian|radians|弧度"),
    "mrad": (1e-3, "rad", "mrad"),
    "urad": (1e-6, "rad", "urad|µrad|μrad"),
    "deg": (pi / 180.0, "rad", "deg|°|º|degree|degrees|gradi|grados|度"),
    "mdeg": (1e-3 * pi / 180.0, "rad", "mdeg"),
    "arcmin": (pi / 10_800.0, "rad", "arcmin"),
    "arcsec": (pi / 648_000.0, "rad", "arcsec"),
    "turn": (2.0 * pi, "rad", "turn|turns|rev|revs|revolution|revolutions|umdr|圈"),
    "rad/s": (
        1.0,
        "rad/s",
        "rad/s|rad_s|radps|rad/sec|radians/s|rad s-1|rad.s-1|rad s^-1|rad·s^-1",
    ),
    "mrad/s": (1e-3, "rad/s", "mrad/s"),
    "deg/s": (pi / 180.0, "rad/s", "deg/s|°/s|º/s|deg_s|degps|dps|deg/sec|degrees/s|degree/s"),
    "turn/s": (2.0 * pi, "rad/s", "turn/s|turns/s|rev/s|revs/s|tr/s|giri/s"),
    "rpm": (pi / 30.0, "rad/s", "rpm|1/min|min-1|min^-1|u/min|rev/min|r/min|tr/min|giri/min|转/分"),
    "N m": (
        *(1.0, "N m"),
        "nm|n m|n*m|n·m|n.m|n-m|n_m|newton meter|newton meters|newton metre|newton metres|"
        "newton-meter|newton-metre|牛米",
    ),
    "mN m": (1e-3, "N m", "mnm|mn m|mn*m|mn·m|mn_m"),
    "uN m": (1e-6, "N m", "unm|µnm|μnm|un m"),
    "N mm": (1e-3, "N m", "nmm|n*mm|n mm"),
    "N cm": (1e-2, "N m", "ncm|n*cm|n cm"),
    "kN m": (1e3, "N m", "knm|kn m|kn*m|kn·m"),
    "kgf m": (9.80665, "N m", "kgfm|kgf m|kgf*m|kgf-m"),
    "kgf cm": (9.80665e-2, "N m", "kgfcm|kgf cm|kgf*cm|kgf-cm"),
    "lbf ft": (1.3558179483314003, "N m", "ft-lb|ft-lbf|ft lb|ftlb|lb-ft|lbf-ft|lbf ft|lbft"),
    "lbf in": (0.11298482902761671, "N m", "in-lb|in-lbf|in lb|inlb|lb-in|lbf-in|lbf in|lbin"),
    "ozf in": (0.007061551814226044, "N m", "oz-in|oz in|ozin|in-oz|ozf in"),
    "m": (1.0, "m", "m|metre|metres|meter|meters|米"),
    "cm": (1e-2, "m", "cm|centimetre|centimetres|centimeter|centimeters"),
    "mm": (1e-3, "m", "mm|millimetre|millimetres|millimeter|millimeters|毫米"),
    "um": (1e-6, "m", "um|µm|μm|micron|microns|micrometre|micrometres|micrometer|micrometers|微米"),
    "in": (0.0254, "m", "inch|inches"),
    "m/s": (1.0, "m/s", "m/s|m_s|mps|m/sec|m s-1|m.s-1|m s^-1|m·s^-1"),
    "cm/s": (1e-2, "m/s", "cm/s"),
    "mm/s": (1e-3, "m/s", "mm/s|mm_s|mmps|mm/sec"),
    "um/s": (1e-6, "m/s", "um/s|µm/s|μm/s"),
    "m/min": (1.0 / 60.0, "m/s", "m/min"),
    "mm/min": (1e-3 / 60.0, "m/s", "mm/min"),
    "N": (1.0, "N", "n|newton|newtons|牛"),
    "mN": (1e-3, "N", "mn"),
    "kN": (1e3, "N", "kn"),
    "kgf": (9.80665, "N", "kgf"),
    "lbf": (4.4482216152605, "N", "lbf"),
    "V": (1.0, "V", "v|volt|volts"),
    "mV": (1e-3, "V", "mv"),
    "A": (1.0, "A", "a|amp|amps|ampere|amperes|arms|a_rms|a rms|安"),
    "mA": (1e-3, "A", "ma|milliamp|milliamps"),
}
_BY_SPELLING = {word: unit for unit, (*_, words) in _KNOWN.items() for word in words.split("|")}
_USUAL = {  # exactly so, what else stands in a row of units
    *("s", "ms", "us", "µs", "μs", "V", "mV", "A", "mA", "Arms", "°", "º", "°/s", "º/s"),
    *("rad/s^2", "rad/s2", "count", "counts", "inc", "N m", "N*m", "N·m", "mN m", "mNm", "kNm"),
    *("W", "Hz", "kHz", "%", "-", "1", "°C", "K", "m", "N", "mN", "kN", "bool"),
}
_PER_SECOND = {"rads": "rad/s", "degs": "deg/s"}  # of a velocity
_MILLI = {  # whose first letter is small, as M is mega
    *("ms", "mrad", "mdeg", "mrad/s", "mN m", "mm", "mm/s", "mN", "mV", "mA"),
}
_SYMBOLS = {"s", "V", "A", "N", "°", "º"}  # of one character, which stand as they are
_COUNTS = {
    *("count", "counts", "cnt", "cnts", "inc", "incs", "increments", "tick", "ticks", "lsb"),
    *("pulse", "pulses", "digit", "digits"),
}
_TURNING = {"rad": "position", "rad/s": "velocity", "N m": "torque"}
_SLIDING = {unit_of(unit, "prismatic"): measured for unit, measured in _TURNING.items()}
_MEASURED = {**_TURNING, **_SLIDING, "A": "current", "V": "voltage"}
_SHARES = {"%", "‰", "percent", "permille", "pct", "promille"}
_RATED = re.compile(r"\s*[%‰]|.*\b(rated|nominal|nenn\w*)\b", re.IGNORECASE)
_GRAD = {"grad", "gon"}
# 0.01 deg, 1e-3 rad; what is larger than one may be a range, as 3.3 V
_MULTIPLE = re.compile(r"(0?\.\d{1,9}|\d[eE]-\d) ?([^\W\d].*)")
DOTS = "\u22c5\u2219\u2022"  # dot operator, bullet operator, bullet: for the middle dot


class UnitError(Exception):
    """A unit cannot be read, or measures something else; the text says what to write instead."""


def is_usual(text: str) -> bool:
    """Whether a text is a unit as loggers write them, of whatever quantity."""
    return text in _USUAL or (len(text) > 1 and _spelled(text) is not None)


def unit_of_word(text: str) -> str | None:
    """The unit that the last word of a name stands for, such as ``deg`` in ``q_link_deg``.

    >>> unit_of_word("Nm"), unit_of_word("counts"), unit_of_word("m"), unit_of_word("v")
    ('N m', 'counts', None, None)
    """
    if is_relative(text) or text.lower() in {*_PER_SECOND, *_GRAD}:
        return text
    is_unit = text in _SYMBOLS or (len(text) > 1 and text != "meter")  # an instrument, too
    return _spelled(text) if is_unit else None


def is_relative(unit: str) -> bool:
    """Whether a unit depends on the encoder or on the drive: counts, or shares of something."""
    return unit.lower() in _COUNTS or _is_share(unit)


def _is_share(unit: str) -> bool:
    return unit.lower() in _SHARES or _RATED.match(unit) is not None


def _spelled(text: str) -> str | None:
    """The unit that a text is a way to write; None where it is none."""
    unit = _BY_SPELLING.get(text.lower())
    return None if unit in _MILLI and not text.startswith("m") else unit


def quantity_of(unit: str) -> str | None:
    """What a unit measures, as far as a name may leave that out: ``"position"`` for degrees."""
    if unit.lower() in _COUNTS:
        return "position"
    return _MEASURED.get(_in_si(unit)[1])


def is_of_a_slide(unit: str) -> bool:
    """Whether a unit measures what slides, in m, m/s or N, and not what turns."""
    return _in_si(unit)[1] in _SLIDING


@cache
def scale_to_si(text: str, si_units: tuple[str, ...]) -> tuple[float, str]:
    """The factor from a unit as written in a file to SI, and which of the SI units that is."""
    if text.lower() in _COUNTS and (positions := {"rad", "m"} & {*si_units}):
        counted = EXAMPLES[max(positions)][-1]
        raise UnitError(
            f"the unit [{text}] depends on the encoder: write unit = '{counted}' and scale = "
            f"'1/4096', for 4096 counts in one, in a column map"
        )
    if _is_share(text):
        raise UnitError(
            f"the unit [{text}] is a share of something: write {_accepted(si_units)} as the unit, "
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
            f"the unit [{text}] is that of a rotation, and another column, or the arm's file, says "
            f"that this joint slides: correct one, or write the lead of a motor that turns in a "
            f"column map, as 0.005 for 5 mm in a turn"
        )
    if si_unit in _SLIDING and {*si_units} & {*_TURNING}:
        raise UnitError(
            f"the unit [{text}] is that of a slide, and this joint turns: write the unit of an "
            f"angle or a torque, or joint = 'prismatic' in a column map; of an arm, slides in its "
            f"file"
        )
    raise UnitError(
        f"the unit [{text}] is not known for this column: write {_accepted(si_units)}, or the unit "
        f"and a scale in a column map"
    )


def _in_si(text: str) -> tuple[float, str]:
    """The factor from a unit to SI, and the SI unit; empty where it is none."""
    multiple = _MULTIPLE.fullmatch(text)
    if multiple is not None:
        factor, si_unit = _in_si(multiple[2])
        return float(multiple[1]) * factor, si_unit
    known = _spelled(re.sub(f"[{DOTS}]", "·", text).replace("º", "°").strip())
    return _KNOWN[known][:2] if known else (0.0, "")


def _accepted(si_units: tuple[str, ...]) -> str:
    """Units that may be written, for a message."""
    return " or ".join(", ".join(f"[{unit}]" for unit in EXAMPLES[si]) for si in si_units)
