"""The flexible joint of eq. (4) and its terms."""

from pathlib import Path

import numpy as np
import pytest

from flexid.errors import SettingError
from flexid.estimators.samples import Samples
from flexid.estimators.state_variable_filter import regressors
from flexid.models.expression import evaluate
from flexid.models.flexible_joint import (
    BACKLASH_WIDTH,
    BEND_DEFLECTION,
    SHAPE_TERMS,
    TERMS,
    TIES,
    flexible_joint,
)
from flexid.models.rigid_joint import rigid_joint
from flexid.models.terms import with_dry_friction

NOTATION = Path(__file__).parents[2] / "docs" / "commands.md"
EVERY = TERMS | SHAPE_TERMS


def test_paper_s_model():
    """Assert that the default is eq. (4) with beta1 unknown."""
    link, motor = flexible_joint().rows
    assert dict(link.regressors) == {"theta1": "-sin(x1)", "theta2": "-(x1 - x3)"}
    assert dict(motor.regressors) == {"alpha1": "x1 - x3", "alpha2": "-x4", "beta1": "u"}


def test_known_coefficient_moves_to_the_known_part():
    """Assert that a known beta1 is a constant of the model and no unknown."""
    system = flexible_joint(known={"beta1": 4.0})
    assert system.coefficients == ("theta1", "theta2", "alpha1", "alpha2")
    assert system.rows[1].known == "beta1*(u)"
    assert system.constants == {"beta1": 4.0}


@pytest.mark.parametrize("term", TERMS)
def test_each_term_adds_its_coefficients(term: str):
    """Assert that a term adds what it declares, and nothing else, to the bare joint."""
    bare = set(flexible_joint(()).coefficients)
    added = set(flexible_joint((term,)).coefficients) - bare
    assert added == {*TERMS[term].link, *TERMS[term].motor}


def along(system, states):
    """Regressors by coefficient along states, without an input."""
    motion = Samples(states[:, ::2], states[:, 1::2], np.zeros((len(states), 1)), 1.0)
    return dict(zip(system.coefficients, regressors(motion, system), strict=True))


def test_an_eccentric_gear_turns_the_torque_as_it_turns_the_angle():
    """Assert that all of its terms together are the spring about a gear that turns by e more.

    With the squares as they follow, the motor has (x1 - x3 - e) (1 + e'), the link x1 - x3 - e.
    """
    sine, cosine, stiffness = 0.03, -0.05, 20.0
    states = np.random.default_rng(5).uniform(-2.0, 2.0, (50, 4))
    joint = flexible_joint(("eccentricity",), known={})
    values = {"theta2": 7.0, "alpha1": stiffness, "beta1": 0.0}
    values |= {"alpha_ecc_sine": stiffness * sine, "alpha_ecc_cosine": stiffness * cosine}
    for name, (a, b, d) in reversed(TIES.items()):
        if "ecc" in name:
            values[name] = values[a] * values[b] / values[d]
    found = along(joint, states)
    torque = {row.name: sum(values[c] * found[c] for c in row.regressors) for row in joint.rows}
    x1, _, x3, _ = states.T
    error = sine * np.sin(x3) + cosine * np.cos(x3)
    slope = sine * np.cos(x3) - cosine * np.sin(x3)
    np.testing.assert_allclose(torque["link"], -7.0 * (x1 - x3 - error), atol=1e-9)
    expected = stiffness * (x1 - x3 - error) * (1.0 + slope)
    np.testing.assert_allclose(torque["motor"], expected, atol=1e-9)


def test_a_spring_bends_where_it_is_said_to():
    """Assert that below the bend nothing acts, and beyond it what is beyond, to either side."""
    joint = flexible_joint(("bent_spring",))
    joint = joint.with_constants({**joint.constants, BEND_DEFLECTION: 0.2})
    deflections = np.array([-0.5, -0.2, -0.1, 0.0, 0.15, 0.2, 0.7])
    states = np.column_stack((deflections, *np.zeros((3, 7))))
    found = along(joint, states)
    np.testing.assert_allclose(found["alpha_bend"], [-0.3, 0, 0, 0, 0, 0, 0.5], atol=1e-9)
    np.testing.assert_allclose(found["theta_bend"], -found["alpha_bend"], atol=1e-9)


REFUSED = {
    "a term": (flexible_joint, ("magnets",), {}, 0.1, "magnets"),
    "a coefficient": (flexible_joint, (), {"beta2": 1.0}, 0.1, "beta2"),
    "a term of the flexible joint": (rigid_joint, ("motor_viscous",), {}, 0.1, "viscous"),
    "a coefficient of the flexible joint": (rigid_joint, (), {"theta1": 1}, 0.1, "theta1"),
    **{
        f"smoothing over {velocity}": (
            *(flexible_joint, ("motor_coulomb",), {}, velocity),
            "coulomb_velocity",
        )
        for velocity in (0.0, -0.1, float("nan"), float("inf"))
    },
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_no_joint_has_is_refused(case: str):
    """Assert that an unknown term or coefficient and an impossible smoothing are named."""
    joint, terms, known, velocity, word = REFUSED[case]
    with pytest.raises(SettingError, match=word):
        joint(terms, known, velocity)


def test_dry_friction_is_the_sign_of_its_row_s_velocity():
    """Assert that dry friction takes the place of the smoothed one, and of nothing else."""
    smooth = flexible_joint(("motor_coulomb", "link_coulomb", "motor_viscous"))
    dry = with_dry_friction(smooth)
    link, motor = dry.rows
    assert (link.regressors["theta_coulomb"], motor.regressors["alpha_coulomb"]) == (
        "-sign(x2)",
        "-sign(x4)",
    )
    assert dry.constants == {}
    others = set(smooth.coefficients) - {"theta_coulomb", "alpha_coulomb"}
    for row, before in zip(dry.rows, smooth.rows, strict=True):
        for name in others & set(row.coefficients):
            assert row.regressors[name] == before.regressors[name]


@pytest.mark.parametrize("term", sorted({*EVERY} - {"eccentricity"}))
def test_terms_of_the_spring_are_tied(term: str):
    """Assert that what acts on both sides of the spring is one torque over each side's inertia."""
    declared = EVERY[term]
    model = flexible_joint((term,))
    values = {x: 0.1 * (i + 1) for i, x in enumerate(model.states)} | {**model.constants, "u": 0.0}
    texts = {name: text for row in model.rows for name, text in row.regressors.items()}
    for name in declared.link if declared.motor else ():
        source, *ratio = TIES[name]
        assert ratio == ["theta2", "alpha1"]
        here, there = (evaluate(texts[one], values, one) for one in (name, source))
        assert here == pytest.approx(-there)


@pytest.mark.parametrize("name", EVERY)
def test_a_term_is_explained(name: str):
    """Assert that a term says what it is, and that the page on notation has its coefficients."""
    declared = NOTATION.read_text(encoding="utf-8")
    assert EVERY[name].description
    assert [c for c in {*EVERY[name].link, *EVERY[name].motor} if f"`{c}`" not in declared] == []


def test_a_spring_with_play_is_a_dead_zone():
    """Assert that the term takes off a spring just what a gap does, where its width is the gap."""
    joint = flexible_joint(("backlash",)).with_constants({BACKLASH_WIDTH: 1e-3})
    deflections = np.linspace(-3e-3, 3e-3, 61)
    states = np.zeros((61, 4))
    states[:, 0] = deflections
    stiffness, half_gap = 250.0, 1e-3
    values = {"theta2": stiffness, "theta_backlash": stiffness * half_gap}
    along_it = along(joint, states)
    found = sum(value * along_it[name] for name, value in values.items())
    beyond = deflections - np.clip(deflections, -half_gap, half_gap)
    assert found == pytest.approx(-stiffness * beyond, abs=1e-12)
