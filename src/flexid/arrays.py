"""The type of array that functions take and return, and conversion of results to JSON."""

import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from math import isfinite, isinf
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray


class _AsLists:
    """Annotation by which pydantic, imported only on use, reads lists of numbers as an array."""

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
    """Return a document as JSON text; NaN and infinity become null."""
    return json.dumps(plain(document), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def plain(value: Any) -> Any:
    """Return a value in JSON types: objects for dataclasses, lists for arrays, null for NaN."""
    if is_dataclass(value):
        return {field.name: plain(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, Mapping):
        return {_key(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if callable(listed := getattr(value, "tolist", None)):  # an array or a NumPy scalar
        return plain(listed())
    return None if isinstance(value, float) and not isfinite(value) else value


def _key(key: Any) -> Any:
    """Key as text if it is a horizon in s; an infinite horizon, a free run, becomes "free"."""
    if isinstance(key, float):
        return "free" if isinf(key) else f"{key:g}"
    return key
