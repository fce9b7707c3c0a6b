"""Storage of a campaign in Parquet files, which are written atomically, and its summary."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from math import nan
from pathlib import Path
from typing import Annotated

import numpy as np
import polars as pl
from filelock import FileLock, Timeout
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from flexid.errors import CampaignError
from flexid.experiments.campaign_rows import ERROR, FINISHED, REACHED, STATUS
from flexid.experiments.variation import MOST_RUNS
from flexid.experiments.variation import SEED as SAMPLING_SEED
from flexid.files import check_name, write_atomically
from flexid.recording.frame import write_parquet

FILE = "campaign.json"
_LOCK = ".campaign.lock"


class Manifest(BaseModel):
    """Plan of a campaign, which determines every row."""

    model_config = ConfigDict(strict=True, frozen=True)

    flexid: str  # version that runs it
    experiment: str  # digest of everything that affects a run
    plan: str  # digest of all values
    kind: str  # of the plan
    runs: Annotated[int, Field(ge=1, le=MOST_RUNS)]
    inputs: tuple[str, ...]  # dotted paths of the varied numbers
    runs_per_part: Annotated[int, Field(ge=1)]  # runs per file
    text: str  # copy of the experiment file

    @property
    def parts(self) -> range:
        """Numbers of all parts."""
        return range(-(-self.runs // self.runs_per_part))

    def runs_of(self, part: int) -> range:
        """Return the numbers of the runs in a part."""
        first = part * self.runs_per_part
        return range(first, min(first + self.runs_per_part, self.runs))


@dataclass(frozen=True)
class Store:
    """Directory with the parts of one campaign."""

    directory: Path
    manifest: Manifest

    def path(self, part: int) -> Path:
        """Return the path of a part's rows."""
        return self.directory / "runs" / f"part-{part:06d}.parquet"

    def write(self, part: int, rows: pl.DataFrame) -> None:
        """Write the rows of a part."""
        with _writing(self.directory):
            write_atomically(self.path(part), lambda temporary: write_parquet(rows, temporary))

    def read(self, part: int) -> pl.DataFrame | None:
        """Return the rows of a part, or None if it is missing or damaged."""
        try:
            rows = pl.read_parquet(self.path(part), memory_map=False)
            whole = rows["run"].to_list() == [*self.manifest.runs_of(part)]
        except (OSError, pl.exceptions.PolarsError):
            return None
        return rows if whole else None

    def missing(self) -> list[int]:
        """Return the numbers of missing or damaged parts."""
        return [part for part in self.manifest.parts if self.read(part) is None]


@contextmanager
def open_store(directory: Path, wanted: Manifest) -> Iterator[Store]:
    """Open or create the directory of a campaign, with a lock against other writers."""
    check_name(directory)
    lock = FileLock(directory / _LOCK)
    with _writing(directory):
        directory.mkdir(parents=True, exist_ok=True)
        lock.acquire(timeout=0)
    try:
        yield Store(directory, _manifest_of(directory, wanted))
    finally:
        lock.release()


@contextmanager
def _writing(directory: Path) -> Iterator[None]:
    """Turn errors of writing into a `CampaignError`."""
    try:
        yield
    except Timeout:
        raise CampaignError(
            str(directory),
            "is being written by another flexid campaign: wait for it, or give another directory",
        ) from None
    except OSError as error:
        reason = (error.strerror or "no space").lower()
        raise CampaignError(
            str(directory),
            f"cannot be written ({reason}): give another directory, or make room and give the same "
            f"command again",
        ) from None


_MUST_AGREE = {"flexid": "version of flexid", "experiment": "experiment", "plan": "plan of runs"}


def _manifest_of(directory: Path, wanted: Manifest) -> Manifest:
    """Return the stored manifest, or store `wanted`; raise if it is of another campaign."""
    # The number of runs per part may differ: it does not affect the rows.
    found = _read_manifest(directory)
    if found is None:
        if any(directory.glob("runs/*")):
            raise CampaignError(
                str(directory), f"contains runs but no {FILE}: give another directory, or empty it"
            )
        found = wanted
        text = wanted.model_dump_json(indent=2) + "\n"
        write_atomically(directory / FILE, lambda path: path.write_text(text, encoding="utf-8"))
        (directory / "runs").mkdir(exist_ok=True)
    for name, what in _MUST_AGREE.items():
        if getattr(found, name) != getattr(wanted, name):
            reason = f"contains a campaign of another {what}: give another directory"
            raise CampaignError(str(directory), reason)
    return found


def find_store(directory: Path) -> Store:
    """Open the directory of a campaign for reading, while it runs or later."""
    check_name(directory, "summary")
    manifest = _read_manifest(directory)
    if manifest is None:
        raise CampaignError(
            str(directory), f"contains no campaign (no {FILE}): give the directory of --out"
        )
    return Store(directory, manifest)


def _read_manifest(directory: Path) -> Manifest | None:
    """Read ``campaign.json``; None if it is missing."""
    try:
        return Manifest.model_validate_json((directory / FILE).read_bytes())
    except (FileNotFoundError, NotADirectoryError):
        return None
    except (OSError, ValidationError):
        raise CampaignError(
            str(directory / FILE),
            "is damaged or not a campaign: start again in another directory",
        ) from None


QUANTILES = (0.05, 0.5, 0.95)


@dataclass(frozen=True)
class Result:
    """Quantiles of one result over all finished runs."""

    finite: int  # finished runs with a finite value
    missing: int  # finished runs without one, for example if they never settle
    quantiles: Mapping[str, float]  # of the finite values in SI units, by share; NaN without any


@dataclass(frozen=True)
class Summary:
    """Summary of a campaign, complete or not."""

    directory: Path
    manifest: Manifest
    done: int  # runs with stored rows
    # files that cannot be read; running the campaign again replaces them
    damaged: tuple[str, ...]
    statuses: Mapping[str, int]  # number of runs by outcome, the most frequent first
    first_error: str  # reason of the first run with status "error", or empty
    results: Mapping[str, Result]  # by column of the rows

    @property
    def finished(self) -> int:
        """Runs that reached their end."""
        return self.statuses.get(FINISHED, 0)

    @property
    def complete(self) -> bool:
        """Whether every run has a row."""
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
        {name: _result(finished[name]) for name in rows.columns if name not in apart},
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
    return pl.concat(parts, how="diagonal_relaxed"), tuple(damaged)


def _result(column: pl.Series) -> Result:
    values = column.cast(pl.Float64).to_numpy()
    finite = values[np.isfinite(values)]
    found = {f"{q:g}": float(np.quantile(finite, q)) if len(finite) else nan for q in QUANTILES}
    return Result(len(finite), len(values) - len(finite), found)
