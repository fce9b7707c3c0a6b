"""TOML files from outside: read, checked against a schema, refused in one sentence.

Every reader has an error of its own; it hands in `Refuse`, which makes that error of a key and a
reason.
"""

import re
import tomllib
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from flexid import files
from flexid.errors import SettingError

if TYPE_CHECKING:
    from pydantic import BaseModel, ValidationError

MAX_BYTES = 200_000
"""Largest file that is read."""

_MOST_PARTS = 20  # of a key, such as controller.nominal.k
_LONG_KEY = re.compile(
    rb"(?:\.[ \t]*+(?:[\w-]++|\"[^\"\n]{0,99}\"|'[^'\n]{0,99}')[ \t]*+){%d}" % _MOST_PARTS
)

Refuse = Callable[[str, str], Exception]
"""Makes an error of a key, empty where the whole file is meant, and a reason, a predicate."""

Content = TypeVar("Content", bound="BaseModel")


def read_bytes(path: Path, wanted: str, refuse: Refuse) -> bytes:
    """Read a small file."""
    return files.read_bytes(path, MAX_BYTES, wanted, partial(refuse, ""))


def is_arm_file(model: str) -> bool:
    """Whether it is the path of a TOML file, which is that of an arm."""
    return model.lower().endswith(".toml")


def refuse_arm_file(model: str) -> None:
    """Raise a `SettingError` for an arm where the model of one joint is wanted."""
    if is_arm_file(model):
        raise SettingError(
            "model", f"{model!r} is an arm: only flexid identify, the command, takes it"
        )


def parse_toml(raw: bytes, refuse: Refuse) -> dict[str, Any]:
    """Tables of a TOML file, from its bytes."""
    if _LONG_KEY.search(raw):  # tomllib takes minutes and gigabytes for it
        raise refuse("", f"has a key of more than {_MOST_PARTS} parts: correct it")
    try:
        return tomllib.loads(raw.decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        raise refuse("", f"is not text at byte {error.start}: save it as UTF-8") from None
    except tomllib.TOMLDecodeError as error:
        if raw.lstrip().startswith(b"{"):
            raise refuse("", "is JSON, as an estimate: give a file in TOML") from None
        raise refuse("", f"is not TOML: {one_line(str(error))}; correct it") from None
    except (RecursionError, ValueError):
        raise refuse("", "is not TOML that can be read: simplify it") from None


def validated(content: object, schema: type[Content], refuse: Refuse) -> Content:
    """The content as an instance of the schema, checked for keys, types and ranges."""
    from pydantic import ValidationError

    try:
        return schema.model_validate(content)
    except ValidationError as error:
        raise refuse(*first_complaint(error, content)) from None


def first_complaint(error: "ValidationError", content: object) -> tuple[str, str]:
    """The key of the content that is wrong first, and the reason, a predicate."""
    # A misspelt key is missing too; its own spelling says more.
    first = min(error.errors(include_url=False), key=lambda one: one["type"] != "extra_forbidden")
    key = _key(first["loc"], content, first["type"] == "missing")
    if first["type"] == "missing":
        return key, "is missing: add it"
    if first["type"] == "extra_forbidden":
        return key, "is unknown: remove it or correct its spelling"
    tables = ("model_type", "model_attributes_type", "dict_type", "mapping_type", "dataclass_type")
    if first["type"] in tables:
        return key, "must be a table: correct it"
    if first["type"].startswith("union_tag"):  # the key that says what kind of table it is
        context = {name: str(text).replace("'", "") for name, text in first.get("ctx", {}).items()}
        key = f"{key}.{context['discriminator']}"
        if "expected_tags" in context:
            return key, f"must be one of {context['expected_tags']}: correct it"
        return key, "is missing or not text: correct it"
    message = one_line(first["msg"]).removeprefix("Value error, ")
    return key, f"is wrong, {message[:1].lower()}{message[1:]}: correct it"


def _key(location: tuple[int | str, ...], content: Any, missing: bool) -> str:
    """Dotted key of a place in the content, without the names that a schema gives to kinds."""
    parts, inside = [], content
    for place, part in enumerate(location, start=1):
        items: Any = dict(enumerate(inside)) if isinstance(inside, list) else inside
        there = isinstance(items, dict) and part in items
        if there or (missing and place == len(location)):
            parts.append(str(part + 1) if isinstance(part, int) else part)
            inside = items[part] if there else None
    return one_line(".".join(parts))[:80]


def one_line(text: str) -> str:
    """The text without line breaks."""
    return " ".join(text.split())
