"""The model of the joint that is asked for: some channels of the log are left aside."""

from dataclasses import replace

import pytest
from made_joint import log, made

from flexid.errors import SettingError
from flexid.identification.identify import identify
from flexid.identification.preparation.recordings import prepare
from flexid.identification.preparation.settings import Settings
from flexid.recording.recording import Log

SHARE = 1 / 3


def recorded(*left_out: str) -> Log:
    """A short log, without some channels."""
    unit = {"input_unit": ""} if "input" in left_out else {}
    return log(replace(made(1, 6.0), **dict.fromkeys(left_out), **unit))


def test_link_is_that_of_a_log_without_input():
    """Assert that the link alone comes out to the bit as if no torque had been recorded."""
    asked = identify([recorded()], Settings(model="link"))
    alone = identify([recorded("input")])
    assert asked.model == "link"
    assert {n: c.value for n, c in asked.coefficients.items()} == {
        n: c.value for n, c in alone.coefficients.items()
    }
    assert asked.provenance["settings"]["model"] == "link"  # type: ignore[index]
    assert "the link alone, as the settings say, with" in asked.summary[0]
    assert "the link alone, since the log has no input, with" in alone.summary[0]


def test_rigid_takes_the_motors_encoder_alone():
    """Assert that the link's channels are left aside, and the input is not."""
    (kept,) = prepare([recorded()], SHARE, "rigid")[0].recorded
    assert kept.link_position is None
    assert kept.link_velocity is None
    assert kept.input is not None


def test_flexible_takes_all_there_is():
    """Assert that naming the model that a log shows changes nothing."""
    whole = recorded()
    assert prepare([whole], SHARE, "flexible")[0].recorded == prepare([whole], SHARE)[0].recorded


@pytest.mark.parametrize(
    ("left_out", "model", "says"),
    [
        ("input", "flexible", "has no input, which flexible needs: give link"),
        ("input", "rigid", "has no input, which rigid needs: give link"),
        ("link_position", "flexible", "has no link position, which flexible needs: give rigid"),
        ("link_position", "link", "has no link position, which link needs: give rigid"),
    ],
)
def test_what_a_model_needs_is_asked_for(left_out, model, says):
    """Assert that a model without its channels is refused, with one that the log has."""
    with pytest.raises(SettingError, match=says):
        prepare([recorded(left_out)], SHARE, model)
