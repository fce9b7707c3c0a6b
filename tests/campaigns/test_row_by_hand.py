"""A row of a campaign against the same run by hand."""

import json
from collections.abc import Callable
from pathlib import Path

import polars as pl
import pytest

from flexid.campaigns import run_campaign
from flexid.experiments import read_experiment

FOLDER = Path(__file__).parents[2] / "experiments"
CAMPAIGN = """
[campaign]
kind = "latin-hypercube"
runs = 3
[campaign.vary]
observer.link = { log_uniform = [5.0, 500.0] }
sampling.velocity_noise = { log_uniform = [1e-4, 1.0] }
"""


def test_row_is_repeated_by_hand(flexid: Callable, tmp_path: Path):
    """Assert that ``flexid simulate`` with a row's values, its seed too, has the row's results."""
    path = tmp_path / "experiment.toml"
    text = (FOLDER / "sampled_joint.toml").read_text(encoding="utf-8")
    path.write_text(text.replace("= 30.0 # s", "= 2.0 # s") + CAMPAIGN, encoding="utf-8")
    run_campaign(read_experiment(path), tmp_path / "rows", workers=1)
    row = pl.read_parquet(tmp_path / "rows" / "runs" / "*.parquet").row(1, named=True)
    paths = ("observer.link", "sampling.velocity_noise", "sampling.seed")
    settings = [word for name in paths for word in ("--set", f"{name}={row[name]!r}")]
    outcome = flexid("simulate", path, *settings, "--json")
    assert outcome.status == 0, outcome.stderr
    by_hand = json.loads(outcome.stdout)
    assert by_hand["provenance"]["tables"]["sampling"]["seed"] == row["sampling.seed"]
    for name, coefficient in by_hand["coefficients"].items():
        assert coefficient["final_error"] == row[f"final_error.{name}"]
    assert by_hand["tracking_peak"] == row["tracking_peak"]
    assert by_hand["peak_inputs"]["u"] == row["peak_input.u"]
    # These are sums, added up in another order
    assert by_hand["tracking_rms"] == pytest.approx(row["tracking_rms"], rel=1e-12)
    for name, excitation in by_hand["excitation"].items():
        condition = excitation["condition_number"]
        assert condition == pytest.approx(row[f"excitation.{name}"], rel=1e-9)
