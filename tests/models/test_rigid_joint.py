"""What is made of the flexible joint: the rigid joint, and one row alone."""

import numpy as np

from flexid.models.flexible_joint import TERMS, flexible_joint
from flexid.models.rigid_joint import RIGID_TERMS, rigid_joint, rigid_terms, row_alone
from flexid.simulation.free_run import free_run


def test_limit_of_the_flexible_joint():
    """Assert that a joint of great stiffness moves as the rigid joint of the summed inertias."""
    t = 2e-3 * np.arange(1000)
    u = (4.0 * np.sin(3 * t) + 1.0)[:, None]
    link, motor, stiffness = 1.0, 0.3, 1e6
    total = link + motor
    soft = {
        "theta1": 5.0 / link,
        "theta2": stiffness / link,
        "theta_cosine": 1.0 / link,
        "alpha1": stiffness / motor,
        "alpha2": 0.2 / motor,
        "beta1": 1 / motor,
        "alpha_coulomb": 0.4 / motor,
        "alpha_offset": 0.1 / motor,
    }
    terms = ("gravity", "gravity_cosine", "motor_viscous", "motor_coulomb", "motor_offset")
    hard = {
        "gamma1": 5.0 / total,
        "gamma_cosine": 1.0 / total,
        "gamma_viscous": 0.2 / total,
        "gamma_coulomb": 0.4 / total,
        "gamma_offset": 0.1 / total,
        "beta1": 1 / total,
    }
    flexible = free_run(flexible_joint(terms), soft, np.zeros(4), u, 2e-3)
    rigid = free_run(rigid_joint(rigid_terms(terms)), hard, np.zeros(2), u, 2e-3)
    np.testing.assert_allclose(flexible[:, 2], rigid[:, 0], atol=2e-5)


def test_every_term_of_the_flexible_joint_is_placed():
    """Assert that all terms map to all rigid ones but one, and those of the spring to none."""
    assert {*RIGID_TERMS} - {*rigid_terms(TERMS)} == {"viscous_asymmetry"}
    assert rigid_terms(("joint_damping", "cubic_stiffness")) == ()


def test_a_row_alone():
    """Assert that it is the joint's row as it was, without constants that only the other uses."""
    joint = flexible_joint(tuple(TERMS), {"theta2": 100.0})
    alone = row_alone(joint, "link")
    assert (alone.rows, alone.states) == ((joint.rows[0],), ("x1", "x2"))
    known = {"theta2": 100.0, "beta1": 3.0}
    joint = flexible_joint(("gravity", "motor_coulomb"), known, 0.05)
    assert row_alone(joint, "link").constants == {"theta2": 100.0}
    assert row_alone(joint, "motor").constants == {"beta1": 3.0, "coulomb_velocity": 0.05}
