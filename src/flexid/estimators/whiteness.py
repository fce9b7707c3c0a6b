"""Are residuals white? A portmanteau test over segments."""

from collections.abc import Sequence

import numpy as np
from scipy.special import chdtrc

from flexid.arrays import FloatArray

LAGS = 20
"""Lags in samples over which correlation is looked for."""


def whiteness(segments: Sequence[FloatArray], n_fitted: int) -> float:
    """Probability of residuals as correlated as these, were the noise white.

    The squared autocorrelations at lags 1 to `LAGS`, summed over lags and outputs and multiplied
    by the number of samples, are χ² distributed for white noise (Box and Pierce, J. Amer. Stat.
    Assoc. 65, 1970). A fit takes smooth motions out of the noise, which leaves each autocorrelation
    at minus the number of fitted unknowns per residual; that much is added back.

    Parameters
    ----------
    segments : sequence of array, shape (n, n_outputs)
        Residuals; no lag reaches from one segment into the next.
    n_fitted : int
        Unknowns that were fitted to all of them together.

    Returns
    -------
    float
        Between 0 and 1; small where the residuals are not white. 1 for residuals that are all zero.
    """
    longest = min(LAGS, min(len(part) for part in segments) - 1)
    count = sum(len(part) for part in segments)
    n_outputs = segments[0].shape[1]
    power = sum(np.sum(part**2, axis=0) for part in segments)
    power = np.where(power > 0.0, power, 1.0)
    bias = n_fitted / (count * n_outputs)
    # Zeros between the segments: no product reaches across them.
    apart = np.zeros((longest, n_outputs))
    joined = np.concatenate([rows for part in segments for rows in (part, apart)])
    columns = [np.ascontiguousarray(column) for column in joined.T]
    statistic = 0.0
    for lag in range(1, longest + 1):
        products = np.array([column[lag:] @ column[:-lag] for column in columns])
        pairs = sum(len(part) - lag for part in segments)
        correlation = products / power * count / pairs
        correlation = np.where(correlation == 0.0, 0.0, correlation + bias)
        statistic += float(pairs * np.sum(correlation**2))
    return float(chdtrc(longest * n_outputs, statistic))
