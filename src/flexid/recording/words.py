"""The words that names of columns are made of, in several languages, and how a name falls apart."""

import re
import unicodedata
from functools import cache
from typing import NamedTuple

QUANTITIES = {  # in English, German, French, Italian, Spanish, Portuguese, Dutch, Chinese, Japanese
    "position": (
        "position pos angle ang q theta phi winkel lage posizione angolo angulo posicion posicao "
        "hoek positie jiaodu weizhi 角度 位置"
    ),
    "velocity": (
        "velocity vel speed omega qd dq qdot dtheta thetadot drehzahl geschwindigkeit vitesse "
        "velocita velocidad velocidade snelheid sudu zhuansu 速度 转速"
    ),
    "torque": (
        "torque tau trq effort drehmoment moment couple coppia par momento binario koppel zhuanju "
        "liju 转矩 力矩 トルク"
    ),
    "current": "current cur curr i iq strom courant corrente corriente stroom dianliu 电流 電流",
    "voltage": "voltage volt u spannung tension tensione tensao spanning dianya 电压 電圧",
    "time": (
        "time t timestamp datetime clock tout zeit zeitstempel temps tempo tiempo tijd shijian "
        "时间 時間"
    ),
}
SIDES = {
    "motor": "motor mot m rotor drive moteur motore antrieb dianji 电机 モータ モーター",
    "link": (
        "link load l arm output last abtrieb charge bras sortie carico braccio uscita carga brazo "
        "braco fuzai 负载 リンク"
    ),
    "joint": "joint jnt gelenk articulation giunto articulacion guanjie 关节 axis axe achse asse",
}
CLEAR_SIDES = {"motor", "rotor", "link", "load"}  # also as a part of a path, or with a unit
_OTHERS = {
    "command": (
        "command cmd commanded ref reference set setpoint target desired des demand soll sollwert "
        "consigne riferimento consigna"
    ),
    "filler": (
        "meas measured act actual active present state states enc encoder side sensor value values "
        "data shaft of the ist istwert gemessen mesure mesuree misurata medida medido de du la le "
        "del della do da van"
    ),
    "filler of time": "date stamp elapsed rel relative since start sim simulation ros abs system",
}
_NEED_UNIT = {"i", "u", "tension", "par"}  # as well a row's number, any input, a belt's tension
_ENGLISH = {"position", "pos", "angle", "ang", "velocity", "vel", "speed", "torque", "current"}
_BESIDE = r"[\s_.,:;/\\$|{}()\[\]<>'\"-]*"  # what may stand between words
_WORD = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|[A-Z]|\d+|[^\W\d_a-zA-Z]+")
_SHORTEST_PART = 3  # letters of a word within a longer one, of which Chinese has two
_WITH_SIDE = {"q", "theta", "phi", "tau", "pos", "dq", "qd"}  # also as qm and ql
_LONGEST_WORD = 40  # letters of a word that is taken apart
_ACCENTED = "aceinouACEINOU"  # letters whose accents say nothing: a point above is a derivative


def _kinds(table: dict[str, str]) -> dict[str, str]:
    return {word: kind for kind, words in table.items() for word in words.split()}


_KINDS = {**_kinds(QUANTITIES), **_kinds(SIDES), **_kinds(_OTHERS)}


class Words(NamedTuple):
    """What the words of a name say."""

    all: tuple[str, ...]
    quantities: tuple[str, ...]
    sides: frozenset[str]
    is_command: bool  # of a value that is wanted, not measured
    needs_unit: bool  # whether another thing is called so, too
    others: tuple[str, ...]  # that say nothing known


@cache
def words_of(name: str) -> Words | None:
    """The words of a name; None where a character belongs to no word.

    >>> words_of("Abtriebswinkel").quantities, [*words_of("θ_m").sides], words_of("torque %")
    (('position',), ['motor'], None)
    """
    plain = re.sub(
        r"(?i)(?<![a-z])i_q(?![a-z])",
        "iq",
        "".join(map(_letter, unicodedata.normalize("NFC", name))),
    )
    if plain.lstrip().startswith("-") or not re.fullmatch(_BESIDE, _WORD.sub("", plain)):
        return None
    words = tuple(part for word in _WORD.findall(plain) for part in _parts(word.lower()))
    kinds = [_kind(word, after) for word, after in zip(words, (*words[1:], ""), strict=False)]
    quantities = tuple(kind for kind in kinds if kind in QUANTITIES)
    unknown = ("", "filler of time")[: 1 if "time" in quantities else 2]
    return Words(
        words,
        quantities,
        frozenset(kind for kind in kinds if kind in SIDES),
        "command" in kinds,
        not _NEED_UNIT.isdisjoint(words),
        tuple(word for word, kind in zip(words, kinds, strict=True) if kind in unknown),
    )


def _kind(word: str, after: str) -> str:
    """What a word stands for; the last position is that of the sample before, not of a Last."""
    return "" if word == "last" and after in _ENGLISH else _KINDS.get(word, "")


def _letter(letter: str) -> str:
    """A letter in Latin: a Greek one spelled out, others without accents, brackets not wide."""
    if letter.isascii():
        return letter
    if "\uff00" <= letter <= "\uffef":  # as wide as a Chinese one
        return unicodedata.normalize("NFKC", letter)
    called = unicodedata.name(letter, "")
    if re.fullmatch("GREEK (SMALL|CAPITAL) LETTER [A-Z]+", called):
        return f"_{called.rpartition(' ')[2].lower()}_"
    base = unicodedata.normalize("NFD", letter)
    is_plain = len(base) == 2 and base[0] in _ACCENTED and base[1] != "\N{COMBINING DOT ABOVE}"
    return base[0] if is_plain else letter


def _parts(word: str) -> tuple[str, ...]:
    """The words that a longer one is made of; itself where it is not."""
    if word in _KINDS or len(word) > _LONGEST_WORD:
        return (word,)
    if word[:-1] in _WITH_SIDE and word[-1] in "ml":
        return word[:-1], word[-1]
    return _known_parts(word) or (word,)


def _known_parts(word: str) -> tuple[str, ...]:
    """Known words that a word consists of, with an s between two; empty where it does not."""
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
