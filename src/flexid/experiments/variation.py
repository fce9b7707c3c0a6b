"""Varied values of a campaign: the table ``[campaign]``, checked when it is read."""

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import prod
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import BeforeValidator, Field, model_validator

from flexid.errors import ExperimentError, did_you_mean
from flexid.experiments.tables import Number, Positive, Table, Whole
from flexid.files import validated

if TYPE_CHECKING:
    import polars as pl

    from flexid.experiments.experiment import Experiment

MOST_RUNS = 10_000_000  # of one campaign

_T = TypeVar("_T")
_Pair = Annotated[list[_T], Field(min_length=2, max_length=2)]

_LARGEST_WHOLE = 2**53  # floats are exact up to here


def _exact(value: Any) -> Any:
    if isinstance(value, int) and abs(value) > _LARGEST_WHOLE:
        raise ValueError("it has more digits than a float stores: give at most 15")
    return value


_Listed = Annotated[Number, BeforeValidator(_exact)]


class Distribution(Table):
    """Distribution or list of values of one varied number."""

    values: Annotated[list[_Listed], Field(min_length=1, max_length=10_000)] | None = None
    uniform: _Pair[Number] | None = None  # ends
    log_uniform: _Pair[Positive] | None = None  # ends
    normal: _Pair[Number] | None = None  # mean and standard deviation
    integers: _Pair[Whole] | None = None  # ends, both included

    @model_validator(mode="after")
    def _has_one_kind(self) -> "Distribution":
        kinds = self.model_dump(exclude_none=True)
        if len(kinds) != 1:
            names = [*type(self).model_fields][1:]
            raise ValueError(f"exactly one of {', '.join(names)} is needed")
        if self.normal is not None and not self.normal[1] > 0.0:
            raise ValueError("a positive standard deviation is needed")
        ends = self._ends
        if ends and not ends[0] < ends[1]:
            raise ValueError("the first number must be below the second")
        return self

    @property
    def _ends(self) -> Sequence[float]:
        return self.uniform or self.log_uniform or self.integers or []

    def quantile(self, shares: ArrayLike) -> NDArray[np.float64]:
        """Return quantiles for `shares`, which are at least 0 and below 1."""
        shares = np.asarray(shares, dtype=float)
        ((kind, numbers),) = self.model_dump(exclude_none=True).items()
        if kind == "values":
            return np.array(numbers, dtype=float)[np.floor(shares * len(numbers)).astype(int)]
        first, second = map(float, numbers)
        if kind == "uniform":
            return first + shares * (second - first)
        if kind == "log_uniform":
            return first * (second / first) ** shares
        if kind == "normal":
            from scipy.special import ndtri  # late: only campaigns need it

            return first + second * ndtri(shares)
        return np.floor(first + shares * (second - first + 1.0))

    @property
    def tried(self) -> tuple[float, ...]:
        """Values to check: all of a list, else both ends, if any, and one inside."""
        return tuple(map(float, self.values or (*self._ends, float(self.quantile(_INSIDE)))))


class Variation(Table):
    """Table ``[campaign]`` of an experiment file."""

    kind: Literal["grid", "latin-hypercube", "sobol"]  # all combinations, or draws
    runs: Annotated[int, Field(ge=1, le=MOST_RUNS)] = 0  # of a grid: product of the list lengths
    seed: Annotated[int, Field(ge=0, le=2**63)] = 0  # of the draws
    # runs per file of the result; None: chosen by the campaign
    runs_per_part: Annotated[int, Field(ge=1, le=100_000)] | None = None
    vary: Annotated[dict[str, Any], Field(min_length=1)]  # a `Distribution` by path after reading


_INSIDE = 0.501  # quantile of the inner value to check


def read_variation(campaign: Any, experiment: "Experiment") -> Variation:
    """Read the table of a campaign and check it with the experiment that it varies."""

    def refuse(key: str, reason: str) -> ExperimentError:
        return ExperimentError(experiment.path, f"campaign.{key}" if key else "campaign", reason)

    content = validated(campaign, Variation, refuse)
    inputs: dict[str, Distribution] = {}
    for path, text in _flattened(content.vary, experiment):
        if path in inputs:
            raise refuse(f"vary.{path}", "is there twice: leave one of them out")
        inputs[path] = _distribution(experiment, path, text)
    runs = content.runs
    if content.kind == "grid":
        for path, choice in inputs.items():
            if choice.values is None:
                raise refuse(f"vary.{path}", "is a distribution: a grid takes a list of values")
        if runs:
            raise refuse("runs", "is for draws: remove it, a grid has one run per combination")
        runs = prod(len(choice.values or ()) for choice in inputs.values())
        if runs > MOST_RUNS:
            raise refuse("vary", f"makes {runs} combinations: give at most {MOST_RUNS}")
    elif not runs:
        raise refuse("runs", "is missing: add it")
    return content.model_copy(update={"runs": runs, "vary": inputs})


def _flattened(vary: Mapping[str, Any], experiment: "Experiment", path: str = "") -> Iterator[Any]:
    """Yield dotted paths and values; TOML reads unquoted dotted keys as nested tables."""
    for key, value in vary.items():
        here = f"{path}.{key}" if path else key
        if isinstance(value, dict) and here not in experiment.values:
            yield from _flattened(value, experiment, here)
        else:
            yield here, value


def _distribution(experiment: "Experiment", path: str, value: Any) -> Distribution:
    """Return an entry's distribution after checking some of its values."""

    def refuse(key: str, reason: str) -> ExperimentError:
        place = f"campaign.vary.{path}" + (f".{key}" if key else "")
        return ExperimentError(experiment.path, place, reason)

    if path not in experiment.values:
        raise refuse("", f"is not in the experiment{did_you_mean(path, experiment.values)}")
    if not isinstance(value, dict | list):
        raise refuse("", "must be a list of values or a distribution, e.g. { uniform = [1, 2] }")
    content = {"values": value} if isinstance(value, list) else value
    chosen = validated(content, Distribution, refuse)
    for number in chosen.tried:
        try:
            experiment.with_values({path: number})
        except ExperimentError as error:
            raise refuse(
                "", f"reaches {number:g}, but the key {error.key!r} {error.reason}"
            ) from None
    return chosen


SEED = "sampling.seed"
"""Path of the noise seed, which is drawn for every run unless it is varied explicitly."""

_SMALLEST_SHARE = 2.0**-53


@dataclass(frozen=True)
class Plan:
    """Values of the varied numbers in each run."""

    inputs: tuple[str, ...]  # dotted paths of the varied numbers
    values: NDArray[np.float64]  # (n_runs, n_inputs), in SI units
    # of the seeds of all runs' noise; None for a continuous loop or if the inputs contain the seed
    seed: int | None

    def table(self, runs: range) -> "pl.DataFrame":
        """Return numbers and values of consecutive runs, one row each."""
        import polars as pl

        values = self.values[runs.start : runs.stop]
        columns = {"run": np.arange(runs.start, runs.stop, dtype=np.int64)}
        columns |= dict(zip(self.inputs, values.T, strict=True))
        if self.seed is not None:
            columns[SEED] = np.array([_run_seed(self.seed, run) for run in runs], dtype=np.int64)
        return pl.DataFrame(columns)

    @property
    def digest(self) -> str:
        """Hash of all values; equal plans have equal digests."""
        content = hashlib.sha256("\n".join((*self.inputs, str(self.seed))).encode())
        content.update(np.ascontiguousarray(self.values).tobytes())
        return content.hexdigest()[:16]


def make_plan(variation: Variation, sampled: bool) -> Plan:
    """Plan the runs of a campaign; equal variations give equal plans."""
    inputs = tuple(variation.vary)
    if variation.kind == "grid":  # all combinations; the last input changes fastest
        axes = [np.array(choice.values, dtype=float) for choice in variation.vary.values()]
        values = np.stack([one.ravel() for one in np.meshgrid(*axes, indexing="ij")], axis=1)
    else:
        values = _draws(variation)
    return Plan(inputs, values, variation.seed if sampled and SEED not in inputs else None)


def _draws(variation: Variation) -> NDArray[np.float64]:
    from scipy.stats import qmc  # late: its import takes a second, and workers do not need it

    runs, count = variation.runs, len(variation.vary)
    if variation.kind == "latin-hypercube":
        shares = qmc.LatinHypercube(count, rng=variation.seed).random(runs)
    else:  # the first points of the scrambled sequence
        points = qmc.Sobol(count, rng=variation.seed).random_base2(int(np.ceil(np.log2(runs))))
        shares = points[:runs]
    # 0 is a possible draw, and the normal distribution's lowest value is minus infinity
    shares = np.maximum(shares, _SMALLEST_SHARE)
    columns = [
        what.quantile(part) for what, part in zip(variation.vary.values(), shares.T, strict=True)
    ]
    return np.stack(columns, axis=1)


def _run_seed(seed: int, run: int) -> int:
    """Return a run's noise seed, from the campaign's seed and the run's number."""
    child = np.random.SeedSequence(seed, spawn_key=(run,))
    return int(child.generate_state(1, np.uint64)[0] >> 1)
