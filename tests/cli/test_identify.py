"""``flexid identify`` from a file on disk to the printed table."""

import json
import re
import tomllib

import numpy as np
import polars as pl
import pytest

from flexid import load
from joint_logs import save, write_held_log
from made_estimates import TRUE

PAPER = ("gravity_torque", "link_inertia", "joint_stiffness", "motor_inertia")
PAPER += ("motor_viscous_friction",)


def write_log(path, amplitudes, frequencies, duration=20.0, gap=None):
    """Write a log of Table I's joint under a held multisine torque, with position noise, 500 Hz."""
    u = np.sin(np.outer(np.arange(0, duration, 0.002), frequencies)) @ np.asarray(amplitudes)
    return write_held_log(path, u, seed=7, gap=gap)


def steady_sine(path, amplitude, frequency, noise=1e-4):
    """Write a log of the same joint in steady motion, its link on one sine: no transient at all."""
    t = np.arange(0, 20, 0.002)
    q, s = amplitude * np.sin(frequency * t), frequency**2
    v = amplitude * frequency * np.cos(frequency * t)
    g, k = TRUE["theta1"] / TRUE["theta2"], 1 / TRUE["theta2"]
    deflection = k * s * q - g * np.sin(q)  # from the link's equation with q'' = -s q
    motor = q - deflection
    velocity = v - (k * s * v - g * np.cos(q) * v)
    acceleration = -s * q + k * s * s * q + g * (-s * q * np.cos(q) - v**2 * np.sin(q))
    u = acceleration - TRUE["alpha1"] * deflection + TRUE["alpha2"] * velocity
    states = np.column_stack([q, v, motor, velocity])
    return save(path, states, u / TRUE["beta1"], noise, seed=11)


@pytest.fixture(scope="module")
def good_log(tmp_path_factory):
    """A log that excites everything."""
    path = tmp_path_factory.mktemp("log") / "good.csv"
    return write_log(path, [4, 6, 5, 6], [0.7, 5.3, 17, 25])


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
    figures = {"fit", "residuals", "estimates", "excitation", "bode", "regions"}
    assert names == {"report.html", "estimate.json"} | {f"{name}.png" for name in figures}
    document = json.loads((tmp_path / "estimate.json").read_text())
    assert not set(document["parameters"]) & set(document["removed"])
    assert document["parameters"]["joint_stiffness"]["unit"] == "N m/rad"
    assert len(document["provenance"]["inputs"][0]["sha256"]) == 64


def test_known_stiffness(flexid, examples):
    """Assert that a stiffness can be known exactly, and narrows what rests on it."""
    log = examples / "flexible_joint.csv"
    free = json.loads(flexid("identify", log, "--json").stdout)["parameters"]
    outcome = flexid("identify", log, "--known", "joint_stiffness=100", "--json")
    found = json.loads(outcome.stdout)["parameters"]
    assert found["joint_stiffness"]["interval"] == [100.0, 100.0]
    assert found["joint_stiffness"]["reason"] == "given"
    assert found["link_inertia"]["std"] < 0.95 * free["link_inertia"]["std"]
    assert outcome.status == 0


@pytest.mark.parametrize(
    ("bounds", "value", "verdict", "reason"),
    [
        ("joint_stiffness=50:200", 100.0, "determined", ""),
        ("joint_stiffness=100.0003:200", 100.0003, "determined", "at its bound"),
        ("joint_stiffness=150:200", 150.0, "undetermined", "bounded by 500, which contradicts"),
    ],
)
def test_bounded_stiffness(flexid, examples, bounds, value, verdict, reason):
    """Assert that a bound of a parameter holds, says that it does, and may contradict the log.

    The inertia is known, so that the bound is one of alpha1 in the fit itself.
    """
    log = examples / "flexible_joint.csv"
    options = ("--known", "motor_inertia=0.3", "--terms", "gravity,motor_viscous", "--hold", "zero")
    outcome = flexid("identify", log, *options, "--bounds", bounds, "--json")
    parameters = json.loads(outcome.stdout)["parameters"]
    found = parameters["joint_stiffness"]
    assert found["value"] == pytest.approx(value, rel=1e-5)
    assert found["verdict"] == verdict
    assert reason in found["reason"]
    assert outcome.status == (1 if verdict == "undetermined" else 0)
    if verdict == "determined":  # the others are as sharp as without the bound
        assert parameters["link_inertia"]["std"] < 1e-5


def test_small_single_sine_is_undetermined(flexid, tmp_path):
    """Assert that a log with gravity and stiffness confused exits 1 and calls no value known.

    None is wrong, and gravity may be any. The page says what to record.
    """
    log = steady_sine(tmp_path / "small.csv", 0.1, 5.0)
    outcome = flexid("identify", log, "--json", "--out", tmp_path / "out")
    assert outcome.status == 1
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "Record another motion" in page
    assert re.search(r"<li>(Add a sine of|No single sine|By rule of thumb)", page)
    document = json.loads(outcome.stdout)
    for name, estimate in document["coefficients"].items():
        lower, upper = estimate["interval"]
        assert estimate["verdict"] == "undetermined" or lower <= TRUE.get(name, 0.0) <= upper
    parameters = document["parameters"] | document["removed"]
    assert parameters["gravity_torque"]["verdict"] == "undetermined"


def test_gap_is_bridged(flexid, tmp_path):
    """Assert that a log with a gap is fitted as two records, with a warning, and correctly."""
    log = write_log(tmp_path / "gap.csv", [4, 6, 5, 6], [0.7, 5.3, 17, 25], gap=(9.0, 9.7))
    outcome = flexid("identify", log, "--json")
    assert outcome.status == 0, outcome.stderr
    assert "gap" in outcome.stderr
    coefficients = json.loads(outcome.stdout)["coefficients"]
    for name, true in TRUE.items():
        assert coefficients[name]["value"] == pytest.approx(
            true, rel=0.02 if name == "alpha2" else 1e-3
        )


def test_wrong_sign_of_the_torque_is_unsupported(flexid, good_log, tmp_path):
    """Assert that a log whose torque has the wrong sign exits 1 and calls no inertia known."""
    header, *rows = good_log.read_text().splitlines()
    cells = [row.split(",") for row in rows]
    flipped = [",".join([*row[:3], str(-float(row[3]))]) for row in cells]
    log = tmp_path / "flipped.csv"
    log.write_text("\n".join([header, *flipped]))
    outcome = flexid("identify", log, "--json")
    assert outcome.status == 1
    assert "sign of the input" in outcome.stderr
    assert json.loads(outcome.stdout)["parameters"]["motor_inertia"]["verdict"] == "undetermined"


def test_a_stream_prints_the_table(flexid, tmp_path):
    """Assert that --stream gives parameters from a Parquet log."""
    text = write_log(tmp_path / "log.csv", [3.0, 4.0, 5.0], [2.3, 5.1, 9.7], duration=60.0)
    log = tmp_path / "log.parquet"
    pl.read_csv(text).write_parquet(log)
    done = flexid("identify", log, "--stream", "--terms", "gravity,motor_viscous")
    assert done.status == 0
    assert "joint_stiffness" in done.stdout
    assert "30000 samples (1 min) were fitted in one pass" in " ".join(done.stdout.split())


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
    assert {"fit.png", "estimates.png", "excitation.png", "bode.png"} <= {
        file.name for file in (tmp_path / "out").iterdir()
    }
    assert load(tmp_path / "out" / "estimate.json").model == "link"
    assert flexid("validate", tmp_path / "out" / "estimate.json", good_log).status == 0
    assert flexid("excitation", path).status == 0
