"""A scene that MuJoCo simulates becomes a recording."""

# MuJoCo's compiled half has no type stubs, so pyright cannot see what it exports.
# pyright: reportAttributeAccessIssue=false

from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from flexid.errors import SettingError, SimulationError
from flexid.exports.mjcf import mjcf_scene
from flexid.exports.mujoco_log import mujoco_log

JOINT = {"theta1": 5.0, "theta2": 100.0, "alpha1": 1000 / 3, "alpha2": 1 / 3, "beta1": 10 / 3}

SAMPLE_TIME = 2e-3  # s


@pytest.fixture
def scene(tmp_path):
    """The paper's joint as a file."""
    path = tmp_path / "joint.xml"
    path.write_text(mjcf_scene("flexible", JOINT).xml)
    return path


def _torque(count: int) -> np.ndarray:
    time = SAMPLE_TIME * np.arange(count)
    return 4.0 * np.sin(3.0 * time + 0.3) + 8.0 * np.sin(19.0 * time)


@pytest.mark.parametrize("hold", ["zero", "linear", "cubic"])
def test_torque_between_samples(scene, hold):
    """Assert that a scene moves as SciPy integrates its equation, whatever the torque does."""
    torque = _torque(150)
    found = mujoco_log(scene, torque, SAMPLE_TIME, hold=hold)
    between = {
        "zero": lambda t: torque[int(t / SAMPLE_TIME + 1e-9)],
        "linear": lambda t: np.interp(t, found.time, torque),
        "cubic": CubicSpline(found.time, torque),
    }[hold]

    def derivative(t, x):
        x1, x2, x3, x4 = x
        u = float(between(t))
        link = -5.0 * np.sin(x1) - 100.0 * (x1 - x3)
        motor = (100.0 * (x1 - x3) - 0.1 * x4 + u) / 0.3
        return [x2, link, x4, motor]

    true = solve_ivp(
        derivative,
        (0.0, found.time[-1]),
        np.zeros(4),
        t_eval=found.time,
        rtol=1e-9,
        atol=1e-11,
        max_step=0.25 * SAMPLE_TIME,
    )
    # A torque held over steps of 1 ms instead of curved is 1e-6 of itself off; a hold mistaken
    # for another one is half a sample, 1 ms, off, which moves the joint by 1e-3 rad and more.
    np.testing.assert_allclose(found.needed_link_position, true.y[0], atol=3e-5)
    np.testing.assert_allclose(found.motor_position, true.y[2], atol=3e-5)


@pytest.mark.parametrize("delay", [0.004, 0.0047])
def test_a_late_torque_is_late(scene, tmp_path, delay):
    """Assert that a scene with a delay moves as one without it whose torque comes later."""
    from flexid.estimators.channel_timing import held_input

    late = tmp_path / "late.xml"
    late.write_text(mjcf_scene("flexible", JOINT, delays={"input_delay": delay}).xml)
    torque = _torque(300)
    found = mujoco_log(late, torque, SAMPLE_TIME)
    # Straight lines that act as the delayed torque does, played one by one.
    lines = held_input(torque[:, None], SAMPLE_TIME, "zero", delay)[:, 0, :2]
    model = mujoco.MjModel.from_xml_path(str(scene))
    model.opt.timestep = SAMPLE_TIME / 10
    fine = np.concatenate([a + b * (np.arange(10) + 0.5) / 10 for a, b in lines])
    expected = mujoco_log(model, fine, SAMPLE_TIME / 10)
    # Half a step of the engine, which is what the straight lines of its history would cost, is
    # ten times the bound.
    np.testing.assert_allclose(found.motor_position, expected.motor_position[::10], atol=3e-5)


def test_a_rigid_scene_has_one_encoder():
    """Assert that a scene with one hinge gives a recording without a link."""
    scene = mjcf_scene("rigid", {"gamma1": 4.0, "beta1": 2.0})
    model = mujoco.MjModel.from_xml_string(scene.xml)
    found = mujoco_log(model, np.full(200, 0.02), SAMPLE_TIME)
    assert found.link_position is None
    # Small swings of a pendulum, sqrt(4) rad/s, about where the torque holds it.
    expected = 0.01 * (1.0 - np.cos(2.0 * found.time))
    np.testing.assert_allclose(found.motor_position, expected, atol=1e-6)


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"model": "empty.xml"}, "needs a hinge and an actuator: call both motor"),
        ({"sample_time": 1.5e-3}, "not a multiple of the scene's step of 0.001 s"),
        ({"sample_time": float("nan")}, "not a multiple"),
        ({"torque": np.array([1.0, np.nan])}, "a list of finite numbers"),
        ({"model": "missing.xml"}, "cannot load it: .*missing.xml"),
        ({"model": "nonsense.xml"}, r"MuJoCo cannot load it: .*nonsense"),
    ],
)
def test_what_cannot_be_played(scene, monkeypatch, keywords, message):
    """Assert that each wrong argument is answered in a sentence that says what there is."""
    monkeypatch.chdir(scene.parent)
    Path("nonsense.xml").write_text("<mujoco><nonsense/></mujoco>")
    Path("empty.xml").write_text("<mujoco/>")
    given = {"model": scene, "torque": np.ones(5), "sample_time": SAMPLE_TIME} | keywords
    with pytest.raises(SettingError, match=message):
        mujoco_log(**given)


def test_without_mujoco(scene, monkeypatch):
    """Assert that the extra is named where the package is missing."""
    import sys

    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(SettingError, match=r"flexid\[mujoco\]"):
        mujoco_log(scene, np.ones(5), SAMPLE_TIME)


@pytest.mark.parametrize(("friction", "torque"), [(-300.0, 1.0), (1.0, 1e12)])
def test_motion_without_bound(tmp_path, monkeypatch, friction, torque):
    """Assert that a joint which flies apart is an error, where the engine begins again.

    Of a torque that it finds too large the engine makes none.
    """
    path = tmp_path / "joint.xml"
    path.write_text(mjcf_scene("flexible", {**JOINT, "alpha2": friction}).xml)
    monkeypatch.chdir(tmp_path)  # MuJoCo writes a log of its own
    with pytest.raises(SimulationError, match="diverges"):
        mujoco_log(path, np.full(500, torque), SAMPLE_TIME)
