"""Identification of arms from logs: the command, ratios, and joints at rest."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from benchmarks.arms.arm import Arm, Link, random_arm
from benchmarks.arms.log import Motion, random_motion, save, simulate
from numpy.typing import NDArray
from scipy.signal import lfilter

import flexid.arms.identify as identify_module
from flexid.arms.identify import (
    doubt_of_negative,
    identify_arm,
    negative_springs,
    weak_springs,
)
from flexid.arms.log import ArmLog, read_arm_log
from flexid.errors import FlexidError
from flexid.identification.vocabulary.evidence import ValueEstimate

MADE = Arm(
    (
        Link(0.4, 2.0, 0.2, 0.0, 0.03, 500.0, 0.3, 0.3, 0.5, 0.3, 0.1, 0.0),
        Link(0.3, 1.0, 0.15, 0.0, 0.01, 90.0, 0.05, 0.05, 0.1, 0.1, 0.02, 0.0),
    ),
    (9.81, 0.0),
)
Run = Callable[..., Any]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the log of an arm in MuJoCo, and the file of the arm."""
    pytest.importorskip("mujoco", reason="mujoco is not installed")
    found = tmp_path_factory.mktemp("arm")
    motion = Motion(duration=6.0, sample_time=2e-3, bits=17)
    save(simulate(MADE, motion, np.random.default_rng(7)), found / "run.csv")
    (found / "arm.toml").write_text("[arm]\nlengths = [0.4, 0.3]\ngravity = 9.81\n")
    amperes = (found / "run.csv").read_text().replace("torque", "current").replace("[N m]", "[A]")
    (found / "current.csv").write_text(amperes)
    return found


def test_the_command_finds_both_joints(folder: Path, flexid: Run, tmp_path: Path):
    """Assert stiffnesses within 0.5 %, output files, and a table for each joint."""
    out = tmp_path / "out"
    model = str(folder / "arm.toml")
    done = flexid("identify", str(folder / "run.csv"), "--model", model, "--out", str(out))
    assert "Joint 1" in done.stdout
    assert "Joint 2" in done.stdout
    assert (out / "report.html").exists()
    document = json.loads((out / "estimate.json").read_text())
    truth = MADE.truth()
    for joint in (1, 2):
        stiffness = document["parameters"][f"joint_stiffness_{joint}"]
        assert stiffness["verdict"] == "determined"
        assert abs(stiffness["value"] / truth[f"joint_stiffness_{joint}"] - 1.0) < 5e-3
        assert document["validation"]["fit_percent"][f"deflection_{joint}"] > 90.0
    assert document["hold"] == "zero"


@pytest.mark.thorough  # 8 s
def test_torques_behind_a_filter(folder: Path, flexid: Run, tmp_path: Path):
    """Assert that a low-pass filter of both torques is found, and inverted in another log too."""
    header, *rows = (folder / "run.csv").read_text().splitlines()
    table = np.loadtxt(rows, delimiter=",")
    filtered = [i for i, name in enumerate(header.split(",")) if "torque" in name]
    decay = np.exp(-2e-3 / 10e-3)
    first = table[0, filtered]
    table[:, filtered] = first + lfilter(
        [1.0 - decay], [1.0, -decay], table[:, filtered] - first, axis=0
    )
    log, model, out = tmp_path / "log.csv", str(folder / "arm.toml"), tmp_path / "out"
    np.savetxt(log, table, "%.12g", ",", header=header, comments="")
    done = flexid("identify", str(log), "--model", model, "--out", str(out))
    assert "low-passed into the log, by a filter of 9 ms" in done.stderr
    document = json.loads((out / "estimate.json").read_text())
    assert document["log_lag"] == pytest.approx(2e-3 * decay / (1.0 - decay), rel=1e-2)
    for name, value in MADE.truth().items():
        if name.startswith(("joint_stiffness", "motor_inertia")):
            assert document["parameters"][name]["value"] == pytest.approx(value, rel=5e-3)
    assert flexid("validate", str(out), str(log), "--min-fit", "90").status == 0


SLIDES = Arm(  # the second joint has units of N and m
    (MADE.links[0], Link(0.3, 1.0, 0.15, 0.02, 0.01, 9e3, 3.0, 3.0, 9.0, 4.0, 1.0, 0.0, slide=0.6)),
    (0.0, -9.81),
)


@pytest.mark.thorough  # 20 s, most of it compilation
def test_an_arm_with_a_slide(flexid: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Assert masses, moments and stiffnesses in m, N and kg, and the prediction of another log."""
    pytest.importorskip("mujoco", reason="mujoco is not installed")
    monkeypatch.chdir(tmp_path)
    for seed in (7, 8):
        motion = Motion(duration=6.0, sample_time=2e-3, bits=17)
        save(simulate(SLIDES, motion, np.random.default_rng(seed)), Path(f"{seed}.csv"))
    angle = np.degrees(0.6)
    text = f"[arm]\nlengths = [0.4, 0.3]\ngravity = [0.0, -9.81]\nslides = {{2 = {angle}}}\n"
    Path("arm.toml").write_text(text)
    flexid("identify", "7.csv", "--model", "arm.toml", "--out", "out")
    found = json.loads(Path("out/estimate.json").read_text())["parameters"]
    units = (
        ("stiffness_over_inertia_2", "1/s^2"),
        ("joint_stiffness_2", "N/m"),
        ("link_mass_2", "kg"),
    )
    for name, unit in (*units, ("link_moment_across_2", "kg m"), ("joint_stiffness_1", "N m/rad")):
        assert (found[name]["unit"], found[name]["verdict"]) == (unit, "determined")
    truth = SLIDES.truth() | {"stiffness_over_inertia_2": 9e3}
    own = [(found[name], value) for name, value in truth.items() if name in found]
    held = [f["interval"][0] <= value <= f["interval"][1] for f, value in own]
    assert np.mean(held) > 0.8
    for name in ("joint_stiffness_1", "joint_stiffness_2", "link_mass_2", "link_moment_along_2"):
        assert abs(found[name]["value"] / truth[name] - 1.0) < 5e-3
    assert "N s/m" in Path("out/report.html").read_text()
    done = flexid("validate", "out", "8.csv", "--min-fit", "90")
    assert done.status == 0
    assert "(rad or m, RMS)" in done.stdout


@pytest.mark.parametrize("noise", [True, False])
def test_a_joint_that_rests(tmp_path: Path, noise: bool):
    """Assert that the other joint is identified, and the resting joint's values are not."""
    pytest.importorskip("mujoco", reason="mujoco is not installed")
    first, second = MADE.links
    held = replace(MADE, links=(first, replace(second, motor_coulomb=1e4)))
    motion = Motion(duration=6.0, sample_time=2e-3, bits=17)
    log = simulate(held, motion, np.random.default_rng(7))
    if not noise:
        log.motor[:, 1], log.torque[:, 1] = log.motor[0, 1], 0.0
    save(log, tmp_path / "run.csv")
    result = identify_arm(tmp_path / "run.csv", MADE.known)
    found = result.parameters
    assert not any("repeats motor_position_2 not" in warning for warning in result.warnings)
    for name in ("joint_stiffness_1", "motor_inertia_1"):
        assert found[name].verdict == "determined"
        assert abs(found[name].value / MADE.truth()[name] - 1.0) < 0.01
    for name in ("joint_stiffness_2", "motor_inertia_2"):
        assert found[name].verdict == "undetermined"
        assert found[name].reason == "joint 2 rests: let it move"


@pytest.mark.thorough  # 12 s
def test_a_joint_that_hardly_creeps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Assert that a creeping motor is fitted, and that intervals of stiffness are right.

    With perturbed rounding, which once led to an error of 15 %.
    """
    pytest.importorskip("mujoco", reason="mujoco is not installed")
    rng = np.random.default_rng([3, 2, True])
    arm, motion = random_arm(rng, 2, True), replace(random_motion(rng, True), duration=10.0)
    save(simulate(arm, motion, rng), tmp_path / "run.csv")
    known = arm.known
    log = read_arm_log(tmp_path / "run.csv", known.types)
    assert log.resting == (1,)
    log = rounded_otherwise(log, 6)
    monkeypatch.setattr("flexid.arms.identify.read_arm_log", lambda *_: log)
    found = identify_arm(tmp_path / "run.csv", known).parameters
    for joint, link in enumerate(arm.links, 1):
        lower, upper = found[f"joint_stiffness_{joint}"].interval
        assert lower < link.stiffness < upper
    friction = found["motor_coulomb_friction_1"]
    assert abs(friction.value / arm.links[0].motor_coulomb - 1.0) < 0.2


def rounded_otherwise(log: ArmLog, seed: int) -> ArmLog:
    """Return a log with relative perturbations of 1e-12."""
    rng = np.random.default_rng(seed)

    def near(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return values * (1.0 + 1e-12 * rng.standard_normal(values.shape))

    near_recordings = (
        replace(r, positions=near(r.positions), inputs=near(r.inputs)) for r in log.recordings
    )
    return replace(log, recordings=tuple(near_recordings))


@pytest.mark.parametrize(
    ("ratio", "predicted", "warned"), [(0.1, 0.0, True), (0.1, 90.0, False), (0.9, 0.0, False)]
)
def test_a_held_motor_must_explain_its_link(ratio: float, predicted: float, warned: bool):
    """Assert a warning about the gear if the link moves far and the spring predicts nothing."""
    link = np.sin(np.arange(100.0))
    positions = np.column_stack((link, link, 0.2 * link, 0.2 * ratio * link))
    fitted: Any = SimpleNamespace(
        data=SimpleNamespace(samples=[SimpleNamespace(positions=positions)])
    )
    found = weak_springs(fitted, {2: predicted}, {"link_2": 0.9, "motor_2": 0.1})
    words = [str(doubt) for _, doubt in found]
    assert any("check the gear ratio and the motor's encoder" in each for each in words) == warned


def test_a_fit_that_does_not_converge_determines_nothing(
    folder: Path, monkeypatch: pytest.MonkeyPatch
):
    """Assert that an unconverged fit determines no parameter, with the reason."""
    monkeypatch.setattr("flexid.arms.identify._UNCONVERGED", 0.0)
    monkeypatch.setattr("flexid.arms.identify.explains", lambda _: False)
    found = identify_arm(folder / "run.csv", MADE.known).parameters
    assert {each.verdict for each in found.values()} == {"undetermined"}
    assert all(each.reason.startswith("the fit does not converge") for each in found.values())


def test_currents_give_ratios(folder: Path):
    """Assert that currents leave one scale undetermined, and that ratios are unchanged."""
    result = identify_arm(folder / "current.csv", MADE.known)
    found, truth = result.parameters, MADE.truth()
    assert result.fixed["torque_constant_1"] == 1.0
    assert found["joint_stiffness_1"].unit == "A/rad"
    assert abs(found["torque_constant_2"].value - 1.0) < 0.02
    wanted = truth["joint_stiffness_2"] / truth["link_inertia_2"]
    assert abs(found["stiffness_over_inertia_2"].value / wanted - 1.0) < 0.01


@pytest.mark.parametrize(
    ("kind", "unit", "joints"),
    [("torque", "N m", (1,)), ("torque", "N m", (2,)), ("current", "A", (1, 2))],
)
def test_an_input_that_turns_its_joint_backwards(
    folder: Path, tmp_path: Path, kind: str, unit: str, joints: tuple[int, ...]
):
    """Assert that inputs with a reversed sign are named with the remedy, torques or currents."""
    names = [f"motor_{kind}_{joint}" for joint in joints]
    columns = tmp_path / "columns.toml"
    column = '{name} = {{column = "{name}", scale = -1.0, unit = "{unit}"}}\n'
    columns.write_text("".join(column.format(name=name, unit=unit) for name in names))
    log = folder / {"torque": "run.csv", "current": "current.csv"}[kind]
    said = f"{' and '.join(names)}: a positive value turns its joint backwards: scale it by -1"
    with pytest.raises(FlexidError, match=said):
        identify_arm(log, MADE.known, columns)


def test_a_deflection_may_turn_the_spring_instead(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Assert that the deflection is named too where the input turns its joint backwards."""
    columns = tmp_path / "columns.toml"
    columns.write_text('deflection_2 = {column = "link_position_2", unit = "rad"}\n')
    monkeypatch.setattr("flexid.arms.identify.backward_inputs", lambda *_: [1])
    said = "motor_torque_2 and deflection_2: .* or the deflection, which is the link's angle minus"
    with pytest.raises(FlexidError, match=said):
        identify_arm(folder / "run.csv", MADE.known, columns)


def read_otherwise(log: ArmLog, kind: str) -> ArmLog:
    """Return a log with its angles counted otherwise."""
    (recording,) = log.recordings
    positions, inputs = recording.positions.copy(), recording.inputs.copy()
    if kind == "reversed":
        positions[:, 2:], inputs[:, 1] = -positions[:, 2:], -inputs[:, 1]
    elif kind == "from the base":
        positions[:, 2:] += positions[:, :1]
    return replace(log, recordings=(replace(recording, positions=positions, inputs=inputs),))


@pytest.mark.parametrize(
    ("kind", "gravity", "said"),
    [
        ("reversed", (9.81, 0.0), "if joint 2 counts the other way"),
        ("from the base", (9.81, 0.0), "if angles are measured from one direction"),
        ("", (0.0, 9.81), r"if gravity is \[9.81, 0\]"),
        ("", (0.0, 0.0), r"if gravity is \[9.81, 0\]"),
        ("", (9.81, 0.0), ""),
    ],
)
def test_angles_that_are_counted_otherwise(
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    kind: str,
    gravity: tuple[float, float],
    said: str,
):
    """Assert that another sense, reference or gravity is named, and none of a right log."""
    arm = replace(MADE.known, gravity=gravity)
    log = read_otherwise(read_arm_log(folder / "run.csv", arm.types), kind)
    monkeypatch.setattr(identify_module, "read_arm_log", lambda *_: log)
    monkeypatch.setattr(identify_module, "_chosen_fit", Mock(side_effect=StopIteration))
    with pytest.raises(FlexidError if said else StopIteration, match=said or None):
        identify_arm(folder / "run.csv", arm)


@pytest.mark.parametrize(
    ("interval", "words"),
    [((-2.0, -0.5), "check the signs"), ((-2.0, 0.5), "interval includes positive values")],
)
def test_only_what_is_surely_negative_speaks_of_signs(interval: tuple[float, float], words: str):
    """Assert that signs are questioned only if the whole interval is negative."""
    found = ValueEstimate("joint_stiffness_1", "N m/rad", -1.0, 1.0, interval, "weak")
    assert words in doubt_of_negative([found])


@pytest.mark.parametrize("std", [1.0, np.inf])
def test_an_unknown_inertia_leaves_the_other_joints_alone(std: float):
    """Assert that a negative inertia doubts other joints only if its value is known."""
    found = {
        name: ValueEstimate(name, "", value, std, (value - 2.0 * std, 2.0 * std), "undetermined")
        for name, value in (("motor_inertia_1", -3e13), ("motor_inertia_2", 0.1))
    }
    ((doubted, _),) = negative_springs(found, ended=False)
    assert doubted == ({"motor_inertia_1"} if std == np.inf else {*found})
