"""``flexid campaign`` from a file to the printed summary."""

import json

import pytest
from tests.campaigns.tiny import CAMPAIGN, EXPERIMENT, write_experiment


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


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ([], "EXPERIMENT: is missing"),
        (["tiny.toml"], "--out: is missing"),
        (["tiny.toml", "--summary", "out"], "--summary: stands alone"),
        (["--summary", "out", "--workers", "2"], "--summary: stands alone"),
        (["tiny.toml", "--out", "out", "--json"], "--json: belongs to --summary"),
        (["tiny.toml", "--out", "out", "--scheduler", "x", "--workers", "2"], "--workers: is for"),
        (["--summary", "nothing"], "nothing holds no campaign"),
        (["nothing.toml", "--out", "out"], "nothing.toml: there is no such file"),
    ],
)
def test_what_does_not_fit_together_is_refused(
    flexid, tiny, tmp_path, monkeypatch, arguments, sentence
):
    """Assert that each contradiction exits 2 with one sentence and writes nothing."""
    assert tiny.parent == tmp_path
    monkeypatch.chdir(tmp_path)
    outcome = flexid("campaign", *arguments)
    assert outcome.status == 2
    assert outcome.stdout == ""
    assert outcome.stderr.startswith(f"flexid: {sentence}")
    assert len(outcome.stderr.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_a_file_without_a_campaign_is_refused(flexid, tmp_path):
    """Assert that the sentence points to flexid simulate."""
    path = write_experiment(tmp_path / "single.toml", campaign="")
    outcome = flexid("campaign", path, "--out", tmp_path / "out")
    assert outcome.status == 2
    assert "the key 'campaign' is missing" in outcome.stderr


def test_runs_that_make_no_sobol_indices_are_refused(flexid, tmp_path):
    """Assert that file and key are named before anything is written."""
    campaign = CAMPAIGN.replace('"sobol"', '"sobol-indices"')
    path = write_experiment(tmp_path / "tiny.toml", campaign, EXPERIMENT)
    outcome = flexid("campaign", path, "--out", tmp_path / "out")
    assert outcome.status == 2
    assert f"{path}: the key 'campaign.runs' 12 is not 4" in outcome.stderr
    assert not (tmp_path / "out").exists()


def test_a_loop_that_no_run_can_have_is_refused(flexid, tmp_path):
    """Assert that a model whose observer needs an acceleration ends the command, not every row."""
    text = EXPERIMENT.partition("[sampling]")[0].replace("[plant]", "[plant]\njoint_damping = 0.1")
    text = '[model]\nterms = ["gravity", "motor_viscous", "joint_damping"]\n' + text
    campaign = '[campaign]\nkind = "grid"\nvary.observer.link = [1.0, 2.0]\n'
    path = write_experiment(tmp_path / "damped.toml", campaign, text)
    outcome = flexid("campaign", path, "--out", tmp_path / "out")
    assert outcome.status == 2
    assert "needs the acceleration" in outcome.stderr
    assert len(outcome.stderr.splitlines()) == 1
