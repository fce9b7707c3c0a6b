"""Least squares on positions through a state-variable filter: no accelerations, no velocities."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, get_blas_funcs

from flexid.arrays import FloatArray
from flexid.errors import SettingError
from flexid.estimators.cluster_covariance import block_influences, block_lengths, covariance_of
from flexid.estimators.normal_equations import scaled_inverse
from flexid.estimators.samples import Samples
from flexid.estimators.unknowns import FIXED, Unknowns, unknowns_of
from flexid.kernels.store import model_kernel
from flexid.models.parametric_system import ParametricSystem
from flexid.recording.recording import Hold


@dataclass(frozen=True, eq=False)
class RowFit:
    """Least-squares fit of one row."""

    name: str  # name of the row
    coefficients: tuple[str, ...]  # names of the row's k unknowns; empty if all are fixed
    gram: FloatArray  # (k, k): Gram matrix of `regressors`
    inverse: FloatArray  # (k, k): inverse of `gram` on the directions that the data determine
    total_sum: float  # sum of squares of the left-hand side
    # coefficients that the data do not determine: their variance is infinite
    undetermined: tuple[str, ...]
    regressors: FloatArray  # (k, n_equations): recordings one after the other
    left_hand_side: FloatArray  # (n_equations,): measured values minus known and fixed terms
    fitted: FloatArray  # (n_equations,): fit of the left-hand side
    values: FloatArray  # (k,): values of the unknowns

    @property
    def count(self) -> int:
        """Number of fitted equations."""
        return len(self.left_hand_side)

    @property
    def residual_sum(self) -> float:
        """Sum of squares of the residuals."""
        return float(np.sum((self.left_hand_side - self.fitted) ** 2))

    def over(self, some: NDArray[np.bool_]) -> FloatArray:
        """Fit only the equations under a mask, shape (n_equations,); return values, shape (k,)."""
        regressors = self.regressors[:, some]
        gram = regressors @ regressors.T
        inverse, _ = scaled_inverse(gram, np.sqrt(np.diag(gram)))
        return inverse @ (regressors @ self.left_hand_side[some])


@dataclass(frozen=True, eq=False)
class LeastSquaresFit:
    """Least-squares fit of all rows: values of the unknowns and their covariance."""

    names: tuple[str, ...]  # names of the n unknowns, row by row
    values: FloatArray  # (n,): in the system's units
    rows: tuple[RowFit, ...]  # fit of each row
    blocks: tuple[int, ...]  # number of equations in each block, for the covariance

    @property
    def by_name(self) -> dict[str, float]:
        """Values by name."""
        return dict(zip(self.names, self.values.tolist(), strict=True))

    @property
    def covariance(self) -> FloatArray:
        """Covariance, (n, n), with infinite variance of undetermined unknowns."""
        return self._uncertainty[0]

    @property
    def degrees_of_freedom(self) -> tuple[float, ...]:
        """Degrees of freedom of each variance, for Student's t; 0 if the variance is unknown."""
        return self._uncertainty[1]

    @property
    def standard_deviations(self) -> FloatArray:
        """Standard deviation of each value, shape (n,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def information(self) -> FloatArray:
        """Block-diagonal Gram matrix of all rows, shape (n, n)."""
        return np.asarray(block_diag(*(row.gram for row in self.rows)))

    @cached_property
    def _uncertainty(self) -> tuple[FloatArray, tuple[float, ...]]:
        """Covariance and degrees of freedom, computed on demand: many fits are only compared."""
        found = [
            block_influences(
                row.regressors, row.left_hand_side - row.fitted, row.inverse, self.blocks
            )
            for row in self.rows
        ]
        influences = np.concatenate([influences for influences, _ in found])
        freedom = np.concatenate([freedom for _, freedom in found])
        undetermined = {c for row in self.rows for c in row.undetermined}
        free = np.array([name in undetermined for name in self.names])
        return covariance_of(influences, (freedom == 0.0) | free), tuple(freedom.tolist())


def _fit_row(
    name: str, coefficients: tuple[str, ...], regressors: FloatArray, left_hand_side: FloatArray
) -> RowFit:
    """Fit one row by least squares."""
    gram = regressors @ regressors.T
    inverse, free = scaled_inverse(gram, np.sqrt(np.diag(gram)))
    values = inverse @ (regressors @ left_hand_side)
    # One refinement brings the normal equations to the accuracy of an orthogonal factorisation.
    values += inverse @ (regressors @ (left_hand_side - values @ regressors))
    return RowFit(
        name,
        coefficients,
        gram,
        inverse,
        float(np.sum(left_hand_side**2)),
        tuple(c for c, is_free in zip(coefficients, free, strict=True) if is_free),
        regressors,
        left_hand_side,
        values @ regressors,
        values,
    )


FASTEST = 0.5
"""Largest product of filter rate and sample time. A faster filter lets more of the encoders' noise
into the regressors, which causes a bias. Up to this product the 95 % intervals cover the bias; at
twice the product they cover the truth in half of all cases.
"""

SLOWEST = 1e-5
"""Smallest product of filter rate and sample time. In single precision a filter rounds its output
by 2e-4 at this product, and by a hundredth at a tenth of it."""


def check_filter_rate(
    filter_rate: float, sample_time: float, *, slowest: float = 1.0, fastest: float = 1.0
) -> None:
    """Raise if a filter rate in 1/s does not suit the sample time in s."""
    least, most = SLOWEST / (slowest * sample_time), FASTEST / (fastest * sample_time)
    if not least <= filter_rate <= most:
        raise SettingError(
            "filter_rate",
            f"{filter_rate:g} 1/s does not suit samples every {sample_time:g} s: give {least:.3g} "
            f"to {most:.3g} 1/s",
        )


_MEMORY = 40.0  # time constants after which the filter's initial state has decayed: to 4e-18
(_solve_banded,) = get_blas_funcs(("tbsv",), dtype=np.float64)
_TILE = 8192  # samples that are filtered together: they fit into the caches


# Every row v' = rᵀp + k is integrated twice over two intervals, which turns v' into a second
# difference, and is smoothed by λ²/(s + λ)². The filter's unknown initial state adds a combination
# of z^i and i z^i, with the pole z. A projection removes both sequences from both sides.
def filtered_least_squares(
    recordings: Sequence[Samples],
    system: ParametricSystem,
    filter_rate: float = 20.0,
    hold: Hold = "linear",
    unknowns: Unknowns | None = None,
) -> LeastSquaresFit:
    """Estimate coefficients from positions; undetermined directions get the least-norm solution."""
    if not (np.isfinite(filter_rate) and filter_rate > 0.0):
        raise SettingError("filter_rate", f"must be above 0 1/s, got {filter_rate}")
    unknowns = unknowns_of(system, len(recordings), unknowns)
    usable = [place for place, recording in enumerate(recordings) if len(recording) > 4]
    used = [recordings[place] for place in usable]
    _check_velocities(recordings, usable, unknowns)
    wanted = _needed_signals(unknowns, usable)
    signals = filtered_signals(used, system, filter_rate, hold, wanted)
    lengths = [len(recording) - 2 for recording in used]
    regressors, left_hand_sides = _signals_of_unknowns(signals, unknowns, usable, lengths)
    most = max(len(unknowns.names_of(row)) for row in system.rows)
    times = [recording.sample_time for recording in used]
    blocks = block_lengths(lengths, times, filter_rate, most)
    rows, stop = [], 0
    for row, left_hand_side in zip(system.rows, left_hand_sides, strict=True):
        names = unknowns.names_of(row)
        own = slice(stop, stop := stop + len(names))
        rows.append(_fit_row(row.name, names, regressors[own], left_hand_side))
    values = np.concatenate([row.values for row in rows])
    return LeastSquaresFit(unknowns.names, values, tuple(rows), tuple(blocks))


def filtered_signals(
    recordings: Sequence[Samples],
    system: ParametricSystem,
    filter_rate: float,
    hold: Hold,
    wanted: NDArray[np.int64] | None = None,
) -> FloatArray:
    """Filter regressors and left-hand sides, and project out the filter's initial state."""
    equations = [len(recording) - 2 for recording in recordings]
    n_signals = len(system.coefficients) + len(system.rows)
    places = range(n_signals) if wanted is None else wanted.tolist()
    # Zeros that are never written take no memory, so unwanted signals are free.
    signals = np.zeros((n_signals, sum(equations)))
    first = 0
    for recording, count in zip(recordings, equations, strict=True):
        rate = filter_rate * float(recording.sample_time)
        pole = float(np.exp(-rate))
        model = _SampledModel(system, recording)
        own = signals[:, first : first + count]
        once = np.zeros(n_signals)
        bands = np.empty((2, min(_TILE, count)), order="F")
        bands[0], bands[1] = 1.0, -pole
        for start in range(0, count, _TILE):
            stop = min(start + _TILE, count)
            for place, signal in model.second_integrals(start, stop, hold == "zero", places):
                smooth = _smoothed(signal, bands, once[place])
                last = own[place, start - 1] if start else 0.0
                own[place, start:stop] = _smoothed(smooth, bands, last)
                once[place] = smooth[-1]
        past = min(count, int(np.ceil(_MEMORY / rate)) + 2)
        # The free response of the filter, z^i and i z^i, is removed.
        i = np.arange(past)
        free, _ = np.linalg.qr(np.column_stack((pole**i, i * pole**i)))
        own[:, :past] -= (own[:, :past] @ free) @ free.T
        first += count
    return signals


def regressors(samples: Samples, system: ParametricSystem) -> list[FloatArray]:
    """Return the regressor of every coefficient at every sample, from positions and velocities."""
    model = _SampledModel(system, samples)
    linear = model.factors @ model.states[1::2]
    parts = model.parts(0, len(samples))
    return [part + v for part, v in zip(parts, linear, strict=True)][: len(system.coefficients)]


class _SampledModel:
    """Signals of a model, its regressors and known parts, at the samples of a recording."""

    def __init__(self, system: ParametricSystem, samples: Samples) -> None:
        self.states = np.zeros((2 * len(system.rows), len(samples)))
        self.states[::2] = samples.positions.T
        if samples.velocities is not None:
            self.states[1::2] = samples.velocities.T
        # A recording may lack an input that no term of the model reads.
        self._inputs = np.full((len(system.inputs), len(samples)), np.nan)
        self._inputs[: samples.inputs.shape[1]] = samples.inputs.T
        self._constants = np.array(list(system.constants.values()), dtype=np.float64)
        self._rate = 1.0 / float(samples.sample_time)
        self._n_coefficients = len(system.coefficients)
        self._functions = model_kernel("signals", system)
        self.factors = np.empty((self._functions.N_SIGNALS, len(system.rows)))
        self._functions.velocity_factors(self._constants, self.factors)

    def parts(self, start: int, stop: int, lag: int = 0) -> FloatArray:
        """Return signals without parts linear in velocities; inputs are `lag` samples earlier."""
        found = np.empty((self._functions.N_SIGNALS, stop - start))
        states = self.states[:, start:stop]
        inputs = self._inputs[:, start - lag : stop - lag]
        with np.errstate(all="ignore"):  # a term that is off may be undefined
            self._functions.sampled_parts(states, inputs, self._constants, found)
        return found

    def second_integrals(
        self, start: int, stop: int, zero_order: bool, wanted: Iterable[int]
    ) -> Iterator[tuple[int, FloatArray]]:
        """Yield the index and the double integral over two intervals of each wanted signal."""
        positions = self.states[::2, start : stop + 2]
        slopes = 0.5 * self._rate * (positions[:, 2:] - positions[:, :-2])
        after = self.parts(start, stop + 2)
        until = after[:, 1:]
        if zero_order:
            until = self.parts(start + 1, stop + 2, lag=1)
        for place in wanted:
            held = self._functions.HELD[place]
            end = 1.0 / 6.0 if held else 1.0 / 12.0
            middle = (2.0 if zero_order else 4.0) / 6.0 if held else 10.0 / 12.0
            signal = middle * after[place][1:-1]
            signal += end * after[place][:-2]
            signal += end * until[place][1:]
            if held and zero_order:  # the input jumps at the middle sample: both values count
                signal += middle * until[place][:-1]
            for row, factor in enumerate(self.factors[place].tolist()):
                if factor != 0.0:
                    signal += factor * slopes[row]
            if place >= self._n_coefficients:
                curvature = np.diff(positions[place - self._n_coefficients], 2)
                signal = self._rate * self._rate * curvature - signal
            yield place, signal


def _smoothed(signal: FloatArray, bands: FloatArray, last: float) -> FloatArray:
    """Filter by (1 - pole) / (1 - pole/z) from the previous output `last`, as a banded solution."""
    pole = -float(bands[1, 0])
    right = (1.0 - pole) * signal
    right[0] += pole * last
    return _solve_banded(1, bands[:, : len(signal)], right, lower=1, diag=1, overwrite_x=1)


def _check_velocities(
    recordings: Sequence[Samples], usable: Sequence[int], unknowns: Unknowns
) -> None:
    """Raise if a recording lacks velocities that a term in use needs."""
    needed = model_kernel("signals", unknowns.system).VELOCITY_NEEDED
    for place in usable:
        if recordings[place].velocities is not None:
            continue
        absent = unknowns.absent(place)
        for name in needed:
            if name not in absent:
                raise SettingError(
                    "velocities",
                    f"the regressor of {name!r} is nonlinear in a velocity, but the recording has "
                    f"none: derive velocities first, or drop the term",
                )


def _needed_signals(unknowns: Unknowns, usable: Sequence[int]) -> NDArray[np.int64]:
    """Indices of the signals that a fit needs: regressors of terms in use, and left-hand sides."""
    system = unknowns.system
    absent = [unknowns.absent(place) for place in usable] or [frozenset()]
    off = frozenset.intersection(*absent)
    coefficients = [i for i, name in enumerate(system.coefficients) if name not in off]
    rows = [len(system.coefficients) + j for j in range(len(system.rows))]
    return np.array(coefficients + rows, dtype=np.int64)


def _signals_of_unknowns(
    signals: FloatArray, unknowns: Unknowns, usable: Sequence[int], lengths: Sequence[int]
) -> tuple[FloatArray, FloatArray]:
    """Regressors of the unknowns, and left-hand sides minus the fixed terms."""
    system = unknowns.system
    n_coefficients = len(system.coefficients)
    regressors = np.zeros((len(unknowns.names), signals.shape[1]))
    left_hand_sides = signals[n_coefficients:].copy()
    stop = 0
    for place, length in zip(usable, lengths, strict=True):
        equations = slice(stop, stop + length)
        stop = equations.stop
        columns = unknowns.columns(place)
        sought = columns != FIXED
        regressors[columns[sought], equations] = signals[:n_coefficients][sought, equations]
        fixed = unknowns.coefficients(np.zeros(len(unknowns.names)), place)
        for row, (_, part) in enumerate(system.row_slices()):
            # The regressor of a term that is off may be infinite, so 0 times it is not added.
            for coefficient in part.start + np.flatnonzero(fixed[part]):
                left_hand_sides[row, equations] -= (
                    fixed[coefficient] * signals[coefficient, equations]
                )
    return regressors, left_hand_sides
