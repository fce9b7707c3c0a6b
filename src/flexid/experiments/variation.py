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
"""What can be kept of each run in addition to its status, the time it reached and its steps."""

MEASURES: tuple[Kept, ...] = tuple(name for name in get_args(Kept) if name != "time_series")
"""All of it but the time series."""

MOST_RUNS = 10_000_000
"""Of one campaign."""

Kind = Literal["uniform", "log_uniform", "normal", "integers"]
Plan = Literal["grid", "latin-hypercube", "sobol", "sobol-indices"]


@dataclass(frozen=True)
class Distribution:
    """A distribution of one number.

    Examples
    --------
    >>> Distribution("uniform", 10.0, 50.0).quantile([0.0, 0.5]).tolist()
    [10.0, 30.0]
    """

    kind: Kind
    first: float  # lower end, or the mean of a normal distribution
    second: float  # upper end, included for integers, or the standard deviation

    def quantile(self, shares: ArrayLike) -> NDArray[np.float64]:
        """Values below which the given shares of all draws lie, each from 0 on and below 1."""
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


Input = tuple[float, ...] | Distribution
"""Values, each equally likely in draws, or a distribution of them."""


@dataclass(frozen=True)
class Variation:
    """The ``[campaign]`` part of an experiment."""

    kind: Plan  # every combination of the values, or draws; the last ones made for Sobol indices
    runs: int  # number of runs; of a grid the product of the numbers of values
    seed: int  # of the draws
    inputs: Mapping[str, Input]  # by dotted path of the experiment's file
    keep: tuple[Kept, ...]  # what is kept of each run
    runs_per_part: int | None  # runs that share a file of the result; None: the campaign chooses


def grid_size(inputs: Mapping[str, Input]) -> int:
    """Number of combinations of all lists of values."""
    return prod(len(values) for values in inputs.values() if isinstance(values, tuple))
