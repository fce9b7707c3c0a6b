"""Least squares on positions through a state-variable filter: no accelerations, no velocities."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import ModuleType

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, get_blas_funcs

from flexid.arrays import FloatArray
from flexid.errors import SettingError
from flexid.estimators.cluster_covariance import block_influences, block_lengths, covariance_of
from flexid.estimators.normal_equations import scaled_inverse
from flexid.estimators.samples import Samples
from flexid.estimators.unknowns import FIXED, Unknowns, unknowns_of
from flexid.kernels.store import load_kernel
from flexid.models.parametric_system import ParametricSystem
from flexid.recording.recording import Hold


@dataclass(frozen=True, eq=False)
class RowFit:
    """Least squares of one row."""

    name: str  # name of the row
    coefficients: tuple[str, ...]  # names of what is sought in it, k of them; none if all is fixed
    gram: FloatArray  # (k, k): rᵀR of the regressors R as they were fitted
    inverse: FloatArray  # (k, k): its inverse on the directions that the data determine
    total_sum: float  # sum of squares of the left-hand side
    # coefficients that the data leave free: their variance is infinite
    undetermined: tuple[str, ...]
    regressors: FloatArray  # (k, n_equations): r, all recordings in turn
    left_hand_side: FloatArray  # (n_equations,): what was fitted, less what is known or fixed
    fitted: FloatArray  # (n_equations,): its fit

    @property
    def count(self) -> int:
        """Equations that were fitted."""
        return len(self.left_hand_side)

    @property
    def residual_sum(self) -> float:
        """Sum of squares of what the fit leaves."""
        return float(np.sum((self.left_hand_side - self.fitted) ** 2))

    def over(self, some: NDArray[np.bool_]) -> FloatArray:
        """Least squares of some equations alone, shape (k,), from whether each is one of them."""
        regressors = self.regressors[:, some]
        gram = regressors @ regressors.T
        inverse, _ = scaled_inverse(gram, np.sqrt(np.diag(gram)))
        return inverse @ (regressors @ self.left_hand_side[some])


@dataclass(frozen=True, eq=False)
class LeastSquaresFit:
    """What is sought in all rows, with its covariance."""

    names: tuple[str, ...]  # what is sought, row by row
    values: FloatArray  # (n,): their values, in the system's units
    rows: tuple[RowFit, ...]  # the rows' own results
    blocks: tuple[int, ...]  # equations in each block of the covariance, independent of one another

    @property
    def by_name(self) -> dict[str, float]:
        """Values by name."""
        return dict(zip(self.names, self.values.tolist(), strict=True))

    @property
    def covariance(self) -> FloatArray:
        """Covariance, (n, n); infinite for what the data leave free."""
        return self._uncertainty[0]

    @property
    def degrees_of_freedom(self) -> tuple[float, ...]:
        """Degrees of freedom of each variance, for Student's t; 0 where there is none."""
        return self._uncertainty[1]

    @property
    def standard_deviations(self) -> FloatArray:
        """Standard deviation of each value, shape (n,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def information(self) -> FloatArray:
        """Gram matrix of all rows, shape (n, n): the sum of squares' quadratic form."""
        return np.asarray(block_diag(*(row.gram for row in self.rows)))

    @cached_property
    def _uncertainty(self) -> tuple[FloatArray, tuple[float, ...]]:
        """Covariance and degrees of freedom, made when asked for: many fits are only compared."""
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


def fit_rows(
    unknowns: Unknowns,
    regressors: FloatArray,  # (n_names, n_equations)
    left_hand_sides: FloatArray,  # (n_rows, n_equations)
) -> tuple[FloatArray, tuple[RowFit, ...]]:
    """Least squares of every row: values, shape (n_names,), and the fit of each row."""
    values = np.zeros(len(unknowns.names))
    rows = []
    first = 0
    for row, left_hand_side in zip(unknowns.system.rows, left_hand_sides, strict=True):
        names = unknowns.names_of(row)
        part = slice(first, first + len(names))
        fit, values[part] = _fit_row(row.name, names, regressors[part], left_hand_side)
        rows.append(fit)
        first = part.stop
    return values, tuple(rows)


def _fit_row(
    name: str, coefficients: tuple[str, ...], regressors: FloatArray, left_hand_side: FloatArray
) -> tuple[RowFit, FloatArray]:
    """Least squares of one row: its fit and values."""
    gram = regressors @ regressors.T
    scale = np.sqrt(np.diag(gram))
    inverse, free = scaled_inverse(gram, scale)
    values = inverse @ (regressors @ left_hand_side)
    # One refinement brings the normal equations to the accuracy of an orthogonal factorisation.
    values += inverse @ (regressors @ (left_hand_side - values @ regressors))
    fitted = values @ regressors
    fit = RowFit(
        name,
        coefficients,
        gram,
        inverse,
        float(np.sum(left_hand_side**2)),
        tuple(c for c, is_free in zip(coefficients, free, strict=True) if is_free),
        regressors,
        left_hand_side,
        fitted,
    )
    return fit, values


FASTEST = 0.5
"""Largest product of filter rate and sample time. Equations of positions hold at the samples, and
so for any filter; but a faster one lets the encoders' noise through to regressors, too. Its bias is
within the intervals up to here, and at twice as much within every second one.
"""

SLOWEST = 1e-5
"""Smallest product. In single precision a filter rounds what passes it by 2e-4 here, and by a
hundredth at a tenth of it."""


def check_filter_rate(
    filter_rate: float, sample_time: float, *, slowest: float = 1.0, fastest: float = 1.0
) -> None:
    """Raise unless a filter suits the samples."""
    least, most = SLOWEST / (slowest * sample_time), FASTEST / (fastest * sample_time)
    if not least <= filter_rate <= most:
        raise SettingError(
            "filter_rate",
            f"{filter_rate:g} 1/s does not suit samples every {sample_time:g} s: give {least:.3g} "
            f"to {most:.3g} 1/s",
        )


_MEMORY = 40.0  # time constants of the filter after which its past has vanished: exp(-40) = 4e-18
(_solve_banded,) = get_blas_funcs(("tbsv",), dtype=np.float64)
_TILE = 8192  # samples that are filtered together: they stay in the caches


# Every row v' = rᵀp + k is integrated twice over two intervals, which turns v' into a second
# difference, and is smoothed by λ²/(s + λ)². What the filter remembers from before the record is a
# combination of z^i and i z^i with its pole z; both sides are projected on what these leave.
def filtered_least_squares(
    recordings: Sequence[Samples],
    system: ParametricSystem,
    filter_rate: float = 20.0,
    hold: Hold = "linear",
    unknowns: Unknowns | None = None,
) -> LeastSquaresFit:
    """Estimate coefficients of contiguous recordings; of what they leave free, the least norm's."""
    if not (np.isfinite(filter_rate) and filter_rate > 0.0):
        raise SettingError("filter_rate", f"must be above 0 1/s, got {filter_rate}")
    unknowns = unknowns_of(system, len(recordings), unknowns)
    usable = [place for place, recording in enumerate(recordings) if len(recording) > 4]
    used = [recordings[place] for place in usable]
    _check_velocities(recordings, usable, unknowns)
    wanted = _wanted_signals(unknowns, usable)
    signals = filtered_signals(used, system, filter_rate, hold, wanted)
    lengths = [len(recording) - 2 for recording in used]
    regressors, left_hand_sides = _sought_signals(signals, unknowns, usable, lengths)
    most = max(len(unknowns.names_of(row)) for row in system.rows)
    times = [recording.sample_time for recording in used]
    blocks = block_lengths(lengths, times, filter_rate, most)
    values, rows = fit_rows(unknowns, regressors, left_hand_sides)
    return LeastSquaresFit(unknowns.names, values, rows, tuple(blocks))


def filtered_signals(
    recordings: Sequence[Samples],
    system: ParametricSystem,
    filter_rate: float,
    hold: Hold,
    wanted: NDArray[np.int64] | None = None,
) -> FloatArray:
    """Filtered regressors and left-hand sides, the filter's initial conditions projected out."""
    equations = [len(recording) - 2 for recording in recordings]
    n_signals = len(system.coefficients) + len(system.rows)
    places = range(n_signals) if wanted is None else wanted.tolist()
    # Memory that nothing is written to takes no room: signals that are not wanted cost nothing.
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
        _project_out_past(own[:, :past], pole)
        first += count
    return signals


def regressors(samples: Samples, system: ParametricSystem) -> list[FloatArray]:
    """Regressor of every coefficient at every sample, from positions and velocities."""
    model = _SampledModel(system, samples)
    linear = model.factors @ model.states[1::2]
    parts = model.parts(0, len(samples))
    return [part + v for part, v in zip(parts, linear, strict=True)][: len(system.coefficients)]


class _SampledModel:
    """The signals of a model at the samples of a recording."""

    def __init__(self, system: ParametricSystem, samples: Samples) -> None:
        self.states = np.zeros((2 * len(system.rows), len(samples)))
        self.states[::2] = samples.positions.T
        if samples.velocities is not None:
            self.states[1::2] = samples.velocities.T
        # A model may have an input that no term reads, and a recording none.
        self._inputs = np.full((len(system.inputs), len(samples)), np.nan)
        self._inputs[: samples.inputs.shape[1]] = samples.inputs.T
        self._constants = np.array(list(system.constants.values()), dtype=np.float64)
        self._rate = 1.0 / float(samples.sample_time)
        self._n_coefficients = len(system.coefficients)
        self._functions = signals(system)
        self.factors = np.empty((self._functions.N_SIGNALS, len(system.rows)))
        self._functions.velocity_factors(self._constants, self.factors)

    def parts(self, start: int, stop: int, lag: int = 0) -> FloatArray:
        """Signals without terms linear in velocities, with the inputs of so many samples before."""
        found = np.empty((self._functions.N_SIGNALS, stop - start))
        states = self.states[:, start:stop]
        inputs = self._inputs[:, start - lag : stop - lag]
        with np.errstate(all="ignore"):  # a term that is off may be of no number
            self._functions.sampled_parts(states, inputs, self._constants, found)
        return found

    def second_integrals(
        self, start: int, stop: int, zero_order: bool, wanted: Iterable[int]
    ) -> Iterator[tuple[int, FloatArray]]:
        """Double integrals of signals over two sampling intervals, and the place of each."""
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
            if held and zero_order:  # the middle sample counts on both sides of its jump
                signal += middle * until[place][:-1]
            for row, factor in enumerate(self.factors[place].tolist()):
                if factor != 0.0:
                    signal += factor * slopes[row]
            if place >= self._n_coefficients:
                curvature = np.diff(positions[place - self._n_coefficients], 2)
                signal = self._rate * self._rate * curvature - signal
            yield place, signal


def _smoothed(signal: FloatArray, bands: FloatArray, last: float) -> FloatArray:
    """The filter (1 - pole) / (1 - pole/z) after it was last: a bidiagonal system of equations."""
    pole = -float(bands[1, 0])
    right = (1.0 - pole) * signal
    right[0] += pole * last
    return _solve_banded(1, bands[:, : len(signal)], right, lower=1, diag=1, overwrite_x=1)


def _project_out_past(signals: FloatArray, pole: float) -> None:
    """Remove from each signal, in place, what the filter may remember: z^i and i z^i."""
    i = np.arange(signals.shape[1])
    past, _ = np.linalg.qr(np.column_stack((pole**i, i * pole**i)))
    signals -= (signals @ past) @ past.T


def _check_velocities(
    recordings: Sequence[Samples], usable: Sequence[int], unknowns: Unknowns
) -> None:
    """Refuse a recording without velocities where a term that is not switched off needs one."""
    needed = signals(unknowns.system).VELOCITY_NEEDED
    for place in usable:
        if recordings[place].velocities is not None:
            continue
        absent = unknowns.absent(place)
        for name in needed:
            if name not in absent:
                raise SettingError(
                    "velocities",
                    f"the regressor of {name!r} is nonlinear in a velocity but there are none: "
                    f"derive velocities first, or drop the term",
                )


def _wanted_signals(unknowns: Unknowns, usable: Sequence[int]) -> NDArray[np.int64]:
    """Places of the signals of least squares: left-hand sides, and regressors that are on."""
    system = unknowns.system
    absent = [unknowns.absent(place) for place in usable] or [frozenset()]
    off = frozenset.intersection(*absent)
    coefficients = [i for i, name in enumerate(system.coefficients) if name not in off]
    rows = [len(system.coefficients) + j for j in range(len(system.rows))]
    return np.array(coefficients + rows, dtype=np.int64)


def _sought_signals(
    signals: FloatArray, unknowns: Unknowns, usable: Sequence[int], lengths: Sequence[int]
) -> tuple[FloatArray, FloatArray]:
    """Regressors of what is sought, and left-hand sides less what is fixed."""
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
            # A term that is off stays out even where its regressor is not finite.
            for coefficient in part.start + np.flatnonzero(fixed[part]):
                left_hand_sides[row, equations] -= (
                    fixed[coefficient] * signals[coefficient, equations]
                )
    return regressors, left_hand_sides


def signals(system: ParametricSystem) -> ModuleType:
    """The signals of a model as functions of arrays."""

    def build() -> str:
        from flexid.derivation.model_functions import signal_module

        return signal_module(system)

    return load_kernel("signals", [system.digest], build)
