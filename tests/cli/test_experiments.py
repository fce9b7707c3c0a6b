"""Experiments on the command line: simulate, campaign and reproduce."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from tests.campaigns.tiny import EXPERIMENT, write_experiment

import flexid as package
from flexid.experiments.experiment import read_experiment

FOLDER = Path(__file__).parents[2] / "experiments"
TABLE1 = FOLDER / "huang2003.toml"
SHORT = ("--set", "run.duration=1")


def test_run_is_written_whole(flexid: Callable, tmp_path: Path):
    """Assert that series, summary and figures are written, and that --json prints a summary."""
    out = tmp_path / "run"
    asked = ("--csv", "--json", "--set", "controller.k=40")
    outcome = flexid("simulate", TABLE1, "--out", out, *SHORT, *asked)
    assert outcome.status == 0, outcome.stderr
    assert outcome.stdout == (out / "run.json").read_text(encoding="utf-8")
    assert {file.name for file in out.iterdir()} == {
        "run.parquet", "run.csv", "log.parquet", "log.csv", "run.json", "motion.png",
        "estimates.png", "report.html",
    }  # fmt: skip
    series = pl.read_parquet(out / "run.parquet")
    assert series.equals(pl.read_csv(out / "run.csv"))
    summary = json.loads(outcome.stdout)
    experiment = read_experiment(TABLE1).with_values({"run.duration": 1.0, "controller.k": 40.0})
    run = experiment.run()
    assert np.array_equal(series["theta2_error [1/s^2]"], run.parameter_errors[:, 1])
    assert np.array_equal(series["link_position [rad]"], run.states[:, 0])
    assert summary["coefficients"]["theta2"]["final"] == series["theta2_estimate [1/s^2]"][-1]
    assert summary["statistics"] == run.statistics
    assert summary["provenance"]["experiment_digest"] == experiment.digest
    assert summary["provenance"]["flexid_version"] == package.__version__
    assert summary["provenance"]["tables"]["controller"]["k"] == 40.0


def test_divergence_says_what_and_when(flexid: Callable, tmp_path: Path):
    """Assert that a diverging loop exits with 1 and a time, and leaves no files."""
    out = tmp_path / "run"
    steps = ("--set", "run.maximum_steps=100")
    outcome = flexid("simulate", TABLE1, "--out", out, *steps)
    assert outcome.status == 1
    assert outcome.stdout == ""
    assert "simulation stopped at t = " in outcome.stderr
    assert "100 steps did not suffice" in outcome.stderr
    assert not out.exists()


@pytest.fixture
def tiny(tmp_path):
    """Return the tiny campaign."""
    return write_experiment(tmp_path / "tiny.toml")


def test_a_campaign_is_run_and_summarised(flexid, tiny, tmp_path):
    """Assert that the command prints the counts of runs, and the summary their results."""
    out = tmp_path / "out"
    run = flexid("campaign", tiny, "--out", out)
    assert (run.status, run.stderr) == (0, "")
    assert run.stdout.splitlines()[0] == f"12 runs in {out}: finished 12"
    summary = flexid("campaign", "--summary", out)
    assert summary.status == 0
    assert "finished 12 (100 %)" in summary.stdout
    assert "tracking_rms" in summary.stdout
    assert max(map(len, summary.stdout.splitlines())) <= 80
    document = json.loads((out / "summary.json").read_text())
    assert document["results"]["tracking_rms"]["finite"] == 12
    assert json.loads(flexid("campaign", "--summary", out, "--json").stdout) == document


def test_a_campaign_in_which_nothing_finishes(flexid, tmp_path):
    """Assert that a campaign without a finished run is done, and that its summary exits with 1."""
    campaign = '[campaign]\nkind = "grid"\nvary.controller.derivative = [1e9, 2e9]\n'
    text = EXPERIMENT.replace("duration = 0.1", "duration = 1.0")
    path = write_experiment(tmp_path / "tiny.toml", campaign, text)
    run = flexid("campaign", path, "--out", tmp_path / "out")
    assert run.status == 0
    assert run.stdout.splitlines()[0].endswith("diverged 2")
    summary = flexid("campaign", "--summary", tmp_path / "out")
    assert summary.status == 1
    assert "diverged 2 (100 %)" in summary.stdout


def test_the_paper_is_reproduced(flexid, reproduction, tmp_path, monkeypatch):
    """Assert that figures, page and result are written, and that --json prints the result alone."""
    monkeypatch.setattr("flexid.studies.reproduction.reproduce", lambda _: reproduction)
    out = tmp_path / "new" / "directory"
    run = flexid("reproduce", "--json", "--out", out)
    assert run.status == 0, run.stderr
    names = [*(f"figure{number}" for number in range(1, 6)), "theorem1"]
    expected = {f"{name}.{extension}" for name in names for extension in ("png", "pdf")}
    assert {file.name for file in out.iterdir()} == expected | {"result.json", "report.html"}
    assert all(file.stat().st_size > 5000 for file in out.iterdir())
    result = json.loads((out / "result.json").read_text(encoding="utf-8"))
    assert json.loads(run.stdout) == result
    assert set(result["readings"]) == {"1,2,3", "1,1,3"}
    for reading in result["readings"].values():
        assert set(reading["parameter_errors_at_30s"]) == {"theta1", "theta2", "alpha1", "alpha2"}
        assert reading["max_tracking_error_20_30"] > 0
        assert len(reading["poles"]) == 4
    assert {"key", "source", "statement", "verdict", "findings"} == set(result["claims"][0])
