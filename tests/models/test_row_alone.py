"""One row of a joint with the other side's motion as its input."""

from flexid.models.flexible_joint import TERMS, flexible_joint
from flexid.models.row_alone import row_alone


def test_inputs_are_the_other_rows_states_and_what_is_used():
    """Assert that the link is driven by the motor's motion alone, the motor by both."""
    joint = flexible_joint(tuple(TERMS))
    assert row_alone(joint, "link").inputs == ("x3", "x4")
    assert row_alone(joint, "motor").inputs == ("x1", "x2", "u")


def test_row_stays_as_it_is():
    """Assert that states, coefficients and expressions are those of the joint's row."""
    joint = flexible_joint(tuple(TERMS), {"theta2": 100.0})
    alone = row_alone(joint, "link")
    assert alone.rows == (joint.rows[0],)
    assert alone.states == ("x1", "x2")


def test_constants_that_only_the_other_row_uses_go():
    """Assert that a known coefficient of the other row is no constant of this one."""
    known = {"theta2": 100.0, "beta1": 3.0}
    joint = flexible_joint(("gravity", "motor_coulomb"), known, 0.05)
    assert row_alone(joint, "link").constants == {"theta2": 100.0}
    assert row_alone(joint, "motor").constants == {"beta1": 3.0, "coulomb_velocity": 0.05}
