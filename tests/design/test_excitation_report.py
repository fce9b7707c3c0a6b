"""What a log can tell, and whether the advice on what to add is right."""

import json

import numpy as np
import pytest
from joint_logs import SAMPLE_TIME, steady_sine, write_log

from flexid.design.excitation_report import examine
from flexid.identification.settings import Settings
from flexid.recording.read import read_log

PAPER_TERMS = Settings(terms=("gravity", "motor_viscous"))


def examined(path):
    """Report on one log with the paper's terms."""
    return examine([read_log(path)], PAPER_TERMS)


@pytest.fixture(scope="module")
def small_sine(tmp_path_factory):
    """A log of 0.3 rad on one sine, its torque and its first state."""
    torque, start = steady_sine(0.3, 5.0)
    path = tmp_path_factory.mktemp("log") / "small.csv"
    return write_log(path, torque, start), torque, start


@pytest.fixture(scope="module")
def small_report(small_sine):
    """The report on it."""
    return examined(small_sine[0])


@pytest.mark.parametrize("pair", [("theta1", "theta2"), ("alpha1", "beta1")])
def test_confounded_pair_is_named(small_report, pair):
    """Assert that a small sine confounds each row's pair, and that each is the other's partner."""
    first, second = (small_report.assessment.coefficients[name] for name in pair)
    assert (first.partner, second.partner) == (second.name, first.name)
    assert abs(first.correlation) > 0.999
    assert first.inflation > 100
    assert first.status == second.status == "undetermined"
    assert not small_report.supported


def test_following_the_advice_is_enough(small_report, small_sine, tmp_path):
    """Assert that with the advised sine in the torque, a new log tells every coefficient."""
    _, torque, start = small_sine
    sine = small_report.advice.sine
    t = SAMPLE_TIME * np.arange(len(torque))
    more = torque + sine.amplitude * np.sin(sine.angular_frequency * t)
    report = examined(write_log(tmp_path / "more.csv", more, start, seed=5))
    assert report.assessment.status == "determined"
    weakest = report.assessment.weakest
    assert weakest.relative_deviation == pytest.approx(sine.relative_deviation, rel=0.5)


def test_half_the_advice_is_not_enough(small_report, small_sine, tmp_path):
    """Assert that the advice asks for little more than is needed."""
    _, torque, start = small_sine
    sine = small_report.advice.sine
    t = SAMPLE_TIME * np.arange(len(torque))
    more = torque + 0.5 * sine.amplitude * np.sin(sine.angular_frequency * t)
    report = examined(write_log(tmp_path / "half.csv", more, start, seed=5))
    assert report.assessment.status != "determined"


def test_a_tiny_sine_gets_a_rule_of_thumb_that_helps(tmp_path):
    """Assert that 0.1 rad on one sine claims no deviation, and that the rule of thumb mends it."""
    torque, start = steady_sine(0.1, 5.0)
    report = examined(write_log(tmp_path / "tiny.csv", torque, start))
    pair = [report.assessment.coefficients[name] for name in ("theta1", "theta2")]
    assert all(np.isinf(c.relative_deviation) for c in pair)
    assert report.advice is not None
    assert report.advice.rule is not None
    amplitude, rate = report.advice.rule
    t = SAMPLE_TIME * np.arange(len(torque))
    more = torque + amplitude * np.sin(rate * t)
    mended = examined(write_log(tmp_path / "mended.csv", more, start))
    assert mended.assessment.status == "determined"


def test_a_rich_log_needs_nothing(examples):
    """Assert that the example log tells everything, close to the interval that identify gives."""
    report = examined(examples / "flexible_joint.csv")
    assert report.assessment.status == "determined"
    assert report.advice is None
    assert report.hold == "zero"
    assert report.noise["link_position"] == pytest.approx(1.04e-4, rel=0.1)


def test_command_says_it_all(flexid, small_sine, tmp_path):
    """Assert that the command exits with 1, fits the page, and writes document and figure."""
    outcome = flexid("excitation", small_sine[0], "--out", tmp_path)
    assert outcome.status == 1, outcome.stderr
    assert max(map(len, outcome.stdout.splitlines())) <= 100
    assert "Add a sine of" in outcome.stdout
    assert "rad/s" in outcome.stdout
    assert {p.name for p in tmp_path.iterdir()} == {"excitation.json", "excitation.png"}
    document = json.loads((tmp_path / "excitation.json").read_text())
    assert document["coefficients"]["theta1"]["partner"] == "theta2"
    assert document["advice"]["sine"]["angular_frequency"] > 0
    assert len(document["provenance"]["inputs"][0]["sha256"]) == 64


def test_command_on_a_rich_log(flexid, examples):
    """Assert that a log that tells everything exits with 0 and says that nothing is missing."""
    outcome = flexid("excitation", examples / "flexible_joint.csv", "--json")
    assert outcome.status == 0, outcome.stderr
    assert json.loads(outcome.stdout)["supported"] is True


def test_one_encoder_is_not_enough(flexid, tmp_path):
    """Assert that a log without the link's encoder exits with 2 and says what is missing."""
    t = np.arange(0, 5, 0.01)
    path = tmp_path / "one.csv"
    table = np.column_stack([t, np.sin(t), np.cos(t)])
    header = "time [s],motor_position [rad],motor_torque [N m]"
    np.savetxt(path, table, delimiter=",", header=header, comments="")
    outcome = flexid("excitation", path)
    assert outcome.status == 2
    assert "link" in outcome.stderr


@pytest.mark.parametrize(
    "options",
    [
        ("--terms", "gravitation"),
        ("--hold", "first"),
        ("--known", "motor_inertia"),
        ("--known", "theta2=9+-1"),
    ],
)
def test_bad_options_are_one_sentence(flexid, small_sine, options):
    """Assert that a wrong option exits with 2 and one line."""
    outcome = flexid("excitation", small_sine[0], *options)
    assert outcome.status == 2
    assert len(outcome.stderr.strip().splitlines()) == 1
