"""Commands from files on disk to printed tables, JSON, files and exit status."""

import json
import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from tests.campaigns.tiny import EXPERIMENT, write_experiment

import flexid as library
from flexid.arrays import to_json
from flexid.stored_estimates.estimate_file import estimate_document
from made_estimates import STIFFER, TRUE, exact, with_parameter

PAPER = ("gravity_torque", "link_inertia", "joint_stiffness", "motor_inertia")
PAPER += ("motor_viscous_friction",)


def test_example_recovers_the_truth(flexid, examples, tmp_path):
    """Assert right and determined values (one of ten intervals may miss), and the files."""
    outcome = flexid("identify", examples / "flexible_joint.csv", "--out", tmp_path / "out")
    assert outcome.status == 0, outcome.stderr
    assert all(name in outcome.stdout for name in (*PAPER, *TRUE))
    assert max(map(len, outcome.stdout.splitlines())) <= 80
    assert "…" not in outcome.stdout
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {"report.html", "estimate.json", "fit.png", "residuals.png", "bode.png"}
    document = json.loads((tmp_path / "out" / "estimate.json").read_text())
    assert not set(document["parameters"]) & set(document["removed"])
    assert document["parameters"]["joint_stiffness"]["unit"] == "N m/rad"
    assert len(document["provenance"]["inputs"][0]["sha256"]) == 64
    truth = tomllib.loads((examples / "flexible_joint_truth.toml").read_text())
    missed = 0
    for kind in ("coefficients", "parameters"):
        assert set(document[kind]) == set(truth[kind])
        for name, true in truth[kind].items():
            lower, upper = document[kind][name]["interval"]
            missed += not lower <= true["value"] <= upper
            off = abs(document[kind][name]["value"] - true["value"])
            assert off <= 3 * document[kind][name]["std"], name
            assert document[kind][name]["verdict"] == "determined"
    assert missed <= 1
    assert all(fit > 99 for fit in document["validation"]["fit_percent"].values())
    assert list(document["validation"]["horizons"]) == ["0.05", "0.2", "1", "5"]
    assert document["choices"]["hold"] == "zero"
    friction = document["removed"]["motor_coulomb_friction"]["interval"]
    assert max(map(abs, friction)) < 1e-3
    assert document["warnings"] == []


def stored(folder: Path, estimate) -> Path:
    """Return a folder as written by `flexid identify --out`."""
    folder.mkdir()
    (folder / "estimate.json").write_text(to_json(estimate_document(estimate)))
    return folder


@pytest.fixture
def folders(tmp_path):
    """Return folders of one drive twice, and of a stiffer one."""
    trues = {"before": TRUE, "again": TRUE, "after": STIFFER}
    return {name: stored(tmp_path / name, exact(true, name)) for name, true in trues.items()}


def test_documents_agree(flexid, folders, tmp_path):
    """Assert equal documents printed, written, and returned for any form of an estimate."""
    pair = folders["before"], folders["after"]
    printed = json.loads(flexid("compare", *pair, "--json").stdout)
    flexid("compare", *pair, "--out", tmp_path / "out")
    assert json.loads((tmp_path / "out" / "comparison.json").read_text()) == printed
    assert "flexid compare" in (tmp_path / "out" / "report.html").read_text()
    found, file = library.compare(*pair), pair[0] / "estimate.json"
    assert found.document == printed
    assert printed["a"] == str(file)
    for form in (library.load(file), str(file), json.loads(file.read_text())):
        other = library.compare(form, library.load(pair[1]))
        assert other.document["parameters"] == printed["parameters"]
    assert (found.changed, found.agree) == (("joint_stiffness",), False)
    assert repr(found) == "<EstimateComparison: 5 compared, changed: joint_stiffness>"
    assert "Changed: joint_stiffness" in found.summary()
    assert "&lt;" not in found._repr_html_()


def test_what_does_not_agree_is_status_1(flexid, folders, tmp_path):
    """Assert 0 for one drive twice, and 1 for a change or an undetermined value."""
    outcome = flexid("compare", folders["before"], folders["again"])
    assert (outcome.status, outcome.stderr) == (0, "")
    assert "No change was found in 5 numbers" in outcome.stdout
    files = [folders[name] / "estimate.json" for name in ("before", "after")]
    outcome = flexid("compare", *files)
    assert outcome.status == 1
    assert "Changed: joint_stiffness by 1" in outcome.stdout
    infinite = {"std": np.inf, "interval": (-np.inf, np.inf), "verdict": "undetermined"}
    vague = with_parameter(exact(TRUE, "vague"), "joint_stiffness", **infinite)
    assert flexid("compare", folders["before"], stored(tmp_path / "vague", vague)).status == 1


def test_notes_are_on_stderr(flexid, examples: Path):
    """Assert that a required u' and numerical integrals are noted on stderr, with JSON too."""
    done = flexid("derive", "flexible-joint", "--unknown-input-gain", "--to", "c")
    assert done.status == 0
    assert "u_rate" in done.stderr
    assert "note" not in done.stdout
    model = examples / "models" / "stribeck.toml"
    done = flexid("derive", model)
    assert done.status == 0
    assert "stribeck; integrated numerically" in done.stderr
    done = flexid("derive", model, "--to", "c", "--json")
    document = json.loads(done.stdout)
    assert document["to"] == "c"
    assert "rate[" in document["text"]
    assert "integrated numerically" in document["notes"][0]


def test_exported_files_are_listed(flexid, tmp_path: Path):
    """Assert that --json lists the written files."""
    options = ("--to", "c99", "--sample-time", "0.001", "--out", str(tmp_path), "--json")
    done = flexid("export", "flexible-joint", *options)
    assert done.status == 0, done.stderr
    document = json.loads(done.stdout)
    assert {Path(path).name for path in document["files"]} == {p.name for p in tmp_path.iterdir()}
    assert document["files"]


FOLDER = Path(__file__).parents[2] / "experiments"
TABLE1 = FOLDER / "huang2003.toml"
SHORT = ("--set", "run.duration=1")


def test_a_run_is_written_whole_or_not_at_all(flexid: Callable, tmp_path: Path):
    """Assert no files and a time if a loop diverges, and else those of the library's run."""
    out = tmp_path / "run"
    steps = ("--set", "run.maximum_steps=100")
    outcome = flexid("simulate", TABLE1, "--out", out, *steps)
    assert outcome.status == 1
    assert outcome.stdout == ""
    assert "simulation stopped at t = " in outcome.stderr
    assert "100 steps did not suffice" in outcome.stderr
    assert not out.exists()
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
    found = library.simulate(TABLE1, set={"run.duration": 1, "controller.k": 40})
    experiment, run = found.experiment, found.result
    assert found.document == summary
    assert len(found.to_dataframe()) == len(run.time)
    drive = library.simulate(FOLDER / "sampled_joint.toml", set={"run.duration": 0.1})
    assert drive.log().recordings[0].input_unit == "N m"
    titles = [found.plot(name).get_suptitle() for name in ("motion", "estimates")]
    assert titles == [f"{experiment.name}: motion", f"{experiment.name}: estimates"]
    assert "<img" in found._repr_html_()
    assert "1 s" in repr(found)
    assert np.array_equal(series["theta2_error [1/s^2]"], run.parameter_errors[:, 1])
    assert np.array_equal(series["link_position [rad]"], run.states[:, 0])
    assert summary["coefficients"]["theta2"]["final"] == series["theta2_estimate [1/s^2]"][-1]
    assert summary["statistics"] == run.statistics
    assert summary["provenance"]["experiment_digest"] == experiment.digest
    assert summary["provenance"]["flexid_version"] == library.__version__
    assert summary["provenance"]["tables"]["controller"]["k"] == 40.0


def test_a_campaign_is_run_and_summarised(flexid, tmp_path):
    """Assert that every run is counted and reported, and that summaries of any caller agree."""
    tiny, out, reached = write_experiment(tmp_path / "tiny.toml"), tmp_path / "out", []
    found = library.campaign(tiny, out=out, workers=1, progress=lambda *n: reached.append(n))
    assert reached[-1] == (12, 12)
    assert found.complete
    assert found.statuses == {"finished": 12}
    assert "12 of 12 runs" in repr(found)
    found.save_figures(tmp_path / "figures")
    summary = flexid("campaign", "--summary", out)
    assert summary.status == 0
    assert "finished 12 (100 %)" in summary.stdout
    assert summary.stdout.split() == found.summary().split()
    document = json.loads((out / "summary.json").read_text())
    assert document["results"]["tracking_rms"]["finite"] == 12
    assert json.loads(flexid("campaign", "--summary", out, "--json").stdout) == document
    assert library.campaign(summary=out).document == found.document == document


def test_a_campaign_in_which_nothing_finishes(flexid, tmp_path):
    """Assert that a campaign without a finished run is done, and that its summary exits with 1."""
    campaign = '[campaign]\nkind = "grid"\nvary.controller.derivative = [1e9, 2e9]\n'
    text = EXPERIMENT.replace("duration = 0.1", "duration = 1.0")
    path = write_experiment(tmp_path / "tiny.toml", campaign, text)
    run = flexid("campaign", path, "--out", tmp_path / "out")
    assert run.status == 0
    assert run.stdout.splitlines()[0] == f"2 runs in {tmp_path / 'out'}: diverged 2"
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
