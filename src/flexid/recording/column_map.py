"""One entry of a column map: which raw columns make up a channel, and how."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from flexid.errors import RecordingError

Number = Annotated[float, Field(allow_inf_nan=False)]
REMEDY = "write a column name, or a table of column or sum, scale, offset and unit"


class Term(BaseModel):
    """One raw column with its factor.

    Parameters
    ----------
    column : str
        A column of the file, with or without the unit in its header.
    scale : float
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    column: str
    scale: Number = 1.0


class Entry(BaseModel):
    """``scale * (sum of the terms) + offset``, in `unit`.

    Parameters
    ----------
    column : str or None
        The only raw column; or else
    sum : tuple of Term
        Several, each by name or with a factor of its own.
    scale, offset : float
        In `unit` per raw unit, and in `unit`.
    unit : str or None
        None takes the unit in the header of the raw column, or SI if there is none.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    column: str | None = None
    sum: list[Term] = Field(default_factory=list)
    scale: Number = 1.0
    offset: Number = 0.0
    unit: str | None = None

    @model_validator(mode="before")
    @classmethod
    def _names_as_terms(cls, value: object) -> object:
        if isinstance(value, str):
            return {"column": value}
        if isinstance(value, dict) and isinstance(value.get("sum"), list):
            terms = [{"column": term} if isinstance(term, str) else term for term in value["sum"]]
            return {**value, "sum": terms}
        return value

    @model_validator(mode="after")
    def _column_or_sum(self) -> Entry:
        if (self.column is None) == (not self.sum):
            raise ValueError("exactly one of 'column' and 'sum' is needed")
        return self

    @property
    def terms(self) -> list[Term]:
        """The raw columns with their factors."""
        return self.sum if self.column is None else [Term(column=self.column)]


def parse_entry(file: str, key: str, value: object) -> Entry:
    """Return one entry of a column map.

    Parameters
    ----------
    file : str
        Name of the map, for the error.
    key : str
        The canonical channel.
    value : object
        What TOML holds there.

    Raises
    ------
    RecordingError
        If the value is not what an entry may be.
    """
    try:
        return Entry.model_validate(value)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in (key, *first["loc"]))
        reason = {
            "extra_forbidden": "this key is not known",
            "model_type": "this is neither a column name nor a table",
        }.get(first["type"], first["msg"].removeprefix("Value error, "))
        raise RecordingError(file, f"key '{place}'", f"{reason}: {REMEDY}") from error
