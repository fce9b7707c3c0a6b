"""What varies over the runs of a campaign, and what is kept of each."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import prod
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

Kept = Literal[
    "final_errors",
    "final_states",
    "settling_time",
    "tracking",
    "excitation",
    "peak_input",
    "time_series",
]
"""What can be kept of each run beside its status, the time it reached and its steps."""

MEASURES: tuple[Kept, ...] = tuple(name for name in get_args(Kept) if name != "time_series")
"""All of it but the time series."""

MOST_RUNS = 10_000_000
"""Of one campaign."""

Kind = Literal["uniform", "log_uniform", "normal", "integers"]
Plan = Literal["grid", "latin-hypercube", "sobol", "sobol-indices"]


@dataclass(frozen=True)
class Distribution:
    """A distribution of one number.

    Parameters
    ----------
    kind : {"uniform", "log_uniform", "normal", "integers"}
    first, second : float
        Both ends, included for integers; of the normal distribution mean and standard deviation.

    Examples
    --------
    >>> Distribution("uniform", 10.0, 50.0).quantile([0.0, 0.5]).tolist()
    [10.0, 30.0]
    """

    kind: Kind
    first: float
    second: float

    def quantile(self, shares: ArrayLike) -> NDArray[np.float64]:
        """Values below which the given shares of all draws lie.

        Parameters
        ----------
        shares : array_like
            From 0 on and below 1; for a normal distribution above 0.

        Returns
        -------
        ndarray
            Of the shape of `shares`.
        """
        shares = np.asarray(shares, dtype=float)
        first, second = self.first, self.second
        if self.kind == "uniform":
            return first + shares * (second - first)
        if self.kind == "log_uniform":
            return first * (second / first) ** shares
        if self.kind == "normal":
            from scipy.special import ndtri  # late, since no single run needs it

            return first + second * ndtri(shares)
        return np.floor(first + shares * (second - first + 1.0))


@dataclass(frozen=True)
class Variation:
    """The ``[campaign]`` part of an experiment.

    Parameters
    ----------
    kind : {"grid", "latin-hypercube", "sobol", "sobol-indices"}
        Every combination of the values, or draws; the last ones made for Sobol indices.
    runs : int
        Number of runs; of a grid the product of the numbers of values.
    seed : int
        Of the draws.
    inputs : mapping of str to tuple of float or Distribution
        By dotted path of the experiment's file; of several values each is equally likely.
    keep : tuple of str
        What is kept of each run.
    runs_per_part : int or None
        How many runs share a file of the result; None leaves it to the campaign.
    """

    kind: Plan
    runs: int
    seed: int
    inputs: Mapping[str, tuple[float, ...] | Distribution]
    keep: tuple[Kept, ...]
    runs_per_part: int | None


def grid_size(inputs: Mapping[str, tuple[float, ...] | Distribution]) -> int:
    """Number of combinations of all lists of values."""
    return prod(len(values) for values in inputs.values() if isinstance(values, tuple))
