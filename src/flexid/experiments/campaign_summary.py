"""What a campaign shows: statuses and quantiles."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl

from flexid.errors import CampaignError
from flexid.experiments.campaign_rows import ERROR, FINISHED, REACHED, STATUS
from flexid.experiments.campaign_store import Manifest, Store, find_store
from flexid.experiments.variation import SEED as SAMPLING_SEED

QUANTILES = (0.05, 0.5, 0.95)


@dataclass(frozen=True)
class Result:
    """One result over all finished runs."""

    name: str  # column of the rows
    finite: int  # finished runs with a finite value
    missing: int  # and those without, for example runs that never settle
    # of the finite values in SI units, at QUANTILES; NaN if there are none
    quantiles: tuple[float, ...]


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
    finished = rows.filter(pl.col(STATUS) == FINISHED)
    apart = {"run", *store.manifest.inputs, SAMPLING_SEED, STATUS, ERROR, REACHED}
    return Summary(
        store.directory,
        store.manifest,
        len(rows),
        damaged,
        dict(counts.iter_rows()),
        errors[0] if len(errors) else "",
        tuple(_result(n, finished) for n in rows.columns if n not in apart),
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


def _result(name: str, finished: pl.DataFrame) -> Result:
    values = finished[name].cast(pl.Float64).to_numpy()
    finite = values[np.isfinite(values)]
    quantiles = np.quantile(finite, QUANTILES) if len(finite) else np.full(len(QUANTILES), np.nan)
    return Result(name, len(finite), len(values) - len(finite), tuple(map(float, quantiles)))
