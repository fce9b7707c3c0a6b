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
from flexid.estimators.block_covariance import Blocks, block_covariance
from flexid.estimators.online import (
    CompiledEstimator,
    checked_sample_time,
    fading_factor,
    row_starts,
)
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
class RecursiveLeastSquares(CompiledEstimator):
    """Recursive least squares of a model; made by the functions of this module.

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
            kernel.HALF_WINDOW if filtered else 0,
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
        return block_covariance(rows, self.coefficients(state), blocks)

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
    least_information: float = LEAST_INFORMATION,
) -> RecursiveLeastSquares:
    """Recursive least squares on positions, through the filter λ²/(s + λ)².

    Without forgetting it ends where `filtered_least_squares` does. What the filter remembers from
    before the first sample is estimated beside the coefficients until it has decayed.

    Parameters
    ----------
    system : ParametricSystem
        The model. Regressors that are nonlinear in a velocity see the slope of a straight line
        fitted to the positions about a sample, 0.25/λ to either side, and then the estimates are
        that much later.
    sample_time : float
        Time between samples in s.
    filter_rate : float, optional
        λ in 1/s.
    hold : {"linear", "zero"}, optional
        Whether the inputs run linearly between samples or are constant until the next one.
    memory_time : float, optional
        Time in s after which a sample weighs 1/e as much; infinite: nothing is forgotten.
    least_information : float, optional
        Part of the largest information of each coefficient that is never forgotten.

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
        raise SettingError("filter rate", f"must be above 0 1/s, got {filter_rate}")
    per_constant = 1.0 / (filter_rate * h)
    half = max(1, min(_LONGEST_HALF_WINDOW, round(_VELOCITY_WINDOW * per_constant)))
    plain = _filtered_kernel(system, 0)
    kernel = _filtered_kernel(system, half) if plain.VELOCITY_NEEDED else plain
    law = _law(h, memory_time, least_information, _INDEPENDENCE * per_constant)
    law += [np.ceil(_MEMORY * per_constant), np.ceil(_SETTLED * per_constant)]
    rows = [h, float(hold == "zero"), np.exp(-1.0 / per_constant)]
    return _built(system, h, hold, False, kernel, law + rows)


def least_squares_observer(
    system: ParametricSystem,
    sample_time: float,
    hold: Hold = "linear",
    memory_time: float = np.inf,
    least_information: float = LEAST_INFORMATION,
) -> RecursiveLeastSquares:
    """The parametric observer with least-squares gain: recursive least squares on velocities.

    The gain of Huang (2003), eqs. (2)-(3) becomes the inverse of the information. Over a sampling
    interval the integral of r v' is r̄ Δv, as in `parametric_observer`: no acceleration, no closed
    form of the immersion, and no rate of the input where its gain is unknown.

    Parameters
    ----------
    system : ParametricSystem
        The model.
    sample_time : float
        Time between samples in s.
    hold : {"linear", "zero"}, optional
        Whether the inputs run linearly between samples or are constant until the next one.
    memory_time : float, optional
        Time in s after which a sample weighs 1/e as much; infinite: nothing is forgotten.
    least_information : float, optional
        Part of the largest information of each coefficient that is never forgotten.

    Returns
    -------
    RecursiveLeastSquares
        It takes samples with velocities.

    Raises
    ------
    SettingError
        If a setting is out of its range.
    """

    def build() -> str:
        from flexid.derivation.model_functions import model_functions

        source = model_functions(system, "Parametric observer with least-squares gain")
        return source + _sizes(system)

    h = checked_sample_time(sample_time)
    templates = _templates("velocity_rows")
    kernel = load_kernel("least_squares_observer", [system.digest], build, templates)
    law = _law(h, memory_time, least_information, _SHORTEST_BLOCK / h)
    law += [0.0, np.ceil(_SHORTEST_BLOCK / h)]
    return _built(system, h, hold, True, kernel, [*law, h, float(hold == "zero")])


def _law(h: float, memory_time: float, least_information: float, block: float) -> list[float]:
    """Settings of the law, length of the first blocks last."""
    if not 0.0 < least_information < 1.0:
        raise SettingError(
            "least information", f"must lie between 0 and 1, got {least_information}"
        )
    longest = max(block, memory_time / h / _BLOCKS_PER_MEMORY)
    return [fading_factor(memory_time, h), least_information, longest, block]


def _built(
    system: ParametricSystem,
    h: float,
    hold: Hold,
    needs_velocities: bool,
    kernel: ModuleType,
    settings: list[float],
) -> RecursiveLeastSquares:
    state = np.zeros(kernel.STATE_SIZE)
    state[kernel.COUNTS_AT + kernel.BLOCK_LENGTH] = settings.pop(3)
    settings += system.constants.values()
    array = np.array(settings, dtype=np.float64)
    return RecursiveLeastSquares(system, h, hold, needs_velocities, kernel, array, state)


def _filtered_kernel(system: ParametricSystem, half_window: int) -> ModuleType:
    def build() -> str:
        from flexid.derivation.regressor_classes import filter_functions

        source = filter_functions(system, "Recursive least squares on positions")
        return source + f"HALF_WINDOW = {half_window}\n" + _sizes(system)

    digests = [system.digest, str(half_window)]
    templates = _templates("filtered_rows")
    return load_kernel("recursive_least_squares", digests, build, templates)


def _sizes(system: ParametricSystem) -> str:
    return "\n\n" + row_starts(system) + f"N_BLOCKS = {N_BLOCKS}\n"


def _templates(rows: str) -> tuple[str, ...]:
    return "status", rows, "block_scores", "least_squares_gain", "online"
