"""Report on the excitation of a log: values as in identify, and valid advice."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

import flexid as flexid_library
from flexid.experiment_design.excitation_report import _caution, advise, examine
from flexid.identification.preparation.settings import Settings
from flexid.identification.vocabulary.evidence import Disturbances, ModelError
from flexid.library.logs import read_log
from flexid.report.excitation import advice_lines
from joint_logs import FINE, SAMPLE_TIME, steady_sine, write_held_log, write_log

TERMS = ("gravity", "motor_viscous")
ON_TIME = Settings(terms=TERMS, hold="cubic", input_delay=0.0, link_delay=0.0)
HELD = Settings(terms=TERMS, hold="zero", input_delay=0.0, link_delay=0.0)
TIME = SAMPLE_TIME * np.arange(3000)
TONES = np.sin(np.outer(TIME, [0.7, 5.3, 17, 25])) @ np.array([4.0, 6.0, 5.0, 6.0])
SLOW = 0.2 * (np.sin(0.7 * TIME) + np.sin(1.3 * TIME)) * np.minimum(1.0, TIME / 2.0) ** 3


@pytest.fixture(scope="module")
def faint(tmp_path_factory):
    """Return a log with slow, small motion in noise, and its report."""
    path = write_held_log(tmp_path_factory.mktemp("log") / "faint.csv", SLOW, 3e-3, seed=4)
    return path, examine([read_log(path)], HELD)


def test_what_the_others_cost(faint):
    """Assert the identified values, and width alone, cost and partner by the covariance."""
    _, report = faint
    fit = report.identification.fit
    inverse = np.linalg.inv(fit.covariance)
    scale = np.sqrt(np.diag(fit.covariance))
    correlations = fit.covariance / np.outer(scale, scale) - np.eye(len(scale))
    for place, name in enumerate(fit.names):
        c, own = report.coefficients[name], report.identification.coefficients[name]
        assert vars(own).items() <= vars(c).items()
        alone = inverse[place, place] ** -0.5 / scale[place]
        assert c.width_alone == pytest.approx(c.width * alone, rel=1e-6)
        other = int(np.argmax(np.abs(correlations[place])))
        assert c.partner == fit.names[other]
        assert c.correlation == pytest.approx(correlations[place, other])


def all_determined(report):
    """Return whether every coefficient is determined."""
    return all(c.verdict == "determined" for c in report.coefficients.values())


def test_following_the_advice_is_enough(faint, tmp_path):
    """Assert that a third of the torque near resonance, or a longer log, determines all values."""
    _, report = faint
    assert not all_determined(report)
    advice = report.advice
    assert advice.resonance == pytest.approx(433.0**0.5, rel=0.15)
    more = SLOW + 0.1 * np.sin(advice.resonance * TIME)
    mended = examine([read_log(write_held_log(tmp_path / "more.csv", more, 3e-3, seed=5))], HELD)
    assert all_determined(mended)
    assert mended.advice is None
    times = advice.longer / (SAMPLE_TIME * len(TIME))
    width = max(c.width for c in report.coefficients.values() if c.verdict != "determined")
    assert times == pytest.approx(1.25 * (width / 0.2) ** 2)


def test_a_small_sine_loses_the_values(tmp_path):
    """Assert that 0.05 rad on one sine leaves values undetermined, and that the advice helps."""
    torque, start = steady_sine(0.05, 5.0, sample_time=FINE)
    path = write_log(tmp_path / "still.csv", torque, start)
    report = examine([read_log(path)], ON_TIME)
    assert report.coefficients["theta1"].verdict != "determined"
    assert report.coefficients["theta1"].partner == "theta2"
    assert report.advice is not None
    second = 0.2 * np.abs(torque).max() * np.sin(2.65 * 5.0 * FINE * np.arange(len(torque)))
    path = write_log(tmp_path / "more.csv", torque + second, start)
    assert all_determined(examine([read_log(path)], ON_TIME))


def test_given_coefficients_cost_nothing(tmp_path):
    """Assert that a given coefficient has no width and is no partner."""
    path = write_held_log(tmp_path / "rich.csv", TONES)
    report = examine([read_log(path)], replace(HELD, known={"beta1": 10 / 3}))
    given = report.coefficients["beta1"]
    assert (given.width, given.partner, given.reason) == (0.0, "", "given")
    assert all(c.partner != "beta1" for c in report.coefficients.values())


def test_a_rigid_joint_is_examined_too():
    """Assert that a log with one encoder is assessed as a rigid joint."""
    from flexid.models.flexible_joint import rigid_joint
    from flexid.simulation.free_run import free_run

    true = {"gamma1": 4.0, "beta1": 0.8}
    x = free_run(rigid_joint(("gravity",)), true, np.zeros(2), TONES, SAMPLE_TIME, "zero")
    noisy = x[:, 0] + 1e-4 * np.random.default_rng(1).standard_normal(len(x))
    log = read_log({"time": TIME, "motor_position": noisy, "motor_torque": TONES})
    report = examine([log], Settings(terms=("gravity",)))
    assert set(report.coefficients) == set(true)
    assert report.identification.supports()


def test_command_says_it_all(flexid, faint, tmp_path):
    """Assert that the command fits the page, and writes document and figure."""
    given = f"--terms {','.join(TERMS)} --hold zero --input-delay 0 --link-delay 0".split()
    outcome = flexid("excitation", faint[0], *given, "--out", tmp_path)
    assert outcome.status in (0, 1), outcome.stderr
    assert max(map(len, outcome.stdout.splitlines())) <= 80
    assert "near the joint's resonance" in outcome.stdout
    names = {p.name for p in tmp_path.iterdir()}
    assert names == {"excitation.json", "report.html"}
    document = json.loads((tmp_path / "excitation.json").read_text())
    assert document["advice"]["resonance"] > 0
    assert document["supported"] is (outcome.status == 0)
    options = {"terms": TERMS, "hold": "zero", "input_delay": 0, "link_delay": 0}
    found = flexid_library.excitation(faint[0], **options)
    assert found.document["coefficients"] == document["coefficients"]
    assert found.supports() is document["supported"]
    assert re.search(r"\d of 5 coefficients determined", repr(found))
    assert "theta2" in found.summary()
    assert len(document["provenance"]["inputs"][0]["sha256"]) == 64


def test_what_another_motion_does_not_mend(faint, example_estimate):
    """Assert that contradictions, model errors and disturbances are named instead of advice."""
    _, report = faint
    found = report.identification
    contradicted = {
        name: replace(
            c, verdict="undetermined", reason="the log contradicts it", interval=(c.value, c.value)
        )
        for name, c in found.coefficients.items()
    }
    contradicting = replace(found, coefficients=contradicted)
    lines = list(advice_lines(advise(contradicting)))
    assert lines == ["Another input does not help: the log contradicts it."]
    clean = example_estimate.result
    assert _caution(clean) == ""
    disturbed = replace(clean, disturbances=Disturbances({"motor": 0.3}, 1e-3))
    for result in (disturbed, replace(clean, model_error=ModelError(2.0, 0.9, 0.5))):
        assert _caution(result).startswith("The residuals show a part of the drive that no term")
