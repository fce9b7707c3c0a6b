"""The delay that explains equations best, and the interval of those that explain them as well.

The equations are linear in coefficients some of which physics forbids to be negative; these bounds
are what tells a late encoder from friction. The misfit as a function of the delay alone, all
coefficients fitted anew within their bounds, is the *profile*. It may be flat where a friction can
take the delay's place, and then the interval is as wide as that: what the data cannot tell apart
is part of the uncertainty, not of the choice.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear, root_scalar
from scipy.special import stdtrit

from flexid.estimators.block_sandwich import block_lengths
from flexid.estimators.samples import FloatArray
from flexid.identification.delay_equations import DelayEquations, Equation, Unknown

_STARTS = 9  # delays between the limits of which the best is where the search begins
_MOST_STEPS = 30
_PRECISION = 1e-3  # of a standard deviation (at least 1e-9 s), at which the search ends
_CONFIDENCE = 0.95
_FINEST = 1e-12  # residual over response that is still told from none
_FINE = 1e-9  # s, to which the ends of an interval are found
_NOTHING = 1e-100  # stands for zero where an upper bound has to lie above a lower one of zero


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
        Best within their bounds.
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


def _row(equation: Equation, least: FloatArray, most: FloatArray) -> _Row:
    signals = (
        *equation.regressors,
        equation.regressor_slope,
        equation.response_slope,
        equation.response,
    )
    triangle = _triangle(np.array(signals).T)
    regressors, response = triangle[:, :-3], triangle[:, -1]
    coefficients, misfit = _bounded(regressors, response, least, most)
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

    def best(self, least: FloatArray, most: FloatArray) -> float:
        """Best delay, the coefficients within bounds."""
        free = np.array([np.inf])
        solution, _ = _bounded(
            self.matrix[:, :-1],
            self.matrix[:, -1],
            np.concatenate((least, -free)),
            np.concatenate((most, free)),
        )
        return self.delay + float(solution[-1])

    def misfit(self, delay: float, least: FloatArray, most: FloatArray) -> float:
        """Sum of squares of the residual at a delay, the coefficients within bounds."""
        left = self.matrix[:, -1] - self.matrix[:, -2] * (delay - self.delay)
        return _bounded(self.matrix[:, :-2], left, least, most)[1]


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
        self._least_of = [np.array([unknown.least for unknown in row]) for row in unknowns]
        self._least = np.concatenate(self._least_of)
        self._most = np.full(len(self._least), np.inf)
        spare = [unknown.spare for row in unknowns for unknown in row]
        self._simple = np.where(spare, _NOTHING, np.inf)

    def best(self) -> DelayEstimate:
        """Find the delay, its interval, and whether there need be one at all."""
        limit = self._layout.limit
        starts = [self._linear(float(d)) for d in np.linspace(-limit, limit, _STARTS)]
        linear = min(starts, key=lambda start: float(np.log(start.sizes).sum()))
        for _ in range(_MOST_STEPS):
            delay = min(max(linear.best(self._least, self._most), -limit), limit)
            done = abs(delay - linear.delay) < _PRECISION * self._layout.spacings[0]
            linear = self._linear(delay)
            if done:
                break
        return self._describe(linear)

    def _describe(self, linear: _Linear) -> DelayEstimate:
        delay, limit = linear.delay, self._layout.limit
        inflation, degrees_of_freedom = self._inflation(linear)
        quantile = float(stdtrit(degrees_of_freedom, 0.5 + _CONFIDENCE / 2))
        best = linear.misfit(delay, self._least, self._most)
        ceiling = best + inflation * quantile**2
        simple = self._linear(delay, linear.sizes, self._simple).best(self._least, self._simple)
        if linear.misfit(simple, self._least, self._most) <= ceiling:
            delay = min(max(simple, -limit), limit)
        low, high = self._interval(linear, delay, ceiling)
        without = self._linear(0.0, linear.sizes).misfit(0.0, self._least, self._most)
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
        self, delay: float, sizes: FloatArray | None = None, most: FloatArray | None = None
    ) -> _Linear:
        """Equations about a delay; sizes are those of their residuals if not given."""
        most = self._most if most is None else most
        edges = np.cumsum([0, *(len(least) for least in self._least_of)])
        rows = [
            _row(equation, least, most[start:stop])
            for equation, least, start, stop in zip(
                self._equations(delay), self._least_of, edges[:-1], edges[1:], strict=True
            )
        ]
        sizes = np.array([row.size for row in rows]) if sizes is None else sizes
        blocks = []
        for row, size, start, stop in zip(rows, sizes, edges[:-1], edges[1:], strict=True):
            block = np.zeros((len(row.reduced), len(self._least) + 2))
            block[:, start:stop] = row.reduced[:, :-2] / size
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
        bounds = np.where(np.isfinite(self._least), 2.0 * _NOTHING, -np.inf)
        start = most = 0
        for row, size in zip(linear.rows, linear.sizes, strict=True):
            regressors = row.equation.regressors / size
            bound = bounds[start : start + len(regressors)]
            start += len(regressors)
            residual = row.equation.response / size - row.coefficients @ regressors
            inside = (row.coefficients > bound) & (np.abs(regressors).max(axis=1) > 0.0)
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

        def excess(delay: float) -> float:
            return linear.misfit(delay, self._least, self._most) - ceiling

        ends = []
        for end in (-limit, limit):
            reached = excess(end) > 0.0 and excess(best) < 0.0
            bracket = (best, end)
            ends.append(root_scalar(excess, bracket=bracket, xtol=_FINE).root if reached else end)
        return float(ends[0]), float(ends[1])


def _triangle(columns: FloatArray) -> FloatArray:
    """What QR factorisation leaves of the columns."""
    return np.asarray(np.linalg.qr(columns, mode="r"), dtype=np.float64)


def _bounded(
    matrix: FloatArray, target: FloatArray, least: FloatArray, most: FloatArray
) -> tuple[FloatArray, float]:
    """Least squares within bounds, and the sum of squares that it leaves."""
    norms = np.linalg.norm(matrix, axis=0)
    norms = np.where(norms > 0.0, norms, 1.0)
    found = lsq_linear(
        matrix / norms, target, (least * norms, most * norms), method="bvls", tol=1e-13
    )
    return found.x / norms, 2.0 * float(found.cost)
