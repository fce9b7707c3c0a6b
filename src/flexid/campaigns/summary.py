"""What a campaign shows: statuses, distributions, and which input matters."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl

from flexid.arrays import FloatArray
from flexid.campaigns.importance import (
    Correlation,
    SobolIndex,
    rank_correlations,
    sobol_indices,
)
from flexid.campaigns.rows import ERROR, FINISHED, REACHED, STATUS
from flexid.campaigns.store import Manifest, Store, find_store
from flexid.errors import CampaignError

QUANTILES = (0.05, 0.5, 0.95)

_APART = (STATUS, ERROR, REACHED)
_SIGNED = ("final_error.", "final_state.")


@dataclass(frozen=True)
class Result:
    """One result over all finished runs."""

    name: str  # column of the rows
    # (n_finished,), in SI units, in the order of the runs; NaN where a run has none
    values: FloatArray
    missing: int  # finished runs without a finite value, for example those that never settle
    quantiles: tuple[float, ...]  # of the finite values, at QUANTILES; NaN if there are none
    # with the inputs, the strongest first; of signed results, that of the magnitude
    correlations: tuple[Correlation, ...]
    # the largest first; empty unless the plan is one for Sobol indices
    indices: tuple[SobolIndex, ...]


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
    inputs: Mapping[str, FloatArray]  # values of the inputs in the finished runs
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
    return Summary(
        store.directory,
        store.manifest,
        len(rows),
        damaged,
        dict(counts.iter_rows()),
        errors[0] if len(errors) else "",
        {name: rows.filter(_finished())[name].to_numpy() for name in store.manifest.inputs},
        tuple(_result(name, rows, store.manifest) for name in _results(rows, store.manifest)),
    )


def campaign_rows(out: str | Path) -> pl.DataFrame:
    """The rows of a campaign that are there, in the order of the runs."""
    return _all_rows(find_store(Path(out)))[0]


def _finished() -> pl.Expr:
    return pl.col(STATUS) == FINISHED


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


def _results(rows: pl.DataFrame, manifest: Manifest) -> list[str]:
    apart = {"run", *manifest.inputs, "sampling.seed", *_APART}
    return [name for name in rows.columns if name not in apart]


def _result(name: str, rows: pl.DataFrame, manifest: Manifest) -> Result:
    finished = rows.filter(_finished())
    values = finished[name].cast(pl.Float64).to_numpy()
    finite = values[np.isfinite(values)]
    quantiles = np.quantile(finite, QUANTILES) if len(finite) else np.full(len(QUANTILES), np.nan)
    inputs = manifest.inputs
    judged = np.abs(values) if name.startswith(_SIGNED) else values
    return Result(
        name,
        values,
        len(values) - len(finite),
        tuple(map(float, quantiles)),
        rank_correlations(inputs, finished.select(inputs).to_numpy(), judged),
        _indices(name, rows, manifest) if manifest.kind == "sobol-indices" else (),
    )


def _indices(name: str, rows: pl.DataFrame, manifest: Manifest) -> tuple[SobolIndex, ...]:
    """Indices from the points of the plan whose runs are all there and finished."""
    size = len(manifest.inputs) + 2
    table = np.full(manifest.runs, np.nan)
    finished = rows.filter(_finished())
    table[finished["run"].to_numpy()] = finished[name].cast(pl.Float64).to_numpy()
    judged = np.abs(table) if name.startswith(_SIGNED) else table
    return sobol_indices(manifest.inputs, judged.reshape(-1, size))
