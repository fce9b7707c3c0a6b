"""``flexid identify`` from a file on disk to the printed table."""

import json
import tomllib

import numpy as np
import pytest

from flexid import load
from joint_logs import FINE, steady_sine, write_held_log, write_log
from made_estimates import TRUE

PAPER = ("gravity_torque", "link_inertia", "joint_stiffness", "motor_inertia")
PAPER += ("motor_viscous_friction",)


def write_multisine(path, amplitudes, frequencies, duration=20.0):
    """Write a log of Table I's joint under a held multisine torque, with position noise, 500 Hz."""
    u = np.sin(np.outer(np.arange(0, duration, 0.002), frequencies)) @ np.asarray(amplitudes)
    return write_held_log(path, u, seed=7)


@pytest.fixture(scope="module")
def good_log(tmp_path_factory):
    """A log that excites everything."""
    path = tmp_path_factory.mktemp("log") / "good.csv"
    return write_multisine(path, [4, 6, 5, 6], [0.7, 5.3, 17, 25])


def test_example_recovers_the_truth(flexid, examples, tmp_path):
    """Assert that every true value lies within three standard deviations, and nothing is doubted.

    Of ten intervals of 95 %, one may miss.
    """
    outcome = flexid("identify", examples / "flexible_joint.csv", "--out", tmp_path / "out")
    assert outcome.status == 0, outcome.stderr
    document = json.loads((tmp_path / "out" / "estimate.json").read_text())
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


def test_output_holds_all_it_promises(flexid, good_log, tmp_path):
    """Assert that table and document have the promised shape, and the figures are there."""
    outcome = flexid("identify", good_log, "--out", tmp_path)
    assert outcome.status == 0, outcome.stderr
    table = outcome.stdout.replace(str(tmp_path), "")
    assert all(name in table for name in (*PAPER, *TRUE))
    assert max(map(len, table.splitlines())) <= 80
    assert "…" not in table
    names = {path.name for path in tmp_path.iterdir()}
    figures = {"fit", "residuals", "bode"}
    assert names == {"report.html", "estimate.json"} | {f"{name}.png" for name in figures}
    document = json.loads((tmp_path / "estimate.json").read_text())
    assert not set(document["parameters"]) & set(document["removed"])
    assert document["parameters"]["joint_stiffness"]["unit"] == "N m/rad"
    assert len(document["provenance"]["inputs"][0]["sha256"]) == 64


def test_small_single_sine_is_undetermined(flexid, tmp_path):
    """Assert that a log with gravity and stiffness confused exits 1 and calls no value known.

    None is wrong, and gravity may be any. The page says what to do.
    """
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


def test_motion_alone_gives_the_link(flexid, good_log, tmp_path):
    """Assert that a log without a torque leaves a table, a document and figures of the link."""
    table = np.loadtxt(good_log, delimiter=",", skiprows=1)
    path = tmp_path / "motion.csv"
    header = "time [s],link_position [rad],motor_position [rad]"
    np.savetxt(path, table[:, :3], delimiter=",", header=header, comments="", fmt="%.9g")
    outcome = flexid("identify", path, "--out", tmp_path / "out", "--explain")
    assert outcome.status == 0, outcome.stderr
    assert "warning" not in outcome.stderr
    assert "the link alone, since the log has no input" in " ".join(outcome.stdout.split())
    document = json.loads((tmp_path / "out" / "estimate.json").read_text())
    assert document["model"] == "link"
    assert set(document["coefficients"]) == {"theta1", "theta2"}
    for name in ("theta1", "theta2"):
        lower, upper = document["coefficients"][name]["interval"]
        assert lower <= TRUE[name] <= upper
    assert {"fit.png", "bode.png"} <= {file.name for file in (tmp_path / "out").iterdir()}
    assert load(tmp_path / "out" / "estimate.json").model == "link"
    assert flexid("validate", tmp_path / "out" / "estimate.json", good_log).status == 0
    assert flexid("excitation", path).status == 0
