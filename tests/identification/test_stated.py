"""What is stated of physical parameters, in terms of coefficients; and what excludes itself."""

from dataclasses import replace
from math import inf, isclose

import numpy as np
import pytest

from flexid.errors import SettingError
from flexid.identification.estimation.knowledge import with_prior_knowledge
from flexid.identification.preparation.joint import flexible, rigid
from flexid.identification.preparation.settings import Settings
from flexid.identification.preparation.stated import stated
from flexid.identification.vocabulary.estimate import Estimate
from flexid.identification.vocabulary.thresholds import THRESHOLDS

JOINT = flexible()


def of(known=None, deviations=None, bounds=None, joint=JOINT, unit="N m", **settings):
    """Return what some settings state of a joint."""
    made = Settings(
        known=known or {}, known_deviations=deviations or {}, bounds=bounds or {}, **settings
    )
    return stated(made, joint, unit)


@pytest.mark.parametrize(
    ("known", "given"),
    [
        ({"motor_inertia": 0.25, "theta2": 100.0}, {"beta1": 4.0, "theta2": 100.0}),
        ({"joint_stiffness": 100.0, "motor_inertia": 0.25}, {"alpha1": 400.0, "beta1": 4.0}),
        ({"motor_inertia": 0.25, "joint_stiffness": 100.0}, {"alpha1": 400.0, "beta1": 4.0}),
        ({"joint_stiffness": 100.0, "link_inertia": 2.0}, {"theta2": 50.0}),
        ({"link_inertia": 2.0, "joint_stiffness": 100.0}, {"theta2": 50.0}),
        ({"joint_stiffness": 100.0, "alpha1": 400.0}, {"alpha1": 400.0, "beta1": 4.0}),
        ({"motor_viscous_friction": 0.0}, {"alpha2": 0.0}),
        (
            {"link_inertia": 2.0, "motor_inertia": 0.5, "joint_stiffness": 100.0},
            {"beta1": 2.0, "alpha1": 200.0, "theta2": 50.0},
        ),
    ],
)
def test_known_parameters_fix_coefficients(known, given):
    """Assert that what follows from known parameters is given, in whichever order they stand."""
    found = of(known).given
    assert found.keys() == given.keys()
    assert all(isclose(found[name], value) for name, value in given.items())


def test_what_is_left_to_the_fit():
    """Assert that a stiffness alone stays a condition on two coefficients.

    A value with a standard deviation is not fixed.
    """
    found = of({"joint_stiffness": 100.0})
    assert found.given == {}
    assert [(k.name, k.value, k.std) for k in found.known] == [("joint_stiffness", 100.0, 0.0)]
    assert found.kept == {"alpha1", "beta1"}
    found = of({"theta2": 100.0, "alpha1": 300.0}, {"theta2": 5.0, "alpha1": 0.0})
    assert found.given == {"alpha1": 300.0}
    assert [k.name for k in found.known] == ["theta2"]


@pytest.mark.parametrize(
    ("known", "bounds", "expected"),
    [
        ({}, {"motor_inertia": (0.2, 0.5)}, {"beta1": (2.0, 5.0)}),
        ({}, {"motor_inertia": (0.2, inf)}, {"beta1": (0.0, 5.0)}),
        ({}, {"motor_inertia": (-inf, 0.5)}, {"beta1": (2.0, inf)}),
        ({"motor_inertia": 0.5}, {"joint_stiffness": (50.0, 200.0)}, {"alpha1": (100.0, 400.0)}),
        ({"joint_stiffness": 60.0, "motor_inertia": 0.5}, {"link_inertia": (1.0, 3.0)},
         {"theta2": (20.0, 60.0)}),
        ({}, {"beta1": (1.0, 4.0), "motor_inertia": (0.5, 2.0)}, {"beta1": (1.0, 2.0)}),
        ({"motor_inertia": 0.5}, {"motor_viscous_friction": (0.0, inf)}, {"alpha2": (0.0, inf)}),
    ],
)  # fmt: skip
def test_bounds_of_one_unknown_are_bounds_of_its_coefficient(known, bounds, expected):
    """Assert that bounds are the fit's own where all other coefficients are known."""
    found = of(known, bounds=bounds)
    assert found.within == {}
    assert found.bounds.keys() == expected.keys()
    for name, ends in expected.items():
        assert found.bounds[name] == pytest.approx(ends)


REFUSED = {
    "known twice": ({"motor_inertia": 0.2, "beta1": 5.0}, {}, {}, "leave it out"),
    "known otherwise": ({"motor_inertia": 0.2, "beta1": 6.0}, {}, {}, "that makes it 5"),
    "known by two others": (
        {"motor_inertia": 0.2, "joint_stiffness": 50.0, "alpha1": 300.0}, {}, {}, "it 250",
    ),
    "uncertain beside exact": (
        {"beta1": 5.0, "motor_inertia": 0.2}, {"motor_inertia": 0.1}, {}, "leave it out",
    ),
    "bound beside what it excludes": (
        {"motor_inertia": 0.3}, {}, {"beta1": (5.0, 6.0)}, "lies outside 5:6",
    ),
    "bound of the same": ({"theta2": 3.0}, {}, {"theta2": (0.0, 1.0)}, "lies outside"),
    "bound beside an uncertain value": (
        {"motor_inertia": 0.3}, {"motor_inertia": 0.01}, {"beta1": (5.0, 6.0)}, "lies outside 5:6",
    ),
    "bound of an uncertain stiffness": (
        {"joint_stiffness": 30.0}, {"joint_stiffness": 1.0}, {"joint_stiffness": (50.0, 60.0)},
        "lies outside 50:60",
    ),
    "bounds without room": (
        {}, {}, {"motor_inertia": (0.1, 0.2), "beta1": (1.0, 2.0)}, "no room",
    ),
    "rigid coefficient": ({"gamma1": 1.0}, {}, {}, "have no gamma1"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_statements_that_exclude_each_other_are_refused(case):
    """Assert that what contradicts or repeats itself is refused, never ignored."""
    known, deviations, bounds, words = REFUSED[case]
    with pytest.raises(SettingError, match=words):
        of(known, deviations, bounds)


def test_what_a_model_does_not_have_is_refused():
    """Assert that bounds of a term that is off are refused, and an inertia of a log in volts.

    A rigid joint has parameters of its own.
    """
    with pytest.raises(SettingError, match="have no alpha2"):
        of(bounds={"alpha2": (0.0, 1.0)}, terms=("gravity",))
    assert of({"joint_stiffness_per_link_inertia": 3.0}, unit="V").given == {"theta2": 3.0}
    with pytest.raises(SettingError, match="needs a torque"):
        of({"motor_inertia": 0.25}, unit="V")
    found = of({"inertia": 0.25}, bounds={"viscous_friction": (0.0, 1.0)}, joint=rigid())
    assert (found.given, found.bounds) == ({"beta1": 4.0}, {"gamma_viscous": (0.0, 4.0)})


ESTIMATE = Estimate(
    ("theta2", "alpha1", "beta1"),
    np.array([50.0, 300.0, 3.0]),
    np.array([[4.0, 3.0, 0.0], [3.0, 9.0, 0.02], [0.0, 0.02, 0.0009]]),
    (np.inf, np.inf, np.inf),
)


def joined(thresholds=THRESHOLDS, **statements):
    """Join statements to a stiffness of 100 N m/rad and a link inertia of 2 kg m²."""
    return with_prior_knowledge(JOINT, ESTIMATE, {}, of(**statements), "N m", thresholds)


def constrained(conditions):
    """Return the minimum of the quadratic form under conditions, by another way."""
    from scipy.optimize import minimize

    inverse = np.linalg.inv(ESTIMATE.covariance)
    scale = ESTIMATE.values

    def cost(relative):
        apart = (relative - 1.0) * scale
        return float(apart @ inverse @ apart)

    constraints = [
        {"type": kind, "fun": lambda relative, f=function: f(relative * scale)}
        for kind, function in conditions
    ]
    found = minimize(cost, np.ones(3), constraints=constraints, method="SLSQP", tol=1e-14)
    return found.x * scale


def test_a_known_stiffness_is_the_constrained_minimum():
    """Assert that an exactly known stiffness gives the minimum under that condition."""
    found = joined(known={"joint_stiffness": 102.0})
    expected = constrained([("eq", lambda p: p[1] / p[2] - 102.0)])
    assert found.estimate.values == pytest.approx(expected, rel=1e-5)
    assert found.exact == {"joint_stiffness": (102.0, "given")}
    assert found.contradicted == ()


@pytest.mark.parametrize(
    ("bounds", "active", "conditions"),
    [
        ({"joint_stiffness": (90.0, 120.0)}, {}, []),
        (
            {"joint_stiffness": (101.0, 120.0)},
            {"joint_stiffness": (101.0, "at its bound")},
            [("ineq", lambda p: p[1] / p[2] - 101.0)],
        ),
        (
            {"joint_stiffness": (0.0, 99.0), "link_inertia": (2.04, inf)},
            {"joint_stiffness": (99.0, "at its bound"), "link_inertia": (2.04, "at its bound")},
            [("ineq", lambda p: 99.0 - p[1] / p[2]), ("ineq", lambda p: p[1] / p[2] / p[0] - 2.04)],
        ),
        (  # the second bound is broken at first, and kept once the first holds
            {"joint_stiffness": (103.0, inf), "link_inertia": (-inf, 1.99)},
            {"joint_stiffness": (103.0, "at its bound")},
            [
                ("ineq", lambda p: p[1] / p[2] - 103.0),
                ("ineq", lambda p: 1.99 - p[1] / p[2] / p[0]),
            ],
        ),
    ],
)
def test_bounds_of_functions_give_the_minimum_within_them(bounds, active, conditions):
    """Assert that the estimate is the least sum of squares within bounds, and says which hold."""
    found = joined(bounds=bounds)
    assert found.estimate.values == pytest.approx(constrained(conditions), rel=1e-4)
    assert found.exact == active


def test_what_the_log_contradicts_is_said_of_bounds_too():
    """Assert that a bound far from what the log says is a contradiction, in a bound's words."""
    (sentence,) = joined(bounds={"joint_stiffness": (150.0, 200.0)}).contradicted
    assert sentence.startswith("joint_stiffness is bounded by 150, which contradicts the log")
    (sentence,) = joined(known={"joint_stiffness": 150.0}).contradicted
    assert sentence.startswith("joint_stiffness is known as 150")
    patient = replace(THRESHOLDS, contradiction=1e6)
    assert joined(patient, known={"joint_stiffness": 150.0}).contradicted == ()
