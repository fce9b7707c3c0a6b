"""Small campaigns: Table I's joint under PD control, sampled, for a tenth of a second."""

from pathlib import Path

import numpy as np
import polars as pl

from flexid.experiments.campaign_store import Manifest
from flexid.experiments.variation import Plan

HERE = Path(__file__).parent
EXPERIMENT = (HERE / "tiny.toml").read_text()
CAMPAIGN = (HERE / "tiny_campaign.toml").read_text()


def write_experiment(path: Path, campaign: str = CAMPAIGN, experiment: str = EXPERIMENT) -> Path:
    """Write an experiment file."""
    path.write_text(experiment + campaign)
    return path


def made_manifest(plan: Plan, kind: str, runs_per_part: int) -> Manifest:
    """Return the manifest of a plan, for an experiment that does not exist."""
    return Manifest(
        flexid="1.0",
        experiment="0123",
        plan=plan.digest,
        kind=kind,
        runs=len(plan.values),
        inputs=plan.inputs,
        runs_per_part=runs_per_part,
        text="the file",
    )


def rows_of(directory: Path) -> pl.DataFrame:
    """Return all rows of a finished campaign."""
    return pl.concat(pl.read_parquet(path) for path in sorted(directory.glob("runs/*.parquet")))


def same_bits(one: pl.DataFrame, other: pl.DataFrame) -> bool:
    """Return whether two tables agree to the last bit, NaN included."""
    return one.schema == other.schema and all(
        np.array_equal(_bits(one[name]), _bits(other[name])) for name in one.columns
    )


def _bits(column: pl.Series) -> np.ndarray:
    values = column.to_numpy()
    return values.view(np.int64) if values.dtype == np.float64 else values
