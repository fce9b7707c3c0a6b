"""Keys and types of a model file. Apart from `model_file`, so that pydantic is loaded late."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, StringConstraints

Name = Annotated[str, StringConstraints(min_length=1, max_length=60, pattern=r"^[\w .:()-]+$")]
Number = Annotated[float, Field(allow_inf_nan=False)]


class RowContent(BaseModel):
    """One ``[[rows]]`` table."""

    model_config = ConfigDict(extra="forbid", strict=True)

    name: Name
    coordinate: Name
    velocity: Name
    known: str = "0"
    coefficients: dict[Name, str] = Field(min_length=1, max_length=100)


class ModelContent(BaseModel):
    """The whole file."""

    model_config = ConfigDict(extra="forbid", strict=True)

    name: Name
    inputs: list[Name] = Field(default=["u"], max_length=50)
    constants: dict[Name, Number] = Field(default={}, max_length=100)
    rows: list[RowContent] = Field(min_length=1, max_length=50)
