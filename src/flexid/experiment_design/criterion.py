"""How good an information matrix is, as one number: what optimal design calls D and E.

With M the information about the coefficients' logarithms, so that 1/√λ is the relative standard
deviation along an eigenvector of eigenvalue λ,

    E:  min λ(M),    the worst direction,
    D:  det M,       the volume of the confidence ellipsoid.

Both are reported as a relative standard deviation: 1/√(min λ), and det M to the power -1/(2k).
"""

import numpy as np

from flexid.arrays import FloatArray
from flexid.experiment_design.drive import Criterion

_SHARPNESS = 4.0  # of the smooth stand-in for the smallest eigenvalue
_FLOOR = 1e-14  # of an eigenvalue, over the largest one


def deviation(relative_information: FloatArray, criterion: Criterion) -> float:
    """Relative standard deviation that a criterion stands for; smaller is better."""
    eigenvalues = np.linalg.eigvalsh(relative_information)
    if eigenvalues[0] <= 0.0:
        return float("inf")
    if criterion == "E":
        return float(eigenvalues[0] ** -0.5)
    return float(np.exp(-0.5 * np.mean(np.log(eigenvalues))))


def smooth_cost(relative_information: FloatArray, criterion: Criterion) -> float:
    """Logarithm of about that deviation, smooth where eigenvalues cross, finite everywhere."""
    eigenvalues = np.linalg.eigvalsh(relative_information)
    eigenvalues = np.maximum(eigenvalues, max(_FLOOR * eigenvalues[-1], 1e-300))
    logs = np.log(eigenvalues)
    if criterion == "D":
        return float(-0.5 * logs.mean())
    lowest = logs.min()
    spread = np.log(np.sum(np.exp(-_SHARPNESS * (logs - lowest)))) / _SHARPNESS
    return float(0.5 * (spread - lowest))
