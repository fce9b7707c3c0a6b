"""The flexible joint of eq. (4), its terms, and models derived from it."""

from functools import partial
from math import inf, nan
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy as sp

from flexid.models.flexible_joint import (
    RIGID_TERMS,
    SHAPE_TERMS,
    TERMS,
    flexible_joint,
    rigid_joint,
    rigid_terms,
    row_alone,
)
from flexid.models.physical import joint_coefficients
from flexid.simulation.free_run import free_run

NOTATION = Path(__file__).parents[2] / "docs" / "commands.md"
EVERY = TERMS | SHAPE_TERMS


def test_paper_s_model():
    """Assert that the default is eq. (4), and that a known beta1 becomes a constant."""
    link, motor = flexible_joint().rows
    assert dict(link.regressors) == {"theta1": "-sin(x1)", "theta2": "-(x1 - x3)"}
    assert dict(motor.regressors) == {"alpha1": "x1 - x3", "alpha2": "-x4", "beta1": "u"}
    system = flexible_joint(known={"beta1": 4.0})
    assert system.coefficients == ("theta1", "theta2", "alpha1", "alpha2")
    assert system.rows[1].known == "beta1*(u)"
    assert system.constants == {"beta1": 4.0}


def test_what_no_joint_has_is_refused(refusals: Any):
    """Assert that unknown terms and coefficients, and invalid smoothing, are refused."""
    smoothed = partial(flexible_joint, ("motor_coulomb",), {})
    refusals(
        {
            "a term": partial(flexible_joint, ("magnets",)),
            "a coefficient": partial(flexible_joint, (), {"beta2": 1.0}),
            "a term of the flexible joint": partial(rigid_joint, ("motor_viscous",)),
            "a coefficient of the flexible joint": partial(rigid_joint, (), {"theta1": 1}),
            **{f"smoothing over {v}": partial(smoothed, v) for v in (0.0, -0.1, nan, inf)},
        }
    )


@pytest.mark.parametrize("name", EVERY)
def test_a_term_is_explained(name: str):
    """Assert that a term has a description, and its coefficients are on the page on notation."""
    declared = NOTATION.read_text(encoding="utf-8")
    assert EVERY[name].description
    assert [c for c in {*EVERY[name].link, *EVERY[name].motor} if f"`{c}`" not in declared] == []


def test_an_error_of_the_transmission_does_no_work():
    """Assert that its torques are the slopes of an energy, up to the error's square."""
    x1, x3, size = sp.symbols("x1 x3 size")
    term = SHAPE_TERMS["transmission_error"]
    names = {"x1": x1, "x3": x3} | {n: sp.Symbol(n) for n in ("error_number", "angle_origin")}
    for link, motor in zip(term.link.values(), term.motor.values(), strict=True):
        on_link, on_motor = (
            sp.parse_expr(text, {**names, "spring_centre": sp.S.Zero}) for text in (link, motor)
        )
        energy = (x1 - x3 - size * on_link) ** 2 / 2  # of a spring of unit stiffness
        for place, torque in ((x1, on_link), (x3, on_motor)):
            slope = sp.diff(-sp.diff(energy, place), size).subs(size, 0)
            assert sp.simplify(slope - torque) == 0


def test_limit_of_the_flexible_joint():
    """Assert that a very stiff joint moves as the rigid joint with the sum of inertias."""
    t = 2e-3 * np.arange(1000)
    u = (4.0 * np.sin(3 * t) + 1.0)[:, None]
    motor = {"motor_inertia": 0.3, "motor_viscous_friction": 0.2, "motor_coulomb_friction": 0.4}
    motor |= {"motor_offset_torque": 0.1}
    link = {"link_inertia": 1.0, "joint_stiffness": 1e6, "gravity_torque": 5.0}
    soft = joint_coefficients(motor | link) | {"theta_cosine": 1.0}
    terms = ("gravity", "gravity_cosine", "motor_viscous", "motor_coulomb", "motor_offset")
    torques = {"gamma1": 5.0, "gamma_cosine": 1.0, "gamma_viscous": 0.2, "gamma_coulomb": 0.4}
    torques |= {"gamma_offset": 0.1, "beta1": 1.0}
    hard = {name: torque / 1.3 for name, torque in torques.items()}
    flexible = free_run(flexible_joint(terms), soft, np.zeros(4), u, 2e-3)
    rigid = free_run(rigid_joint(rigid_terms(terms)), hard, np.zeros(2), u, 2e-3)
    np.testing.assert_allclose(flexible[:, 2], rigid[:, 0], atol=2e-5)


def test_every_term_of_the_flexible_joint_is_placed():
    """Assert that terms map to all rigid terms but one, and terms of the spring to none."""
    assert {*RIGID_TERMS} - {*rigid_terms(TERMS)} == {"viscous_asymmetry"}
    assert rigid_terms(("joint_damping", "cubic_stiffness")) == ()


def test_a_row_alone():
    """Assert that the row is unchanged, without constants that only the other row uses."""
    joint = flexible_joint(tuple(TERMS), {"theta2": 100.0})
    alone = row_alone(joint, "link")
    assert (alone.rows, alone.states) == ((joint.rows[0],), ("x1", "x2"))
    known = {"theta2": 100.0, "beta1": 3.0}
    joint = flexible_joint(("gravity", "motor_coulomb"), known, 0.05)
    assert row_alone(joint, "link").constants == {"theta2": 100.0}
    assert row_alone(joint, "motor").constants == {"beta1": 3.0, "coulomb_velocity": 0.05}
