"""Stored estimates of arms in other commands: free runs, differences, a scene for MuJoCo."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benchmarks.arms.arm import random_arm
from benchmarks.arms.log import Log, Motion, save, simulate
from test_identify_arm import MADE
from test_torque_balance import functions_of, rates
from two_links import ARM, TRUTH, TwoLinks, accelerations

from flexid.arms.result import ArmIdentification
from flexid.arrays import FloatArray, to_json
from flexid.errors import SettingError
from flexid.exports.mjcf_arm import arm_scene
from flexid.identification.vocabulary.evidence import Estimate, ValueEstimate
from flexid.models.motion import unit_of
from flexid.models.planar_arm import PlanarArm, planar_arm
from flexid.report.arm import parts
from flexid.stored_estimates.estimate_file import estimate_document, read_estimate
from flexid.stored_estimates.validate_estimate import validate_arm
from made_estimates import with_parameter

Run = Callable[..., Any]


def estimate(values: Mapping[str, float], arm: PlanarArm = ARM) -> ArmIdentification:
    """Return the estimate of an arm with these values, each with a standard error of 0.1 %."""
    fixed = {f"torque_constant_{joint}": 1.0 for joint in range(1, arm.joints + 1)}
    sought = tuple(name for name in planar_arm(arm).coefficients if name not in fixed)
    found = np.array([values.get(name, 0.0) for name in sought])
    stds = 1e-3 * np.abs(found) + 1e-6
    parameters = {
        name: ValueEstimate(
            name, "", value, std, (value - 2 * std, value + 2 * std), "determined",
            degrees_of_freedom=1e3, slopes={name: 1.0},
        )
        for name, value, std in zip(sought, found.tolist(), stds.tolist(), strict=True)
    }  # fmt: skip
    return ArmIdentification(
        "arm",
        arm,
        parameters,
        Estimate(sought, found, np.diag(stds**2), (1e3,) * len(sought)),
        fixed,
        tuple(unit_of("N m", way) for way in arm.types),
        None,
        "",
        {},
        "zero",
        0.0,
        10.0,
        10.0,
        (),
        {"inputs": []},
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the true estimate of an arm, a wrong one, and a log from MuJoCo."""
    pytest.importorskip("mujoco", reason="mujoco is not installed")
    found = tmp_path_factory.mktemp("arm")
    motion = Motion(duration=4.0, sample_time=2e-3, bits=17)
    log = simulate(MADE, motion, np.random.default_rng(7))
    save(log, found / "run.csv")
    late = [log.link[2:, 0], log.link[:-2, 1]]  # the second link's encoder is two samples late
    without_link_delays = {name: getattr(log, name)[2:] for name in ("time", "motor", "torque")}
    save(
        Log(link=np.column_stack(late), types=log.types, **without_link_delays), found / "late.csv"
    )
    truth = MADE.truth()
    softer = truth | {"joint_stiffness_2": 0.8 * truth["joint_stiffness_2"]}
    for name, values in (("true", truth), ("softer", softer)):
        made = estimate_document(estimate(values))
        (found / f"{name}.json").write_text(to_json(made))
    return found


def test_a_stored_estimate_is_read_as_it_was(folder: Path):
    """Assert that names, values and covariance are read unchanged, and that edits are detected."""
    read = read_estimate(folder / "true.json").result
    made = estimate(MADE.truth())
    assert isinstance(read, ArmIdentification)
    assert read.fit.names == made.fit.names
    assert read.parameters == made.parameters
    np.testing.assert_array_equal(read.fit.covariance, made.fit.covariance)
    content = json.loads((folder / "true.json").read_text()) | {"hold": "linear"}
    with pytest.raises(SettingError, match="was changed since"):
        read_estimate(content)


def test_a_late_encoder_is_predicted_late(folder: Path):
    """Assert that an estimate with the encoder's delay predicts a delayed log better."""
    made = estimate(MADE.truth())
    fits = []
    for delays in ({}, {"link_2": 4e-3}):
        own = read_estimate(estimate_document(replace(made, encoder_delays=delays)))
        fits.append(validate_arm(own, [folder / "late.csv"], None).fit_percent)
    assert fits[1]["deflection_2"] > fits[0]["deflection_2"] + 1.0


def test_the_true_arm_predicts_a_log_and_a_softer_one_does_not(
    folder: Path, flexid: Run, tmp_path: Path
):
    """Assert that `validate` scores each joint, and that its exit status follows --min-fit."""
    log, out = str(folder / "run.csv"), tmp_path / "out"
    options = ("--min-fit", "95", "--out", str(out))
    done = flexid("validate", str(folder / "true.json"), log, *options)
    assert done.status == 0
    assert (out / "report.html").exists()
    fits = json.loads((out / "validation.json").read_text())["fit_percent"]
    assert set(fits) == {
        f"{kind}_{joint}"
        for kind in ("link_position", "motor_position", "deflection")
        for joint in (1, 2)
    }
    wrong = flexid("validate", str(folder / "softer.json"), log, "--min-fit", "95", "--json")
    assert wrong.status == 1
    softer = json.loads(wrong.stdout)["fit_percent"]
    assert softer["deflection_2"] < 80.0 < fits["deflection_2"]


def test_two_arms_are_compared(folder: Path, flexid: Run):
    """Assert that the softer spring counts as changed, and nothing else."""
    done = flexid("compare", str(folder / "true.json"), str(folder / "softer.json"), "--json")
    assert done.status == 1
    found = json.loads(done.stdout)
    changed = {name for name, d in found["parameters"].items() if d["outcome"] == "changed"}
    assert changed == {"joint_stiffness_2"}
    assert found["parameters"]["joint_stiffness_2"]["percent"] == pytest.approx(-20.0)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ("export true.json --to c99 --sample-time 0.001 --out out", "export it to mjcf"),
        ("export true.json --to mjcf --sample-time 0.001 --out out", "leave it out with mjcf"),
        ("watch run.csv --estimate true.json", "the estimate of an arm"),
        ("validate true.json current.csv", "is in A, A"),  # not compatible with newton metres
        *(
            (f"identify run.csv --model arm.toml {option}", f"{option[2:].split()[0]}: .*arm")
            for option in ("--terms gravity", "--stream", "--known motor_inertia=1")
        ),
        ("excitation run.csv --model arm.toml", "only flexid identify"),
        ("watch run.csv --model arm.toml", "only flexid identify"),
    ],
)
def test_what_takes_no_arm_says_so(
    folder: Path, flexid: Run, monkeypatch: pytest.MonkeyPatch, arguments: str, said: str
):
    """Assert that commands refuse an arm, its log or options of a single joint in one sentence."""
    monkeypatch.chdir(folder)
    text = Path("run.csv").read_text().replace("torque", "current").replace("[N m]", "[A]")
    Path("current.csv").write_text(text)
    Path("arm.toml").write_text("[arm]\nlengths = [0.4, 0.3]\ngravity = 9.81\n")
    done = flexid(*arguments.split())
    assert done.status == 2
    assert re.search(said, done.stderr)


def accelerations_of_scene(
    model: Any, joints: Sequence[Any], x: FloatArray, inputs: FloatArray
) -> list[float]:
    """Return MuJoCo's forward dynamics at positions and velocities of the joints in order."""
    mujoco = pytest.importorskip("mujoco", reason="mujoco is not installed")
    data = mujoco.MjData(model)
    for place, joint in enumerate(joints):
        data.qpos[joint.qposadr[0]] = x[2 * place]
        data.qvel[joint.dofadr[0]] = x[2 * place + 1]
    data.ctrl[:] = inputs
    mujoco.mj_forward(model, data)
    return [data.qacc[joint.dofadr[0]] for joint in joints]


def test_a_scene_accelerates_as_the_textbook_says():
    """Assert that MuJoCo's forward dynamics equal the textbook's, with friction and coupling."""
    mujoco = pytest.importorskip("mujoco", reason="mujoco is not installed")
    scene = arm_scene(estimate(TRUTH))
    assert scene.notes == ()
    model = mujoco.MjModel.from_xml_string(scene.xml)
    joints = [model.joint(name) for name in ("link_1", "motor_1", "link_2", "motor_2")]
    rng = np.random.default_rng(4)
    for _ in range(20):
        x, torque = rng.standard_normal(8), rng.standard_normal(2)
        x[::2] *= 0.2
        x[1::2] += np.sign(x[1::2])  # fast, as MuJoCo's friction is smooth near rest
        found = accelerations_of_scene(model, joints, x, torque)
        wanted = accelerations(TwoLinks(torque), 0.0, x, np.sign(x[1::2]))
        assert found == pytest.approx(wanted, rel=1e-6, abs=1e-6)


# Seeds of joints that turn, slide and turn; slide, turn and slide; turn, turn and slide. Rotors of
# turning joints move with the links.
@pytest.mark.parametrize("seed", [34, 53, 3])
def test_a_scene_with_slides_accelerates_as_its_balance_says(seed: int):
    """Assert that MuJoCo's forward dynamics equal the balance's, with the same parameters."""
    mujoco = pytest.importorskip("mujoco", reason="mujoco is not installed")
    made = random_arm(np.random.default_rng(seed), 3, slides=True)
    truth = {name: 0.0 if "coulomb" in name else x for name, x in made.truth().items()}
    model = mujoco.MjModel.from_xml_string(arm_scene(estimate(truth, made.known)).xml)
    joints = [model.joint(f"{side}_{i}") for i in (1, 2, 3) for side in ("link", "motor")]
    balance = planar_arm(made.known)
    functions = functions_of(balance.types)
    values = {**truth, **{f"torque_constant_{i}": 1.0 for i in (1, 2, 3)}}
    p = np.array([values[name] for name in balance.coefficients])
    rng = np.random.default_rng(4)
    for _ in range(5):
        x, force = rng.standard_normal(12), rng.standard_normal(3)
        found = accelerations_of_scene(model, joints, x, force)
        wanted = rates(functions, x, force, p, made.known)[1::2]
        assert found == pytest.approx(wanted, rel=1e-6, abs=1e-6)


def test_offsets_and_gains_of_a_scene():
    """Assert that springs and motors are in equilibrium as in the balance."""
    mujoco = pytest.importorskip("mujoco", reason="mujoco is not installed")
    offsets = {"joint_offset_1": 3.0, "motor_offset_2": 0.4}
    scene = arm_scene(replace(estimate(TRUTH | offsets), input_delay=0.0))
    model = mujoco.MjModel.from_xml_string(scene.xml)
    data = mujoco.MjData(model)
    data.ctrl[:] = 3.0, 0.4
    mujoco.mj_forward(model, data)
    # At rest the torque of motor 1 balances its spring, and the torque of motor 2 its offset.
    for name in ("motor_1", "motor_2"):
        assert data.qfrc_smooth[model.joint(name).dofadr[0]] == pytest.approx(0.0, abs=1e-9)
    link = data.qfrc_smooth[model.joint("link_1").dofadr[0]]
    weight = 9.81 * (TRUTH["link_moment_across_1"] + TRUTH["link_moment_across_2"])
    assert link == pytest.approx(3.0 - weight)


BODIES = {"joint_stiffness_1": -1.0, "motor_inertia_2": 0.0, "link_inertia_1": 0.01}


def test_friction_that_falls_is_reported_with_its_velocity_and_in_no_scene():
    """Assert the velocity of Stribeck friction in the report, and a note of the scene."""
    found = estimate(TRUTH | {"motor_stribeck_friction_1": 0.3})
    assert "Stribeck friction of motor 1: over 0.3 rad/s, exponent 2." in [*parts(found)]
    left_out = [note for note in arm_scene(found).notes if "left out" in note]
    assert left_out == ["motor_stribeck_friction_1 = 0.3 is left out: MuJoCo does not model it"]


def test_what_is_no_scene_of_an_arm(refusals: Run):
    """Assert that unphysical parameters are refused, and parameters hidden by a resting joint."""
    calls = {f"{n} = {v}": partial(arm_scene, estimate(TRUTH | {n: v})) for n, v in BODIES.items()}
    found, unknown = estimate(TRUTH), {"value": np.nan, "verdict": "undetermined"}
    held = {"motor_inertia_2": 1e3, "motor_coulomb_friction_2": 1e9}
    rested = replace(found, fixed={**found.fixed, **held})
    for name in held:
        rested = with_parameter(rested, name, **unknown)
    slides = PlanarArm((0.0, 0.3), slides=(0.0, None))  # at least 1 kg turns on the first joint
    light = dict.fromkeys(planar_arm(slides).coefficients, 1.0) | {"link_mass_1": 0.1}
    calls["a carriage that is too light"] = partial(arm_scene, estimate(light, slides))
    refusals(calls | {"a joint that rested": partial(arm_scene, rested)})
