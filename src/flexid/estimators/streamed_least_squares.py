"""Least squares on filtered positions in one pass over a record of any length.

The record comes in stretches that overlap: each brings the samples before it that the filter still
remembers, so that its equations are those of the whole record and stretches may be worked on in any
order. Of each block of equations only the products are kept,

    M_b = Σ [r; e] [r; e]ᵀ,        e = y - rᵀ p₀,

with the regressors r, the left-hand side y and values p₀ near the answer, from the beginning of the
record. Their sum gives the coefficients; centred on p₀ it loses no digits to cancellation. One by
one they give the blocks' scores at whatever the coefficients turn out to be, and so the same
covariance as of a record in memory (`flexid.estimators.block_sandwich`). When there are
`MOST_BLOCKS` of them, neighbours are joined, and from then on blocks are twice as long: memory is
bounded, and longer blocks are no less independent.
"""

import threading
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from flexid.arrays import FloatArray
from flexid.estimators.block_sandwich import divided, summed_influences
from flexid.estimators.row_signals import fill_row_signals, wanted_signals
from flexid.estimators.rowwise import RowSums, covariance_of_rows
from flexid.estimators.samples import Samples
from flexid.estimators.scaled_inverse import scaled_inverse
from flexid.estimators.state_variable_filter import memory, project_out_past
from flexid.estimators.unknowns import FIXED, Unknowns
from flexid.recording.recording import Hold

MOST_BLOCKS = 32_768
"""Blocks whose products are kept: nine hours in blocks of a second."""


@dataclass(frozen=True, eq=False)
class StreamedFit:
    """Least squares of a record that is not in memory."""

    names: tuple[str, ...]  # What is sought, row by row
    values: FloatArray  # shape (n,); Their values, in the system's units
    rows: tuple[RowSums, ...]  # The rows' own results
    covariance: FloatArray  # shape (n, n); As of `flexid.estimators.rowwise.RowwiseFit`
    # Of each variance, for Student's t; 0 where there is none
    degrees_of_freedom: tuple[float, ...]
    hold: Hold  # Hold of the inputs
    filter_rate: float  # λ in 1/s

    @property
    def standard_deviations(self) -> FloatArray:
        """Standard deviation of each value, shape (n,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def information(self) -> FloatArray:
        """Gram matrix of all rows, shape (n, n): the sum of squares' quadratic form."""
        return np.asarray(block_diag(*(row.gram for row in self.rows)))


@dataclass(frozen=True, eq=False)
class Products:
    """Products of the equations of a stretch, block by block."""

    rows: tuple[FloatArray, ...]  # shape (n_blocks, k + 1, k + 1); M_b of each row
    lengths: tuple[int, ...]  # Equations in each block


@dataclass(frozen=True, eq=False)
class StreamedProblem:
    """What is sought in a stream, and how."""

    unknowns: Unknowns  # What is sought; of one group of recordings
    # shape (n,); p₀, values near the answer; the answer does not depend on them but for rounding
    reference: FloatArray
    filter_rate: float  # λ in 1/s
    hold: Hold  # Hold of the inputs
    block: int  # Equations in a block

    def warm_up(self, sample_time: float) -> int:
        """Samples before the first equation of a stretch that its samples have to begin."""
        return memory(self.filter_rate, sample_time)

    def products(self, samples: Samples, skipped: int, count: int, begins: bool) -> Products:
        """Products of some equations of a stretch; may be called from several threads."""
        system = self.unknowns.system
        pole = float(np.exp(-self.filter_rate * samples.sample_time))
        signals = self._room(len(samples) - 2)
        fill_row_signals(signals, 0, samples, system, self.hold, pole, self._wanted)
        if begins:
            project_out_past(signals[:, : self.warm_up(samples.sample_time)], pole)
        equations = slice(skipped, skipped + count)
        lengths = divided(count, self.block)
        rows = tuple(
            _block_products(self._row(place, signals, equations), self.block, lengths)
            for place in range(len(system.rows))
        )
        return Products(rows, tuple(lengths))

    @cached_property
    def _wanted(self) -> NDArray[np.int64]:
        return wanted_signals(self.unknowns, [0])

    @cached_property
    def _rooms(self) -> threading.local:
        return threading.local()

    def _room(self, equations: int) -> FloatArray:
        """Memory for the signals of a stretch, one for each thread.

        Fresh memory costs a third of what the filter does, so it is used again.
        """
        system = self.unknowns.system
        room: FloatArray | None = getattr(self._rooms, "signals", None)
        if room is None or room.shape[1] < equations:
            room = np.zeros((len(system.coefficients) + len(system.rows), equations))
            self._rooms.signals = room
        return room

    def _row(self, place: int, signals: FloatArray, equations: slice) -> FloatArray:
        """Regressors of what is sought in a row and, last, what the reference leaves of y."""
        system = self.unknowns.system
        columns = self.unknowns.columns(0)
        fixed = self.unknowns.coefficients(np.zeros(len(self.unknowns.names)), 0)
        part = list(system.row_slices())[place][1]
        coefficients = np.arange(part.start, part.stop)
        sought = coefficients[columns[part] != FIXED]
        both = np.empty((len(sought) + 1, equations.stop - equations.start))
        both[:-1] = signals[sought, equations]
        both[-1] = signals[len(system.coefficients) + place, equations]
        both[-1] -= self.reference[columns[sought]] @ both[:-1]
        # A term that is off stays out even where its regressor is not finite.
        for coefficient in coefficients[fixed[part] != 0.0]:
            both[-1] -= fixed[coefficient] * signals[coefficient, equations]
        return both


class StreamedSums:
    """Products of all blocks of a stream, in order; memory is bounded."""

    def __init__(self, problem: StreamedProblem, most_blocks: int = MOST_BLOCKS) -> None:
        self.problem = problem
        self.count = 0
        """Equations added."""
        sizes = [len(problem.unknowns.names_of(row)) + 1 for row in problem.unknowns.system.rows]
        self._most = most_blocks
        self._kept = [np.empty((most_blocks, size, size)) for size in sizes]
        self._filled = 0  # of the kept
        self._joined = 1  # blocks in each of these
        self._open = [np.zeros((size, size)) for size in sizes]  # the next one, not yet complete
        self._in_open = 0

    def add(self, products: Products) -> None:
        """Add the blocks of the next stretch."""
        self.count += sum(products.lengths)
        for block in range(len(products.lengths)):
            for total, row in zip(self._open, products.rows, strict=True):
                total += row[block]
            self._in_open += 1
            if self._in_open == self._joined:
                self._close()

    def _close(self) -> None:
        for kept, total in zip(self._kept, self._open, strict=True):
            kept[self._filled] = total
            total[:] = 0.0
        self._filled += 1
        self._in_open = 0
        if self._filled == self._most:
            half = self._most // 2
            for kept in self._kept:
                kept[:half] = kept[::2] + kept[1::2]
            self._filled = half
            self._joined *= 2

    def fit(
        self, unknowns: Unknowns | None = None, without: Sequence[Products] = ()
    ) -> StreamedFit:
        """Least squares of all that was added."""
        unknowns = unknowns or self.problem.unknowns
        left_out = sum(sum(products.lengths) for products in without)
        values, rows, found = [], [], []
        first = 0
        for place, row in enumerate(unknowns.system.rows):
            blocks = self._blocks(place)
            total = blocks.sum(axis=0)
            for products in without:
                total -= products.rows[place].sum(axis=0)
            names = self.problem.unknowns.names_of(row)
            reference = self.problem.reference[first : first + len(names)]
            sought = np.array([i for i, c in enumerate(names) if c not in unknowns.fixed], np.int64)
            step = np.array([unknowns.fixed.get(c, 0.0) for c in names]) - reference
            sums, step[sought] = _solved(
                row.name, names, reference, sought, step, total, self.count - left_out
            )
            scores = (blocks @ np.append(-step, 1.0))[:, sought]
            normal = blocks[:, sought[:, None], sought]
            found.append(summed_influences(normal, scores, sums.inverse))
            values.append(reference[sought] + step[sought])
            rows.append(sums)
            first += len(names)
        covariance, freedom = covariance_of_rows(rows, found)
        return StreamedFit(
            unknowns.names,
            np.concatenate(values),
            tuple(rows),
            covariance,
            freedom,
            self.problem.hold,
            self.problem.filter_rate,
        )

    def _blocks(self, place: int) -> FloatArray:
        """Products of a row, block by block, the last one as far as it got."""
        kept = self._kept[place][: self._filled]
        return np.concatenate((kept, self._open[place][None])) if self._in_open else kept


def _solved(
    name: str,
    names: tuple[str, ...],
    reference: FloatArray,
    sought: NDArray[np.int64],
    step: FloatArray,
    total: FloatArray,
    count: int,
) -> tuple[RowSums, FloatArray]:
    """Least squares of a row from the sum of its products."""
    fixed = step.copy()
    fixed[sought] = 0.0
    gram = total[sought[:, None], sought]
    scale = np.sqrt(np.diag(gram))
    inverse, free = scaled_inverse(gram, scale)
    from_fixed = np.append(-fixed, 1.0)
    right = (total @ from_fixed)[sought]
    # Along directions that the data leave open the answer is the one of least norm.
    found = inverse @ (right + gram @ reference[sought]) - reference[sought]
    found += inverse @ (right - gram @ found)
    whole = fixed.copy()
    whole[sought] = found
    from_zero, from_found = np.append(-step, 1.0), np.append(-whole, 1.0)
    coefficients = tuple(names[i] for i in sought)
    sums = RowSums(
        name,
        coefficients,
        gram,
        inverse,
        float(from_found @ total @ from_found),
        float(from_zero @ total @ from_zero),
        tuple(c for c, is_free in zip(coefficients, free, strict=True) if is_free),
        count,
    )
    return sums, found


def _block_products(both: FloatArray, size: int, lengths: Sequence[int]) -> FloatArray:
    """Products of a row's equations, shape (n_blocks, k + 1, k + 1), from (k + 1, n_equations)."""
    whole = len(lengths) - 1
    products = np.empty((len(lengths), len(both), len(both)))
    blocks = both[:, : whole * size].reshape(len(both), whole, size).transpose(1, 0, 2)
    np.matmul(blocks, blocks.transpose(0, 2, 1), out=products[:whole])
    rest = both[:, whole * size :]
    products[whole] = rest @ rest.T
    return products
