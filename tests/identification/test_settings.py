"""What a user may set, and what is refused before anything is computed."""

from math import inf, nan

import pytest

from flexid.errors import SettingError
from flexid.identification.preparation.joint import flexible, rigid
from flexid.identification.preparation.settings import Settings, check_against, check_for

REFUSED = {
    "unknown model": ({"model": "elastic"}, "flexible"),
    "unknown term": ({"terms": ("gravity", "turbulence")}, "turbulence"),
    "unknown coefficient": ({"known": {"stiffness": 3.0}}, "stiffness"),
    "inertia of zero": ({"known": {"motor_inertia": 0.0}}, "no possible value"),
    "gain of zero": ({"known": {"beta1": 0.0}}, "above zero"),
    "value that is none": ({"known": {"theta2": nan}}, "no possible value"),
    "negative deviation": (
        {"known": {"theta2": 1.0}, "known_deviations": {"theta2": -1.0}},
        "no standard deviation",
    ),
    "tiny inertia": ({"known": {"motor_inertia": 1e-320}}, "no possible value"),
    "huge stiffness": ({"known": {"joint_stiffness": 1e200}}, "no possible value"),
    "spring of zero": ({"known": {"joint_stiffness": 0.0}}, "above zero"),
    "huge deviation": (
        {"known": {"theta2": 1.0}, "known_deviations": {"theta2": 1e200}},
        "no standard deviation",
    ),
    "huge bound": ({"bounds": {"alpha2": (1e308, inf)}}, "no possible value"),
    "bounds below zero": ({"bounds": {"link_inertia": (-2.0, -1.0)}}, "above zero"),
    "bounds of nothing": ({"bounds": {"stiffness": (0.0, 1.0)}}, "no parameter or coefficient"),
    "bounds the wrong way": ({"bounds": {"alpha2": (2.0, 1.0)}}, "not below"),
    "bound that is none": ({"bounds": {"alpha2": (nan, 1.0)}}, "not below"),
    "unknown hold": ({"hold": "first"}, "'first' is none of"),
    "coulomb velocity of zero": ({"coulomb_velocity": 0.0}, "coulomb_velocity"),
    "coulomb velocity of next to nothing": ({"coulomb_velocity": 1e-300}, "outside 1e-06 to 100"),
    "huge coulomb velocity": ({"coulomb_velocity": 101.0}, "outside 1e-06 to 100 rad/s"),
    "negative filter rate": ({"filter_rate": -3.0}, "filter_rate"),
    "infinite segments": ({"segment_duration": inf}, "segment_duration"),
    "word for a number": ({"segment_duration": "long"}, "segment_duration"),
    "infinite input delay": ({"input_delay": inf}, "input_delay"),
    "link delay that is none": ({"link_delay": nan}, "link_delay"),
    "nothing to validate on": ({"validation_share": 0.0}, "validation_share"),
    "nothing to fit": ({"validation_share": 0.9}, "validation_share"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_used_is_refused(case):
    """Assert that a setting without a meaning is refused with its name or value."""
    settings, words = REFUSED[case]
    with pytest.raises(SettingError, match=words):
        Settings(**settings)


OTHER_TERMS = {
    "rigid term": (flexible, {"terms": ("viscous",)}, "no term of the flexible joint"),
    "flexible term": (rigid, {"terms": ("motor_viscous",)}, "no term of the rigid joint"),
    "inertia of the motor alone": (rigid, {"known": {"motor_inertia": 0.3}}, "motor and link"),
}


@pytest.mark.parametrize("case", OTHER_TERMS)
def test_what_the_joint_does_not_have_is_refused(case):
    """Assert that a setting that would go unheeded in this joint is refused."""
    joint, settings, words = OTHER_TERMS[case]
    with pytest.raises(SettingError, match=words):
        check_for(joint(), Settings(**settings))


@pytest.mark.parametrize("term", ["backlash", "torque_saturation", "motor_stribeck"])
def test_terms_beyond_the_usual_ones_may_be_named(term):
    """Assert that a flexible joint takes them, and that a rigid one does not."""
    settings = Settings(terms=("gravity", term))
    check_for(flexible(), settings)
    with pytest.raises(SettingError, match="no term of the rigid joint"):
        check_for(rigid(), settings)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"segment_duration": 1e-9}, "less than 20 samples"),
        ({"filter_rate": 501.0}, "does not suit samples every 0.001 s"),
        ({"input_delay": 5.0}, "a tenth of the log"),
        ({"link_delay": -1e3}, "a tenth of the log"),
    ],
)
def test_what_a_log_gives_no_meaning_to_is_refused(settings, words):
    """Assert that segments, filters and delays that the samples cannot show are refused."""
    with pytest.raises(SettingError, match=words):
        check_against(Settings(**settings), 1e-3, 20.0)


def test_what_a_log_can_show_is_taken():
    """Assert that numbers at the edge of what the samples show pass."""
    usable = Settings(segment_duration=30.0, filter_rate=499.0, input_delay=2.0, link_delay=-2.0)
    check_against(usable, 1e-3, 20.0)
    assert usable.given_delay == 2.0
    assert Settings().given_delay == 0.0
