"""Estimators that need starting values, with least squares beside them, which needs none.

Least squares on filtered positions runs all the time. It starts the other estimator once it can
determine the coefficients, and is asked at the end of every block of samples whether the other's
can be true. If not, that is said, and the other is started anew: a wrong number is never returned
silently.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import SettingError
from flexid.estimators.online import History, Status
from flexid.estimators.recursive_least_squares import RecursiveLeastSquares
from flexid.estimators.samples import Samples
from flexid.models.parametric_system import ParametricSystem

FILLED, STARTED, CHECKED = 0, 1, 2
"""Places in the part "progress" of a state: samples of the block, whether it runs and was checked.
"""


@dataclass(frozen=True, eq=False)
class BesideLeastSquares(ABC):
    """What such estimators have in common.

    The innovations are those of least squares, and so are the estimates until it has started.

    Parameters
    ----------
    least_squares : RecursiveLeastSquares
        What runs beside it, starts it and checks it.
    block_samples : int
        Samples in a block.
    """

    least_squares: RecursiveLeastSquares
    block_samples: int
    _layout: np.dtype

    @property
    def system(self) -> ParametricSystem:
        """The model."""
        return self.least_squares.system

    def init(self, values: Mapping[str, float] | None = None) -> FloatArray:
        """State before the first sample.

        Parameters
        ----------
        values : mapping of str to float, optional
            Initial estimates of least squares, which needs none; they matter where the data leave
            a coefficient open.

        Returns
        -------
        array
            The state, packed. `coefficients` reads the estimates from it.

        Raises
        ------
        SettingError
            If a name is no coefficient of the model, or a value is not finite.
        """
        state = np.zeros(self._layout.itemsize // 8)
        self._parts(state)["least_squares"][:] = self.least_squares.init(values)
        return state

    def step(self, state: FloatArray, sample: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Take in one sample.

        Parameters
        ----------
        state : array
            From `init`, `step` or a replay; not changed.
        sample : array, float64
            One row of what `pack` makes.

        Returns
        -------
        state : array
            The new state.
        info : array, shape (n_rows + 1,)
            Innovations of least squares, and `Status`.
        """
        history = self.replay(state, sample[None, :])
        return history.state, np.append(history.innovations[0], history.status[0])

    def replay(self, state: FloatArray, samples: FloatArray) -> History:
        """Take in many samples, exactly as `step` would one by one.

        Parameters
        ----------
        state : array
            From `init`, `step` or an earlier replay; not changed.
        samples : array, shape (n, sample size)
            One sample per row; `pack` makes them.

        Returns
        -------
        History
        """
        samples = np.ascontiguousarray(samples, dtype=np.float64)
        state = state.copy()
        parts = self._parts(state)
        progress = parts["progress"]
        stretches = [self._least_squares_of(parts, samples[:0])]
        bad = np.flatnonzero(~np.isfinite(samples).all(axis=1))
        first = 0
        while first < len(samples):
            stop = min(len(samples), first + self.block_samples - int(progress[FILLED]))
            missing = bad[(bad >= first) & (bad < stop)]
            if len(missing):
                stop = int(missing[0]) + 1
            part = self._least_squares_of(parts, samples[first:stop])
            last = part.status[-1]
            if len(missing):
                self._run(parts, samples[first : stop - 1], part.coefficients[:-1])
                self._break_off(parts)
                progress[FILLED] = 0.0
                part.coefficients[-1] = self.coefficients(state)
            else:
                self._run(parts, samples[first:stop], part.coefficients)
                if progress[STARTED] and not progress[CHECKED]:
                    part.status[part.status == Status.USED] = Status.STARTING
                progress[FILLED] += stop - first
                if progress[FILLED] == self.block_samples:
                    progress[FILLED] = 0.0
                    part.status[-1] = self._end_block(parts, last)
                    part.coefficients[-1] = self.coefficients(state)
            stretches.append(part)
            first = stop
        return History(
            np.concatenate([stretch.coefficients for stretch in stretches]),
            np.concatenate([stretch.innovations for stretch in stretches]),
            np.concatenate([stretch.status for stretch in stretches]),
            state,
        )

    def coefficients(self, state: FloatArray) -> FloatArray:
        """Estimates in a state, shape (n_coefficients,)."""
        parts = self._parts(state)
        if parts["progress"][STARTED]:
            return self._values(parts).copy()
        return self.least_squares.coefficients(parts["least_squares"])

    def pack(self, samples: Samples) -> FloatArray:
        """Samples as `step` and `replay` take them, one per row.

        Raises
        ------
        SettingError
            If velocities are needed and the samples have none.
        """
        return self.least_squares.pack(samples)

    def _parts(self, state: FloatArray) -> np.ndarray:
        """The state's parts by name; they are views of it."""
        return state.view(self._layout)[0]

    def _least_squares_of(self, parts: np.ndarray, samples: FloatArray) -> History:
        """Least squares beside, which moves on."""
        history = self.least_squares.replay(parts["least_squares"], samples)
        parts["least_squares"][:] = history.state
        return history

    def _end_block(self, parts: np.ndarray, status: float) -> float:
        """Finish a block; return the status of its last sample."""
        progress = parts["progress"]
        beside = parts["least_squares"]
        determined = status == Status.USED  # by least squares
        if not progress[STARTED]:
            if not determined:
                return status
            self._begin(parts)
        self._finish_block(parts)
        if progress[STARTED] and determined:
            if not self.least_squares.agrees(beside, self._values(parts)):
                progress[STARTED] = 0.0  # least squares takes over, and starts it anew
                return float(Status.CONTRADICTED)
            progress[CHECKED] = 1.0
        return status

    @abstractmethod
    def _values(self, parts: np.ndarray) -> FloatArray:
        """The estimates once it runs."""

    @abstractmethod
    def _begin(self, parts: np.ndarray) -> None:
        """Start from least squares."""

    @abstractmethod
    def _run(self, parts: np.ndarray, samples: FloatArray, coefficients: FloatArray) -> None:
        """Take in samples of one block; overwrite the coefficients if it runs."""

    @abstractmethod
    def _break_off(self, parts: np.ndarray) -> None:
        """A sample is missing: the next one begins a new stretch."""

    @abstractmethod
    def _finish_block(self, parts: np.ndarray) -> None:
        """What is left to do at the end of a block; it runs if it sets `STARTED`."""


def state_layout(
    least_squares: RecursiveLeastSquares, parts: Mapping[str, int | tuple[int, ...]]
) -> np.dtype:
    """Layout of a state: least squares, progress, and an estimator's own parts with shapes."""
    beside = len(least_squares.init())
    fields = {"least_squares": beside, "progress": 3, **parts}
    return np.dtype([(name, "f8", shape) for name, shape in fields.items()])


def samples_in(duration: float, sample_time: float, fewest: int, what: str) -> int:
    """Samples in a block of a duration in s; a `SettingError` if there are fewer than needed."""
    samples = round(duration / sample_time) if np.isfinite(duration) else 0
    if samples < fewest:
        raise SettingError(what, f"{duration} s is none: give a time of {fewest} samples or more")
    return samples
