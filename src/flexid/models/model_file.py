"""Model files: a `ParametricSystem` written down in TOML.

The file holds names and text expressions only; expressions are read over a whitelist and never
evaluated.
"""

import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexid.errors import ExpressionError, ModelError
from flexid.models.parametric_system import ParametricSystem, Row

if TYPE_CHECKING:
    from pydantic import ValidationError

MAX_BYTES = 200_000
"""Largest model file that is read."""


def read_model(path: str | Path) -> ParametricSystem:
    """Read a model file.

    Parameters
    ----------
    path : str or Path
        A TOML file with ``name``, optionally ``inputs`` (default ``["u"]``), a table ``constants``
        and one ``[[rows]]`` table per equation: ``name``, ``coordinate``, ``velocity``, optionally
        ``known``, and a table ``coefficients`` of regressors.

    Returns
    -------
    ParametricSystem

    Raises
    ------
    ModelError
        If the file cannot be read or declares no model; the text names file, key and remedy.
    ExpressionError
        If an expression leaves the whitelist.
    """
    path = Path(path)
    content = _validated(path, _parsed(path))
    rows = tuple(
        Row(row.name, row.coordinate, row.velocity, row.coefficients, row.known)
        for row in content.rows
    )
    try:
        return ParametricSystem(content.name, rows, tuple(content.inputs), content.constants)
    except ModelError as error:
        raise ModelError(f"{path}: {error.model}", error.reason) from None
    except ExpressionError as error:
        raise ExpressionError(error.expression, error.reason, f"{path}: {error.place}") from None
    except RecursionError:
        raise ModelError(str(path), "an expression is nested too deeply: split it") from None


def _parsed(path: Path) -> dict[str, Any]:
    try:
        with path.open("rb") as file:
            raw = file.read(MAX_BYTES + 1)
    except OSError as error:
        reason = (error.strerror or "cannot be opened").lower()
        raise ModelError(
            str(path), f"{reason}: give the path of a TOML file, or the name flexible-joint"
        ) from None
    except ValueError:  # a null character in the path
        raise ModelError(repr(str(path)), "is no path: give that of a TOML file") from None
    if len(raw) > MAX_BYTES:
        raise ModelError(str(path), f"is larger than {MAX_BYTES} bytes: this is no model file")
    try:
        return tomllib.loads(raw.decode("utf-8"))
    except UnicodeDecodeError as error:
        raise ModelError(
            str(path), f"is no text at byte {error.start}: save the model as UTF-8 TOML"
        ) from None
    except tomllib.TOMLDecodeError as error:
        raise ModelError(str(path), f"is no TOML: {_one_line(str(error))}; correct it") from None
    except (RecursionError, ValueError):
        raise ModelError(str(path), "is no TOML that can be read: simplify it") from None


def _validated(path: Path, content: dict[str, Any]) -> Any:
    """The content, checked for keys and types."""
    from pydantic import ValidationError

    from flexid.models.model_schema import ModelContent

    try:
        return ModelContent.model_validate(content)
    except ValidationError as error:
        raise ModelError(str(path), _first_complaint(error)) from None


def _first_complaint(error: "ValidationError") -> str:
    first = error.errors(include_url=False, include_context=False)[0]
    key = ".".join(str(part + 1) if isinstance(part, int) else part for part in first["loc"])
    key = _one_line(key)[:80]
    kind = first["type"]
    if kind == "missing":
        return f"the key {key!r} is missing: add it"
    if kind == "extra_forbidden":
        return f"the key {key!r} is unknown: remove it or correct its spelling"
    return f"the key {key!r}: {_one_line(first['msg']).lower()}: correct its value"


def _one_line(text: str) -> str:
    return " ".join(text.split())
