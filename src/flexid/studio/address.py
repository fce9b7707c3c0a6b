"""What an address or a form holds: keys and texts from outside, never believed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from flexid.errors import SettingError

LONGEST_VALUE = 300  # characters
MOST_KEYS = 80


def texts_of(values: object) -> dict[str, str]:
    """Texts by key, as many and as long as a form has; what is no text is left out."""
    if not isinstance(values, Mapping) or len(values) > MOST_KEYS:
        raise SettingError("address", "it holds what the studio does not know: open it without")
    texts = {}
    for key, value in values.items():
        if isinstance(key, str) and isinstance(value, str):
            if len(value) > LONGEST_VALUE:
                raise SettingError("address", f"a value has more than {LONGEST_VALUE} characters")
            texts[key] = value
    return texts


def one_of(what: str, text: str, known: Iterable[str]) -> str:
    """A text, if it is known; else a `SettingError`."""
    known = list(known)
    if text not in known:
        raise SettingError(what, f"{text[:40]!r} is none of {', '.join(known)}")
    return text
