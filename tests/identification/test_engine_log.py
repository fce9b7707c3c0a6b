"""`identify` on logs of MuJoCo, whose friction is not flexid's."""

import pytest
from engine_log import TRUTH, engine_log

from flexid.identification.identify import identify
from flexid.recording.recording import Log


@pytest.fixture(scope="module", params=[0, 10])
def result(request):
    """Thirty seconds with 14-bit encoders, held torque, dry friction, unknown motor inertia."""
    return identify([Log((engine_log(request.param),), (), "engine", "")])


def test_every_parameter_is_within_one_percent(result):
    """Assert that friction and damping are recovered as well as inertias and stiffness."""
    for name, value in TRUTH.items():
        assert result.parameters[name].value == pytest.approx(value, rel=0.01), name


def test_every_parameter_is_determined(result):
    """Assert that nothing is doubted in a log that tells everything."""
    assert {result.parameters[name].status for name in TRUTH} == {"determined"}


def test_friction_that_holds_is_found(result):
    """Assert that the engine's friction is told from Coulomb's by the free run."""
    assert "motor_stiction" in result.choices.terms
    assert result.choices.stopping_time == pytest.approx(9.5e-3, rel=0.03)


def test_held_torque_is_found(result):
    """Assert that the torque is seen to be held over each sample, without any delay."""
    assert result.choices.hold == "zero"
    assert result.choices.alignment.input_delay.value == 0.0
