"""Joints as MuJoCo scenes: their content and their motion in MuJoCo."""

import json
from collections.abc import Mapping
from functools import partial
from typing import Any

import mujoco
import numpy as np
import pytest

from flexid.errors import SettingError
from flexid.exports.mjcf import Scene, mjcf_scene
from flexid.library.export import export
from flexid.library.identify import load
from flexid.library.logs import read_log
from flexid.stored_estimates.estimate_file import sealed
from made_estimates import TRUE

# MuJoCo's compiled half has no type stubs, so pyright cannot see what it exports.
# pyright: reportAttributeAccessIssue=false


_LINK_INERTIA, _MOTOR_INERTIA = 1.0, 0.3


def _both(**torques: float) -> dict[str, float]:
    """Return coefficients of torques that act between link and motor."""
    return {
        f"{row}_{name}": torque / inertia
        for name, torque in torques.items()
        for row, inertia in (("theta", _LINK_INERTIA), ("alpha", _MOTOR_INERTIA))
    }


def _scene(more: Mapping[str, float], unit: str = "N m", **keywords: object) -> Scene:
    return mjcf_scene("flexible", {**TRUE, **more}, unit, **keywords)  # pyright: ignore[reportArgumentType]


def _accelerations(scene: Scene, x: np.ndarray, u: float) -> np.ndarray:
    """Return accelerations of link and motor in MuJoCo, or of a rigid joint."""
    model = mujoco.MjModel.from_xml_string(scene.xml)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.ctrl[0] = x[::2], x[1::2], u
    mujoco.mj_forward(model, data)
    return data.qacc.copy()


def _by_hand(c: Mapping[str, float], x: np.ndarray, u: float) -> np.ndarray:
    """Return the accelerations by Huang (2003), eq. (4), with further smooth terms."""
    x1, x2, x3, x4 = x
    d, rate = x1 - x3, x2 - x4
    link = -c["theta1"] * np.sin(x1) - c["theta_cosine"] * np.cos(x1) - c["theta2"] * d
    link += -c["theta_viscous"] * x2 - c["theta_drag"] * x2 * abs(x2) + c["theta_offset"]
    link += -c["theta_damping"] * rate - c["theta_cubic"] * d**3 - c["theta_lopsided"] * d**2
    motor = c["alpha1"] * d - c["alpha2"] * x4 - c["alpha_drag"] * x4 * abs(x4)
    motor += c["alpha_offset"] + c["beta1"] * u
    motor += c["alpha_damping"] * rate + c["alpha_cubic"] * d**3 + c["alpha_lopsided"] * d**2
    return np.array([link, motor])


SMOOTH = {
    **_both(damping=0.4, cubic=700.0, lopsided=-30.0),
    "theta_cosine": -2.0,
    "theta_viscous": 0.25,
    "theta_drag": 0.06,
    "theta_offset": -0.3,
    "alpha_drag": 0.07,
    "alpha_offset": 0.8,
}


SLIDES = {"theta1": 0.0, "theta_cosine": 0.0}


@pytest.mark.parametrize(
    ("unit", "joint", "own"),
    [
        *(
            (unit, "revolute", {"theta1": theta1})
            for unit in ("N m", "V")
            for theta1 in (5.0, -3.0, 1e-4)
        ),
        *((unit, "prismatic", SLIDES) for unit in ("N", "A")),
    ],
)
def test_accelerations_are_those_of_the_model(unit, joint, own):
    """Assert that every smooth term acts according to its equation, for any input."""
    coefficients = {**TRUE, **SMOOTH, **own}
    scene = mjcf_scene("flexible", coefficients, unit, joint)
    for x in np.random.default_rng(1).normal(size=(8, 4)) * (1.0, 3.0, 1.0, 5.0):
        found = _accelerations(scene, x, 1.7)
        # Torques are written with ten digits and may nearly cancel.
        np.testing.assert_allclose(found, _by_hand(coefficients, x, 1.7), rtol=1e-6)
    assert len(scene.notes) == (unit in "VA")
    if joint == "prismatic":
        model = mujoco.MjModel.from_xml_string(scene.xml)
        assert (model.jnt_type == mujoco.mjtJoint.mjJNT_SLIDE).all()
        assert all(note.endswith("1 kg") for note in scene.notes)


def test_a_rigid_joint_is_one_hinge():
    """Assert that a rigid joint moves according to its equation."""
    values = {"gamma1": 4.0, "gamma_cosine": 1.0, "gamma_viscous": 0.5, "gamma_offset": 0.2}
    scene = mjcf_scene("rigid", {**values, "beta1": 2.0})
    expected = -4.0 * np.sin(0.7) - np.cos(0.7) + 0.5 * 2.0 + 0.2 + 2.0 * 3.0
    found = _accelerations(scene, np.array([0.7, -2.0]), 3.0)  # rigid joint
    np.testing.assert_allclose(found, [expected], rtol=1e-8)


FREE = {"theta1": 0.0, "alpha2": 0.0}
LINK_DRY, MOTOR_DRY = FREE | {"theta_coulomb": 2.0}, FREE | {"alpha_coulomb": 2.0}
PLAY = {"theta1": 0.0, **_both(backlash=0.2)}  # 2 mrad to either side
HYSTERESIS = {**FREE, **_both(hysteresis=0.3), "hysteresis_grip": 20.0}
EXACT, HELD = 2e-6, 1e-3
CORNERS = {  # values, state, accelerations of link and motor, and tolerance
    "a link slides": (LINK_DRY, (0, 1, 0, 0), (-2.0, 0.0), EXACT),
    "nine tenths of its friction pull": (LINK_DRY, (-0.018, 0, 0, 0), (0.0, -6.0), HELD),
    "eleven": (LINK_DRY, (-0.022, 0, 0, 0), (0.2, -22 / 3), HELD),
    "a motor slides": (MOTOR_DRY, (0, 0, 0, 1), (0.0, -2.0), EXACT),
    "nine tenths of its friction": (MOTOR_DRY, (0, 0, -0.0054, 0), (-0.54, 0.0), HELD),
    "eleven of its": (MOTOR_DRY, (0, 0, -0.0066, 0), (-0.66, 0.2), HELD),
    "within the play": (PLAY, (0.0018, 0, 0, 0), (0.0, 0.0), 1e-9),
    "beyond it": (PLAY, (0, 0, 0.006, 0), (0.4, -0.4 / 0.3), 4e-7),
    "friction within the spring": (HYSTERESIS, (0, 1, 0, -1), (-0.3, 1.0), 3e-7),
}


@pytest.mark.parametrize("case", CORNERS)
def test_friction_and_play_act_by_hand(case):
    """Assert by hand the accelerations of dry friction, of friction in the spring, and of play."""
    values, x, expected, tolerance = CORNERS[case]
    scene = _scene(values)
    found = _accelerations(scene, np.array(x, dtype=float), 0.0)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=tolerance)
    assert not scene.notes


LEFT_OUT: dict[str, tuple[dict[str, float], dict[str, Any]]] = {
    "Stribeck friction": ({"alpha_stribeck": 0.5}, {}),
    "saturation": ({"alpha_saturation": 0.001}, {}),
    "presliding": ({"alpha_presliding": 0.5, "presliding_grip": 1e3}, {}),
    "error of the transmission": (_both(error_sine=0.1, error_cosine=0.2), {}),
    "eccentricity": (_both(ecc_sine=0.1, ecc_cosine=0.2), {}),
    "a term that nobody knows": ({"theta_unheard_of": 1.0}, {}),
    "an early input": ({}, {"delays": {"input_delay": -0.002}}),
    "a late encoder": ({}, {"delays": {"link_delay": 0.0015}}),
    "a friction that drives": ({"alpha_coulomb": -1.0}, {}),
    "a hysteresis that drives": (_both(hysteresis=-0.1), {}),
    "negative play": (_both(backlash=-0.1), {}),
}


def test_what_has_no_place_is_named(golden):
    """Assert that unsupported terms are named once, in the scene as well."""
    x = np.array([0.3, 1.0, 0.2, 2.0])
    plain = _accelerations(_scene({}), x, 1.0)
    found = {}
    for name, (more, about) in LEFT_OUT.items():
        scene = _scene(more, **about)
        (found[name],) = scene.notes
        assert f"Note: {scene.notes[0]}." in scene.xml
        assert "frictionloss" not in scene.xml
        np.testing.assert_array_equal(_accelerations(scene, x, 1.0), plain)
    golden(found)


def test_steps_suit_what_is_fast():
    """Assert that stiff joints and dry friction have shorter steps, fractions of a millisecond."""

    def step(more: Mapping[str, float]) -> float:
        return mujoco.MjModel.from_xml_string(_scene(more).xml).opt.timestep

    assert step({}) == 1e-3
    assert step({"theta2": 1e4, "alpha1": 3e4}) == 1.25e-4
    assert step({"alpha_coulomb": 1.0}) == 1.25e-4
    assert step({"alpha_coulomb": 1.0, "theta2": 1e4, "alpha1": 3e4}) == 1e-3 / 64


@pytest.fixture
def document(example_estimate):
    """Return a copy of the document, to be changed."""
    return json.loads(json.dumps(example_estimate.document))


def _stored(document, folder):
    path = folder / "estimate.json"
    path.write_text(json.dumps(sealed(document)))
    return path


def played(scene, torque: np.ndarray, sample_time: float) -> np.ndarray:
    """Return positions of link and motor under a held torque, shape (n, 2)."""
    model = mujoco.MjModel.from_xml_path(str(scene))
    data = mujoco.MjData(model)
    positions = np.empty((len(torque), 2))
    for sample, value in enumerate(torque):
        positions[sample] = data.qpos
        data.ctrl[0] = value
        mujoco.mj_step(model, data, nstep=round(sample_time / model.opt.timestep))
    return positions


def test_the_example_goes_round(example_estimate, examples, tmp_path):
    """Assert that the scene under the log's torque has the errors of the fit itself."""
    (scene,), warnings = export(example_estimate, to="mjcf", out=tmp_path / "scene")
    log = read_log(examples / "flexible_joint.csv")
    (recorded,) = log.recordings
    found = played(scene, recorded.needed_input, recorded.sample_time)
    own = example_estimate.validate(log).residuals[np.inf]
    off = found - np.column_stack((recorded.needed_link_position, recorded.motor_position))
    assert np.sqrt(np.mean(off[:, 0] ** 2)) < 1.05 * own["link_position"]
    assert np.sqrt(np.mean(off[:, 1] ** 2)) < 1.05 * own["motor_position"]
    assert warnings == ()


def test_hysteresis_of_the_spring_is_exported(document, tmp_path):
    """Assert that hysteresis of the spring becomes the tendon's friction, or is refused."""
    found = document["coefficients"]
    for name in ("theta_hysteresis", "alpha_hysteresis", "hysteresis_grip"):
        found[name] = found["alpha2"] | {"name": name}
    found["theta_hysteresis"]["value"] *= found["theta2"]["value"] / found["alpha1"]["value"]
    estimate = load(_stored(document, tmp_path))
    (scene,), _ = export(estimate, to="mjcf", out=tmp_path / "scene")
    torque = found["alpha2"]["value"] / found["beta1"]["value"]
    model = mujoco.MjModel.from_xml_path(str(scene))
    assert model.tendon_frictionloss[0] == pytest.approx(torque)
    with pytest.raises(SettingError, match="depends on the past motion, which this export"):
        export(estimate, to="fmu", out=tmp_path / "units")


def test_offsets_that_differ_from_log_to_log(document, tmp_path):
    """Assert that the first log's offset is used, with a message."""
    for number, value in enumerate((1.5, 2.5), 1):
        own = document["coefficients"]["alpha2"] | {"value": value}
        document["coefficients"][f"alpha_offset[{number}]"] = own
    path = _stored(document, tmp_path)
    (scene,), warnings = export(load(path), to="mjcf", out=tmp_path / "scene")
    assert "alpha_offset differs between logs" in warnings[0]
    inertia = 1.0 / document["coefficients"]["beta1"]["value"]
    model = mujoco.MjModel.from_xml_path(str(scene))
    assert model.actuator_biasprm[0, 0] == pytest.approx(1.5 * inertia)


def test_what_is_no_scene(document, example_estimate, tmp_path, refusals):
    """Assert that missing values, a model alone, a link alone and options are refused."""
    document["coefficients"]["alpha2"]["value"] = None
    write = partial(export, to="mjcf", out=tmp_path / "scene")
    refusals(
        {
            "no value": lambda: write(_stored(document, tmp_path)),
            "no estimate": lambda: write("flexible-joint"),
            "no motor": lambda: mjcf_scene("link", {"theta2": 100.0}),
            "options of an estimator": lambda: write(example_estimate, sample_time=1e-3),
        }
    )
    assert not (tmp_path / "scene").exists()
