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
from scipy.stats import t as student_t

from flexid.estimators.block_sandwich import block_lengths
from flexid.estimators.samples import FloatArray
from flexid.identification.delay_equations import DelayEquations, Equations, Unknown

_STARTS = 9  # delays between the limits of which the best is where the search begins
_MOST_STEPS = 30
_PRECISION = 1e-3  # of a standard deviation (at least 1e-9 s), at which the search ends
_CONFIDENCE = 0.95
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
class _Linear:
    """Equations about a delay d0: ``response = regressors' p + step (d - d0)``, all in turn.

    Parameters
    ----------
    delay : float
        d0 in s.
    coefficients : array, shape (k,)
        Best coefficients there.
    columns : array, shape (k + 2, r n)
        Regressors, step and response, each equation divided by its residual's size.
    triangle : array, shape (k + 2, k + 2)
        What is left of the columns by QR factorisation.
    """

    delay: float
    coefficients: FloatArray
    columns: FloatArray
    triangle: FloatArray

    def best(self, least: FloatArray, most: FloatArray) -> float:
        """Best delay, the coefficients within bounds."""
        free = np.array([np.inf])
        solution, _ = _bounded(
            self.triangle[:, :-1],
            self.triangle[:, -1],
            np.concatenate((least, -free)),
            np.concatenate((most, free)),
        )
        return self.delay + float(solution[-1])

    def misfit(self, delay: float, least: FloatArray, most: FloatArray) -> float:
        """Sum of squares of the residual at a delay, the coefficients within bounds."""
        left = self.triangle[:, -1] - self.triangle[:, -2] * (delay - self.delay)
        return _bounded(self.triangle[:, :-2], left, least, most)[1]


class DelaySearch:
    """Search for one delay in one set of equations.

    Parameters
    ----------
    equations : callable
        Delay in s -> Equations.
    unknowns : sequence of Unknown
        Their coefficients.
    layout : DelayEquations
        Where the equations come from: lengths and rates of the pieces, and the limit.
    """

    def __init__(
        self,
        equations: Callable[[float], Equations],
        unknowns: Sequence[Unknown],
        layout: DelayEquations,
    ) -> None:
        self._equations = equations
        self._layout = layout
        self._least = np.array([unknown.least for unknown in unknowns])
        self._most = np.full(len(unknowns), np.inf)
        spare = np.array([unknown.spare for unknown in unknowns])
        self._simple = np.where(spare, _NOTHING, np.inf)

    def best(self) -> DelayEstimate:
        """Find the delay, its interval, and whether there need be one at all."""
        limit = self._layout.limit
        starts = np.linspace(-limit, limit, _STARTS)
        start = float(starts[np.argmin([np.log(self._sizes(d)[1]).sum() for d in starts])])
        sizes = self._sizes(start)[1]
        for _ in range(_MOST_STEPS):
            linear = self._linear(start, sizes, self._most)
            delay = min(max(linear.best(self._least, self._most), -limit), limit)
            sizes = self._sizes(delay)[1]
            if abs(delay - start) < _PRECISION * self._layout.spacings[0]:
                break
            start = delay
        return self._describe(self._linear(delay, sizes, self._most), sizes)

    def spread(self, delay: float) -> float:
        """Standard deviation in s of an estimate near a delay, frictions that mimic it apart."""
        return self._inflation(self._linear(delay, self._sizes(delay)[1], self._simple))[0]

    def _describe(self, linear: _Linear, sizes: FloatArray) -> DelayEstimate:
        delay, inflation, blocks = linear.delay, *self._inflation(linear)[1:]
        quantile = float(student_t.ppf(0.5 + _CONFIDENCE / 2, blocks - 1))
        ceiling = linear.misfit(delay, self._least, self._most) + inflation * quantile**2
        simple = self._linear(delay, sizes, self._simple)
        preferred = simple.best(self._least, self._simple)
        if linear.misfit(preferred, self._least, self._most) <= ceiling:
            delay = min(max(preferred, -self._layout.limit), self._layout.limit)
            linear = self._linear(delay, sizes, self._simple)
        interval = self._interval(linear, ceiling)
        at_zero = self._linear(0.0, sizes, self._most)
        total = float(np.sum(linear.columns[-1] ** 2))
        without = at_zero.misfit(0.0, self._least, self._most)
        return DelayEstimate(
            value=delay,
            std=(interval[1] - interval[0]) / (2.0 * quantile),
            interval=interval,
            contains_zero=without <= ceiling,
            misfit=linear.misfit(delay, self._least, self._most) / total,
            misfit_without=without / total,
            misfit_ceiling=ceiling / total,
        )

    def _sizes(self, delay: float) -> tuple[FloatArray, FloatArray]:
        """Best coefficients at a delay, and the root mean square each equation leaves there."""
        equations = self._equations(delay)
        coefficients = self._coefficients(equations, np.ones(len(equations.response)), self._most)
        residual = equations.response - np.einsum("rkn,k->rn", equations.regressors, coefficients)
        sizes = np.sqrt(np.mean(residual**2, axis=1))
        floor = 1e-12 * np.sqrt(np.mean(equations.response**2, axis=1))
        return coefficients, np.maximum(sizes, np.maximum(floor, np.finfo(float).tiny))

    def _coefficients(
        self, equations: Equations, sizes: FloatArray, most: FloatArray
    ) -> FloatArray:
        columns = _weighted(equations.regressors, equations.response, sizes)
        triangle = np.linalg.qr(columns.T, mode="r")
        return _bounded(triangle[:, :-1], triangle[:, -1], self._least, most)[0]

    def _linear(self, delay: float, sizes: FloatArray, most: FloatArray) -> _Linear:
        equations = self._equations(delay)
        coefficients = self._coefficients(equations, sizes, most)
        step = np.einsum("rkn,k->rn", equations.regressors_slope, coefficients)
        step -= equations.response_slope
        regressors = np.concatenate((equations.regressors, step[:, None]), axis=1)
        columns = _weighted(regressors, equations.response, sizes)
        return _Linear(delay, coefficients, columns, np.linalg.qr(columns.T, mode="r"))

    def _inflation(self, linear: _Linear) -> tuple[float, float, int]:
        """Standard deviation of the delay, its square over the textbook's, and the blocks' number.

        The scores of the delay, summed over blocks, have a spread that allows for residuals that
        are correlated from instant to instant and from equation to equation.
        """
        regressors, step, response = (
            linear.columns[:-2],
            linear.columns[-2],
            linear.columns[-1],
        )
        residual = response - linear.coefficients @ regressors
        bound = np.where(np.isfinite(self._least), 2.0 * _NOTHING, -np.inf)
        inside = (linear.coefficients > bound) & (np.abs(regressors).max(axis=1) > 0.0)
        others = regressors[inside]
        basis, _ = np.linalg.qr((others / np.linalg.norm(others, axis=1)[:, None]).T)
        own = step - basis @ (basis.T @ step)
        lengths, spacings = self._layout.lengths, self._layout.spacings
        scores = (own * residual).reshape(-1, sum(lengths)).sum(axis=0)
        blocks = block_lengths(lengths, spacings, self._layout.filter_rate, 1)
        sums = np.add.reduceat(scores, np.concatenate(([0], np.cumsum(blocks)[:-1])))
        information = max(float(own @ own), np.finfo(float).tiny)
        spread = float(sums @ sums) * len(blocks) / max(1, len(blocks) - 1)
        return float(np.sqrt(spread)) / information, spread / information, len(blocks)

    def _interval(self, linear: _Linear, ceiling: float) -> tuple[float, float]:
        """Delays on both sides at which the profile reaches the ceiling, or the limits."""
        limit = self._layout.limit

        def excess(delay: float) -> float:
            return linear.misfit(delay, self._least, self._most) - ceiling

        ends = []
        for end in (-limit, limit):
            reached = excess(end) > 0.0 and excess(linear.delay) < 0.0
            found = root_scalar(excess, bracket=(linear.delay, end)).root if reached else end
            ends.append(float(found))
        return ends[0], ends[1]


def _weighted(regressors: FloatArray, response: FloatArray, sizes: FloatArray) -> FloatArray:
    """Columns of all equations in turn, each equation divided by its size, response last."""
    columns = np.concatenate((regressors, response[:, None]), axis=1) / sizes[:, None, None]
    return columns.transpose(1, 0, 2).reshape(columns.shape[1], -1)


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
