"""Files of identifications without their time series: the dataclasses are the schema."""

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

FORMAT_VERSION = 1  # format that is written, and the newest that can be read

LARGEST_FILE = 20_000_000  # bytes; an estimate has a few values for each of its logs

_USUAL_NAME = "estimate.json"  # the file that ``flexid identify --out`` writes

WANTED = "an estimate.json of flexid identify"

_MISSING = {
    **dict.fromkeys(("std", "covariance", "degrees_of_freedom"), inf),
    **dict.fromkeys(("value", "values", "probability", "segment_evidence"), nan),
    **dict.fromkeys(("fit_percent", "horizons"), nan),
    **dict.fromkeys(("deflection", "deflection_noise"), nan),
    **dict.fromkeys(("residual_excess", "condition_number"), inf),
}
"""Number that null represents, by key, as JSON has no infinity and no NaN."""


def estimate_document(result: "Identification | ArmIdentification") -> dict[str, Any]:
    """Return the content of an estimate's file: all of the result but its time series."""
    stripped = replace(result, validation=replace(result.validation, runs=()))
    if stripped.model == "arm":
        return sealed({"format_version": FORMAT_VERSION, **plain(stripped)})
    fields = plain(replace(stripped, recordings=()))
    excitation = {row: {"row": row, **e.document} for row, e in stripped.excitation.items()}
    return sealed({"format_version": FORMAT_VERSION, **fields, "excitation": excitation})


# The digest detects edits, after which coefficients, covariance, parameters and intervals disagree.
def sealed(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return the document with a digest of its content."""
    return {**document, "sha256": _digest(to_json(document))}


def _digest(text: str) -> str:
    """Return a JSON text's digest, which does not depend on layout or on ``1`` versus ``1.0``."""
    content = json.loads(text, parse_int=float)
    content.pop("sha256", None)
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


class StoredEstimate(NamedTuple):
    """An estimate and the file it was read from."""

    result: "Identification | ArmIdentification"  # its time series are empty: they are not stored
    file: str  # path; empty if the estimate is in memory
    sha256: str  # digest of the file

    @property
    def name(self) -> str:
        """Name of the estimate in messages."""
        return self.file or "estimate"

    @property
    def of_joint(self) -> "Identification":
        """Identification of one joint; raises a `SettingError` if the estimate is of an arm."""
        if self.result.model == "arm":
            raise self.refuse(
                "",
                "is the estimate of an arm, which only flexid validate, compare and export --to "
                "mjcf take: give the estimate of one joint",
            )
        return self.result

    def refuse(self, key: str, reason: str) -> SettingError:
        """Return an error about a key of the file, or about the whole file if `key` is empty."""
        return refusal(self.name, key, reason)


def drive_of(model: str) -> str:
    """Return the kind of drive of an estimate's model, for a sentence."""
    return {"arm": "an arm", "link": "a link alone"}.get(model, f"a {model} joint")


def read_estimate(estimate: "Path | str | Mapping[str, Any]") -> StoredEstimate:
    """Read a stored estimate from its file, its folder, or its content as a mapping."""
    if isinstance(estimate, Mapping):
        file = ""
        try:
            raw = json.dumps(dict(estimate), default=str).encode()
        except (TypeError, ValueError, RecursionError):
            raise refusal("estimate", "", f"is not JSON: give {WANTED}") from None
    else:
        path = Path(estimate)
        path = path / _USUAL_NAME if path.is_dir() else path
        file = str(path)
        raw = read_bytes(path, LARGEST_FILE, WANTED, partial(refusal, file, ""))
    refuse = partial(refusal, file or "estimate")
    try:
        content = json.loads(raw.decode("utf-8"))
    except (ValueError, RecursionError):
        raise refuse("", f"is not JSON: give {WANTED}") from None
    return StoredEstimate(_result(content, refuse), file, hashlib.sha256(raw).hexdigest())


def refusal(name: str, key: str, reason: str) -> SettingError:
    """Return an error about a key of a file, or about the whole file if `key` is empty."""
    return SettingError(name, f"the key {key!r} {reason}" if key else reason)


def _result(content: Any, refuse: RefuseKey) -> "Identification | ArmIdentification":
    """Return the estimate from the content of a file, or raise if the content is invalid."""
    from pydantic import ValidationError

    version = content.get("format_version") if isinstance(content, dict) else None
    if isinstance(version, bool) or not isinstance(version, int):
        raise refuse("", f"is no estimate: give {WANTED}")
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
    """Return the content with each null replaced by the number that it represents."""
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
