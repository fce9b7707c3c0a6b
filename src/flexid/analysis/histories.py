"""Regressors and parameter errors of each row along a motion: what the monitors look at."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from flexid.arrays import FloatArray
from flexid.models.expression import FUNCTIONS, OPERATIONS, Algebra, fold
from flexid.models.parametric_system import ParametricSystem
from flexid.simulation.loop import Run


@dataclass(frozen=True, eq=False)
class RowHistory:
    """One row along a run of n samples, with m coefficients."""

    row: str  # name of the row
    coefficients: tuple[str, ...]  # names of its m coefficients
    gain: float  # the observer's gain c of this row
    regressors: FloatArray  # (n, m), r at every sample
    errors: FloatArray  # (n, m), p̃ = p̂ - p at every sample

    @property
    def mismatch(self) -> FloatArray:
        """rᵀp̃, shape (n,): what the proof of Theorem 1 shows to vanish."""
        return np.einsum("ij,ij->i", self.regressors, self.errors)

    @property
    def error_rates(self) -> FloatArray:
        """p̃' = -c r rᵀp̃ of Huang (2003), eq. (7), shape (n, m), per second."""
        return -self.gain * self.regressors * self.mismatch[:, None]

    def part(self, samples: slice) -> "RowHistory":
        """The same row over some of the samples."""
        return replace(self, regressors=self.regressors[samples], errors=self.errors[samples])


def row_histories(run: Run) -> tuple[RowHistory, ...]:
    """Histories of all rows of a simulated closed loop."""
    system = run.loop.system
    regressors = regressors_along(system, run.states, run.inputs)
    return tuple(
        RowHistory(
            row.name,
            row.coefficients,
            run.loop.observer_gains[row.name],
            regressors[row.name],
            run.parameter_errors[:, place],
        )
        for row, place in system.row_slices()
    )


def regressors_along(
    system: ParametricSystem, states: ArrayLike, inputs: ArrayLike
) -> dict[str, FloatArray]:
    """Regressors of every row, shape (n, m) each, along states and inputs at n instants.

    Examples
    --------
    >>> from flexid.models.flexible_joint import flexible_joint
    >>> joint = flexible_joint(known={"beta1": 4.0})
    >>> regressors_along(joint, [[0.0, 1.0, -0.5, 2.0]], [[0.0]])["motor"].tolist()
    [[0.5, -2.0]]
    """
    states = np.asarray(states, dtype=float)
    values: dict[str, ArrayLike] = dict(zip(system.states, states.T, strict=True))
    values |= zip(system.inputs, np.asarray(inputs, dtype=float).T, strict=True)
    values |= {**system.constants, "pi": np.pi}
    algebra = Algebra(
        lambda text: np.asarray(float(text)),
        lambda name: np.asarray(values[name], dtype=float),
        _OF_ARRAYS,
    )
    return {
        row.name: np.stack(
            [
                np.broadcast_to(fold(text, system.variables, algebra, place), len(states))
                for place, text in row.regressors.items()
            ],
            axis=1,
        )
        for row in system.rows
    }


_OF_ARRAYS = OPERATIONS | {"**": np.power} | {name: getattr(np, name) for name in FUNCTIONS}
