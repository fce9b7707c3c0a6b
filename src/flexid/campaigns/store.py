"""The rows of a campaign on disk: a directory of Parquet files that are complete or not there."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import polars as pl
from filelock import FileLock, Timeout

from flexid.atomic import write_atomically
from flexid.campaigns.manifest import (
    FILE,
    Manifest,
    read_manifest,
    refuse_another,
    write_manifest,
)
from flexid.campaigns.plan import Plan
from flexid.errors import CampaignError
from flexid.recording.write import write_parquet

_LOCK = ".campaign.lock"


@dataclass(frozen=True)
class Store:
    """The parts of one campaign."""

    directory: Path
    manifest: Manifest

    def path(self, part: int) -> Path:
        """File of a part's rows."""
        return self.directory / "runs" / f"part-{part:06d}.parquet"

    def series_path(self, part: int) -> Path:
        """File of a part's time series, where these are kept."""
        return self.directory / "series" / f"part-{part:06d}.parquet"

    def write(self, part: int, rows: pl.DataFrame, series: pl.DataFrame | None) -> None:
        """Keep a part: first its time series, so that rows never wait for theirs."""
        try:
            if series is not None:
                _write_table(series, self.series_path(part))
            _write_table(rows, self.path(part))
        except OSError as error:
            raise CampaignError(
                str(self.directory),
                f"cannot be written ({(error.strerror or 'no space').lower()}): make room; the "
                f"same command goes on",
            ) from None

    def read(self, part: int) -> pl.DataFrame | None:
        """Rows of a part; None if it is missing or damaged."""
        try:
            rows = pl.read_parquet(self.path(part), memory_map=False)
            complete = rows["run"].to_list() == list(self.manifest.runs_of(part))
        except (OSError, pl.exceptions.PolarsError):
            return None
        return rows if complete else None

    @property
    def kept(self) -> int:
        """Number of runs whose files are there, read or not."""
        there = (part for part in self.manifest.parts if self.path(part).exists())
        return sum(len(self.manifest.runs_of(part)) for part in there)

    def missing(self, plan: Plan, results: Mapping[str, pl.DataType]) -> list[int]:
        """Numbers of the parts that have to be run, damaged ones among them."""
        return [part for part in self.manifest.parts if not self._holds(part, plan, results)]

    def _holds(self, part: int, plan: Plan, results: Mapping[str, pl.DataType]) -> bool:
        rows = self.read(part)
        if rows is None:
            return False
        planned = plan.table(self.manifest.runs_of(part))
        if list(rows.schema.items()) != [*planned.schema.items(), *results.items()]:
            return False
        if not rows.select(planned.columns).equals(planned):
            return False
        return "time_series" not in self.manifest.keep or _readable(self.series_path(part))


@contextmanager
def open_store(directory: Path, wanted: Manifest) -> Iterator[Store]:
    """Open the directory of a campaign for writing, alone; make it if it is missing."""
    _check_name(directory)
    try:
        directory.mkdir(parents=True, exist_ok=True)
        lock = FileLock(directory / _LOCK)
        lock.acquire(timeout=0)
    except Timeout:
        raise CampaignError(
            str(directory),
            "is being written by another flexid campaign: wait for it, or give another directory",
        ) from None
    except OSError as error:
        reason = (error.strerror or "no space").lower()
        raise CampaignError(
            str(directory), f"cannot be written ({reason}): give another directory"
        ) from None
    try:
        yield Store(directory, _settled(directory, wanted))
    finally:
        lock.release()


def _settled(directory: Path, wanted: Manifest) -> Manifest:
    found = read_manifest(directory)
    folders = ("runs", "series") if "time_series" in wanted.keep else ("runs",)
    if found is None:
        if any(directory.glob("runs/*")):
            raise CampaignError(
                str(directory), f"holds runs but no {FILE}: give another directory, or empty it"
            )
        found = wanted
        write_manifest(wanted, directory)
    else:
        refuse_another(found, wanted, directory)
    for folder in folders:
        (directory / folder).mkdir(exist_ok=True)
    return found


def find_store(directory: Path) -> Store:
    """Open the directory of a campaign for reading, while it runs or later."""
    _check_name(directory)
    manifest = read_manifest(directory)
    if manifest is None:
        raise CampaignError(
            str(directory), f"holds no campaign (no {FILE}): give the directory of --out"
        )
    return Store(directory, manifest)


def _check_name(directory: Path) -> None:
    try:
        str(directory).encode()
    except UnicodeEncodeError:  # Polars can neither read nor write there
        raise CampaignError(
            repr(str(directory)), "has a name that is not UTF-8: give another directory"
        ) from None


def _write_table(table: pl.DataFrame, path: Path) -> None:
    write_atomically(path, lambda temporary: write_parquet(table, temporary))


def _readable(path: Path) -> bool:
    try:
        pl.read_parquet(path, memory_map=False)
    except (OSError, pl.exceptions.PolarsError):
        return False
    return True
