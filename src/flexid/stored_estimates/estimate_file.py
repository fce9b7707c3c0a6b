"""Files that hold an identification: read, checked for their version, made a result once more.

What a file holds is an `Identification` without its time series, or an `ArmIdentification`: the
dataclasses are its schema.
"""

import json
from collections.abc import Mapping
from functools import cache, partial
from math import inf, nan
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from flexid.errors import SettingError
from flexid.files import read_bytes
from flexid.toml_file import Refuse, first_complaint, validated

if TYPE_CHECKING:
    from pydantic import TypeAdapter

    from flexid.arms.result import ArmIdentification
    from flexid.identification.result.identification import Identification

FORMAT_VERSION = 1
"""Of the files that this version writes, and the newest that it reads."""

LARGEST_FILE = 20_000_000  # bytes; an estimate of many logs has some values for each

USUAL_NAME = "estimate.json"
"""Of the file in a folder that ``flexid identify --out`` wrote."""

WANTED = "an estimate.json of flexid identify"

_ALIGNMENT = ("hold", "input_delay", "link_delay", "hold_reason")  # of the choices

_MISSING = {
    **dict.fromkeys(("std", "covariance", "degrees_of_freedom"), inf),
    **dict.fromkeys(("value", "values", "probability", "segment_evidence", "estimates"), nan),
    **dict.fromkeys(("fit_percent", "horizons", "rigid_fit_percent"), nan),
    **dict.fromkeys(("deflection", "deflection_noise"), nan),
    **dict.fromkeys(("free_run_percent",), nan),
    **dict.fromkeys(("residual_excess", "condition_number"), inf),
}
"""What null stands for, by key: for a number that JSON does not have."""


class EstimateFile(NamedTuple):
    """An estimate as it is stored."""

    name: str  # the file, for messages
    raw: bytes  # its text
    content: dict[str, Any]  # what that says

    @property
    def is_of_arm(self) -> bool:
        """Whether it is of an arm."""
        return self.content.get("model") == "arm"

    @property
    def refuse(self) -> Refuse:
        """Makes an error of a key of this file and a reason."""
        return lambda key, reason: SettingError(
            self.name, f"the key {key!r} {reason}" if key else reason
        )


def read_estimate(estimate: "Path | str | Mapping[str, Any] | EstimateFile") -> EstimateFile:
    """A stored estimate: a file, the folder that holds it, its content, or what was read of it.

    A `SettingError` if it cannot be read, is no estimate, or is of a newer version.
    """
    if isinstance(estimate, EstimateFile):
        return estimate
    if isinstance(estimate, Mapping):
        raw = json.dumps(estimate, default=str).encode()
        return _checked(EstimateFile("estimate", raw, dict(estimate)))
    path = Path(estimate)
    if path.is_dir():
        path = path / USUAL_NAME
    file = EstimateFile(str(path), b"", {})
    raw = read_bytes(path, LARGEST_FILE, WANTED, partial(file.refuse, ""))
    try:
        content = json.loads(raw.decode("utf-8"))
    except (ValueError, RecursionError):
        raise file.refuse("", f"is no JSON: give {WANTED}") from None
    return _checked(EstimateFile(file.name, raw, content))


def _checked(file: EstimateFile) -> EstimateFile:
    version = file.content.get("format_version") if isinstance(file.content, dict) else None
    if isinstance(version, bool) or not isinstance(version, int):
        raise file.refuse("", f"holds no estimate: give {WANTED}")
    if version > FORMAT_VERSION:
        raise file.refuse(
            "",
            f"is of format {version}, and this version of flexid reads up to {FORMAT_VERSION}: "
            f"update flexid",
        )
    return file


def stored_identification(file: EstimateFile) -> "Identification":
    """The identification of one joint that a file holds.

    A `SettingError` if a part is missing or is not what it should be, or it is of an arm.
    """
    found = stored_estimate(file)
    if found.model == "arm":
        raise file.refuse(
            "",
            "is the estimate of an arm, which only flexid validate, compare and export --to mjcf "
            "take: give the estimate of one joint",
        )
    return found


def stored_estimate(file: EstimateFile) -> "Identification | ArmIdentification":
    """What a file holds of a joint or an arm; time series, which are not stored, are empty.

    A `SettingError` if a part is missing or is not what it should be.
    """
    from pydantic import ValidationError

    from flexid.stored_estimates.consistency import StoredProvenance, check_arm, check_consistency

    provenance = file.content.get("provenance", {})
    validated(provenance, StoredProvenance, lambda key, why: file.refuse(f"provenance.{key}", why))
    content = json.dumps(_numbers(_as_dataclasses(file.content), None))
    try:
        found = _schema(of_arm=file.is_of_arm).validate_json(content, strict=True)
    except ValidationError as error:
        raise file.refuse(*first_complaint(error, file.content)) from None
    if found.model == "arm":
        check_arm(found, file.refuse)
    else:
        check_consistency(found, file.refuse)
    return found


@cache
def _schema(*, of_arm: bool) -> "TypeAdapter[Any]":
    from pydantic import TypeAdapter

    from flexid.arms.result import ArmIdentification
    from flexid.identification.result.identification import Identification

    return TypeAdapter(ArmIdentification if of_arm else Identification)


def _as_dataclasses(content: Mapping[str, Any]) -> dict[str, Any]:
    """The content with names, alignment and observer where the dataclasses have them."""
    made = {key: value for key, value in content.items() if key != "recordings"}
    for key, field in (
        ("coefficients", "name"),
        ("parameters", "name"),
        ("removed", "name"),
        ("excitation", "row"),
    ):
        if isinstance(parts := made.get(key), Mapping):
            made[key] = {
                name: {**part, field: name} if isinstance(part, Mapping) else part
                for name, part in parts.items()
            }
    if isinstance(choices := made.get("choices"), Mapping):
        alignment = {name: choices[name] for name in _ALIGNMENT if name in choices}
        made["choices"] = {**choices, "alignment": alignment}
    if isinstance(observer := made.get("observer"), Mapping):
        final = observer.get("final")
        known = final if isinstance(final, Mapping) else {}
        last = {"time": [], "names": list(known), "estimates": [list(known.values())]}
        made["observer"] = {**observer, **last}
    return made


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
