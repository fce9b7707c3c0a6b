"""From a log to a scene and back: the command, the library, and MuJoCo beside the log."""

# MuJoCo's compiled half has no type stubs, so pyright cannot see what it exports.
# pyright: reportAttributeAccessIssue=false

import json

import mujoco
import numpy as np
import pytest

from flexid.errors import SettingError
from flexid.exports.mujoco_log import mujoco_log
from flexid.library.export import export
from flexid.library.logs import read_log


@pytest.fixture
def document(example_estimate):
    """The same as its file has it, to be changed."""
    return json.loads(json.dumps(example_estimate.document))


def _stored(document, folder):
    path = folder / "estimate.json"
    path.write_text(json.dumps(document))
    return path


def test_the_example_goes_round(example_estimate, examples, tmp_path):
    """Assert that the scene, played the log's torque, is as far off as the fit itself.

    The log begins at rest. Its encoders' noise is 1e-4 rad, and rounded to 16 bits.
    """
    (scene,), warnings = export(example_estimate, to="mjcf", out=tmp_path / "scene")
    log = read_log(examples / "flexible_joint.csv")
    (recorded,) = log.recordings
    played = mujoco_log(scene, recorded.needed_input, recorded.sample_time)
    own = example_estimate.validate(log).residuals[np.inf]
    for channel in ("link_position", "motor_position", "deflection"):
        off = getattr(played, channel) - getattr(recorded, channel)
        assert np.sqrt(np.mean(off**2)) < 1.05 * own[channel]
    assert warnings == ()


def test_the_command_writes_the_same(example_estimate, document, tmp_path, flexid):
    """Assert that a stored estimate becomes the scene that the library writes of it at once."""
    path = _stored(document, tmp_path)
    done = flexid("export", path, "--to", "mjcf", "--out", tmp_path / "command")
    assert (done.status, done.stderr) == (0, "")
    assert done.stdout.split() == [str(tmp_path / "command" / "joint.xml")]
    (made,), _ = export(example_estimate, to="mjcf", out=tmp_path / "library")
    assert made.read_text() == (tmp_path / "command" / "joint.xml").read_text()


def test_warnings_are_printed(document, tmp_path, flexid):
    """Assert that a term without a place in the scene, and a guess in it, are told to the user."""
    document["coefficients"]["alpha_stribeck"] = document["coefficients"]["alpha2"]
    document["choices"]["shapes"]["stribeck_velocity"] = 0.05
    document["coefficients"]["theta1"]["verdict"] = "undetermined"
    path = _stored(document, tmp_path)
    done = flexid("export", path, "--to", "mjcf", "--out", tmp_path / "scene")
    assert done.status == 0
    guess, lost = done.stderr.splitlines()
    assert guess == "warning: the estimate leaves theta1 undetermined"
    assert lost.startswith("warning: motor_stribeck")


def test_hysteresis_of_the_spring_is_exported(document, tmp_path):
    """Assert that a friction that remembers its path becomes one of the tendon, and is refused
    where there is no place for it.
    """
    from flexid.library.identify import load

    found = document["coefficients"]
    for name in ("theta_hysteresis", "alpha_hysteresis", "hysteresis_grip"):
        found[name] = found["alpha2"] | {"name": name}
    found["theta_hysteresis"]["value"] *= found["theta2"]["value"] / found["alpha1"]["value"]
    estimate = load(_stored(document, tmp_path))
    (scene,), warnings = export(estimate, to="mjcf", out=tmp_path / "scene")
    torque = found["alpha2"]["value"] / found["beta1"]["value"]
    model = mujoco.MjModel.from_xml_path(str(scene))
    assert model.tendon_frictionloss[0] == pytest.approx(torque)
    assert "sticks here" in warnings[0]
    with pytest.raises(SettingError, match="remembers the path of the spring, which this export"):
        export(estimate, to="fmu", out=tmp_path / "units")


def test_offsets_that_differ_from_log_to_log(document, tmp_path):
    """Assert that the first log's offset stands in the scene, and that this is said."""
    from flexid.library.identify import load

    for number, value in enumerate((1.5, 2.5), 1):
        own = document["coefficients"]["alpha2"] | {"value": value}
        document["coefficients"][f"alpha_offset[{number}]"] = own
    path = _stored(document, tmp_path)
    (scene,), warnings = export(load(path), to="mjcf", out=tmp_path / "scene")
    assert "alpha_offset differs from log to log" in warnings[0]
    inertia = 1.0 / document["coefficients"]["beta1"]["value"]
    model = mujoco.MjModel.from_xml_path(str(scene))
    assert model.actuator_biasprm[0, 0] == pytest.approx(1.5 * inertia)


@pytest.mark.parametrize("from_file", [True, False])
def test_what_has_no_value_is_refused(document, tmp_path, flexid, from_file):
    """Assert that a coefficient without a value, or a model alone, makes no scene and no file."""
    document["coefficients"]["alpha2"]["value"] = None
    what = _stored(document, tmp_path) if from_file else "flexible-joint"
    done = flexid("export", what, "--to", "mjcf", "--out", tmp_path / "scene")
    assert done.status == 2
    sentence = "alpha2: has no value" if from_file else "needs values: give an estimate.json"
    assert sentence in done.stderr
    assert not (tmp_path / "scene").exists()


def test_options_of_an_estimator_are_refused(example_estimate, tmp_path):
    """Assert that what a scene has no use for is not passed over."""
    with pytest.raises(SettingError, match="has no estimator"):
        export(example_estimate, to="mjcf", out=tmp_path / "scene", sample_time=1e-3)
