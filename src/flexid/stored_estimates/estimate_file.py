"""Files that hold an identification without its time series: the dataclasses are the schema."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import replace
from functools import cache, partial
from math import inf, nan
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from flexid.arrays import plain, to_json
from flexid.errors import SettingError
from flexid.files import RefuseKey, first_complaint, read_bytes

if TYPE_CHECKING:
    from pydantic import TypeAdapter

    from flexid.arms.result import ArmIdentification
    from flexid.identification.result import Identification

FORMAT_VERSION = 1  # of the files that this version writes, and the newest that it reads

LARGEST_FILE = 20_000_000  # bytes; an estimate of many logs has some values for each

_USUAL_NAME = "estimate.json"  # of the file in a folder that ``flexid identify --out`` wrote

WANTED = "an estimate.json of flexid identify"

_MISSING = {
    **dict.fromkeys(("std", "covariance", "degrees_of_freedom"), inf),
    **dict.fromkeys(("value", "values", "probability", "segment_evidence"), nan),
    **dict.fromkeys(("fit_percent", "horizons"), nan),
    **dict.fromkeys(("deflection", "deflection_noise"), nan),
    **dict.fromkeys(("residual_excess", "condition_number"), inf),
}
"""What null stands for, by key: for a number that JSON does not have."""


def estimate_document(result: "Identification | ArmIdentification") -> dict[str, Any]:
    """Everything of an estimate but its time series, as a file holds it; numbers stay numbers."""
    held = replace(result, validation=replace(result.validation, runs=()))
    if held.model == "arm":
        return sealed({"format_version": FORMAT_VERSION, **plain(held)})
    made = plain(replace(held, recordings=()))
    excitation = {row: {"row": row, **e.document} for row, e in held.excitation.items()}
    return sealed({"format_version": FORMAT_VERSION, **made, "excitation": excitation})


# The digest refuses edited files: coefficients make the parameters, the covariance the intervals.
def sealed(document: Mapping[str, Any]) -> dict[str, Any]:
    """A document with the digest of all else in it."""
    return {**document, "sha256": _digest(to_json(document))}


def _digest(text: str) -> str:
    """The digest of a document, however its text is laid out and its whole numbers are written."""
    content = json.loads(text, parse_int=float)
    content.pop("sha256", None)
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


class StoredEstimate(NamedTuple):
    """An estimate, and where it was read."""

    result: "Identification | ArmIdentification"  # time series, which are not stored, are empty
    file: str  # empty of one in memory
    sha256: str  # of its text

    @property
    def name(self) -> str:
        """How a message names it."""
        return self.file or "estimate"

    @property
    def of_joint(self) -> "Identification":
        """The identification of one joint; a `SettingError` if it is of an arm."""
        if self.result.model == "arm":
            raise self.refuse(
                "",
                "is the estimate of an arm, which only flexid validate, compare and export --to "
                "mjcf take: give the estimate of one joint",
            )
        return self.result

    def refuse(self, key: str, reason: str) -> SettingError:
        """An error of a key, empty where all of it is meant, and a reason."""
        return refusal(self.name, key, reason)


def read_estimate(estimate: "Path | str | Mapping[str, Any]") -> StoredEstimate:
    """A stored estimate from a file, the folder that holds it, or its content."""
    if isinstance(estimate, Mapping):
        file = ""
        try:
            raw = json.dumps(dict(estimate), default=str).encode()
        except (TypeError, ValueError, RecursionError):
            raise refusal("estimate", "", f"is no JSON: give {WANTED}") from None
    else:
        path = Path(estimate)
        path = path / _USUAL_NAME if path.is_dir() else path
        file = str(path)
        raw = read_bytes(path, LARGEST_FILE, WANTED, partial(refusal, file, ""))
    refuse = partial(refusal, file or "estimate")
    try:
        content = json.loads(raw.decode("utf-8"))
    except (ValueError, RecursionError):
        raise refuse("", f"is no JSON: give {WANTED}") from None
    return StoredEstimate(_result(content, refuse), file, hashlib.sha256(raw).hexdigest())


def refusal(name: str, key: str, reason: str) -> SettingError:
    """An error of a file, of its key, empty where all of it is meant, and a reason."""
    return SettingError(name, f"the key {key!r} {reason}" if key else reason)


def _result(content: Any, refuse: RefuseKey) -> "Identification | ArmIdentification":
    """What the content of a file says, checked."""
    from pydantic import ValidationError

    version = content.get("format_version") if isinstance(content, dict) else None
    if isinstance(version, bool) or not isinstance(version, int):
        raise refuse("", f"holds no estimate: give {WANTED}")
    if version > FORMAT_VERSION:
        raise refuse(
            "",
            f"is of format {version}, and this version of flexid reads up to {FORMAT_VERSION}: "
            f"update flexid",
        )
    if content.get("sha256") != _digest(json.dumps(content)):
        raise refuse("", "was changed since flexid wrote it: identify again")
    numbers = json.dumps(_numbers(content, None))
    try:
        return _schema(of_arm=content.get("model") == "arm").validate_json(numbers, strict=True)
    except ValidationError as error:
        raise refuse(*first_complaint(error, content)) from None


@cache
def _schema(*, of_arm: bool) -> "TypeAdapter[Any]":
    from pydantic import TypeAdapter

    from flexid.arms.result import ArmIdentification
    from flexid.identification.result import Identification

    return TypeAdapter(ArmIdentification if of_arm else Identification)


def _numbers(value: Any, missing: float | None) -> Any:
    """The content with numbers in place of null, where a number has to be."""
    if isinstance(value, Mapping):
        return {
            key: _interval(part)
            if key == "interval"
            else _numbers(part, _MISSING.get(key) if missing is None else missing)
            for key, part in value.items()
        }
    if isinstance(value, list | tuple):
        return [_numbers(part, missing) for part in value]
    return missing if value is None else value


def _interval(value: Any) -> Any:
    if not isinstance(value, list | tuple) or len(value) != 2:
        return value
    ends = zip(value, (-inf, inf), strict=True)
    return [infinite if end is None else end for end, infinite in ends]
