"""The whole way from logs to coefficients, intervals and choices."""

from dataclasses import replace

import numpy as np
import pytest

from flexid.identification.identify import identify
from flexid.identification.joint import flexible, rigid
from flexid.identification.settings import Settings
from flexid.recording.recording import Log, Recording
from flexid.simulation.free_run import free_run

TRUE = {"theta1": 5.0, "theta2": 100.0, "alpha1": 1000 / 3, "alpha2": 1 / 3, "beta1": 10 / 3}
RIGID = {"gamma1": 4.0, "gamma_viscous": 0.3, "beta1": 0.8}
SAMPLE_TIME = 0.002  # s
TONES = np.array([0.7, 5.3, 17.0, 25.0])  # rad/s
AMPLITUDES = np.array([4.0, 6.0, 5.0, 6.0])  # N m

TERMS = ("gravity", "motor_viscous")
SETTINGS = Settings(terms=TERMS, input_delay=0.0, link_delay=0.0, segment_duration=1.0)


def recording(truth, seed, *, joint=None, recorded_early=0.0, noise=1e-5):
    """Ten seconds under a multisine torque that stands so many seconds too early in the log."""
    joint = joint or flexible()
    rng = np.random.default_rng(seed)
    time, phases = SAMPLE_TIME * np.arange(5000), rng.uniform(0.0, 2 * np.pi, len(TONES))

    def torque(t):
        return np.sin(np.outer(t, TONES) + phases) @ AMPLITUDES

    values = {c: truth.get(c, 0.0) for c in joint.system.coefficients}
    states = free_run(
        joint.system,
        values,
        np.zeros(len(joint.system.states)),
        torque(time - recorded_early),
        SAMPLE_TIME,
    )
    positions = states[:, ::2] + noise * rng.standard_normal((len(time), states.shape[1] // 2))
    link = positions[:, 0].copy() if joint.kind == "flexible" else None
    motor = positions[:, -1].copy()
    return Recording(SAMPLE_TIME, 0.0, link, motor, torque(time), "N m", source=f"{seed}.csv")


def log(piece):
    """Return a log of one piece."""
    return Log((piece,), (), piece.source, piece.source)


def assert_true(result, truth, accuracy=0.005):
    """Every coefficient within a relative accuracy, and no others."""
    assert set(result.coefficients) == set(truth)
    for name, true in truth.items():
        assert result.coefficients[name].value == pytest.approx(true, rel=accuracy), name


@pytest.fixture(scope="module")
def clean():
    """One log of the paper's joint."""
    return log(recording(TRUE, 1))


@pytest.fixture(scope="module")
def alone(clean):
    """That log, identified without knowledge."""
    return identify([clean], SETTINGS)


def test_given_choices_are_kept(alone):
    """Assert that what the settings fix is what was done, and leads to the truth."""
    choices = alone.choices
    assert choices.terms == TERMS
    assert choices.estimator == "prediction-error"
    assert choices.segment_duration == 1.0
    assert choices.alignment.input_delay.status == "given"
    assert_true(alone, TRUE)


def test_provenance_names_every_choice(alone):
    """Assert that what was chosen is on record under the names of the settings."""
    chosen = alone.provenance["chosen"]
    not_choices = {"known", "known_deviations", "bounds", "validation_share"}
    assert set(alone.provenance["settings"]) - not_choices <= set(chosen)
    assert chosen["terms"] == list(TERMS)
    assert chosen["segment_duration"] == 1.0


def test_segments_are_no_longer_than_the_log(clean):
    """Assert that a segment length beyond the log's is reported as what it came to."""
    choices = identify([clean], replace(SETTINGS, segment_duration=60.0)).choices
    assert choices.segment_duration == pytest.approx(10.0)


def test_least_squares_alone(clean):
    """Assert that least squares may be had without prediction error."""
    settings = replace(SETTINGS, estimator="least-squares", segment_duration="auto")
    result = identify([clean], settings)
    assert result.choices.estimator == "least-squares"
    assert result.choices.segment_duration is None
    values = {name: c.value for name, c in result.coefficients.items()}
    assert values == pytest.approx(dict(result.least_squares))
    assert_true(result, TRUE, 0.02)


def test_every_log_has_its_own_offset():
    """Assert that two constant torques in two logs come out as two, and spoil nothing else."""
    logs = [
        log(recording({**TRUE, "theta_offset": offset}, seed))
        for seed, offset in ((2, 1.0), (3, -0.5))
    ]
    result = identify(logs, replace(SETTINGS, terms=(*TERMS, "link_offset")))
    assert_true(result, {**TRUE, "theta_offset[1]": 1.0, "theta_offset[2]": -0.5})
    assert result.parameters["link_offset_torque[2]"].value == pytest.approx(-0.5, rel=0.005)


def test_coefficient_ends_at_its_bound(clean):
    """Assert that a coefficient that wants to leave its bounds ends there, and that it says so."""
    result = identify([clean], replace(SETTINGS, bounds={"alpha2": (0.5, 2.0)}))
    alpha2 = result.coefficients["alpha2"]
    assert (alpha2.value, alpha2.std, alpha2.reason) == (0.5, 0.0, "at its bound")
    assert "alpha2" not in result.least_squares


def test_knowledge_narrows_and_shifts(clean, alone):
    """Assert that a known stiffness, one deviation off, draws the estimate halfway to it."""
    before = alone.coefficients["theta2"]
    known = before.value + before.std
    settings = replace(SETTINGS, known={"theta2": known}, known_deviations={"theta2": before.std})
    result = identify([clean], settings)
    after = result.coefficients["theta2"]
    assert after.value == pytest.approx(before.value + before.std / 2, abs=0.05 * before.std)
    assert after.std < 0.9 * before.std
    assert not any("log alone" in warning for warning in result.warnings)


def test_contradiction_is_told(clean):
    """Assert that a known inertia that the log does not bear out earns a warning."""
    known = {"motor_inertia": 0.4}
    settings = replace(SETTINGS, known=known, known_deviations={"motor_inertia": 0.001})
    warnings = identify([clean], settings).warnings
    assert any("motor_inertia is known as 0.4" in w and "log alone" in w for w in warnings)


@pytest.fixture(scope="module")
def early():
    """A log whose torque was recorded three milliseconds before it acted."""
    return log(recording(TRUE, 4, recorded_early=0.003))


def test_given_delay_is_corrected(early):
    """Assert that a torque that acts later than it was recorded is moved to where it acts."""
    assert_true(identify([early], replace(SETTINGS, input_delay=0.003, hold="linear")), TRUE)


def test_unknown_delay_is_found(early):
    """Assert that three milliseconds of delay are found from the log, and the truth with them."""
    result = identify([early], replace(SETTINGS, input_delay="auto"))
    delay = result.choices.alignment.input_delay
    assert delay.status == "found"
    assert delay.value == pytest.approx(0.003, abs=2e-4)
    assert_true(result, TRUE)


def test_one_encoder_gives_the_rigid_joint():
    """Assert that a log with one encoder gives inertia and gravity, and no compliance."""
    settings = replace(SETTINGS, terms=("gravity", "viscous"))
    result = identify([log(recording(RIGID, 5, joint=rigid()))], settings)
    assert result.model == "rigid"
    assert not result.compliance.visible
    assert_true(result, RIGID)
    assert result.parameters["inertia"].value == pytest.approx(1 / 0.8, rel=0.005)


def test_option_of_the_same_name_repeats_the_choice(clean):
    """Assert that what was chosen automatically, given by hand, gives the same coefficients."""
    automatic = identify([clean], Settings(terms=TERMS))
    chosen = automatic.provenance["chosen"]
    by_hand = Settings(
        terms=tuple(chosen["terms"]),
        hold=chosen["hold"],
        input_delay=chosen["input_delay"],
        link_delay=chosen["link_delay"],
        filter_rate=chosen["filter_rate"],
        estimator=chosen["estimator"],
        segment_duration=chosen["segment_duration"],
    )
    repeated = identify([clean], by_hand)
    assert repeated.provenance["chosen"] == chosen
    for name, coefficient in automatic.coefficients.items():
        assert repeated.coefficients[name].value == pytest.approx(coefficient.value, rel=1e-6)
        assert repeated.coefficients[name].std == pytest.approx(coefficient.std, rel=1e-3)
