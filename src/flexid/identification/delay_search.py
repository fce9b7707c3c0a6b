"""The delay that explains equations best, and the interval of those that explain them as well.

The equations are linear in coefficients some of which physics forbids to be negative; these bounds
are what tells a late encoder from friction. The misfit as a function of the delay alone, all
coefficients fitted anew within their bounds, is the *profile*. It may be flat where a friction can
take the delay's place, and then the interval is as wide as that: what the data cannot tell apart
is part of the uncertainty, not of the choice.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from flexid.estimators.block_sandwich import block_lengths
from flexid.estimators.samples import FloatArray
from flexid.identification.delay_equations import DelayEquations, Equation, Unknown
from flexid.identification.nonnegative import nonnegative_least_squares

_STARTS = 9  # delays between the limits of which the best is where the search begins
_MOST_STEPS = 30
_PRECISION = 1e-3  # of a standard deviation (at least 1e-9 s), at which the search ends
_CONFIDENCE = 0.95
_FINEST = 1e-12  # residual over response that is still told from none
_FINE = 1e-9  # s, to which the ends of an interval are found

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class DelayEstimate:
    """What one set of equations says about one delay.

    Parameters
    ----------
    value : float
        The best delay in s. Where frictions can stand for a part of it, the one without them.
    std : float
        In s; half the interval over Student's quantile.
    interval : tuple of float
        All delays that explain the equations as well, at 95 %, frictions having whatever part.
    contains_zero : bool
        Whether no delay at all is one of them.
    misfit : float
        Mean square of the residual over that of the response, at the best delay.
    misfit_without : float
        The same without a delay.
    misfit_ceiling : float
        The largest that is not significantly worse than the best.
    """

    value: float
    std: float
    interval: tuple[float, float]
    contains_zero: bool
    misfit: float
    misfit_without: float
    misfit_ceiling: float


@dataclass(frozen=True, eq=False)
class _Row:
    """One equation at a delay, reduced by QR factorisation, with its own best coefficients.

    Parameters
    ----------
    equation : Equation
        The equation.
    coefficients : array, shape (k,)
        The best of those that are allowed.
    reduced : array, shape (k + 3, k + 2)
        Regressors, step and response of ``response = regressors' p + step (d - delay)``.
    size : float
        Root mean square of the residual.
    """

    equation: Equation
    coefficients: FloatArray
    reduced: FloatArray
    size: float

    @property
    def step(self) -> FloatArray:
        """Change of the response that a unit of delay explains, shape (n,)."""
        equation = self.equation
        slope = self.coefficients[equation.changing] * equation.regressor_slope
        return slope - equation.response_slope


def _row(equation: Equation, bounded: Mask, allowed: Mask) -> _Row:
    signals = (
        *equation.regressors,
        equation.regressor_slope,
        equation.response_slope,
        equation.response,
    )
    triangle = _triangle(np.array(signals).T)
    regressors, response = triangle[:, :-3], triangle[:, -1]
    coefficients, misfit = nonnegative_least_squares(regressors * allowed, response, bounded)
    step = coefficients[equation.changing] * triangle[:, -3] - triangle[:, -2]
    size = max(np.sqrt(misfit), _FINEST * float(np.linalg.norm(response)), np.finfo(float).tiny)
    return _Row(
        equation,
        coefficients,
        np.column_stack((regressors, step, response)),
        float(size) / np.sqrt(len(equation.response)),
    )


@dataclass(frozen=True, eq=False)
class _Linear:
    """All equations about a delay, each divided by its size.

    Parameters
    ----------
    delay : float
        In s.
    rows : list of _Row
        The equations.
    sizes : array, shape (r,)
        What each is divided by.
    matrix : array, shape (m, k + 2)
        Regressors of all, step and response.
    """

    delay: float
    rows: list[_Row]
    sizes: FloatArray
    matrix: FloatArray

    def best(self, bounded: Mask, allowed: Mask) -> float:
        """Best delay; of the coefficients, those not allowed are zero, those bounded not below."""
        solution, _ = nonnegative_least_squares(
            self.matrix[:, :-1] * np.append(allowed, True),
            self.matrix[:, -1],
            np.append(bounded, False),
        )
        return self.delay + float(solution[-1])

    def misfit(self, delay: float, bounded: Mask) -> float:
        """Sum of squares of the residual at a delay."""
        left = self.matrix[:, -1] - self.matrix[:, -2] * (delay - self.delay)
        return nonnegative_least_squares(self.matrix[:, :-2], left, bounded)[1]


class DelaySearch:
    """Search for one delay in one set of equations.

    Parameters
    ----------
    equations : callable
        Delay in s -> list of Equation.
    unknowns : sequence of sequence of Unknown
        Coefficients of each equation.
    layout : DelayEquations
        Where the equations come from: lengths and rates of the pieces, and the limit.
    """

    def __init__(
        self,
        equations: Callable[[float], list[Equation]],
        unknowns: Sequence[Sequence[Unknown]],
        layout: DelayEquations,
    ) -> None:
        self._equations = equations
        self._layout = layout
        self._edges = np.cumsum([0, *(len(row) for row in unknowns)])
        joined = [unknown for row in unknowns for unknown in row]
        self._bounded = np.array([unknown.bounded for unknown in joined])
        self._simple = np.array([not unknown.spare for unknown in joined])
        self._all = np.ones_like(self._simple)

    def best(self) -> DelayEstimate:
        """Find the delay, its interval, and whether there need be one at all."""
        limit = self._layout.limit
        starts = [self._linear(float(d)) for d in np.linspace(-limit, limit, _STARTS)]
        linear = min(starts, key=lambda start: float(np.log(start.sizes).sum()))
        for _ in range(_MOST_STEPS):
            delay = min(max(linear.best(self._bounded, self._all), -limit), limit)
            done = abs(delay - linear.delay) < _PRECISION * self._layout.spacings[0]
            linear = self._linear(delay)
            if done:
                break
        return self._describe(linear)

    def _describe(self, linear: _Linear) -> DelayEstimate:
        delay, limit = linear.delay, self._layout.limit
        inflation, degrees_of_freedom = self._inflation(linear)
        quantile = float(stdtrit(degrees_of_freedom, 0.5 + _CONFIDENCE / 2))
        best = linear.misfit(delay, self._bounded)
        ceiling = best + inflation * quantile**2
        simple = self._linear(delay, linear.sizes, self._simple).best(self._bounded, self._simple)
        if linear.misfit(simple, self._bounded) <= ceiling:
            delay = min(max(simple, -limit), limit)
        low, high = self._interval(linear, delay, ceiling)
        without = self._linear(0.0, linear.sizes).misfit(0.0, self._bounded)
        total = float(np.sum(linear.matrix[:, -1] ** 2))
        return DelayEstimate(
            value=delay,
            std=(high - low) / (2.0 * quantile),
            interval=(low, high),
            contains_zero=without <= ceiling,
            misfit=best / total,
            misfit_without=without / total,
            misfit_ceiling=ceiling / total,
        )

    def _linear(
        self, delay: float, sizes: FloatArray | None = None, allowed: Mask | None = None
    ) -> _Linear:
        """Equations about a delay; sizes are those of their residuals if not given."""
        allowed = self._all if allowed is None else allowed
        equations = self._equations(delay)
        parts = [slice(start, stop) for start, stop in pairwise(self._edges)]
        rows = [
            _row(equation, self._bounded[part], allowed[part])
            for equation, part in zip(equations, parts, strict=True)
        ]
        sizes = np.array([row.size for row in rows]) if sizes is None else sizes
        blocks = []
        for row, size, part in zip(rows, sizes, parts, strict=True):
            block = np.zeros((len(row.reduced), len(self._bounded) + 2))
            block[:, part] = row.reduced[:, :-2] / size
            block[:, -2:] = row.reduced[:, -2:] / size
            blocks.append(block)
        return _Linear(delay, rows, sizes, np.concatenate(blocks))

    def _inflation(self, linear: _Linear) -> tuple[float, int]:
        """Variance of the delay over the textbook's, and its degrees of freedom.

        The scores of the delay, summed over blocks, have a spread that allows for residuals that
        are correlated from instant to instant and from equation to equation.
        """
        scores = np.zeros(len(linear.rows[0].equation.response))
        information = np.finfo(float).tiny
        most = 0
        for row, size, (start, stop) in zip(
            linear.rows, linear.sizes, pairwise(self._edges), strict=True
        ):
            regressors = row.equation.regressors / size
            residual = row.equation.response / size - row.coefficients @ regressors
            inside = ~self._bounded[start:stop] | (row.coefficients > 0.0)
            inside &= np.abs(regressors).max(axis=1) > 0.0
            most = max(most, int(np.sum(inside)))
            others = regressors[inside] / np.linalg.norm(regressors[inside], axis=1)[:, None]
            basis, _ = np.linalg.qr(others.T)
            own = row.step / size
            own = own - basis @ (basis.T @ own)
            information += float(own @ own)
            scores += own * residual
        lengths, spacings = self._layout.lengths, self._layout.spacings
        blocks = block_lengths(lengths, spacings, self._layout.filter_rate, 1)
        sums = np.add.reduceat(scores, np.concatenate(([0], np.cumsum(blocks)[:-1])))
        # The fitted coefficients take their part of what the blocks would show.
        left = max(1, len(blocks) - most)
        return float(sums @ sums) * len(blocks) / left / information, left

    def _interval(self, linear: _Linear, best: float, ceiling: float) -> tuple[float, float]:
        """Delays on both sides at which the profile reaches the ceiling, or the limits."""
        limit = self._layout.limit

        def reached(delay: float) -> bool:
            return linear.misfit(delay, self._bounded) > ceiling

        ends = []
        for end in (-limit, limit):
            inside, outside = best, end
            if reached(end) and not reached(best):
                while abs(outside - inside) > _FINE:
                    middle = 0.5 * (inside + outside)
                    inside, outside = (inside, middle) if reached(middle) else (middle, outside)
            ends.append(outside)
        return float(ends[0]), float(ends[1])


def _triangle(columns: FloatArray) -> FloatArray:
    """What QR factorisation leaves of the columns."""
    return np.asarray(np.linalg.qr(columns, mode="r"), dtype=np.float64)
