"""The verdict on a coefficient: which evidence decides."""

import numpy as np
import pytest

from flexid.analysis.excitation import Excitation
from flexid.identification.verdict import Evidence, verdict, worst


def judged(
    name="theta1",
    value=1.0,
    std=1e-3,
    shift=0.0,
    moving=None,
    size=0.5,
    residual_excess=1.0,
    condition=2.0,
    direction=(1.0, -1.0, 0.0),
    link=95.0,
    deflection=90.0,
    doubt=0.0,
):
    """Verdict on a coefficient of a row of four, of which two share the worst direction."""
    names = ("theta1", "theta2", "theta3", "theta4")
    excitation = Excitation(
        "link",
        names[:3],  # theta4 is known beforehand
        np.array([1.0, 1.0, 1.0 / condition]),
        1.0,
        ("theta1", "theta2"),
        np.array(direction),
        0.5,
        ("theta1", "theta2"),
    )
    values = {**dict.fromkeys(names, 1.0), name: value}
    fits = {"link_position": link, "motor_position": -10.0, "deflection": deflection}
    row = Evidence(
        values,
        {**dict.fromkeys(names, 1e-3), name: std},
        {**dict.fromkeys(names, 0.0), moving or name: shift},
        dict.fromkeys(names, size),
        residual_excess,
        excitation,
        fits,
        doubt,
    )
    return verdict(name, row)


@pytest.mark.parametrize(
    ("std", "expected"),
    [(0.1, "determined"), (0.3, "weak"), (0.8, "undetermined"), (np.inf, "undetermined")],
)
def test_interval_decides(std, expected):
    """Assert that the relative standard deviation decides where all else is well."""
    assert judged(std=std)[0] == expected


def test_negligible_term_is_determined():
    """Assert that a friction known to be nearly zero counts as known."""
    assert judged(value=0.001, std=0.01, size=0.1) == ("determined", "")


@pytest.mark.parametrize(
    ("condition", "expected"), [(500, "determined"), (5e3, "weak"), (5e5, "undetermined")]
)
def test_excitation_decides(condition, expected):
    """Assert that a narrow interval does not help a coefficient in a lost direction."""
    status, reason = judged(std=1e-6, condition=condition)
    assert status == expected
    assert ("theta2" in reason) == (expected != "determined")


def test_excitation_spares_the_others():
    """Assert that a coefficient that a lost direction does not touch keeps its verdict."""
    assert judged("theta3", condition=1e7) == ("determined", "")


def test_small_coefficient_is_tainted_by_a_lost_direction():
    """Assert that a coefficient of little weight in a lost direction is lost if its value is small.

    A step that doubles theta1 unseen changes theta3 by 0.01: nothing beside 1, all beside 0.02.
    """
    touched = {"name": "theta3", "condition": 1e7, "direction": (1.0, -1.0, 0.01)}
    assert judged(value=1.0, **touched)[0] == "determined"
    assert judged(value=0.02, std=1e-6, **touched)[0] == "undetermined"


@pytest.mark.parametrize(
    ("shift", "expected"), [(0.04, "determined"), (0.2, "weak"), (2.0, "weak")]
)
def test_shift_with_the_filter_decides(shift, expected):
    """Assert that a coefficient that depends on the filter rate is not called known."""
    status, reason = judged(shift=shift)
    assert status == expected
    assert ("estimated" in reason) == (expected != "determined")


@pytest.mark.parametrize(("size", "expected"), [(0.5, "weak"), (0.05, "determined")])
def test_a_moving_neighbour_makes_a_row_weak(size, expected):
    """Assert that a coefficient is weak if another of its row moves, unless that moves little."""
    status, reason = judged("theta1", shift=0.2, moving="theta3", size=size)
    assert status == expected
    assert ("theta3" in reason) == (expected == "weak")


@pytest.mark.parametrize(("excess", "expected"), [(4.0, "determined"), (9.0, "weak")])
def test_residual_decides(excess, expected):
    """Assert that a row that leaves far more than noise explains is not called known."""
    status, reason = judged(residual_excess=excess)
    assert status == expected
    assert ("noise" in reason) == (expected == "weak")


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        ("theta2", -1.0, "undetermined"),
        ("theta2", 1.0, "determined"),
        ("theta1", -1.0, "determined"),
    ],
)
def test_sign_decides(name, value, expected):
    """Assert that a negative spring is not called known; gravity may have either sign."""
    assert judged(name, value)[0] == expected


@pytest.mark.parametrize(
    ("deflection", "stiffness", "beside"),
    [
        (80.0, "determined", "determined"),
        (30.0, "weak", "determined"),
        (6.0, "undetermined", "weak"),
        (-5.0, "undetermined", "weak"),
        (np.nan, "determined", "determined"),
    ],
)
def test_validation_decides_on_stiffness(deflection, stiffness, beside):
    """Assert that a model that does not repeat the deflection knows no stiffness.

    And that it knows what stands beside the stiffness weakly at best.
    """
    assert judged("theta2", deflection=deflection)[0] == stiffness
    assert judged("theta1", deflection=deflection)[0] == beside


@pytest.mark.parametrize(
    ("link", "expected"),
    [
        (80.0, "determined"),
        (30.0, "weak"),
        (-np.inf, "undetermined"),
        (np.nan, "determined"),
    ],
)
def test_validation_decides_on_a_row(link, expected):
    """Assert that a row whose motion the model does not repeat knows none of its coefficients.

    The other row's motion, which the model here never repeats, does not matter to it.
    """
    assert judged("theta1", link=link)[0] == expected


@pytest.mark.parametrize(
    ("doubt", "expected"), [(0.05, "determined"), (0.2, "weak"), (0.8, "undetermined")]
)
def test_alignment_decides_on_stiffness(doubt, expected):
    """Assert that a stiffness whose deflection a delay could make is not called known."""
    assert judged("theta2", doubt=doubt)[0] == expected
    assert judged("theta1", doubt=doubt)[0] == "determined"


def test_excitation_spares_what_is_known_beforehand():
    """Assert that a coefficient that the excitation leaves out, as known, is not confounded."""
    assert judged("theta4", condition=1e7)[0] == "determined"


def test_parameter_is_as_bad_as_its_worst_coefficient():
    """Assert that the worst of several verdicts wins, in any order."""
    assert worst(["determined", "undetermined", "weak"]) == "undetermined"
    assert worst(["weak", "determined"]) == "weak"
