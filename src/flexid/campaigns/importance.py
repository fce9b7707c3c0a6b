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
    """Spearman's rank correlation of a result with an input."""

    input: str  # dotted path
    value: float  # between -1 and 1
    # whether it differs from 0 at a level of 5 %, shared by all inputs of the result (Bonferroni)
    significant: bool


@dataclass(frozen=True)
class SobolIndex:
    """Share of a result's variance that an input makes."""

    input: str  # dotted path
    first: float  # share of the input alone
    first_half_width: float  # of its 95 % interval
    total: float  # share together with all interactions
    total_half_width: float


def rank_correlations(
    inputs: Sequence[str],
    values: FloatArray,  # (n_runs, n_inputs)
    result: FloatArray,  # (n_runs,); runs without a finite value are left out
) -> tuple[Correlation, ...]:
    """Rank correlations of one result with all inputs, the strongest first."""
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
    """Sobol indices of one result, shape (n_points, n_inputs + 2), the largest total first.

    A point of the plan with a run that has no finite value is left out whole.
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
