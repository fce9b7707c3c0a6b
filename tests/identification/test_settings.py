"""What a user may set, and what is refused before anything is computed."""

from math import inf, nan

import pytest

from flexid.errors import SettingError
from flexid.identification.joint import flexible, rigid
from flexid.identification.settings import Settings, check_for

REFUSED = {
    "unknown term": ({"terms": ("gravity", "turbulence")}, "turbulence"),
    "unknown coefficient": ({"known": {"stiffness": 3.0}}, "stiffness"),
    "inertia of zero": ({"known": {"motor_inertia": 0.0}}, "no possible value"),
    "negative inertia": ({"known": {"motor_inertia": -1.0}}, "no possible value"),
    "gain of zero": ({"known": {"beta1": 0.0}}, "no possible value"),
    "value that is none": ({"known": {"theta2": nan}}, "no possible value"),
    "negative deviation": (
        {"known": {"theta2": 1.0}, "known_deviations": {"theta2": -1.0}},
        "no standard deviation",
    ),
    "infinite deviation": (
        {"known": {"theta2": 1.0}, "known_deviations": {"theta2": inf}},
        "no standard deviation",
    ),
    "inertia given twice": ({"known": {"motor_inertia": 0.2, "beta1": 5.0}}, "give one of them"),
    "bounds of nothing": ({"bounds": {"stiffness": (0.0, 1.0)}}, "no coefficient"),
    "bounds the wrong way": ({"bounds": {"alpha2": (2.0, 1.0)}}, "not below"),
    "bounds without room": ({"bounds": {"alpha2": (1.0, 1.0)}}, "not below"),
    "bound that is none": ({"bounds": {"alpha2": (nan, 1.0)}}, "not below"),
    "unknown hold": ({"hold": "first"}, "'first' is none of"),
    "coulomb velocity of zero": ({"coulomb_velocity": 0.0}, "coulomb-velocity"),
    "negative filter rate": ({"filter_rate": -3.0}, "filter-rate"),
    "infinite segments": ({"segment_duration": inf}, "segment-duration"),
    "word for a number": ({"segment_duration": "long"}, "segment-duration"),
    "infinite input delay": ({"input_delay": inf}, "input-delay"),
    "link delay that is none": ({"link_delay": nan}, "link-delay"),
    "nothing to validate on": ({"validation_share": 0.0}, "validation-share"),
    "nothing to fit": ({"validation_share": 0.9}, "validation-share"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_used_is_refused(case):
    """Assert that a setting without a meaning is refused with its name or value."""
    settings, words = REFUSED[case]
    with pytest.raises(SettingError, match=words):
        Settings(**settings)


CONTRADICTIONS = {
    "rigid term": (flexible, {"terms": ("viscous",)}, "no term of the flexible joint"),
    "flexible term": (rigid, {"terms": ("motor_viscous",)}, "no term of the rigid joint"),
    "rigid coefficient": (flexible, {"known": {"gamma1": 1.0}}, "no coefficient of the flexible"),
    "flexible bound": (rigid, {"bounds": {"theta2": (0.0, 1.0)}}, "no coefficient of the rigid"),
    "inertia of the motor alone": (rigid, {"known": {"motor_inertia": 0.3}}, "motor and link"),
    "bound of what is off": (
        flexible,
        {"terms": ("gravity",), "bounds": {"alpha2": (0.0, 1.0)}},
        "off: switch it on",
    ),
    "known beyond its bound": (
        flexible,
        {"known": {"theta2": 3.0}, "bounds": {"theta2": (0.0, 1.0)}},
        "lies outside",
    ),
}


@pytest.mark.parametrize("case", CONTRADICTIONS)
def test_what_the_joint_does_not_have_is_refused(case):
    """Assert that a setting that would go unheeded in this joint is refused."""
    joint, settings, words = CONTRADICTIONS[case]
    with pytest.raises(SettingError, match=words):
        check_for(joint(), Settings(**settings))


@pytest.mark.parametrize("term", ["backlash", "torque_saturation", "motor_stribeck"])
def test_terms_beyond_the_usual_ones_may_be_named(term):
    """Assert that a flexible joint takes them, and that a rigid one does not."""
    settings = Settings(terms=("gravity", term))
    check_for(flexible(), settings)
    with pytest.raises(SettingError, match="no term of the rigid joint"):
        check_for(rigid(), settings)


def test_known_inertia_fixes_the_gain():
    """Assert that a motor inertia becomes its inverse, beta1."""
    settings = Settings(known={"motor_inertia": 0.25, "theta2": 100.0})
    assert settings.fixed_coefficients(input_is_torque=True) == {"beta1": 4.0, "theta2": 100.0}


def test_what_is_uncertain_is_not_fixed():
    """Assert that a value with a standard deviation is left to the fit."""
    settings = Settings(
        known={"theta2": 100.0, "alpha1": 300.0}, known_deviations={"theta2": 5.0, "alpha1": 0.0}
    )
    assert settings.fixed_coefficients(input_is_torque=True) == {"alpha1": 300.0}


def test_known_inertia_needs_a_torque():
    """Assert that a motor inertia is refused where the input's gain is unknown too."""
    with pytest.raises(SettingError, match="voltage or current"):
        Settings(known={"motor_inertia": 0.25}).fixed_coefficients(input_is_torque=False)
