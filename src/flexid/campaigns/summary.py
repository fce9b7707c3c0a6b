"""What a campaign shows: statuses, distributions, and which input matters for which result."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from flexid.arrays import FloatArray
from flexid.campaigns.rows import ERROR, FINISHED, REACHED, STATUS
from flexid.campaigns.store import Manifest, Store, find_store
from flexid.errors import CampaignError
from flexid.experiments.variation import SEED as SAMPLING_SEED

_FEWEST_RUNS = 10  # fewest runs from which a correlation is computed

_LEVEL = 0.05


@dataclass(frozen=True)
class Correlation:
    """Spearman's rank correlation of a result with an input."""

    input: str  # dotted path
    value: float  # between -1 and 1
    # whether it differs from 0 at a level of 5 %, shared by all inputs of the result (Bonferroni)
    significant: bool


def rank_correlations(
    inputs: Sequence[str],
    values: FloatArray,  # (n_runs, n_inputs)
    result: FloatArray,  # (n_runs,); runs without a finite value are left out
) -> tuple[Correlation, ...]:
    """Rank correlations of one result with all inputs, the strongest first."""
    from scipy import stats  # late: it loads for a second, and only a summary needs it

    there = np.isfinite(result)
    values, result = values[there], result[there]
    if len(result) < _FEWEST_RUNS or np.ptp(result) == 0.0:
        return ()
    varying = [place for place in range(len(inputs)) if np.ptp(values[:, place]) > 0.0]
    found = []
    for place in varying:
        test: Any = stats.spearmanr(values[:, place], result)  # SciPy names no type
        significant = bool(test.pvalue < _LEVEL / len(varying))
        found.append(Correlation(inputs[place], float(test.statistic), significant))
    return tuple(sorted(found, key=lambda one: -abs(one.value)))


QUANTILES = (0.05, 0.5, 0.95)

_SIGNED = ("final_error.", "final_state.")


@dataclass(frozen=True)
class Result:
    """One result over all finished runs."""

    name: str  # column of the rows
    finite: int  # finished runs with a finite value
    missing: int  # and those without, for example runs that never settle
    # of the finite values in SI units, at QUANTILES; NaN if there are none
    quantiles: tuple[float, ...]
    # with the inputs, the strongest first; of signed results, that of the magnitude
    correlations: tuple[Correlation, ...]


@dataclass(frozen=True)
class Summary:
    """What a campaign shows, finished or not."""

    directory: Path
    manifest: Manifest
    done: int  # runs whose rows are there
    # files that cannot be read; running the campaign again replaces them
    damaged: tuple[str, ...]
    statuses: Mapping[str, int]  # how many runs ended how, the most frequent first
    first_error: str  # text of the first run with the status "error"; empty if there is none
    results: tuple[Result, ...]

    @property
    def finished(self) -> int:
        """Runs that reached their end."""
        return self.statuses.get(FINISHED, 0)

    @property
    def complete(self) -> bool:
        """Whether every run has its row."""
        return self.done == self.manifest.runs


def summarise(out: str | Path) -> Summary:
    """Summarise the campaign of a directory, while it runs or later."""
    store = find_store(Path(out))
    rows, damaged = _all_rows(store)
    counts = rows[STATUS].value_counts().sort(by=["count", STATUS], descending=[True, False])
    errors = rows[ERROR].drop_nulls()
    finished, inputs = rows.filter(pl.col(STATUS) == FINISHED), store.manifest.inputs
    apart = {"run", *inputs, SAMPLING_SEED, STATUS, ERROR, REACHED}
    return Summary(
        store.directory,
        store.manifest,
        len(rows),
        damaged,
        dict(counts.iter_rows()),
        errors[0] if len(errors) else "",
        tuple(_result(n, finished, inputs) for n in rows.columns if n not in apart),
    )


def _all_rows(store: Store) -> tuple[pl.DataFrame, tuple[str, ...]]:
    parts, damaged = [], []
    for part in store.manifest.parts:
        rows = store.read(part)
        if rows is not None:
            parts.append(rows)
        elif store.path(part).exists():
            damaged.append(store.path(part).name)
    if not parts:
        raise CampaignError(
            str(store.directory), "has no rows yet: run the campaign, or wait for its first part"
        )
    try:
        return pl.concat(parts), tuple(damaged)
    except pl.exceptions.PolarsError:
        raise CampaignError(
            str(store.directory),
            "holds parts that do not belong together: run the campaign in another directory",
        ) from None


def _result(name: str, finished: pl.DataFrame, inputs: Sequence[str]) -> Result:
    values = finished[name].cast(pl.Float64).to_numpy()
    finite = values[np.isfinite(values)]
    quantiles = np.quantile(finite, QUANTILES) if len(finite) else np.full(len(QUANTILES), np.nan)
    judged = np.abs(values) if name.startswith(_SIGNED) else values
    return Result(
        name,
        len(finite),
        len(values) - len(finite),
        tuple(map(float, quantiles)),
        rank_correlations(inputs, finished.select(inputs).to_numpy(), judged),
    )
