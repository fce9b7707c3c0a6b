"""Warnings that know what they are about, so that the first one is what to do first."""

from __future__ import annotations

from collections.abc import Iterable
from enum import IntEnum


class Rank(IntEnum):
    """What a warning is about. The lowest is to be mended first, as others may follow from it."""

    DATA = 0  # samples are wrong, lost or left out
    SCALE = 1  # a unit, a scale, a sign or the wiring is wrong
    MODEL = 2  # the model lacks something that the drive has
    MOTION = 3  # the motion shows too little
    NOTE = 4  # what was assumed or mended


class Caution(str):
    """A warning: one sentence with its rank; a plain string counts as a note."""

    __slots__ = ("rank",)

    rank: Rank

    def __new__(cls, text: str, rank: Rank = Rank.NOTE) -> Caution:
        """Return the sentence with its rank."""
        made = super().__new__(cls, text)
        made.rank = rank
        return made


def cautions(rank: Rank, texts: Iterable[str]) -> tuple[Caution, ...]:
    """Sentences of one rank; those that have one keep it."""
    return tuple(text if isinstance(text, Caution) else Caution(text, rank) for text in texts)


def rank_of(text: str) -> Rank:
    """The rank of a sentence."""
    return text.rank if isinstance(text, Caution) else Rank.NOTE


def ranked(texts: Iterable[str]) -> tuple[str, ...]:
    """Sentences in the order in which to act on them; equals stay in their order."""
    return tuple(sorted(texts, key=rank_of))
