"""Where a stored estimate comes from: what reports and comparisons read of it, if it is there."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Setting = float | str | None
Ends = Annotated[list[float | None], Field(min_length=2, max_length=2)]


class _Part(BaseModel):
    model_config = ConfigDict(extra="ignore", strict=True)


class StoredOrigin(_Part):
    """How a channel was computed from columns."""

    columns: dict[str, float]
    factor: float
    offset: float
    unit: str
    gear_ratio: float | None


class StoredLog(_Part):
    """A log."""

    file: str | None = None
    sha256: str | None = None
    columns: dict[str, StoredOrigin] = {}


class StoredSettings(_Part):
    """What was asked for."""

    model: str = "auto"
    terms: str | list[str] = "auto"
    known: dict[str, float] = {}
    known_deviations: dict[str, float] = {}
    bounds: dict[str, Ends] = {}
    hold: str = "auto"
    input_delay: Setting = "auto"
    link_delay: Setting = "auto"
    coulomb_velocity: Setting = "auto"
    filter_rate: Setting = "auto"
    segment_duration: Setting = "auto"
    validation_share: float = 1 / 3


class StoredChoice(_Part):
    """What was chosen."""

    terms: list[str] | None = None
    hold: str | None = None
    estimator: str | None = None
    input_delay: float | None = None
    link_delay: float | None = None
    filter_rate: float | None = None
    segment_duration: float | None = None


class StoredProvenance(_Part):
    """All of it; a part that nobody reads may be anything."""

    flexid_version: str = ""
    settings: StoredSettings = StoredSettings()
    chosen: StoredChoice = StoredChoice()
    inputs: list[StoredLog] = []
