"""What varies over the runs of a campaign: the table ``[campaign]``, tried out when it is read."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import prod
from typing import TYPE_CHECKING, Annotated, Any, Literal, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from flexid.errors import ExperimentError, did_you_mean
from flexid.experiments.tables import Number, Positive, Table, Whole
from flexid.toml_file import Refuse, validated

if TYPE_CHECKING:
    from flexid.experiments.experiment import Experiment

MOST_RUNS = 10_000_000
"""Of one campaign."""

Kind = Literal["uniform", "log_uniform", "normal", "integers"]
Plan = Literal["grid", "latin-hypercube", "sobol"]


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

    kind: Plan  # every combination of the values, or draws
    runs: int  # number of runs; of a grid the product of the numbers of values
    seed: int  # of the draws
    inputs: Mapping[str, Input]  # by dotted path of the experiment's file
    runs_per_part: int | None  # runs that share a file of the result; None: the campaign chooses


def grid_size(inputs: Mapping[str, Input]) -> int:
    """Number of combinations of all lists of values."""
    return prod(len(values) for values in inputs.values() if isinstance(values, tuple))


_LARGEST_WHOLE = 2**53  # up to which values, which are floats, keep every digit
_INSIDE = 0.501  # share of the draws below the value inside a distribution that is tried


class CampaignTable(Table):
    """What varies over many runs."""

    kind: Plan
    runs: Annotated[int, Field(ge=1, le=MOST_RUNS)] | None = None
    seed: Annotated[int, Field(ge=0, le=2**63)] = 0
    runs_per_part: Annotated[int, Field(ge=1, le=100_000)] | None = None
    vary: Annotated[dict[str, Any], Field(min_length=1)]


class ListedValues(Table):
    """Several values of one number."""

    values: Annotated[list[Number], Field(min_length=1, max_length=10_000)]


class DistributionTable(Table):
    """One distribution: a kind and two numbers."""

    uniform: Annotated[list[Number], Field(min_length=2, max_length=2)] | None = None
    log_uniform: Annotated[list[Positive], Field(min_length=2, max_length=2)] | None = None
    normal: Annotated[list[Number], Field(min_length=2, max_length=2)] | None = None
    integers: Annotated[list[Whole], Field(min_length=2, max_length=2)] | None = None


def read_variation(campaign: Any, experiment: "Experiment") -> Variation:
    """Check a campaign against the experiment that it varies."""

    def refuse(key: str, reason: str) -> ExperimentError:
        return ExperimentError(experiment.path, f"campaign.{key}" if key else "campaign", reason)

    content = validated(campaign, CampaignTable, refuse)
    inputs: dict[str, Input] = {}
    for path, text in _flat(content.vary, experiment):
        if path in inputs:
            raise refuse(f"vary.{path}", "is there twice: leave one of them out")
        inputs[path] = _input(experiment, path, text)
    runs = content.runs
    if content.kind == "grid":
        for path, choice in inputs.items():
            if isinstance(choice, Distribution):
                raise refuse(f"vary.{path}", "is a distribution: a grid takes a list of values")
        if runs is not None:
            raise refuse("runs", "is for draws: remove it, a grid has one run per combination")
        runs = grid_size(inputs)
        if runs > MOST_RUNS:
            raise refuse("vary", f"makes {runs} combinations: give at most {MOST_RUNS}")
    elif runs is None:
        raise refuse("runs", "is missing: add it")
    return Variation(content.kind, runs, content.seed, inputs, content.runs_per_part)


def _flat(vary: Mapping[str, Any], experiment: "Experiment", path: str = "") -> Iterator[Any]:
    """Dotted paths with their values: TOML nests tables where dotted keys are not quoted."""
    for key, value in vary.items():
        here = f"{path}.{key}" if path else key
        if isinstance(value, dict) and here not in experiment.values:
            yield from _flat(value, experiment, here)
        else:
            yield here, value


def _input(experiment: "Experiment", path: str, value: Any) -> Input:
    def refuse(key: str, reason: str) -> ExperimentError:
        place = f"campaign.vary.{path}" + (f".{key}" if key else "")
        return ExperimentError(experiment.path, place, reason)

    if path not in experiment.values:
        raise refuse("", f"varies nothing{did_you_mean(path, experiment.values)}")
    if isinstance(value, list):
        for place, one in enumerate(value, start=1):
            if isinstance(one, int) and abs(one) > _LARGEST_WHOLE:
                raise refuse(str(place), "has more digits than are kept: give at most 15")
        chosen: Input = tuple(validated({"values": value}, ListedValues, refuse).values)
        tried = chosen
    elif isinstance(value, dict):
        chosen = _distribution(value, refuse)
        ends = () if chosen.kind == "normal" else (chosen.first, chosen.second)
        tried = (*ends, float(chosen.quantile(_INSIDE)))
    else:
        raise refuse("", "must be a list of values or a distribution, e.g. { uniform = [1, 2] }")
    for number in tried:
        try:
            experiment.with_values({path: number})
        except ExperimentError as error:
            raise refuse(
                "", f"reaches {number:g}, but the key {error.key!r} {error.reason}"
            ) from None
    return chosen


def _distribution(value: dict[str, Any], refuse: Refuse) -> Distribution:
    given = validated(value, DistributionTable, refuse).model_dump(exclude_none=True)
    if len(given) != 1:
        raise refuse("", "must have exactly one of uniform, log_uniform, normal, integers")
    ((kind, pair),) = given.items()
    found = Distribution(cast(Kind, kind), *map(float, pair))
    if found.kind != "normal" and not found.first < found.second:
        raise refuse(found.kind, "must rise from the first number to the second: correct it")
    if found.kind == "normal" and not found.second > 0.0:
        raise refuse("normal", "needs a positive standard deviation: correct it")
    return found
