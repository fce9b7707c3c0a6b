"""The instants at which a simulated closed loop is sampled, and what it did."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from flexid.arrays import FloatArray
from flexid.errors import SettingError
from flexid.simulation.loop import ClosedLoop


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


@dataclass(frozen=True)
class Run:
    """A closed loop over time; n samples, all quantities in SI units."""

    # what was simulated: the model, its true coefficients, controller, reference, observer
    loop: ClosedLoop
    time: FloatArray  # (n,), in s
    states: FloatArray  # (n, n_states), x, in plain coordinates, in the order of loop.system.states
    inputs: FloatArray  # (n, n_inputs), u, in the order of loop.system.inputs
    estimates: FloatArray  # (n, n_coefficients), p̂, in the order of loop.system.coefficients
    # (n, n_coefficients), p̃ = p̂ - p. From a continuous run it is not the difference of the two
    # but the integrated error itself, so it keeps its digits as it vanishes.
    parameter_errors: FloatArray
    # (n,), tracked state minus q_d, accurate also where it is far smaller than either
    tracking_error: FloatArray
    settings: dict[str, str | int | float]  # task, tolerances, seed and version that made the run
    statistics: dict[str, int]  # accepted and rejected steps
    # (n, n_states), what controller and observer saw, in a sampled run
    measured: FloatArray | None = None

    @cached_property
    def reference(self) -> FloatArray:
        """q_d and its first four derivatives, (n, 5)."""
        return np.stack([self.loop.reference.evaluate(self.time, d) for d in range(5)], axis=1)

    def between(self, start: float, stop: float) -> slice:
        """Samples of a time window, both ends included."""
        first = int(np.searchsorted(self.time, start - 1e-9))
        return slice(first, int(np.searchsorted(self.time, stop + 1e-9)))

    def final_errors(self) -> dict[str, float]:
        """Parameter errors at the end, by coefficient."""
        last = self.parameter_errors[-1]
        return dict(zip(self.loop.system.coefficients, map(float, last), strict=True))

    def largest_tracking_error(self, start: float, stop: float) -> float:
        """Largest magnitude of the tracking error in a time window."""
        return float(np.max(np.abs(self.tracking_error[self.between(start, stop)])))

    def log(self) -> dict[str, FloatArray]:
        """Columns of a log: time, position and velocity of every row, inputs.

        Measured values where there are any. A single input is called ``motor_torque``, several
        have the system's names.
        """
        columns = {"time": self.time}
        values = self.states if self.measured is None else self.measured
        for place, row in enumerate(self.loop.system.rows):
            columns[f"{row.name}_position"] = values[:, 2 * place]
            columns[f"{row.name}_velocity"] = values[:, 2 * place + 1]
        names = self.loop.system.inputs
        inputs = dict(zip(names, self.inputs.T, strict=True))
        return columns | ({"motor_torque": inputs[names[0]]} if len(names) == 1 else inputs)


def split_columns(kernel: ModuleType, table: FloatArray) -> list[FloatArray]:
    """Columns of states, inputs, estimates, errors, tracking error and the rest, (n, …) each."""
    n = kernel.N_COEFFICIENTS
    widths = (kernel.N_STATES, kernel.N_INPUTS, n, n, 1)
    return np.split(table, np.cumsum(widths), axis=1)
