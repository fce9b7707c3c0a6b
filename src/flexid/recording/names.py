"""Recognition of channels by the names of columns, in several languages, with their units."""

import difflib
import re
import tomllib
import unicodedata
from collections import Counter
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

from flexid.recording.units import is_usual, quantity_of, unit_of_word

_WORDS = tomllib.loads(Path(__file__).with_name("words.toml").read_text(encoding="utf-8"))
QUANTITIES, SIDES = _WORDS["quantities"], _WORDS["sides"]
_MEANT_SIDES = {"motor", "link"}  # the others depend on the log
CLEAR_SIDES = {"motor", "rotor", "link", "load"}  # sides even as a part of a path, or with a unit
_SIDE_WORDS = {*CLEAR_SIDES, "joint"}  # name a quantity together with its unit
# Without a unit these may be a row number, any input, a speed, a count, a belt's tension, a factor.
_NEED_UNIT = {"i", "u", "v", "w", "n", "tension", "par", "scale"}
_ENGLISH = {"position", "pos", "angle", "ang", "velocity", "vel", "speed", "torque", "current"}
_BETWEEN = r"[\s_.,:;/\\$|{}()\[\]<>'\"-]*"  # characters allowed between words
_WORD = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|[A-Z]|\d+|[^\W\d_a-zA-Z]+")
_SHORTEST_PART = 3  # letters of a word within a longer one; two in Chinese
_WITH_SIDE = {  # symbols before m or l: qm, ql
    *("q", "theta", "phi", "tau", "pos", "dq", "qd", "v", "u", "i")
}
_LONGEST_WORD = 40  # letters of a compound that is split
_ACCENTED = "aceinouACEINOU"  # letters whose accents are dropped, but not a dot (a derivative)


LONGEST = 200  # characters of a name that is parsed
_KINDS = {
    word: kind
    for table in _WORDS.values()
    for kind, words in table.items()
    for word in words.split()
}


class Words(NamedTuple):
    """Words of a name and their meaning."""

    all: tuple[str, ...]
    quantities: tuple[str, ...]
    sides: frozenset[str]
    needs_unit: bool  # whether the name is ambiguous without a unit
    others: tuple[str, ...]  # unknown words
    kinds: frozenset[str]  # also those of words that say nothing about the channel

    @property
    def precedence(self) -> int:
        """Place among columns of one channel: 0 if measured, 1 if filtered, 2 if commanded."""
        return 2 if "command" in self.kinds else int("filtered" in self.kinds)

    @property
    def is_encoder(self) -> bool:
        """Whether an encoder is named."""
        return not {"enc", "encoder"}.isdisjoint(self.all)


@cache
def words_of(name: str) -> Words | None:
    """Return the words of a name; None if it has an unexpected character or is too long.

    >>> words_of("Abtriebswinkel").quantities, [*words_of("θ_m").sides], words_of("torque %")
    (('position',), ['motor'], None)
    """
    if len(name) > LONGEST:
        return None
    plain = "".join(map(_letter, unicodedata.normalize("NFC", name)))
    plain = re.sub(r"(?i)(?<![a-z])i_q(?![a-z])", "iq", plain)
    if plain.lstrip().startswith("-") or not re.fullmatch(_BETWEEN, _WORD.sub("", plain)):
        return None
    words = tuple(part for word in _WORD.findall(plain) for part in _parts(word.lower()))
    kinds = [
        # In "last position" the word is English, not the German word for a load.
        "" if word == "last" and after in _ENGLISH else _KINDS.get(word, "")
        for word, after in zip(words, (*words[1:], ""), strict=False)
    ]
    quantities = tuple(kind for kind in kinds if kind in QUANTITIES)
    unknown = {"", *(f"filler of {one}" for one in QUANTITIES if one not in quantities)}
    if not {*quantities} & {*_INPUTS}:
        unknown.add("command")
    return Words(
        words,
        quantities,
        frozenset(kind for kind in kinds if kind in SIDES),
        not _NEED_UNIT.isdisjoint(words),
        tuple(word for word, kind in zip(words, kinds, strict=True) if kind in unknown),
        frozenset(kinds),
    )


def _letter(letter: str) -> str:
    """A letter in plain Latin: Greek spelled out, accents dropped, full-width forms narrowed."""
    if letter.isascii():
        return letter
    if "\uff00" <= letter <= "\uffef":  # full-width forms
        return unicodedata.normalize("NFKC", letter)
    called = unicodedata.name(letter, "")
    if re.fullmatch("GREEK (SMALL|CAPITAL) LETTER [A-Z]+", called):
        return f"_{called.rpartition(' ')[2].lower()}_"
    base = unicodedata.normalize("NFD", letter)
    is_plain = len(base) == 2 and base[0] in _ACCENTED and base[1] != "\N{COMBINING DOT ABOVE}"
    return base[0] if is_plain else letter


def _parts(word: str) -> tuple[str, ...]:
    """Words that a compound consists of; the word itself if it is no compound."""
    if word[:-1] in _WITH_SIDE and word[-1] in "ml" and word not in _KINDS:
        return word[:-1], word[-1]
    return (len(word) <= _LONGEST_WORD and _known_parts(word)) or (word,)


def _known_parts(word: str) -> tuple[str, ...]:
    """Known words that form a compound, perhaps joined by an s; empty if they do not."""
    if word in _KINDS:
        return (word,)
    shortest = _SHORTEST_PART if word.isascii() else 2
    for end in range(len(word) - shortest, shortest - 1, -1):
        if word[:end] in _KINDS:
            for rest in (word[end:], word[end:].removeprefix("s")):
                parts = _known_parts(rest) if len(rest) >= shortest else ()
                if parts:
                    return (word[:end], *parts)
    return ()


_TIMES = ("s", "ms", "us", "ns")
_FEWEST_NAMES = 3  # names with a quantity; a word that all of them share is ignored
_LONGEST_SYMBOL = 4  # letters; a longer name of a time unit is a time column
_NARROW = str.maketrans(  # full-width brackets and no-break spaces
    "（）［］【】｛｝＜＞\u00a0\u202f", "()[][]{}<>  "
)
_BARE_UNIT = re.compile(r"(.*?[^\s/,:])(?:\s+/\s*|\s*,\s*|\s*:\s*|\s+in\s+)([^\s\d][^,:]{0,23})")
_WORD_BREAK = re.compile(r"[\s_.\-/]+|(?<=[a-z])(?=[A-Z])")
_PATHSEP = re.compile(r"[/.](?=[^\s\d])")
_MOST_PARTS = 8  # of a path in its shortest end
_INPUTS = ("torque", "force", "current", "voltage")
_SPEED = ("velocity",)
# Symbols for several quantities, of which the unit selects one.
_BY_UNIT = {
    "scale": ("position",),
    "u": _INPUTS,
    "v": ("voltage", "velocity"),
    "w": _SPEED,
    "n": _SPEED,
}
_JOINT_NUMBER = re.compile(r"(?:(?:joint|jnt|j|axis|axe|achse|asse|gelenk|a) )?(\d{1,2})")


class Usual(NamedTuple):
    """Meaning of a column with a common name."""

    channel: str  # "position", "velocity" or "torque" if the name has no side
    unit: str | None  # as stated in the name
    joint: str = ""  # number of the joint in the name, if any
    precedence: int = 0  # 0 if measured, 1 if filtered, 2 if it is a commanded input


@cache
def split_header(header: str) -> tuple[str, str | None]:
    """Split a header such as ``link_position [deg]`` into its name and its unit.

    A number in brackets is an index; brackets within the name belong to it.

    >>> split_header("link_position [deg]")
    ('link_position', 'deg')
    >>> split_header("time (s)")
    ('time', 's')
    >>> split_header("position[0]")
    ('position[0]', None)
    >>> split_header("q(:,2)")
    ('q(:,2)', None)
    >>> split_header("Winkel / °")
    ('Winkel', '°')
    """
    header = header.strip().translate(_NARROW)
    if len(header) > LONGEST:
        return header, None
    match = re.fullmatch(r"(.*?)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\)|\{([^{}]*)\}|<([^<>]*)>)", header)
    if match is not None:
        unit = next(group for group in match.groups()[1:] if group is not None).strip()
        # Words in brackets may name a side of the joint; [m] is the unit.
        words = words_of(unit) if len(unit) > 1 else None
        is_side = words is not None and words.all and not (words.others or words.quantities)
        if re.fullmatch(r"[\d:, ]+", unit) or is_side:
            return header, None
        return match[1].strip(), None if unit == "t" else unit  # q(t) is a function of time
    match = _BARE_UNIT.fullmatch(header)
    if match is not None and unit_of_word(match[2]) is not None:
        return match[1].strip(), match[2]
    return header, None


def folded(name: str) -> str:
    """Return a name in lower case, its words joined by underscores, without a comment mark."""
    return re.sub(r"[\s.\-]+", "_", name.casefold().lstrip(" #%"))


def usual_channel(header: str) -> Usual | None:
    """Return the channel that a common name indicates; None if it numbers its joint."""
    found = named_channel(header)
    return None if found is None or found.joint else found


def named_channel(header: str, ignored: frozenset[str] = frozenset()) -> Usual | None:
    """Return the channel that a common name indicates, of any joint, without `ignored` words."""
    for stem, unit in _stems_and_units(header):
        words = words_of(stem)
        found = None if words is None else _channel(words, unit, ignored)
        if found is not None:
            return found
    return None


def common_words(headers: Iterable[str]) -> frozenset[str]:
    """Return the unknown words that the names of all quantities except the time share.

    >>> [*common_words(["n", "rig_q_m", "rig_q_l", "rig_tau"])], [*common_words(["a_q", "q_l"])]
    (['rig'], [])
    """
    found = []
    for header in headers:
        stem, unit = split_header(header)
        words = words_of(stem)
        if words is None or (words.needs_unit and unit is None):  # such as n, a row number
            continue
        if {*words.quantities} - {"time"} or (words.sides and words.is_encoder):
            found.append({word for word in words.others if not word.isdigit()})
    return frozenset(set.intersection(*found)) if len(found) >= _FEWEST_NAMES else frozenset()


def _channel(words: Words, unit: str | None, ignored: frozenset[str]) -> Usual | None:
    """Channel that the words of a name and its unit indicate; None without one."""
    if unit is None and len(words.all) == 1 and len(words.all[0]) > _LONGEST_SYMBOL:  # as seconds
        named = unit_of_word(words.all[0])
        if named in _TIMES:
            return Usual("time", named)
    if words.all == ("x", "value"):  # name of the time in LabVIEW
        return Usual("time", unit)
    others = " ".join(word for word in words.others if word not in ignored)
    joint = _JOINT_NUMBER.fullmatch(others)
    if others and joint is None:
        return None
    number = joint[1] if joint else ""
    sides = words.sides & _MEANT_SIDES
    of_joint = "joint" in words.sides and not sides
    is_time = {*words.quantities} == {"time"}  # such as "time t", joined to a group
    quantities = words.quantities[:1] if is_time else words.quantities
    if {*quantities} == {"deflection", "position"}:  # such as "torsion angle"
        quantities = ("deflection",)
    is_encoder = words.is_encoder
    if not quantities and words.sides and (is_encoder or not _SIDE_WORDS.isdisjoint(words.all)):
        measured = quantity_of(unit) if unit else "position" if is_encoder else None
        if of_joint and measured != "position":  # a torque at a joint may be the spring's
            measured = None
        quantities = (measured,) if measured else ()  # such as "Motor [deg]"
    if len(quantities) != 1 or len(sides) > 1:
        return None
    quantity, side = quantities[0], next(iter(sides), None)
    if unit is not None:
        for symbol in _BY_UNIT.keys() & words.all:
            quantity = str(quantity_of(unit))
            if quantity not in _BY_UNIT[symbol]:
                return None
    if words.needs_unit and unit is None:
        return None
    if quantity == "time":
        is_other = unit is not None and is_usual(unit) and unit_of_word(unit) not in _TIMES
        return None if side or number or is_other else Usual("time", unit)
    if quantity in _INPUTS:
        if side == "link":
            return None
        # A torque sensor in the joint measures the spring's torque, not the motor's.
        is_apart = quantity == "torque" and (of_joint or "sensor" in words.all) and not number
        name = "torque" if is_apart else f"motor_{quantity}"
        if quantity == "force":
            name, unit = "force", unit or "N"
        return Usual(name, unit, number, words.precedence)
    if quantity == "deflection":  # the bending of a link, or a strain, is in another unit
        is_angle = unit is None or quantity_of(unit) == "position"
        return Usual(quantity, unit, number) if is_angle and not side else None
    name = f"{side}_{quantity}" if side else quantity
    return Usual(name, unit, number, words.precedence)


def _stems_and_units(header: str) -> Iterator[tuple[str, str | None]]:
    """Yield ways to split a name from its unit: in brackets, or as the last word."""
    bare, unit = split_header(header)
    if unit is not None:
        yield bare, unit
    if unit is not None or len(header) > LONGEST:
        return
    first = re.fullmatch(r"[\[(<{]([^\])>}]+)[\])>}]\s*(.+)", bare)
    if first is not None:  # [deg] link_position
        yield first[2], first[1]
        return
    for match in _WORD_BREAK.finditer(bare):
        found = _unit_at_end(bare, match.end())
        if match.start() and found is not None and not _is_letter(bare[: match.start()], found):
            yield bare[: match.start()], found
    yield bare, None


def _is_letter(stem: str, unit: str) -> bool:
    """Whether a unit of one letter labels an encoder, as the A in POS_A."""
    words = words_of(stem)
    is_position = words is not None and words.quantities == ("position",)
    return is_position and len(unit) == 1 and quantity_of(unit) not in (None, "position")


def _unit_at_end(name: str, start: int) -> str | None:
    """Unit that the end of a name spells, also in capitals or in camel case."""
    word = name[start:]
    spellings = [word]
    if name.isupper():
        spellings.append(word.lower())
    elif start and name[start - 1].islower():
        spellings.append(word[0].lower() + word[1:])
    return next((unit for one in spellings if (unit := unit_of_word(one)) is not None), None)


def shortest_ends(paths: Iterable[str]) -> dict[str, str]:
    """Return for each path its shortest unique end that keeps the side of the joint.

    >>> ends = shortest_ends(["log/time", "log/motor/effort", "log/q_link", "speed_rad/s"])
    >>> [*ends.values()]
    ['time', 'motor/effort', 'q_link', 'speed_rad/s']
    """
    bare = {path: split_header(path)[0] for path in paths}
    starts = {path: [0, *(m.end() for m in _PATHSEP.finditer(name))] for path, name in bare.items()}
    ends: dict[str, str] = {}
    for count in range(1, _MOST_PARTS + 1):
        begins = {path: at[max(0, len(at) - count)] for path, at in starts.items()}
        times = Counter(bare[path][begin:] for path, begin in begins.items())
        for path, begin in begins.items():
            parent = path[starts[path][-count - 1] : begin] if begin else ""
            is_only = times[bare[path][begin:]] == 1
            if is_only and not _leaves_side_out(path[begin:], parent):
                ends.setdefault(path, path[begin:])
    for path, end in ends.items():
        if usual_channel(end) is None and usual_channel(path) is not None:
            ends[path] = path  # only the whole path is a common name
    return {path: ends.get(path, path) for path in starts}


def _leaves_side_out(end: str, parent: str) -> bool:
    """Whether an end of a path names a quantity without a side, and the part before it a side."""
    found = usual_channel(end)
    is_open = found is not None and found[0] in ("position", "velocity", "motor_torque")
    return is_open and not CLEAR_SIDES.isdisjoint(re.findall("[a-z]+", parent.casefold()))


def is_setpoint(header: str) -> bool:
    """Return whether a name is that of a commanded position or velocity, or of an error.

    >>> is_setpoint("theta_ref (rad)"), is_setpoint("Following Error [um]"), is_setpoint("tau_cmd")
    (True, True, False)
    """
    words = words_of(split_header(header)[0])
    if words is None:
        return False
    is_asked = "command" in words.kinds and {*words.quantities}.isdisjoint(_INPUTS)
    return is_asked or not {"error", "err"}.isdisjoint(words.all)


def may_be_channel(header: str) -> bool:
    """Return whether a name or its unit states a quantity of a channel, or a side of the joint.

    >>> may_be_channel("tau_2"), may_be_channel("trial"), may_be_channel("load_torque [N m]")
    (True, False, False)
    """
    bare, unit = split_header(header)
    words = words_of(bare)
    if words is None:
        return True
    measured = {*words.quantities, quantity_of(unit) if unit else None}
    if "link" in words.sides:  # no channel is a torque at the link
        return measured.isdisjoint(_INPUTS)
    return bool(words.sides or measured - {None, "time"})


def nearest_name(word: str, candidates: Iterable[str]) -> str:
    """Return "(did you mean …?)" with the candidate closest to a word; empty if none is close."""
    by_lower = {name.lower(): name for name in candidates if len(name) <= LONGEST}
    close = difflib.get_close_matches(word.lower(), by_lower, n=1, cutoff=0.75)
    return f" (did you mean {by_lower[close[0]]!r}?)" if close else ""


def quoted(names: Iterable[str]) -> str:
    """Return names in quotation marks for a message, shortened to 20 names of 60 characters."""
    return first_of([repr(cut(name)) for name in names])


def cut(name: str, longest: int = 60) -> str:
    """Return a name shortened to `longest` characters."""
    return name if len(name) <= longest else name[: longest - 3] + "..."


def first_of(items: list[str]) -> str:
    """Return the first 20 items in one line, and how many more there are."""
    shown = items if len(items) <= 20 else [*items[:20], f"and {len(items) - 20} more"]
    return ", ".join(shown)
