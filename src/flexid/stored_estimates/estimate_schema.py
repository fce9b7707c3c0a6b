"""What of an ``estimate.json`` makes up its model; the rest of the file may be anything."""

from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from flexid.models.flexible_joint import RIPPLE_ORIGIN

_LONGEST_DELAY = 10.0  # s

Number = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


def _widths(shapes: dict[str, float]) -> dict[str, float]:
    for name, width in shapes.items():
        if width <= 0.0 and name != RIPPLE_ORIGIN:
            raise ValueError(f"{name} is {width:g}: give a positive number")
    return shapes


Shapes = Annotated[dict[str, Number], AfterValidator(_widths)]
"""Constants of shapes."""


class _Part(BaseModel):
    model_config = ConfigDict(extra="ignore", strict=True)


class StoredCoefficient(_Part):
    """A coefficient; one that the data leave free may have no value in the file."""

    value: Number
    unit: str = ""
    verdict: str = "determined"


class StoredDelay(_Part):
    """A delay in s."""

    value: Annotated[float, Field(ge=-_LONGEST_DELAY, le=_LONGEST_DELAY, allow_inf_nan=False)]


class StoredChoices(_Part):
    """What was chosen about the model."""

    terms: list[str]
    hold: Literal["zero", "linear", "cubic"]
    input_delay: StoredDelay
    link_delay: StoredDelay
    coulomb_velocity: Positive | None = None
    shapes: Shapes = {}


class StoredInput(_Part):
    """A log that the estimate was made from."""

    file: str = ""
    sha256: str = ""


class StoredProvenance(_Part):
    """Where the estimate comes from."""

    inputs: list[StoredInput] = []


class StoredEstimate(_Part):
    """The whole file."""

    model: Literal["flexible", "link", "rigid"]
    coefficients: dict[str, StoredCoefficient]
    choices: StoredChoices
    provenance: StoredProvenance = StoredProvenance()
