"""Validation of a stored estimate with other logs, and refusals."""

import json
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from flexid.arrays import to_json
from flexid.errors import RecordingError, SettingError
from flexid.identification.identify import identify
from flexid.identification.preparation.settings import Settings
from flexid.library.logs import read_log
from flexid.models.flexible_joint import flexible_joint, rigid_joint
from flexid.simulation.free_run import free_run
from flexid.stored_estimates.estimate_file import estimate_document, read_estimate, sealed
from flexid.stored_estimates.validate_estimate import validate_estimate as validate_stored
from joint_logs import save, write_held_log
from made_estimates import TRUE, altered, stored_document, stored_value

STEP = 0.002
NOISE = 1e-4
CHANNELS = ("link_position", "motor_position", "deflection")


def torque(seed, duration=8.0):
    """Return a torque of four tones with random phases, held between samples."""
    phases = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, 4)
    t = STEP * np.arange(round(duration / STEP))
    tones = np.sin(np.outer(t, [0.9, 4.3, 15.0, 24.0]) + phases)
    return t, tones @ np.array([4.0, 5.0, 5.0, 4.0])


def write_flexible(path, seed=0, duration=8.0, column="motor_torque [N m]"):
    """Write a log of Table I's joint from rest."""
    _, u = torque(seed, duration)
    return read_log(write_held_log(path, u, NOISE, seed + 100, column=column))


def stored(coefficients=TRUE, keys="", value=None):
    """Return a joint as a document, by default Table I's, with one value changed."""
    document = stored_document(coefficients)
    return altered(document, keys, value) if keys else document


def validate_estimate(estimate, logs):
    """Validate a file, or its content, with logs."""
    content = sealed(estimate) if isinstance(estimate, dict) else estimate
    return validate_stored(read_estimate(content), logs)


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """Return a log of the joint."""
    return write_flexible(tmp_path_factory.mktemp("log") / "log.csv")


def test_the_truth_leaves_the_noise(log):
    """Assert that predictions of the true values are at the noise, over any horizon."""
    found = validate_estimate(stored(), [log])
    assert set(found.fit_percent) == set(CHANNELS)
    assert set(found.horizons) == {0.05, 0.2, 1.0, 5.0}
    for horizon in (0.05, 0.2):  # longer ones show errors of the initial state
        residuals = found.residuals[horizon]
        assert residuals["link_position"] == pytest.approx(NOISE, rel=0.2)
        assert residuals["motor_position"] == pytest.approx(NOISE, rel=0.2)
        assert residuals["deflection"] == pytest.approx(np.sqrt(2) * NOISE, rel=0.2)
    assert all(fit > 99 for fit in found.fit_percent.values())
    assert found.noise["deflection"] == pytest.approx(np.sqrt(2) * NOISE, rel=0.1)
    spread = np.std(found.runs[0].measured[:, 0])
    assert found.fit_percent["link_position"] == pytest.approx(
        100 * (1 - found.residuals[np.inf]["link_position"] / spread)
    )
    assert found.warnings == ()


def test_what_identify_reports_comes_again(log, tmp_path):
    """Assert that a stored estimate predicts the held-out end as well as identify did."""
    result = identify([log], Settings(terms=("gravity", "motor_viscous")))
    path = tmp_path / "estimate.json"
    path.write_text(to_json(estimate_document(result)))
    start = len(log.recordings[0]) - round(len(log.recordings[0]) / 3)
    # Starts 0.5 s before the held-out end, so that the same part is predicted.
    part = log.recordings[0].window(start - round(0.5 / STEP), len(log.recordings[0]))
    end = replace(log, recordings=(part,), sha256="of the end alone")
    found = validate_estimate(path, [end])
    for channel in CHANNELS:
        once = result.validation.fit_percent[channel]
        # The stored values are those of all data.
        assert 100 - found.fit_percent[channel] == pytest.approx(100 - once, rel=0.3)
    assert found.warnings == ()
    (warning,) = validate_estimate(path, [log]).warnings
    assert "no independent test" in warning


def test_delays_are_heeded(tmp_path):
    """Assert that an early input is predicted with its delay, and not without."""
    _, u = torque(3)
    x = free_run(flexible_joint(), TRUE, np.zeros(4), u, STEP, "zero")
    early = np.append(u[5:], np.full(5, u[-1]))  # acts 10 ms after its record
    log = read_log(save(tmp_path / "late.csv", x, early, 0.0, 0))
    late = stored(keys="choices.alignment.input_delay.value", value=0.01)
    with_delay = validate_estimate(late, [log]).horizons[0.2]["deflection"]
    without = validate_estimate(stored(), [log]).horizons[0.2]["deflection"]
    assert with_delay > 99.5
    assert without < 90.0


def test_terms_without_effect_change_nothing(log):
    """Assert that play needs its width, and that offsets of several logs are averaged."""
    document = stored()
    for name in ("alpha_backlash", "theta_backlash"):
        document["coefficients"][name] = stored_value(0.0, name=name)
    document["choices"]["terms"].append("backlash")
    with pytest.raises(SettingError, match="backlash_width"):
        validate_estimate(document, [log])
    document["choices"]["shapes"] = {"backlash_width": 1e-4}
    found = validate_estimate(document, [log])
    plain = validate_estimate(stored(), [log])
    assert found.fit_percent == pytest.approx(plain.fit_percent)
    document = stored()
    document["coefficients"] |= {
        name: stored_value(v, name=name)
        for name, v in (("alpha_offset[1]", 2), ("alpha_offset[2]", -2))
    }
    document["choices"]["terms"].append("motor_offset")
    found = validate_estimate(document, [log])
    assert found.fit_percent == pytest.approx(validate_estimate(stored(), [log]).fit_percent)
    assert "alpha_offset" in found.warnings[0]


def test_a_rigid_joint():
    """Assert that a rigid joint predicts the motor's encoder, also in a log with two encoders."""
    t, u = torque(4)
    true = {"gamma1": 4.0, "beta1": 0.8}
    x = free_run(rigid_joint(("gravity",)), true, np.zeros(2), u, STEP, "zero")
    motor = x[:, 0] + NOISE * np.random.default_rng(1).standard_normal(len(t))
    log = read_log({"time": t, "motor_position": motor, "motor_torque": u})
    rigid = stored(true)
    rigid["model"], rigid["choices"]["terms"] = "rigid", ["gravity"]
    found = validate_estimate(rigid, [log])
    assert set(found.fit_percent) == {"motor_position"}
    assert found.residuals[0.05]["motor_position"] == pytest.approx(NOISE, rel=0.15)
    assert found.residuals[np.inf]["motor_position"] < 5.0 * NOISE
    with pytest.raises(RecordingError, match="link_position"):
        validate_estimate(stored(), [log])


def test_what_does_not_suit_an_estimate(log, tmp_path):
    """Assert a warning of an undetermined value; other inputs and short logs are refused."""
    document = stored(keys="coefficients.alpha2.verdict", value="undetermined")
    (warning,) = validate_estimate(document, [log]).warnings
    assert "alpha2" in warning
    document = stored(keys="coefficients.beta1.unit", value="rad/s^2/(N m)")
    assert validate_estimate(document, [log]).fit_percent["link_position"] > 99
    other = write_flexible(tmp_path / "volts.csv", column="motor_voltage [V]")
    with pytest.raises(RecordingError, match="input"):
        validate_estimate(document, [other])
    with pytest.raises(RecordingError, match="longer"):
        validate_estimate(stored(), [write_flexible(tmp_path / "short.csv", duration=0.4)])


NO_MODEL = {
    "a coefficient missing": stored({name: v for name, v in TRUE.items() if name != "theta2"}),
    "no value": stored(keys="coefficients.beta1.value"),
    "a coefficient of another": stored(
        keys="coefficients.gamma1", value=stored_value(1.0, name="gamma1")
    ),
    "an unknown term": stored(keys="choices.terms", value=["stiction"]),
}


def test_estimates_of_no_model(log, refusals):
    """Assert that coefficients of no model are named in one line."""
    refusals({name: partial(validate_estimate, one, [log]) for name, one in NO_MODEL.items()})


def test_the_command(flexid, tmp_path):
    """Assert that the command writes document and figures, and the status of a minimum fit."""
    write_flexible(tmp_path / "log.csv")
    path = tmp_path / "estimate.json"
    path.write_text(json.dumps(sealed(stored())))
    outcome = flexid("validate", path, tmp_path / "log.csv", "--out", tmp_path / "out")
    assert outcome.status == 0, outcome.stderr
    names = {file.name for file in (tmp_path / "out").iterdir()}
    assert names == {"report.html", "validation.json", "validation.png", "residuals.png"}
    document = json.loads((tmp_path / "out" / "validation.json").read_text())
    assert set(document["residuals"]) == {"0.05", "0.2", "1", "5", "free"}
    assert document["provenance"]["inputs"][0]["file"] == str(tmp_path / "log.csv")
    for least, status in (("99", 0), ("99.999", 1)):
        printed = flexid("validate", path, tmp_path / "log.csv", "--json", "--min-fit", least)
        assert printed.status == status
        assert json.loads(printed.stdout)["fit_percent"] == document["fit_percent"]
