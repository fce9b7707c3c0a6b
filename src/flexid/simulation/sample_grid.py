"""The instants at which a run is sampled."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from flexid.errors import SettingError


@dataclass(frozen=True)
class SampleGrid:
    """The instants 0, sample_time, 2 sample_time … up to the duration, in s."""

    duration: float
    sample_time: float

    def __post_init__(self) -> None:
        check_positive(asdict(self))

    @property
    def count(self) -> int:
        """Number of samples."""
        return int(np.floor(self.duration / self.sample_time * (1.0 + 1e-12))) + 1

    @property
    def end(self) -> float:
        """Time of the last one in s."""
        return (self.count - 1) * self.sample_time

    @property
    def times(self) -> NDArray[np.float64]:
        """All of them, in s."""
        return self.sample_time * np.arange(self.count, dtype=np.float64)


def check_positive(settings: Mapping[str, float]) -> None:
    """Raise a `SettingError` for the first that is no positive finite number."""
    for name, value in settings.items():
        if not 0.0 < value < np.inf:
            raise SettingError(name, f"{value!r} must be a positive number")
