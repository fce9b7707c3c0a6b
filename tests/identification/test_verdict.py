"""The verdict on a coefficient: which evidence decides."""

import numpy as np
import pytest

from flexid.analysis.excitation import Excitation
from flexid.identification.verdict import verdict, worst

GOOD_FIT = {"link_position": 95.0, "motor_position": 95.0, "deflection": 90.0}


def excited(condition=2.0, confounded=("theta1", "theta2")):
    """An excitation with a given condition number."""
    return Excitation(
        "link",
        ("theta1", "theta2"),
        np.array([1.0, 1.0 / condition]),
        1.0,
        confounded,
        0.5,
        ("theta1", "theta2"),
    )


@pytest.mark.parametrize(
    ("std", "expected"),
    [(0.1, "determined"), (0.3, "weak"), (0.8, "undetermined"), (np.inf, "undetermined")],
)
def test_interval_decides(std, expected):
    """Assert that the relative standard deviation decides where all else is well."""
    assert verdict("theta1", 1.0, std, 0.5, excited(), GOOD_FIT)[0] == expected


def test_negligible_term_is_determined():
    """Assert that a friction known to be nearly zero counts as known."""
    assert verdict("alpha2", 0.001, 0.01, 0.001, excited(), GOOD_FIT) == ("determined", "")


@pytest.mark.parametrize(
    ("condition", "expected"), [(500, "determined"), (5e3, "weak"), (5e5, "undetermined")]
)
def test_excitation_decides(condition, expected):
    """Assert that a narrow interval does not help a coefficient in a lost direction."""
    status, reason = verdict("theta1", 1.0, 1e-6, 1e-6, excited(condition), GOOD_FIT)
    assert status == expected
    assert ("theta2" in reason) == (expected != "determined")


def test_excitation_spares_the_others():
    """Assert that a coefficient outside the lost direction keeps its verdict."""
    poor = excited(1e7, confounded=("theta2", "theta3"))
    assert verdict("theta1", 1.0, 1e-3, 1e-3, poor, GOOD_FIT)[0] == "determined"


@pytest.mark.parametrize(
    ("deflection", "expected"), [(80.0, "determined"), (30.0, "weak"), (-5.0, "undetermined")]
)
def test_validation_decides_on_stiffness(deflection, expected):
    """Assert that a model that does not repeat the deflection knows no stiffness."""
    fit = {**GOOD_FIT, "deflection": deflection}
    assert verdict("theta2", 1.0, 1e-3, 1e-3, excited(), fit)[0] == expected
    assert verdict("theta1", 1.0, 1e-3, 1e-3, excited(), fit)[0] == "determined"


def test_parameter_is_as_bad_as_its_worst_coefficient():
    """Assert that the worst of several verdicts wins, in any order."""
    assert worst(["determined", "undetermined", "weak"]) == "undetermined"
    assert worst(["weak", "determined"]) == "weak"
