"""`identify` on logs of MuJoCo, whose friction is not flexid's."""

import pytest
from engine_log import TRUTH, engine_log

from flexid.identification.identify import identify
from flexid.recording.recording import Log


def identified(seed, solref):
    """Thirty seconds with 14-bit encoders, held torque, friction, unknown motor inertia."""
    return identify([Log((engine_log(seed, solref=solref),), (), "engine", "")])


@pytest.fixture(scope="module", params=[0, 10])
def result(request):
    """An engine whose friction acts within a millisecond: as good as dry."""
    return identified(request.param, "0.001 1")


def test_every_parameter_is_within_three_thousandths(result):
    """Assert that friction and damping are recovered as well as inertias and stiffness."""
    for name, value in TRUTH.items():
        assert result.parameters[name].value == pytest.approx(value, rel=0.003), name


def test_every_parameter_is_determined(result):
    """Assert that nothing is doubted in a log that tells everything, and the truth is inside."""
    for name, value in TRUTH.items():
        lower, upper = result.parameters[name].interval
        assert result.parameters[name].verdict == "determined"
        assert lower <= value <= upper, name


def test_friction_is_dry(result):
    """Assert that the engine's friction is taken for Coulomb's, without any velocity to choose."""
    assert "motor_coulomb" in result.choices.terms
    assert result.choices.coulomb_velocity is None


def test_held_torque_is_found(result):
    """Assert that the torque is seen to be held over each sample, without any delay to speak of."""
    assert result.choices.hold == "zero"
    assert abs(result.choices.alignment.input_delay.value) < 1e-5


@pytest.fixture(scope="module")
def soft():
    """The engine as it is delivered: its friction builds up over ten milliseconds."""
    return identified(0, "0.02 1")


def test_friction_that_builds_up_is_no_dry_one(soft):
    """Assert that friction that no term describes is told, and widens intervals to the truth."""
    assert soft.model_error.share > 0.0
    for name, value in TRUTH.items():
        lower, upper = soft.parameters[name].interval
        assert lower <= value <= upper, name
        assert soft.parameters[name].value == pytest.approx(value, rel=0.04), name


def test_held_torque_is_found_with_friction_that_builds_up(soft):
    """Assert that the torque is still seen to be held."""
    assert soft.choices.hold == "zero"
