"""``flexid campaign`` from a file to the printed summary."""

import json

import pytest
from tests.campaigns.tiny import EXPERIMENT, write_experiment


@pytest.fixture
def tiny(tmp_path):
    """The tiny campaign."""
    return write_experiment(tmp_path / "tiny.toml")


def test_a_campaign_is_run_and_summarised(flexid, tiny, tmp_path):
    """Assert that the command says what became of the runs, and the summary what they tell."""
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
    assert (out / "distributions.png").stat().st_size > 10_000
    assert json.loads(flexid("campaign", "--summary", out, "--json").stdout) == document


def test_a_campaign_in_which_nothing_finishes(flexid, tmp_path):
    """Assert that the campaign is done, and that its summary exits 1 and says why."""
    campaign = '[campaign]\nkind = "grid"\nvary.controller.derivative = [1e9, 2e9]\n'
    text = EXPERIMENT.replace("duration = 0.1", "duration = 1.0")
    path = write_experiment(tmp_path / "tiny.toml", campaign, text)
    run = flexid("campaign", path, "--out", tmp_path / "out")
    assert run.status == 0
    assert run.stdout.splitlines()[0].endswith("diverged 2")
    summary = flexid("campaign", "--summary", tmp_path / "out")
    assert summary.status == 1
    assert "diverged 2 (100 %)" in summary.stdout
