"""Which online estimator is exported, with its settings; and its twin in Python."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf
from typing import TYPE_CHECKING

from flexid.errors import SettingError
from flexid.estimators.filter_rate import check_filter_rate
from flexid.models.parametric_system import ParametricSystem
from flexid.recording.sampling import check_sample_time

if TYPE_CHECKING:
    from flexid.estimators.parametric_observer import ParametricObserver
    from flexid.estimators.recursive_least_squares import RecursiveLeastSquares
    from flexid.recording.recording import Hold

MEMORY_TIME = 60.0
"""s; a drive runs for years, and sums in float do not grow for ever."""


@dataclass(frozen=True)
class EstimatorSettings:
    """Settings of an online estimator."""

    sample_time: float  # s
    hold: "Hold" = "zero"  # the input between samples
    velocities: bool = False  # samples hold measured velocities
    # by coefficient or row: the paper's observer
    gains: Mapping[str, float] = field(default_factory=dict)
    filter_rate: float = 20.0  # 1/s, of the filter that positions pass
    memory_time: float = MEMORY_TIME  # s, after which a sample weighs 1/e as much
    start: Mapping[str, float] = field(default_factory=dict)  # 0 where no value is given

    def __post_init__(self) -> None:
        if self.gains and not self.velocities:
            raise SettingError(
                "gain", "a constant gain takes measured velocities: add --velocities, or leave it"
            )
        check_sample_time(self.sample_time)
        if not self.velocities:
            check_filter_rate(self.filter_rate, self.sample_time)

    def twin(self, system: ParametricSystem) -> "RecursiveLeastSquares | ParametricObserver":
        """The same estimator in Python."""
        from flexid.estimators.parametric_observer import parametric_observer
        from flexid.estimators.recursive_least_squares import recursive_least_squares

        h, hold, memory = self.sample_time, self.hold, self.memory_time
        if self.gains:
            return parametric_observer(system, self.gains, h, hold)
        return recursive_least_squares(system, h, self.filter_rate, hold, memory, self.velocities)

    @property
    def summary(self) -> str:
        """What is estimated from what, in a line."""
        if self.gains:
            return "Constant gain, from positions, velocities and inputs."
        if self.velocities:
            return f"Least-squares gain{self._fading}, from positions, velocities and inputs."
        return (
            f"Least-squares gain{self._fading}, from positions and inputs "
            f"through a filter of {self.filter_rate:g} 1/s."
        )

    @property
    def _fading(self) -> str:
        return "" if self.memory_time == inf else f", memory {self.memory_time:g} s"
