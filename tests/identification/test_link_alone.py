"""The link alone, from logs of motion without an input, simulated by an independent integrator."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from made_joint import log, made

from flexid.errors import RecordingError, SettingError
from flexid.estimators.channel_timing import INPUT
from flexid.identification.identify import identify
from flexid.identification.preparation.joint import link
from flexid.identification.preparation.settings import Settings
from flexid.identification.structure import link_delay
from flexid.identification.vocabulary.evidence import Estimate
from flexid.recording.recording import Log


def motion(seed: int, **more: Any) -> Log:
    """Return a simulated log without its torque."""
    return log(replace(made(seed, **more), input=None, input_unit=""))


@pytest.fixture(scope="module")
def alone():
    """Return the result for a log of the paper's joint without torque, with default settings."""
    return identify([motion(1)])


def test_link_may_be_asked_for(alone):
    """Assert that model "link" gives the same bits as a log without torque, without a warning."""
    assert alone.warnings == ()
    assert {p.unit for p in alone.parameters.values()} == {"1/s^2"}
    assert alone.compliance.visible
    assert {*alone.validation.fit_percent} == {"link_position", "deflection"}
    assert min(alone.validation.fit_percent.values()) > 99.9
    assert "the motor's measured position drives the link" in alone.summary[1]
    asked = identify([log(made(1))], Settings(model="link"))
    values = [{n: c.value for n, c in each.coefficients.items()} for each in (asked, alone)]
    assert values[0] == values[1]
    assert asked.provenance["settings"]["model"] == "link"  # type: ignore[index]
    assert "the link alone, as the settings say, with" in asked.summary[0]
    assert "the link alone, since the log has no input, with" in alone.summary[0]


def test_delay_may_pass_for_damping():
    """Assert that intervals include what a delay could cause, and shrink if the delay is given."""
    damped = motion(4, joint_damping=0.5, link_viscous=0.3)
    result = identify([damped])
    assert {"joint_damping", "link_viscous"} <= set(result.choices.terms)
    lower, upper = result.choices.alignment.link_delay.interval
    assert lower == pytest.approx(-5e-3, rel=0.1)
    assert upper == pytest.approx(3e-3, rel=0.1)
    assert "give --link-delay" in result.summary[1]
    assert result.coefficients["theta_damping"].verdict != "determined"
    assert result.coefficients["theta2"].verdict == "determined"
    known = identify([damped], Settings(link_delay=0.0))
    for name, true in {"theta_damping": 0.5, "theta_viscous": 0.3}.items():
        found = result.coefficients[name]
        assert found.value == pytest.approx(true, rel=0.02)
        assert found.interval[1] - found.interval[0] > 0.3
        found = known.coefficients[name]
        assert found.interval[0] <= true <= found.interval[1]
        assert found.verdict == "determined"


def test_signs_tell_of_a_delay():
    """Assert that the delay is bounded by damping and friction over the stiffness."""
    values = {"theta2": 100.0, "theta_damping": 0.5, "theta_viscous": 0.3}
    assert link_delay.possible(values) == (-0.005, 0.003)
    assert link_delay.doubtful(values) == set()
    assert link_delay.possible({"theta2": 100.0, "theta_damping": -0.5}) == (0.0, 0.0)
    assert link_delay.doubtful({**values, "theta_damping": -0.2}) == {"theta_damping"}
    assert link_delay.doubtful({"theta2": -1.0}) == {"theta_damping", "theta_viscous"}


@pytest.mark.parametrize(
    ("delay", "friction", "expected"),
    [
        (-2e-3, 0.2, True),
        (-2e-3, 0.219, True),
        (-2e-3, 0.183, True),
        (-2e-3, 0.23, False),
        (-2e-3, 0.17, False),
        (2e-3, 0.2, False),
        (0.0, 0.0, False),
    ],
)
def test_an_early_encoder_with_as_much_friction_is_damping(delay, friction, expected):
    """Assert that delay and friction count as damping if their friction agrees within a tenth."""
    values = {"theta2": 100.0, "theta_viscous": friction, "link_delay": delay}
    assert link_delay.is_damping(values) == expected
    assert not link_delay.is_damping({"theta2": 100.0})


def test_delay_moves_damping_and_friction_by_as_much():
    """Assert that a delay shifts damping and friction by opposite amounts, times the stiffness."""
    names = ("theta2", "theta_damping", "theta_viscous", "link_delay")
    estimate = Estimate(names, np.array([100.0, 0.6, 0.3, 0.0]), np.zeros((4, 4)), (9.0,) * 4)
    added = link_delay.confused_covariance(estimate)
    variance = 0.5 * (6.0**2 - 6.0 * 3.0 + 3.0**2) * 1e-6 / 3.0  # uniform from -6 to 3 ms, or zero
    np.testing.assert_allclose(np.diag(added), [0.0, 1e4 * variance, 1e4 * variance, variance])
    assert added[1, 2] == pytest.approx(-1e4 * variance)


def test_what_an_input_alone_gives_a_meaning_to_is_refused():
    """Assert that a hold, or a log with an input besides, is refused; the model has no input."""
    with pytest.raises(SettingError, match="no input, so this setting has no meaning"):
        identify([motion(1)], Settings(hold="zero"))
    with pytest.raises(RecordingError, match=r"made 6.*is missing, and in made 5 in N m"):
        identify([log(made(5)), motion(6)])
    joint = link()
    assert joint.systems[0].inputs == ("x3", "x4")
    assert INPUT not in joint.units
    assert not any(name.startswith("alpha") for name in joint.units)
