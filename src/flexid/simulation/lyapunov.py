"""Theorem 1 of Huang (2003) along a run: V of eq. (8), mismatches, errors and rates."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexid.arrays import FloatArray
from flexid.errors import SettingError
from flexid.estimators.excitation import Excitation, excitation
from flexid.estimators.samples import Samples
from flexid.estimators.state_variable_filter import regressors
from flexid.simulation.closed_loop import Run


@dataclass(frozen=True, eq=False)
class RowHistory:
    """Regressors and errors of a row with m coefficients along a run of n samples."""

    row: str  # name of the row
    coefficients: tuple[str, ...]  # names of its m coefficients
    gain: float  # the observer's gain c of this row
    regressors: FloatArray  # (n, m), r at every sample
    errors: FloatArray  # (n, m), p̃ = p̂ - p at every sample

    @property
    def mismatch(self) -> FloatArray:
        """rᵀp̃, shape (n,), which tends to zero by Theorem 1."""
        return np.einsum("ij,ij->i", self.regressors, self.errors)

    @property
    def error_rates(self) -> FloatArray:
        """p̃' = -c r rᵀp̃ of Huang (2003), eq. (7), shape (n, m), per second."""
        return -self.gain * self.regressors * self.mismatch[:, None]


def row_histories(run: Run) -> tuple[RowHistory, ...]:
    """Return the histories of all rows of a simulated closed loop."""
    system, x = run.loop.system, run.states
    motion = Samples(x[:, ::2], x[:, 1::2], run.inputs, float(run.time[1] - run.time[0]))
    found = np.column_stack(regressors(motion, system))
    return tuple(
        RowHistory(
            row.name,
            row.coefficients,
            run.loop.observer_gains[row.name],
            found[:, place],
            run.parameter_errors[:, place],
        )
        for row, place in system.row_slices()
    )


def row_excitation(run: Run, samples: slice = slice(None)) -> dict[str, Excitation]:
    """Return the excitation of each row over some of the samples."""
    return {
        history.row: excitation(history.row, history.coefficients, history.regressors[samples])
        for history in row_histories(run)
    }


SETTLED = 1e-3
"""Largest drift or final value of an error, over its first value, to be settled or vanished."""

ALLOWED_RISE = 10.0  # rise of V in integration tolerances that the integrator may cause


@dataclass(frozen=True)
class Limit:
    """Behaviour of one parameter error in the last window of a run."""

    coefficient: str  # its name
    first: float  # the error at the start of the run
    last: float  # the error at its end
    drift: float  # largest minus smallest value within the window
    largest_rate: float  # largest magnitude of its rate within the window, per second

    @property
    def settled(self) -> bool:
        """Whether the error stays constant to a thousandth of its first value."""
        return self.drift <= SETTLED * abs(self.first)

    @property
    def vanished(self) -> bool:
        """Whether the error is settled and below a thousandth of its first value."""
        return self.settled and abs(self.last) <= SETTLED * abs(self.first)


@dataclass(frozen=True, eq=False)
class LyapunovMonitor:
    """V, its rate and the limits of the errors along a run of n samples."""

    time: FloatArray  # (n,), in s
    value: FloatArray  # (n,), v = Σ |p̃|²/2, Huang (2003), eq. (8)
    rate: FloatArray  # (n,): V' = -Σ c (rᵀp̃)², per second, eq. (9)
    limits: tuple[Limit, ...]  # one per coefficient
    # largest rise of V above its minimum so far, over the error of V that one integration step may
    # have at the given tolerance
    rise_in_tolerances: float


def monitor_run(run: Run, window: float) -> LyapunovMonitor:
    """Check Theorem 1 along a simulated closed loop in continuous time."""
    if "relative_tolerance" not in run.settings:
        raise SettingError("run", "has no tolerance: use a continuous run, or call `monitor`")
    relative = float(run.settings["relative_tolerance"])
    absolute = float(run.settings["absolute_tolerance"])
    return monitor(run.time, row_histories(run), window, relative, absolute)


# Theorem 1: V of eq. (8) never rises, mismatches have a finite integral, and errors and rates have
# limits. The limit of the errors is zero if (A4) holds.
def monitor(
    time: FloatArray,  # (n,), in s
    rows: Sequence[RowHistory],
    window: float,
    relative_tolerance: float,
    absolute_tolerance: float,
) -> LyapunovMonitor:
    """Check Theorem 1 along histories of rows; `window` is the length of the last part in s."""
    errors = np.hstack([row.errors for row in rows])
    value = 0.5 * np.sum(errors**2, axis=1)
    mismatches = np.stack([row.mismatch for row in rows], axis=1)
    gains = np.array([row.gain for row in rows])
    # One step within tolerance changes V by Σ |p̃| δp̃ at most, to first order.
    allowed = np.sum(
        np.abs(errors) * (relative_tolerance * np.abs(errors) + absolute_tolerance), axis=1
    )
    smallest = np.minimum.accumulate(value)
    rise = value - smallest
    at_smallest = allowed[_place_of_minimum(value)]
    last = slice(int(np.searchsorted(time, time[-1] - window)), None)
    return LyapunovMonitor(
        time,
        value,
        -(mismatches**2) @ gains,
        tuple(limit for row in rows for limit in _limits(row, last)),
        float(np.max(np.divide(rise, at_smallest, out=np.zeros_like(rise), where=rise > 0))),
    )


def _place_of_minimum(value: FloatArray) -> NDArray[np.intp]:
    """Return for every sample the index of the smallest value so far."""
    lower = value < np.concatenate(([np.inf], np.minimum.accumulate(value)[:-1]))
    return np.maximum.accumulate(np.where(lower, np.arange(len(value)), 0))


def _limits(row: RowHistory, window: slice) -> list[Limit]:
    rates = np.abs(row.error_rates[window]).max(axis=0)
    drift = np.ptp(row.errors[window], axis=0)
    columns = zip(row.coefficients, row.errors[0], row.errors[-1], drift, rates, strict=True)
    return [Limit(name, *map(float, numbers)) for name, *numbers in columns]
