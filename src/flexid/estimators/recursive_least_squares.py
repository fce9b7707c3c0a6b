"""Recursive least squares: estimates and standard deviations after every sample."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import SettingError
from flexid.estimators.cluster_covariance import kept_covariance
from flexid.estimators.online import OnlineEstimator, checked_sample_time, fading_factor
from flexid.kernels.store import load_kernel, model_kernel
from flexid.models.parametric_system import ParametricSystem
from flexid.recording.recording import Hold

_MEMORY = 20.0  # time constants after which the filter's initial state has decayed: to 2e-9
_INDEPENDENCE = 10.0  # smallest length of a block in time constants of the filter
_SETTLED = 5.0  # time constants of the filter before an estimate may count as determined
_BLOCKS_PER_MEMORY = 8.0  # so that 40 blocks reach back over five memories
_VELOCITY_WINDOW = 0.25  # half window of the velocity estimate, in time constants of the filter
_LONGEST_HALF_WINDOW = 25  # samples; the cost of each step grows with the window


@dataclass(frozen=True)
class Law:
    """Constants of an update, for implementations in other languages."""

    fading: float  # μ, the factor on earlier information per sample
    # fraction of the largest information of each coefficient that is never forgotten
    least_information: float
    fewest: int  # equations before an estimate may count as determined
    ridge: float  # ρ, added to the matrix when it is scaled to a unit diagonal
    least_tolerance: float  # smallest part of a regressor's square not explained by the others
    least_explained: float  # smallest part of a left-hand side that a row must explain
    # equations after which the filter's initial state has decayed
    memory: int
    pole: float  # of the filter
    # samples to either side of a straight line whose slope is the velocity; 0 if none is needed
    half_window: int


# Each sample gives one equation per row, y = rᵀp. With weights that fade by μ per sample,
#     A <- μ A + r rᵀ + (1 - μ) F,    b <- μ b + r y + (1 - μ) F p,    p <- p + A⁻¹ (b - A p).
# F is a small part of the largest information that each coefficient has had. It is never forgotten,
# so that the gain A⁻¹ stays bounded when excitation ends.
@dataclass(frozen=True, eq=False)
class RecursiveLeastSquares(OnlineEstimator):
    """Recursive least squares of a model; innovations have the unit of an acceleration."""

    _sizes: Any  # sizes of the model and indices in a state: see the template ``least_squares``
    law: Law  # constants of an update

    def standard_deviations(self, state: FloatArray) -> FloatArray:
        """Return each estimate's standard deviation, shape (n_coefficients,); see `covariance`."""
        return np.sqrt(np.diag(self.covariance(state)[0]))

    # Scores are summed over blocks that grow with the log: 20 to 40 blocks, or eight per memory.
    def covariance(self, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the covariance, from the spread of the blocks' scores, and degrees of freedom."""
        at = self._sizes
        kept, clock, _, span, _, past_gone = state[at.counts : at.power]
        n, size = int(kept), at.own - at.equations
        stored = state[at.stored :][: n * size]
        ends, lengths = state[at.ends :][:n], state[at.lengths :][:n]
        if past_gone and span > 0.0:  # the last block is not full yet
            stored = np.append(stored, state[at.own : at.ends])
            ends, lengths = np.append(ends, clock), np.append(lengths, span)
        weights = self.law.fading ** (clock - ends)
        rows = [part for _, part in self.system.row_slices()]
        values = self.coefficients(state)
        return kept_covariance(self._equations(stored), lengths, weights, rows, values)

    def information(self, state: FloatArray) -> list[FloatArray]:
        """Return Σ r rᵀ of each row, with fading; its singular values measure excitation (A4)."""
        matrices, _ = self._equations(state[self._sizes.equations : self._sizes.own])
        sizes = [len(row.coefficients) for row in self.system.rows]
        return [matrix[:k, :k].copy() for matrix, k in zip(matrices[0], sizes, strict=True)]

    def powers(self, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return each row's sum of squares, with fading, and its unexplained part."""
        at = self._sizes
        (matrices,), (vectors,) = self._equations(state[at.equations : at.own])
        power = np.maximum(state[at.power : at.past], 0.0)
        values = self.coefficients(state)
        unexplained = power.copy()
        for place, (_, part) in enumerate(self.system.row_slices()):
            p, n = values[part], part.stop - part.start
            unexplained[place] -= p @ (2.0 * vectors[place, :n] - matrices[place, :n, :n] @ p)
        return power, np.maximum(unexplained, 0.0)

    def equations(self, state: FloatArray) -> int:
        """Return the number of equations that each row has had."""
        return int(state[self._sizes.counts + self._kernel.CLOCK])

    def _equations(self, numbers: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Matrices and vectors of blocks' normal equations from the numbers in a state."""
        at = self._sizes
        width, n_rows = at.width, at.n_rows
        blocks = numbers.reshape(-1, at.own - at.equations)
        vectors = n_rows * width * width
        matrices = blocks[:, :vectors].reshape(-1, n_rows, width, width)
        return matrices, blocks[:, vectors:].reshape(-1, n_rows, width)


def recursive_least_squares(
    system: ParametricSystem,
    sample_time: float,
    filter_rate: float = 20.0,
    hold: Hold = "linear",
    memory: float = np.inf,
) -> RecursiveLeastSquares:
    """Make an estimator: recursive least squares on positions through the filter λ²/(s + λ)².

    Without forgetting, the last estimate equals the one of `filtered_least_squares`. The filter's
    initial state is estimated until it has decayed.

    Parameters
    ----------
    system : ParametricSystem
        The model. Regressors that are nonlinear in a velocity use the slope of a straight line
        fitted to the positions within 0.25/λ of a sample. Estimates of such a model come 0.25/λ
        later.
    sample_time : float
        Time between samples in s.
    filter_rate : float, optional
        λ in 1/s.
    hold : {"linear", "zero"}, optional
        Whether the inputs are linear between samples or constant until the next sample.
    memory : float, optional
        Time in s after which a sample has 1/e of its weight; infinite: no forgetting.

    Returns
    -------
    RecursiveLeastSquares

    Raises
    ------
    SettingError
        If a setting is out of its range.
    """
    h = checked_sample_time(sample_time)
    if not (np.isfinite(filter_rate) and filter_rate > 0.0):
        raise SettingError("filter_rate", f"must be above 0 1/s, got {filter_rate}")
    per_constant = 1.0 / (filter_rate * h)
    plain, half = model_kernel("signals", system), 0
    if plain.VELOCITY_NEEDED:
        half = max(1, min(_LONGEST_HALF_WINDOW, round(_VELOCITY_WINDOW * per_constant)))
    kernel = load_kernel("least_squares", (), None, ["least_squares"])
    law = Law(
        fading_factor(memory, h),
        kernel.LEAST_INFORMATION,
        int(np.ceil(_SETTLED * per_constant)),
        kernel.RIDGE,
        kernel.LEAST_TOLERANCE,
        kernel.LEAST_EXPLAINED,
        int(np.ceil(_MEMORY * per_constant)),
        float(np.exp(-1.0 / per_constant)),
        half,
    )
    shortest_block = _INDEPENDENCE * per_constant
    longest_block = max(shortest_block, memory / h / _BLOCKS_PER_MEMORY)
    constants = np.array(list(system.constants.values()), dtype=np.float64)
    factors = np.empty((plain.N_SIGNALS, len(system.rows)))
    plain.velocity_factors(constants, factors)
    of_update = [law.fading, longest_block, law.memory, law.fewest]
    of_rows = [h, hold == "zero", law.pole, half, *constants, *factors.ravel(), *plain.HELD]
    settings = np.array([*of_update, *of_rows], dtype=np.float64)
    starts = (0, *(part.stop for _, part in system.row_slices()))
    address = model_kernel("sampled_signals", system).sampled_parts.address
    model = kernel.sizes(address, starts, len(system.inputs), len(constants), half)
    layout = tuple(model), np.array(starts, dtype=np.int64)
    state = np.zeros(model.state)
    state[model.counts + kernel.BLOCK_LENGTH] = shortest_block
    return RecursiveLeastSquares(
        system, h, hold, False, kernel, settings, layout, state, model, law
    )
