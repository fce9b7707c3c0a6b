"""Names of columns: split from their units, and recognised however they are written."""

from __future__ import annotations

import difflib
import re
from collections import Counter
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

_QUANTITIES = {  # in English, German, French and Italian
    "position": {
        *("position", "pos", "angle", "ang", "q", "theta", "phi"),
        *("winkel", "lage", "posizione", "angolo"),
    },
    "velocity": {
        *("velocity", "vel", "speed", "omega", "qd", "dq", "qdot", "dtheta", "thetadot"),
        *("drehzahl", "geschwindigkeit", "vitesse", "velocita"),
    },
    "torque": {"torque", "tau", "trq", "effort", "drehmoment", "moment", "couple", "coppia"},
    "current": {"current", "cur", "curr", "i", "iq", "strom", "courant", "corrente"},
    "voltage": {"voltage", "volt", "u", "spannung", "tension", "tensione"},
    "time": {"time", "t", "timestamp", "datetime", "clock", "tout", "zeit", "temps", "tempo"},
}
_SIDES = {
    "motor": {"motor", "mot", "m", "rotor", "drive", "moteur", "motore", "antrieb"},
    "link": {
        *("link", "load", "l", "arm", "output"),
        *("last", "abtrieb", "charge", "sortie", "carico", "uscita"),
    },
}
_CLEAR_SIDES = {"motor", "rotor", "link", "load"}  # also as a part of a path, or with a unit
_FILLERS = {
    *("meas", "measured", "act", "actual", "enc", "encoder", "side", "sensor", "value", "data"),
    *("ist", "istwert", "mesure", "de"),
}
_OF_TIME = {"date", "stamp"}  # fillers beside the time
_UNITS = {
    "s": "s", "sec": "s", "ms": "ms", "us": "us", "rad": "rad", "deg": "deg", "rpm": "rpm",
    "rad_s": "rad/s", "rad/s": "rad/s", "radps": "rad/s", "rads": "rad/s",
    "deg_s": "deg/s", "deg/s": "deg/s", "degps": "deg/s", "degs": "deg/s",
    "Nm": "N m", "N_m": "N m", "mNm": "mN m", "A": "A", "mA": "mA", "V": "V", "mV": "mV",
}  # fmt: skip
_BY_UNIT = {
    **dict.fromkeys(("rad", "deg", "°", "turn"), "position"),
    **dict.fromkeys(("rad/s", "deg/s", "°/s", "rpm", "1/min"), "velocity"),
    **dict.fromkeys(("N m", "Nm", "mN m", "mNm"), "torque"),
    **dict.fromkeys(("A", "mA"), "current"),
    **dict.fromkeys(("V", "mV"), "voltage"),
}
LONGEST = 200  # characters of a name that is looked into
MOST_TIMES = 3  # in a message
_PARTING = re.compile(r"[/.](?=[^\s\d])")  # of the parts of a path
_MOST_PARTS = 8  # of a path that are looked at for its shortest end
_INPUTS = ("torque", "current", "voltage")


def split_header(header: str) -> tuple[str, str | None]:
    """Split a header such as ``link_position [deg]`` into its name and its unit.

    A number in brackets is an index.

    >>> split_header("link_position [deg]")
    ('link_position', 'deg')
    >>> split_header("time (s)")
    ('time', 's')
    >>> split_header("position[0]")
    ('position[0]', None)
    >>> split_header("q(:,2)")
    ('q(:,2)', None)
    """
    header = header.strip()
    match = None
    if len(header) <= LONGEST:
        match = re.fullmatch(r"(.*?)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\)|\{([^{}]*)\})", header)
    if match is None:
        return header, None
    unit = next(group for group in match.groups()[1:] if group is not None).strip()
    if re.fullmatch(r"[\d:, ]+", unit):
        return header, None
    return match[1].strip(), unit


def folded(name: str) -> str:
    """A name in lower case, its words joined by underscores.

    >>> folded("Motor Position")
    'motor_position'
    """
    return re.sub(r"[\s.\-]+", "_", name.casefold())


def usual_channel(header: str) -> tuple[str, str | None] | None:
    """The channel that a column holds by a usual name, and the unit in that name.

    A position or a velocity whose name has no side is that of a drive with one encoder, and is
    returned as ``"position"`` or ``"velocity"``.

    >>> usual_channel("q_link_deg")
    ('link_position', 'deg')
    >>> usual_channel("tau")
    ('motor_torque', None)
    >>> usual_channel("temperature") is None
    True
    """
    if len(header) > LONGEST:
        return None
    stem, unit = _stem_and_unit(header)
    words = [word.lower() for word in re.findall(r"[A-Z]?[a-z]+|[A-Z]+|\d+", stem)]
    quantities = [_kind(word, _QUANTITIES) for word in words]
    sides = [_kind(word, _SIDES) for word in words]
    fillers = _FILLERS | (_OF_TIME if "time" in quantities else set())
    if any(
        quantity is None and side is None and word not in fillers
        for word, quantity, side in zip(words, quantities, sides, strict=True)
    ):
        return None
    found = [quantity for quantity in quantities if quantity is not None]
    where = {side for side in sides if side is not None}
    if not found and not _CLEAR_SIDES.isdisjoint(words):  # as Motor [deg]
        found = [_BY_UNIT[unit]] if unit in _BY_UNIT else []
    if len(found) != 1 or len(where) > 1:
        return None
    quantity, side = found[0], next(iter(where), None)
    if {"i", "u"} & set(words) and unit is None:  # as well a row's number, or any input
        return None
    if quantity == "time":
        return None if side else ("time", unit)
    if quantity in _INPUTS:
        return None if side == "link" else (f"motor_{quantity}", unit)
    return (f"{side}_{quantity}" if side else quantity, unit)


def _stem_and_unit(header: str) -> tuple[str, str | None]:
    """A name and the unit behind it, in brackets or behind an underscore."""
    bare, unit = split_header(header)
    match = None
    if unit is None:
        match = re.fullmatch(rf"(.+?)[\s_.\-/]+({'|'.join(map(re.escape, _UNITS))})", bare)
    return (match[1], _UNITS[match[2]]) if match else (bare, unit)


def may_be_input(header: str) -> bool:
    """Whether a column may hold what drives the motor, by its name or its unit.

    >>> [may_be_input(header) for header in ("tau", "M_Nm", "load torque [Nm]", "temperature")]
    [True, True, False, False]
    """
    usual = usual_channel(header)
    if usual is not None:
        return usual[0].removeprefix("motor_") in _INPUTS
    if len(header) > LONGEST:
        return False
    stem, unit = _stem_and_unit(header)
    is_of_link = any(_kind(word, _SIDES) == "link" for word in re.findall("[a-z]+", stem.lower()))
    return not is_of_link and _BY_UNIT.get(unit or "") in _INPUTS


def _kind(word: str, kinds: dict[str, set[str]]) -> str | None:
    return next((kind for kind, words in kinds.items() if word in words), None)


def shortest_ends(paths: Iterable[str]) -> dict[str, str]:
    """By path, its shortest end that no other path has and that leaves no side of the joint out.

    >>> ends = shortest_ends(["log/time", "log/motor/effort", "log/q_link", "speed_rad/s"])
    >>> [*ends.values()]
    ['time', 'motor/effort', 'q_link', 'speed_rad/s']
    """
    bare = {path: split_header(path)[0] for path in paths}
    starts = {path: [0, *(m.end() for m in _PARTING.finditer(name))] for path, name in bare.items()}
    ends: dict[str, str] = {}
    for count in range(1, _MOST_PARTS + 1):
        begins = {path: at[max(0, len(at) - count)] for path, at in starts.items()}
        times = Counter(bare[path][begin:] for path, begin in begins.items())
        for path, begin in begins.items():
            parent = path[starts[path][-count - 1] : begin] if begin else ""
            is_clear = not (_names_side(parent) and _has_no_side(path[begin:]))
            if times[bare[path][begin:]] == 1 and is_clear:
                ends.setdefault(path, path[begin:])
    return {path: _recognised(ends.get(path, path), path) for path in starts}


def _names_side(part: str) -> bool:
    """Whether a part of a path is of one side of the joint."""
    return not _CLEAR_SIDES.isdisjoint(re.findall("[a-z]+", part.casefold()))


def _has_no_side(end: str) -> bool:
    """Whether an end names a quantity that either side may have."""
    found = usual_channel(end)
    return found is not None and found[0] in ("position", "velocity", "motor_torque")


def _recognised(end: str, path: str) -> str:
    """The end of a path, or all of it where that alone is a usual name."""
    return path if usual_channel(end) is None and usual_channel(path) is not None else end


def did_you_mean(word: str, candidates: Iterable[str]) -> str:
    """A question in brackets that names the candidate closest to a word; empty if none is."""
    by_lower = {name.lower(): name for name in candidates if len(name) <= LONGEST}
    close = difflib.get_close_matches(word.lower(), by_lower, n=1, cutoff=0.75)
    return f" (did you mean {by_lower[close[0]]!r}?)" if close else ""


def quoted(names: Iterable[str]) -> str:
    """Names between quotation marks, as many and as much of them as one can read."""
    return first_of([repr(cut(name)) for name in names])


def cut(name: str, longest: int = 60) -> str:
    """As much of a name as one can read."""
    return name if len(name) <= longest else name[: longest - 3] + "..."


def first_of(items: list[str]) -> str:
    """As many items as one can read, in one line."""
    shown = items if len(items) <= 20 else [*items[:20], f"and {len(items) - 20} more"]
    return ", ".join(shown)


def first_times(times: Sequence[str], count: int = 0) -> str:
    """The first three times, and how many more there are of `count`, or of these."""
    more = max(count, len(times)) - MOST_TIMES
    return ", ".join(times[:MOST_TIMES]) + (f" and {more} more times" if more > 0 else "")
