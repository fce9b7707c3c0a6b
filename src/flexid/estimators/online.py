"""Base of the online estimators: init, step, and replay, which equals steps bit for bit."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from types import ModuleType
from typing import Any, ClassVar

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import SettingError
from flexid.estimators.samples import Samples
from flexid.models.parametric_system import ParametricSystem
from flexid.recording.recording import Hold


class Status(IntEnum):
    """Outcome of a sample; the last entry of its info."""

    USED = 0
    """The sample was used; the data determine the estimates."""
    STARTING = 1
    """The sample was used; the data do not determine the estimates yet: wait, or excite more."""
    REJECTED = 2
    """A value is not finite: estimates stay unchanged; the next sample starts a new recording."""


@dataclass(frozen=True, eq=False)
class History:
    """Result of a replay.

    Parameters
    ----------
    coefficients : array, shape (n, n_coefficients)
        Estimates after each sample.
    innovations : array, shape (n, n_rows)
        Measured minus predicted value of each row, before the sample updates the estimates, in
        the estimator's units. NaN without a prediction.
    status : array, shape (n,)
        A `Status` for each sample.
    state : array
        State after the last sample, from which a stream continues.
    """

    coefficients: FloatArray
    innovations: FloatArray
    status: FloatArray
    state: FloatArray


@dataclass(frozen=True, eq=False)
class OnlineEstimator:
    """Base class of the online estimators; a step is one compiled function."""

    system: ParametricSystem  # the model
    sample_time: float  # time between samples in s
    hold: Hold  # hold of the inputs between samples
    needs_velocities: bool  # whether samples contain velocities besides coordinates and inputs
    _kernel: ModuleType
    _settings: FloatArray
    _layout: tuple[Any, ...]  # the model, as arguments of a kernel that serves all models
    _first_state: FloatArray
    _first_coefficient: ClassVar[int] = 0

    def init(self, values: Mapping[str, float] | None = None) -> FloatArray:
        """Return the state before the first sample.

        Parameters
        ----------
        values : mapping of str to float, optional
            Initial estimates by coefficient; 0 for the other coefficients.
        """
        names = self.system.coefficients
        start = np.zeros(len(names))
        for name, value in (values or {}).items():
            if name not in names:
                raise SettingError(
                    "values", f"{name!r} is not a coefficient: give {', '.join(names)}"
                )
            if not np.isfinite(value):
                raise SettingError("values", f"must be finite, got {value} for {name!r}")
            start[names.index(name)] = value
        state = self._first_state.copy()
        state[self._coefficients] = start
        return state

    def step(self, state: FloatArray, sample: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the new state and info (innovations, `Status`) after one sample.

        Parameters
        ----------
        state : array
            From `init`, `step` or a replay; not changed.
        sample : array
            One row of the array from `pack`.
        """
        state = _of_shape("state", state, self._first_state.shape)
        sample = _of_shape("sample", sample, (self._sample_size,))
        return self._kernel.step(state, sample, self._settings, *self._layout)

    def replay(self, state: FloatArray, samples: FloatArray) -> History:
        """Process many samples, exactly as `step` would one by one.

        Parameters
        ----------
        state : array
            From `init`, `step` or an earlier replay; not changed.
        samples : array, shape (n, sample size)
            Array from `pack`.
        """
        state = _of_shape("state", state, self._first_state.shape)
        samples = _of_shape("samples", samples, (len(samples), self._sample_size))
        coefficients = np.empty((len(samples), len(self.system.coefficients)))
        infos = np.empty((len(samples), len(self.system.rows) + 1))
        made = coefficients, infos
        last = self._kernel.replay(state, samples, self._settings, *self._layout, *made)
        return History(coefficients, infos[:, :-1], infos[:, -1], last)

    def coefficients(self, state: FloatArray) -> FloatArray:
        """Return the estimates in a state, in the order of the model's coefficients.

        Parameters
        ----------
        state : array
            From `init`, `step` or a replay.
        """
        return _of_shape("state", state, self._first_state.shape)[self._coefficients].copy()

    @cached_property
    def _sample_size(self) -> int:
        sides = 2 if self.needs_velocities else 1
        return sides * len(self.system.rows) + len(self.system.inputs)

    @property
    def _coefficients(self) -> slice:
        first = self._first_coefficient
        return slice(first, first + len(self.system.coefficients))

    def pack(self, samples: Samples) -> FloatArray:
        """Return samples as the array that this estimator takes, one sample per row.

        Parameters
        ----------
        samples : Samples
            Samples of a log, for example from `flexid.samples`.
        """
        if self.needs_velocities:
            return packed(samples)
        return np.ascontiguousarray(np.concatenate((samples.positions, samples.inputs), axis=1))


def _of_shape(name: str, values: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    """Return an array of this shape, beyond whose ends compiled code would read and write."""
    values = np.ascontiguousarray(values, dtype=np.float64)
    if values.shape != shape:
        raise SettingError(
            name, f"has the shape {values.shape}, not {shape}: give what init or pack returns"
        )
    return values


def packed(samples: Samples) -> FloatArray:
    """Return samples with velocities as an array, shape (n, 2 n_rows + n_inputs)."""
    if samples.velocities is None:
        raise SettingError("velocities", "this estimator needs them: derive velocities first")
    states = np.stack((samples.positions, samples.velocities), axis=2).reshape(len(samples), -1)
    return np.ascontiguousarray(np.concatenate((states, samples.inputs), axis=1))


def checked_sample_time(sample_time: float) -> float:
    """Return the sample time in s, or raise if it is not above 0."""
    if not (np.isfinite(sample_time) and sample_time > 0.0):
        raise SettingError("sample_time", f"must be above 0 s, got {sample_time}")
    return float(sample_time)


def fading_factor(memory: float, sample_time: float) -> float:
    """Return the fading of weights per sample, exp(-h/τ): 1 for an infinite memory τ."""
    if not memory > 10.0 * sample_time:
        raise SettingError("memory", f"must be longer than ten samples, got {memory} s")
    return float(np.exp(-sample_time / memory))
