"""What is chosen in Live: where the samples come from, how fast, and what is done to the drive."""

from __future__ import annotations

from dataclasses import dataclass
from urllib.parse import urlencode

from flexid.errors import SettingError
from flexid.studio.address import one_of, texts_of

DRIVE, REPLAY, FOLLOW = "drive", "replay", "follow"

SOURCES = {
    DRIVE: "a simulated drive",
    REPLAY: "the log, played again",
    FOLLOW: "the log, followed while it grows",
}
"""Where samples may come from. A source is one of these words, and no path."""

PACES = {1: "as it was", 4: "4 times as fast", 16: "16 times as fast"}


@dataclass(frozen=True)
class LiveChoices:
    """What is chosen.

    Parameters
    ----------
    source : str
        A key of `SOURCES`.
    pace : int
        Seconds of the stream in a second: a key of `PACES`.
    loaded : bool
        Whether the simulated drive's link carries a load.
    unplugged : bool
        Whether the encoder of its link is.
    """

    source: str = DRIVE
    pace: int = 1
    loaded: bool = False
    unplugged: bool = False

    @property
    def query(self) -> str:
        """The end of an address that shows the room so."""
        pairs = {"room": "live", "source": self.source, "pace": str(self.pace)}
        pairs |= {name: "yes" for name in ("loaded", "unplugged") if getattr(self, name)}
        return urlencode(pairs)


def read_live(values: object, sources: tuple[str, ...]) -> LiveChoices:
    """What a form or an address holds.

    Parameters
    ----------
    values : object
        Keys and texts, from outside.
    sources : tuple of str
        Those that there are: without a log, the simulated drive alone.

    Returns
    -------
    LiveChoices

    Raises
    ------
    SettingError
        If a value cannot be used.
    """
    texts = texts_of(values)
    source = texts.get("source", DRIVE)
    if source not in sources:
        known = ", ".join(sources)
        raise SettingError(
            "source",
            f"there is {known} here: for a log, choose it in Identify, or start the studio with "
            f"it, flexid studio LOG",
        )
    paces = {str(pace): pace for pace in PACES}
    pace = one_of("pace", texts.get("pace", "1"), paces)
    on = {name: texts.get(name) == "yes" for name in ("loaded", "unplugged")}
    return LiveChoices(source, paces[pace], **on)
