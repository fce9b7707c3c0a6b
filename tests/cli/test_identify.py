"""``flexid identify`` from a file on disk to the printed table."""

import json
import tomllib

import polars as pl

from flexid import load
from joint_logs import FINE, steady_sine, write_log
from made_estimates import TRUE

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


def test_small_single_sine_is_undetermined(flexid, tmp_path):
    """Assert that a log that confounds gravity and stiffness exits with 1, without wrong values."""
    log = write_log(tmp_path / "small.csv", *steady_sine(0.1, 5.0, sample_time=FINE))
    outcome = flexid("identify", log, "--json", "--out", tmp_path / "out")
    assert outcome.status == 1
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "Record another motion" in page
    document = json.loads(outcome.stdout)
    for name, estimate in document["coefficients"].items():
        lower, upper = estimate["interval"]
        assert estimate["verdict"] == "undetermined" or lower <= TRUE.get(name, 0.0) <= upper
    parameters = document["parameters"] | document["removed"]
    assert parameters["gravity_torque"]["verdict"] == "undetermined"


def test_motion_alone_gives_the_link(flexid, examples, tmp_path):
    """Assert that a log without a torque gives table, document and figures of the link."""
    log, path = examples / "flexible_joint.csv", tmp_path / "motion.csv"
    pl.read_csv(log).drop("motor_torque [N m]").write_csv(path)
    outcome = flexid("identify", path, "--out", tmp_path / "out", "--explain")
    assert outcome.status == 0, outcome.stderr
    assert "the link alone, since the log has no input" in " ".join(outcome.stdout.split())
    document = json.loads((tmp_path / "out" / "estimate.json").read_text())
    assert document["model"] == "link"
    assert set(document["coefficients"]) == {"theta1", "theta2"}
    for name in ("theta1", "theta2"):
        lower, upper = document["coefficients"][name]["interval"]
        assert lower <= TRUE[name] <= upper
    assert {"fit.png", "bode.png"} <= {file.name for file in (tmp_path / "out").iterdir()}
    assert load(tmp_path / "out" / "estimate.json").model == "link"
    assert flexid("validate", tmp_path / "out" / "estimate.json", log).status == 0
    assert flexid("excitation", path).status == 0
