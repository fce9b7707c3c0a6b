"""Which input matters most for which result: rank correlations, or Sobol indices."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import CampaignError

FEWEST_RUNS = 10
"""Fewest runs from which a correlation is computed."""

FEWEST_POINTS = 16
"""Fewest complete points of Saltelli's plan from which indices are computed."""

_LEVEL = 0.05
_SEED = 1  # of the resampling; SALib takes 0 for none


@dataclass(frozen=True)
class Correlation:
    """Spearman's rank correlation of a result with an input.

    Parameters
    ----------
    input : str
        Dotted path.
    value : float
        Between -1 and 1.
    significant : bool
        Whether it differs from 0 at a level of 5 %, shared by all inputs of the result
        (Bonferroni).
    """

    input: str
    value: float
    significant: bool


@dataclass(frozen=True)
class SobolIndex:
    """Share of a result's variance that an input makes.

    Parameters
    ----------
    input : str
        Dotted path.
    first, first_half_width : float
        Share of the input alone, and half of its 95 % interval.
    total, total_half_width : float
        The same together with all interactions.
    """

    input: str
    first: float
    first_half_width: float
    total: float
    total_half_width: float


def rank_correlations(
    inputs: Sequence[str], values: FloatArray, result: FloatArray
) -> tuple[Correlation, ...]:
    """Rank correlations of one result with all inputs, the strongest first.

    Parameters
    ----------
    inputs : sequence of str
    values : (n_runs, n_inputs) ndarray
    result : (n_runs,) ndarray
        Runs without a finite value are left out.

    Returns
    -------
    tuple of Correlation
        Without inputs that do not vary; empty if the result does not, or has too few runs.
    """
    from scipy import stats  # late: it loads for a second, and only a summary needs it

    there = np.isfinite(result)
    values, result = values[there], result[there]
    if len(result) < FEWEST_RUNS or np.ptp(result) == 0.0:
        return ()
    varying = [place for place in range(len(inputs)) if np.ptp(values[:, place]) > 0.0]
    found = []
    for place in varying:
        test: Any = stats.spearmanr(values[:, place], result)  # SciPy names no type
        significant = bool(test.pvalue < _LEVEL / len(varying))
        found.append(Correlation(inputs[place], float(test.statistic), significant))
    return tuple(sorted(found, key=lambda one: -abs(one.value)))


def sobol_indices(inputs: Sequence[str], result: FloatArray) -> tuple[SobolIndex, ...]:
    """Sobol indices of one result, the largest total first.

    Parameters
    ----------
    inputs : sequence of str
    result : (n_points, n_inputs + 2) ndarray
        Of a plan for Sobol indices, point by point. A point with a run that has no finite value
        is left out whole.

    Returns
    -------
    tuple of SobolIndex
        Empty if the result does not vary or too few points are complete.

    Raises
    ------
    CampaignError
        If SALib is not installed.
    """
    try:
        from SALib.analyze import sobol
    except ImportError:
        raise CampaignError(
            "a plan for Sobol indices",
            "is evaluated by SALib, which is not installed: pip install 'flexid[campaigns]'",
        ) from None
    result = result[np.all(np.isfinite(result), axis=1)]
    if len(result) < FEWEST_POINTS or np.ptp(result) == 0.0:
        return ()
    problem = {"num_vars": len(inputs), "names": list(inputs)}
    found = sobol.analyze(
        problem, result.ravel(), calc_second_order=False, num_resamples=200, seed=_SEED
    )
    columns = (found[key] for key in ("S1", "S1_conf", "ST", "ST_conf"))
    rows = zip(inputs, *(map(float, column) for column in columns), strict=True)
    return tuple(sorted((SobolIndex(*row) for row in rows), key=lambda one: -one.total))
