"""The one type of array that functions take and return, and results as JSON has them."""

import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from math import isfinite, isinf
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray


class _AsLists:
    """Lets pydantic read an array from lists of numbers, without being loaded for it."""

    @staticmethod
    def __get_pydantic_core_schema__(_source: Any, _handler: Any) -> Any:
        from pydantic_core import core_schema

        lists = core_schema.list_schema(core_schema.float_schema())
        either = core_schema.union_schema([lists, core_schema.list_schema(lists)])
        return core_schema.no_info_after_validator_function(_array, either)


def _array(lists: list[Any]) -> NDArray[np.float64]:
    try:
        return np.array(lists, dtype=np.float64)
    except ValueError:
        raise ValueError("its rows differ in length") from None


FloatArray = Annotated[NDArray[np.float64], _AsLists]


def to_json(document: Mapping[str, Any]) -> str:
    """Text of a document; numbers that JSON does not have become null."""
    return json.dumps(plain(document), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def plain(value: Any) -> Any:
    """What JSON has for a value: tables for dataclasses, lists for arrays, null for no number."""
    if is_dataclass(value):
        return {field.name: plain(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, Mapping):
        return {_key(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if callable(listed := getattr(value, "tolist", None)):  # an array, or a number of NumPy
        return plain(listed())
    return None if isinstance(value, float) and not isfinite(value) else value


def _key(key: Any) -> Any:
    """A key; a horizon in s as a number, and that of a free run, which has no end, in a word."""
    if isinstance(key, float):
        return "free" if isinf(key) else f"{key:g}"
    return key
