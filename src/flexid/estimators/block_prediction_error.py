"""Prediction error online, block by block: the last digit, from positions alone.

Least squares on filtered positions runs all the time. At the end of each block of about a second
the model's free motion is fitted to the block's positions, its initial state free, with what the
blocks before have shown as a prior,

    min  Σ (y - x(t; s, p))² / σ² + (p - p̄)ᵀ Λ (p - p̄),

by Gauss-Newton from p̄, which is the estimate so far (for the first block: that of least squares).
The block's own information, its initial state eliminated, is then added to Λ. So the work comes in
bursts, once per block, and the estimate stands still in between.
"""

from dataclasses import dataclass, replace

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import ConvergenceError
from flexid.estimators.beside_least_squares import (
    FILLED,
    STARTED,
    BesideLeastSquares,
    samples_in,
    state_layout,
)
from flexid.estimators.block_covariance import Blocks, block_covariance
from flexid.estimators.channel_timing import Timing
from flexid.estimators.gauss_newton import Minimum, approach, output_weights
from flexid.estimators.recursive_least_squares import (
    LEAST_INFORMATION,
    N_BLOCKS,
    recursive_least_squares,
)
from flexid.estimators.samples import Samples
from flexid.estimators.segmented_motion import (
    By,
    Equations,
    Point,
    SegmentedMotion,
    segmented_motion,
)
from flexid.estimators.segments import FEWEST_SAMPLES, divide, first_states
from flexid.models.parametric_system import ParametricSystem
from flexid.recording.recording import Hold
from flexid.recording.velocities import position_noise

_COARSE, _FINE = 1.0, 0.1  # length of a step, in standard deviations, that ends the iteration
_BLOCKS_PER_MEMORY = 8.0  # as in recursive least squares
_CLOCK, _BLOCK_LENGTH, _SPAN = 1, 2, 3  # places in a state's counts


@dataclass(frozen=True, eq=False)
class _MotionWithPrior(SegmentedMotion):
    """A motion to be fitted, and what is known of its coefficients already."""

    prior_values: FloatArray
    prior_information: FloatArray

    def equations(self, point: Point, by: By = "everything") -> Equations:
        """Normal equations with those of the prior."""
        found = super().equations(point, by)
        n_states = point.initial_states.shape[1]
        off = point.values - self.prior_values
        pull = self.prior_information @ off
        if by == "everything":
            found.normal[0, n_states:, n_states:] += self.prior_information
            found.gradient[0, n_states:] -= pull
        return replace(found, cost=found.cost + float(off @ pull))


@dataclass(frozen=True, eq=False)
class BlockPredictionError(BesideLeastSquares):
    """Prediction error block by block; made by `block_prediction_error`.

    The last sample of a block takes a thousand times as long as the others.

    Parameters
    ----------
    fading : float
        Factor of a weight from sample to sample.
    """

    fading: float

    def standard_deviations(self, state: FloatArray) -> FloatArray:
        """Standard deviation of each estimate, shape (n_coefficients,); see `covariance`."""
        return np.sqrt(np.diag(self.covariance(state)[0]))

    def covariance(self, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Covariance of the estimates from the spread of the blocks' scores.

        Returns
        -------
        covariance : array, shape (n_coefficients, n_coefficients)
            That of least squares before the first block is done; infinite variance as long as
            there are no more blocks than coefficients.
        degrees_of_freedom : array, shape (n_coefficients,)
            For Student's t; 0 where there is no covariance.
        """
        parts = self._parts(state)
        counts = parts["counts"]
        if not parts["progress"][STARTED]:
            return self.least_squares.covariance(parts["least_squares"])
        kept, k = int(counts[0]), len(parts["values"])
        equations = parts["stored"][:kept]
        ends, lengths = parts["ends"][:kept], parts["lengths"][:kept]
        if counts[_SPAN] > 0.0:
            equations = np.vstack((equations, parts["own"]))
            ends, lengths = np.append(ends, counts[_CLOCK]), np.append(lengths, counts[_SPAN])
        blocks = Blocks(
            lengths,
            self.fading ** (counts[_CLOCK] - ends),
            equations[:, : k * k].reshape(-1, 1, k, k),
            equations[:, k * k :].reshape(-1, 1, k),
        )
        return block_covariance([slice(0, k)], parts["values"], blocks)

    def _values(self, parts: np.ndarray) -> FloatArray:
        return parts["values"]

    def _begin(self, parts: np.ndarray) -> None:
        parts["values"][:] = self.least_squares.coefficients(parts["least_squares"])
        for name in ("information", "peaks", "own", "noise", "counts"):
            parts[name][...] = 0.0
        parts["counts"][_BLOCK_LENGTH] = self.block_samples

    def _run(self, parts: np.ndarray, samples: FloatArray, coefficients: FloatArray) -> None:
        filled = int(parts["progress"][FILLED])
        parts["buffer"][filled : filled + len(samples)] = samples
        if parts["progress"][STARTED]:
            coefficients[:] = parts["values"]

    def _break_off(self, parts: np.ndarray) -> None:
        """A block that lacks a sample is no block; there is nothing else to forget."""

    def _finish_block(self, parts: np.ndarray) -> None:
        try:
            found = self._fit(parts)
        except ConvergenceError:  # as if the block had not been
            parts["counts"][_CLOCK] += self.block_samples
        else:
            self._learn(parts, found)
            parts["progress"][STARTED] = 1.0

    def _fit(self, parts: np.ndarray) -> Minimum:
        """The block's motion at its best coefficients; where the noise is a guess, once more."""
        system, n_rows = self.system, len(self.system.rows)
        h, hold = self.least_squares.sample_time, self.least_squares.hold
        positions = parts["buffer"][:, :n_rows].copy()
        samples = Samples(positions, None, parts["buffer"][:, n_rows:].copy(), h)
        segments = divide([samples], h * self.block_samples)
        plain = segmented_motion(system, segments, Timing(hold))
        prior = parts["values"].copy(), parts["information"].copy()
        problem = _MotionWithPrior(**vars(plain), prior_values=prior[0], prior_information=prior[1])
        point = Point(prior[0], first_states(segments))
        if not parts["noise"].any():  # guessed from the positions, then taken from the residuals
            noise = np.array([position_noise(column) for column in positions.T])
            problem = problem.at(point, output_weights(noise, positions))
            coarse = approach(problem, point, _COARSE)
            point = coarse.point
            parts["noise"][:] = 1.0 / output_weights(coarse.noise(problem), positions)
        # The same weights for all blocks, so that their information and the prior's compare
        problem = problem.at(point, 1.0 / parts["noise"])
        return approach(problem, point, _FINE)

    def _learn(self, parts: np.ndarray, found: Minimum) -> None:
        """Add the block's information, score and residuals to what is known."""
        counts, values, reduced = parts["counts"], found.point.values, found.reduced
        known, fading = parts["information"].copy(), self.fading**self.block_samples
        information = reduced.information - known
        score = reduced.scores.sum(axis=1) + known @ (values - parts["values"])
        faded = fading * known
        peaks = np.maximum(parts["peaks"], np.diag(faded + information))
        parts["peaks"][:] = peaks
        parts["values"][:] = values
        parts["information"][:] = faded + information
        parts["information"][:] += np.diag((1.0 - fading) * LEAST_INFORMATION * peaks)
        # b_B of the linear problem that has the same score and information at these values
        equations = np.concatenate((information.ravel(), score + information @ values))
        parts["own"][:] = fading * parts["own"] + equations
        counts[_CLOCK] += self.block_samples
        counts[_SPAN] += self.block_samples
        if counts[_SPAN] >= counts[_BLOCK_LENGTH]:
            memory = -1.0 / np.log(self.fading) if self.fading < 1.0 else np.inf
            longest = max(float(self.block_samples), memory / _BLOCKS_PER_MEMORY)
            self.least_squares.store_block(
                counts, parts["ends"], parts["lengths"], parts["stored"], parts["own"], longest
            )
            parts["own"][:] = 0.0
            counts[_SPAN] = 0.0


def block_prediction_error(
    system: ParametricSystem,
    sample_time: float,
    filter_rate: float = 20.0,
    hold: Hold = "linear",
    memory_time: float = np.inf,
    block_duration: float = 1.0,
) -> BlockPredictionError:
    """Prediction error block by block, on positions, with least squares beside it.

    Parameters
    ----------
    system : ParametricSystem
        The model.
    sample_time : float
        Time between samples in s.
    filter_rate : float, optional
        λ in 1/s of the least squares beside it. See `choose_filter_rate`.
    hold : {"linear", "zero"}, optional
        Whether the inputs run linearly between samples or are constant until the next one.
    memory_time : float, optional
        Time in s after which a block weighs 1/e as much; infinite: nothing is forgotten.
    block_duration : float, optional
        In s. Longer blocks hold more information, forgive less, and come in longer bursts.

    Returns
    -------
    BlockPredictionError

    Raises
    ------
    SettingError
        If a setting is out of its range.
    """
    beside = recursive_least_squares(system, sample_time, filter_rate, hold, memory_time)
    samples = samples_in(block_duration, sample_time, FEWEST_SAMPLES, "block duration")
    k, n_rows = len(system.coefficients), len(system.rows)
    square = k * k + k
    layout = state_layout(
        beside,
        {
            "values": k,
            "information": (k, k),
            "peaks": k,
            "own": square,
            "counts": 4,  # as of `store_block`, then span
            "noise": n_rows,  # standard deviations in the first block
            "ends": N_BLOCKS,
            "lengths": N_BLOCKS,
            "stored": (N_BLOCKS, square),
            "buffer": (samples, n_rows + len(system.inputs)),
        },
    )
    fading = float(np.exp(-sample_time / memory_time))
    return BlockPredictionError(beside, samples, layout, fading)
