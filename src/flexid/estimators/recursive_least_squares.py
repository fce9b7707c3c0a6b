"""Recursive least squares: a value, its standard deviation and whether it is determined, any time.

Each sample gives one equation per row, y = rᵀp, either from positions through the state-variable
filter or from increments of measured velocities. With weights that fade by μ per sample,

    A <- μ A + r rᵀ + (1 - μ) F,    b <- μ b + r y + (1 - μ) F p,    p <- p + A⁻¹ (b - A p).

F is a small part of the largest information that each coefficient has had. It is never forgotten,
so that the gain A⁻¹ stays bounded when excitation ends; it draws the estimate to where it is.
"""

from dataclasses import dataclass
from types import ModuleType

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import SettingError
from flexid.estimators.block_sandwich import Blocks
from flexid.estimators.online import OnlineEstimator, checked_sample_time, fading_factor
from flexid.kernels.store import load_kernel
from flexid.models.parametric_system import ParametricSystem
from flexid.recording.recording import Hold

N_BLOCKS = 40
"""Blocks that are kept for the standard deviations."""

_MEMORY = 20.0  # time constants of the filter after which its past is gone: exp(-20) = 2e-9
_INDEPENDENCE = 10.0  # time constants of the filter that a block spans at least
_SETTLED = 5.0  # time constants of the filter before anything is called determined
_BLOCKS_PER_MEMORY = 8.0  # so that 40 blocks reach back over five memories
_VELOCITY_WINDOW = 0.25  # half window of the velocity estimate, in time constants of the filter
_LONGEST_HALF_WINDOW = 25  # samples: the window moves with every sample, at that cost
_SHORTEST_BLOCK = 0.5  # s, where there is no filter to say how long noise is correlated

LEAST_INFORMATION = 1e-4
"""Part of the largest information of a coefficient that is never forgotten."""


@dataclass(frozen=True)
class Law:
    """The numbers that an update goes by, for whoever writes it down in another language."""

    fading: float  # μ, by which what was learnt fades per sample
    # part of the largest information of each coefficient that is never forgotten
    least_information: float
    fewest: int  # equations before anything is called determined
    ridge: float  # ρ, added to the matrix when it is scaled to a unit diagonal
    least_tolerance: float  # part of a regressor's square that the others must leave over
    least_explained: float  # part of a left-hand side that a row must explain
    # equations after which the filter remembers nothing of the time before; 0 without a filter
    memory: int
    pole: float  # of the filter; 0 without one
    # samples to either side that a velocity is the slope over; 0 where none is needed
    half_window: int


@dataclass(frozen=True, eq=False)
class RecursiveLeastSquares(OnlineEstimator):
    """Recursive least squares of a model; made by `recursive_least_squares`.

    The innovations are in the unit of the row's left-hand side, an acceleration.
    """

    @property
    def law(self) -> Law:
        """The numbers that an update goes by."""
        kernel = self._kernel
        settings = self._settings.tolist()
        filtered = not self.needs_velocities
        return Law(
            settings[kernel.FORGETTING],
            settings[kernel.LEAST_INFORMATION],
            int(settings[kernel.FEWEST]),
            kernel.RIDGE,
            kernel.LEAST_TOLERANCE,
            kernel.LEAST_EXPLAINED,
            int(settings[kernel.MEMORY]) if filtered else 0,
            settings[kernel.N_LAW_SETTINGS + kernel.POLE] if filtered else 0.0,
            int(settings[kernel.N_LAW_SETTINGS + kernel.HALF_WINDOW]) if filtered else 0,
        )

    def standard_deviations(self, state: FloatArray) -> FloatArray:
        """Standard deviation of each estimate, shape (n_coefficients,); see `covariance`."""
        return np.sqrt(np.diag(self.covariance(state)[0]))

    def covariance(self, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Covariance of the estimates from the spread of the blocks' scores.

        The residuals are filtered noise, and correlated. So the scores are summed over blocks that
        are long enough to be independent of one another; blocks grow with the record, so that there
        are always between 20 and 40, or eight per memory time.
        """
        kernel = self._kernel
        kept, clock, _, span, _, past_gone = state[kernel.COUNTS_AT :][:6]
        n = int(kept)
        stored = state[kernel.STORED_AT :][: n * kernel.EQUATIONS_SIZE]
        ends, lengths = state[kernel.ENDS_AT :][:n], state[kernel.LENGTHS_AT :][:n]
        if past_gone and span > 0.0:  # the block that is not full yet
            stored = np.append(stored, state[kernel.OWN_AT :][: kernel.EQUATIONS_SIZE])
            ends, lengths = np.append(ends, clock), np.append(lengths, span)
        weights = self._settings[kernel.FORGETTING] ** (clock - ends)
        blocks = Blocks(lengths, weights, *self._equations(stored))
        rows = [part for _, part in self.system.row_slices()]
        return blocks.covariance(rows, self.coefficients(state))

    def information(self, state: FloatArray) -> list[FloatArray]:
        """Σ r rᵀ of each row, faded: what its singular values say of excitation, see (A4)."""
        kernel = self._kernel
        matrices, _ = self._equations(state[kernel.EQUATIONS_AT :][: kernel.EQUATIONS_SIZE])
        sizes = [len(row.coefficients) for row in self.system.rows]
        return [matrix[:k, :k].copy() for matrix, k in zip(matrices[0], sizes, strict=True)]

    def powers(self, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Sums of squares of each row's left-hand sides, faded, and what of them is unexplained."""
        kernel = self._kernel
        stored = state[kernel.EQUATIONS_AT :][: kernel.EQUATIONS_SIZE]
        (matrices,), (vectors,) = self._equations(stored)
        power = np.maximum(state[kernel.POWER_AT :][: kernel.N_ROWS], 0.0)
        values = self.coefficients(state)
        unexplained = power.copy()
        for place, (_, part) in enumerate(self.system.row_slices()):
            p, n = values[part], part.stop - part.start
            unexplained[place] -= p @ (2.0 * vectors[place, :n] - matrices[place, :n, :n] @ p)
        return power, np.maximum(unexplained, 0.0)

    @property
    def fading(self) -> float:
        """Factor by which a weight fades per sample; 1 if nothing is forgotten."""
        return float(self._settings[self._kernel.FORGETTING])

    def equations(self, state: FloatArray) -> int:
        """How many equations each row has had."""
        return int(state[self._kernel.COUNTS_AT + self._kernel.CLOCK])

    def _equations(self, numbers: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Matrices and vectors of blocks' normal equations, as the state holds them."""
        kernel = self._kernel
        width, n_rows = kernel.WIDTH, kernel.N_ROWS
        blocks = numbers.reshape(-1, kernel.EQUATIONS_SIZE)
        matrices = blocks[:, : kernel.VECTORS].reshape(-1, n_rows, width, width)
        return matrices, blocks[:, kernel.VECTORS :].reshape(-1, n_rows, width)


def recursive_least_squares(
    system: ParametricSystem,
    sample_time: float,
    filter_rate: float = 20.0,
    hold: Hold = "linear",
    memory_time: float = np.inf,
    velocities: bool = False,
) -> RecursiveLeastSquares:
    """Recursive least squares on positions through the filter λ²/(s + λ)², or on velocities.

    On positions it ends, without forgetting, where `filtered_least_squares` does. What the filter
    remembers from before the first sample is estimated until it has decayed.

    Parameters
    ----------
    system : ParametricSystem
        The model. Without measured velocities, regressors that are nonlinear in a velocity see the
        slope of a straight line fitted to the positions about a sample, 0.25/λ to either side, and
        then the estimates are that much later.
    sample_time : float
        Time between samples in s.
    filter_rate : float, optional
        λ in 1/s.
    hold : {"linear", "zero"}, optional
        Whether the inputs run linearly between samples or are constant until the next one.
    memory_time : float, optional
        Time in s after which a sample weighs 1/e as much; infinite: nothing is forgotten.
    velocities : bool, optional
        Samples hold measured velocities, and there is no filter: the paper's observer with the
        inverse of the information as its gain. Over an interval the integral of r v' is r̄ Δv, so
        it needs no acceleration and no closed form of the immersion.

    Returns
    -------
    RecursiveLeastSquares

    Raises
    ------
    SettingError
        If a setting is out of its range.
    """
    h = checked_sample_time(sample_time)
    half = 0
    if velocities:
        kernel, rows = _velocity_kernel(system), [h, float(hold == "zero")]
        shortest_block, memory, fewest = _SHORTEST_BLOCK / h, 0.0, np.ceil(_SHORTEST_BLOCK / h)
    else:
        if not (np.isfinite(filter_rate) and filter_rate > 0.0):
            raise SettingError("filter rate", f"must be above 0 1/s, got {filter_rate}")
        per_constant = 1.0 / (filter_rate * h)
        kernel = _filtered_kernel(system)
        if kernel.VELOCITY_NEEDED:
            half = max(1, min(_LONGEST_HALF_WINDOW, round(_VELOCITY_WINDOW * per_constant)))
        rows = [h, float(hold == "zero"), np.exp(-1.0 / per_constant), float(half)]
        shortest_block = _INDEPENDENCE * per_constant
        memory, fewest = np.ceil(_MEMORY * per_constant), np.ceil(_SETTLED * per_constant)
    fading = fading_factor(memory_time, h)
    longest_block = max(shortest_block, memory_time / h / _BLOCKS_PER_MEMORY)
    law = [fading, LEAST_INFORMATION, longest_block, memory, fewest]
    settings = np.array([*law, *rows, *system.constants.values()], dtype=np.float64)
    state = np.zeros(kernel.STATE_SIZE + 2 * half * kernel.SAMPLE_SIZE)
    state[kernel.COUNTS_AT + kernel.BLOCK_LENGTH] = shortest_block
    return RecursiveLeastSquares(system, h, hold, velocities, kernel, settings, state)


def _velocity_kernel(system: ParametricSystem) -> ModuleType:
    def build() -> str:
        from flexid.derivation.model_functions import model_functions

        source = model_functions(system, "Parametric observer with least-squares gain")
        return source + _sizes(system)

    templates = _templates("velocity_rows")
    return load_kernel("least_squares_observer", [system.digest], build, templates)


def _filtered_kernel(system: ParametricSystem) -> ModuleType:
    def build() -> str:
        from flexid.derivation.regressor_classes import filter_functions

        source = filter_functions(system, "Recursive least squares on positions")
        return source + _sizes(system)

    templates = _templates("filtered_rows")
    return load_kernel("recursive_least_squares", [system.digest], build, templates)


def _sizes(system: ParametricSystem) -> str:
    """Lines of a kernel's source: where the coefficients of each row begin, kept blocks."""
    starts = (0, *(part.stop for _, part in system.row_slices()))
    return f"\n\nROW_STARTS = {starts}\nN_BLOCKS = {N_BLOCKS}\n"


def _templates(rows: str) -> tuple[str, ...]:
    return "status", rows, "block_scores", "least_squares_gain", "online"
