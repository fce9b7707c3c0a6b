"""Covariance of a few blocks, drawn towards that of white noise as far as its scatter allows.

A dozen blocks show a covariance with a dozen degrees of freedom: intervals from it are long, for
Student's t, and those where blocks agree by chance are short nevertheless. Most residuals are
nearly white, and of white noise the covariance G is known up to a factor φ that all directions
show together. In coordinates in which G is the identity the blocks' covariance S is therefore drawn
towards φ I: altogether where directions differ by no more than chance, hardly where they do.
By how much follows from the traces of S and S² (Chen, Wiesel, Eldar and Hero, IEEE Trans. Signal
Processing 58, 2010, eq. 23, the oracle approximating shrinkage).
"""

import numpy as np

from flexid.arrays import FloatArray
from flexid.estimators.cluster_covariance import covariance_root


def shrunken(
    spread: FloatArray,  # (k, k)
    white: FloatArray,  # (k, k)
    freedom: FloatArray,  # (k,)
) -> tuple[FloatArray, FloatArray]:
    """The covariance drawn towards that of white noise, and its degrees of freedom, shape (k,)."""
    known = (freedom > 0.0) & (np.diag(white) > 0.0)
    _, back = covariance_root(white[np.ix_(known, known)])
    p = int(np.count_nonzero(np.any(back != 0.0, axis=0)))
    if p == 0:
        return spread, freedom
    part, own = np.ix_(known, known), freedom[known]
    mean_freedom = len(own) / float(np.sum(1.0 / own))
    alone = back.T @ spread[part] @ back
    factor = max(float(np.trace(alone)) / p, 1.0)
    share = _share(alone, p, mean_freedom)
    covariance, degrees = spread.copy(), freedom.copy()
    covariance[part] = (1.0 - share) * spread[part] + share * factor * white[part]
    degrees[known] = 1.0 / ((1.0 - share) ** 2 / own + share**2 / (p * mean_freedom))
    return covariance, degrees


def _share(alone: FloatArray, p: int, freedom: float) -> float:
    """What the multiple of the identity counts beside a covariance in p directions."""
    if p == 1:
        return 1.0
    trace, squares = float(np.trace(alone)), float(np.sum(alone**2))
    apart = (freedom + 1.0 - 2.0 / p) * (squares - trace**2 / p)
    alike = (1.0 - 2.0 / p) * squares + trace**2
    return 1.0 if alike >= apart else alike / apart
