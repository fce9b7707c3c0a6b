"""`identify` on logs of MuJoCo, whose friction is not flexid's."""

import pytest
from engine_log import TRUTH, engine_log

from flexid.identification.identify import identify
from flexid.recording.recording import Log


def identified(seed, solref):
    """Thirty seconds with 14-bit encoders, held torque, friction, unknown motor inertia."""
    return identify([Log((engine_log(seed, solref=solref),), (), "engine", "")])


@pytest.fixture(scope="module", params=[0, pytest.param(10, marks=pytest.mark.thorough)])
def result(request):
    """An engine whose friction acts within a millisecond: as good as dry."""
    return identified(request.param, "0.001 1")


def test_every_parameter_is_determined(result):
    """Assert that all, friction too, is within three thousandths, and the truth inside."""
    for name, value in TRUTH.items():
        assert result.parameters[name].value == pytest.approx(value, rel=0.003), name
        lower, upper = result.parameters[name].interval
        assert result.parameters[name].verdict == "determined"
        assert lower <= value <= upper, name


def test_friction_is_dry_and_torque_held(result):
    """Assert that friction needs no velocity, and that a held torque without delay is seen."""
    assert "motor_coulomb" in result.choices.terms
    assert result.choices.coulomb_velocity is None
    assert result.choices.hold == "zero"
    assert abs(result.choices.alignment.input_delay.value) < 1e-5


def test_friction_that_builds_up_is_no_dry():
    """Assert that friction that no term describes is told, and widens intervals to the truth.

    The engine as it is delivered: its friction builds up over ten milliseconds. The torque is
    still seen to be held.
    """
    soft = identified(0, "0.02 1")
    assert soft.choices.hold == "zero"
    assert soft.model_error.share > 0.0
    for name, value in TRUTH.items():
        lower, upper = soft.parameters[name].interval
        assert lower <= value <= upper, name
        assert soft.parameters[name].value == pytest.approx(value, rel=0.04), name
