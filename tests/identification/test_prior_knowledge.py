"""Prior knowledge: conversion to coefficients, combination with a fit, and contradictions."""

from dataclasses import replace
from functools import partial
from math import inf
from typing import Any

import numpy as np
import pytest
from made_joint import COEFFICIENTS, PAPER, data, made, made_fit
from scipy.optimize import minimize
from scipy.stats import t

from flexid.identification.estimation.knowledge import contradictions, with_prior_knowledge
from flexid.identification.full_model.model import Data
from flexid.identification.preparation.joint import flexible, link, rigid
from flexid.identification.preparation.settings import Settings
from flexid.identification.preparation.stated import Known, informed, stated
from flexid.identification.vocabulary.evidence import Estimate
from flexid.identification.vocabulary.thresholds import THRESHOLDS
from flexid.models.physical import physical_parameters

JOINT = flexible()


def stating(known=None, deviations=None, bounds=None, joint=JOINT, unit="N m", **settings):
    """Return the statements of some settings about a joint."""
    made = Settings(
        known=known or {}, known_deviations=deviations or {}, bounds=bounds or {}, **settings
    )
    return stated(made, joint, unit)


@pytest.mark.parametrize(
    ("known", "given"),
    [
        ({"motor_inertia": 0.25, "theta2": 100.0}, {"beta1": 4.0, "theta2": 100.0}),
        ({"joint_stiffness": 100.0, "motor_inertia": 0.25}, {"alpha1": 400.0, "beta1": 4.0}),
        ({"joint_stiffness": 100.0, "link_inertia": 2.0}, {"theta2": 50.0}),
        ({"joint_stiffness": 100.0, "alpha1": 400.0}, {"alpha1": 400.0, "beta1": 4.0}),
        ({"motor_viscous_friction": 0.0}, {"alpha2": 0.0}),
        (
            {"link_inertia": 2.0, "motor_inertia": 0.5, "joint_stiffness": 100.0},
            {"beta1": 2.0, "alpha1": 200.0, "theta2": 50.0},
        ),
    ],
)
def test_known_parameters_fix_coefficients(known, given):
    """Assert the coefficients that follow from known parameters, in any order."""
    for items in (known.items(), reversed(known.items())):
        assert stating(dict(items)).given == pytest.approx(given, rel=1e-9, abs=0.0)


def test_what_is_left_to_the_fit():
    """Assert that a known stiffness alone is a constraint, and an uncertain value is not fixed."""
    found = stating({"joint_stiffness": 100.0})
    assert found.given == {}
    assert [(k.name, k.value, k.std) for k in found.known] == [("joint_stiffness", 100.0, 0.0)]
    assert found.kept == {"alpha1", "beta1"}
    found = stating({"theta2": 100.0, "alpha1": 300.0}, {"theta2": 5.0, "alpha1": 0.0})
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
    """Assert that a bound becomes one on a coefficient if all other coefficients are known."""
    found = stating(known, bounds=bounds)
    assert found.within == {}
    assert found.bounds.keys() == expected.keys()
    for name, ends in expected.items():
        assert found.bounds[name] == pytest.approx(ends)


EXCLUDING: list[tuple[dict[str, Any], ...]] = [  # known values, deviations, bounds
    ({"motor_inertia": 0.2, "beta1": 5.0},),
    ({"motor_inertia": 0.2, "beta1": 6.0},),
    ({"motor_inertia": 0.2, "joint_stiffness": 50.0, "alpha1": 300.0},),
    ({"beta1": 5.0, "motor_inertia": 0.2}, {"motor_inertia": 0.1}),
    ({"motor_inertia": 0.3}, {}, {"beta1": (5.0, 6.0)}),
    ({"motor_inertia": 0.3}, {"motor_inertia": 0.01}, {"beta1": (5.0, 6.0)}),
    ({"theta2": 3.0}, {}, {"theta2": (0.0, 1.0)}),
    ({"joint_stiffness": 30.0}, {"joint_stiffness": 1.0}, {"joint_stiffness": (50.0, 60.0)}),
    ({}, {}, {"motor_inertia": (0.1, 0.2), "beta1": (1.0, 2.0)}),
]
ABSENT: dict[str, dict[str, Any]] = {
    "a coefficient of a rigid joint": {"known": {"gamma1": 1.0}},
    "a term that is off": {"bounds": {"alpha2": (0.0, 1.0)}},
    "an inertia in volts": {"known": {"motor_inertia": 0.25}, "unit": "V"},
    "a gain of the link alone": {"known": {"beta1": 3.0}, "joint": link(), "unit": ""},
}


def test_statements_that_cannot_be(refusals):
    """Assert that contradictory, repeated or inapplicable statements are refused."""
    calls = {str(one): partial(stating, *one) for one in EXCLUDING}
    calls |= {name: partial(stating, terms=("gravity",), **one) for name, one in ABSENT.items()}
    refusals(calls)


def test_what_other_joints_have():
    """Assert that ratios can be known in volts, and that a rigid joint has its own names."""
    assert stating({"joint_stiffness_per_link_inertia": 3.0}, unit="V").given == {"theta2": 3.0}
    found = stating({"inertia": 0.25}, bounds={"viscous_friction": (0.0, 1.0)}, joint=rigid())
    assert (found.given, found.bounds) == ({"beta1": 4.0}, {"gamma_viscous": (0.0, 4.0)})


ESTIMATE = Estimate(
    ("theta2", "alpha1", "beta1"),
    np.array([50.0, 300.0, 3.0]),
    np.array([[4.0, 3.0, 0.0], [3.0, 9.0, 0.02], [0.0, 0.02, 0.0009]]),
    (np.inf, np.inf, np.inf),
)


"""A stiffness of 100 N m/rad and a link inertia of 2 kg m²."""


@pytest.mark.parametrize(
    ("bounds", "active", "conditions"),
    [
        ({"joint_stiffness": (90.0, 120.0)}, {}, []),
        (
            {"joint_stiffness": (101.0, 120.0)},
            {"joint_stiffness": 101.0},
            [lambda p: p[1] / p[2] - 101.0],
        ),
        (
            {"joint_stiffness": (0.0, 99.0), "link_inertia": (2.04, inf)},
            {"joint_stiffness": 99.0, "link_inertia": 2.04},
            [lambda p: 99.0 - p[1] / p[2], lambda p: p[1] / p[2] / p[0] - 2.04],
        ),
        (  # the second bound is violated at first, and met once the first is active
            {"joint_stiffness": (103.0, inf), "link_inertia": (-inf, 1.99)},
            {"joint_stiffness": 103.0},
            [lambda p: p[1] / p[2] - 103.0, lambda p: 1.99 - p[1] / p[2] / p[0]],
        ),
    ],
)
def test_bounds_of_functions_give_the_minimum_within_them(bounds, active, conditions):
    """Assert that the estimate is SciPy's constrained minimum, and that active bounds are named."""
    statements = stating(bounds=bounds)
    found = with_prior_knowledge(JOINT, ESTIMATE, {}, statements, "N m", THRESHOLDS)
    inverse, scale = np.linalg.inv(ESTIMATE.covariance), ESTIMATE.values

    def cost(relative):
        apart = (relative - 1.0) * scale
        return float(apart @ inverse @ apart)

    constraints = [
        {"type": "ineq", "fun": lambda relative, f=function: f(relative * scale)}
        for function in conditions
    ]
    least = minimize(cost, np.ones(3), constraints=constraints, method="SLSQP", tol=1e-14).x
    assert found.estimate.values == pytest.approx(least * scale, rel=1e-4)
    assert found.exact == {name: (end, "at its bound") for name, end in active.items()}


PARAMETERS = physical_parameters(["alpha1", "beta1"], input_is_torque=True)


def least_squares(regressors: np.ndarray, measured: np.ndarray) -> Estimate:
    """Return a fitted line with its covariance for unit variance."""
    covariance = np.linalg.inv(regressors.T @ regressors)
    return Estimate(("a", "b"), covariance @ regressors.T @ measured, covariance, (np.inf,) * 2)


def drive(deviation: float = 0.05) -> Estimate:
    """Return alpha1 and beta1 with equal relative uncertainty and correlation."""
    values = np.array([1000 / 3, 10 / 3])
    correlation = np.array([[1.0, 0.8], [0.8, 1.0]])
    covariance = deviation**2 * np.outer(values, values) * correlation
    return Estimate(("alpha1", "beta1"), values, covariance, (12.0, 12.0))


def test_linear_case_is_one_more_measurement():
    """Assert that knowledge of b equals one more weighted equation of least squares."""
    regressors = np.column_stack((np.ones(40), np.linspace(0.5, 3.0, 40)))
    measured = regressors @ [2.0, -1.0] + np.random.default_rng(0).standard_normal(40)
    found = informed(least_squares(regressors, measured), [Known("b", -1.3, 0.2)])[0]
    more = least_squares(np.vstack((regressors, [0.0, 1.0 / 0.2])), np.append(measured, -1.3 / 0.2))
    assert found.values == pytest.approx(more.values, rel=1e-10)
    assert found.covariance == pytest.approx(more.covariance, rel=1e-10)
    first, second = Known("a", 2.2, 0.3), Known("b", -1.1, 0.1)
    fit = least_squares(regressors, measured)
    together, _ = informed(fit, [first, second])
    in_turn, _ = informed(informed(fit, [first])[0], [second])
    assert together.values == pytest.approx(in_turn.values, rel=1e-10)
    assert together.covariance == pytest.approx(in_turn.covariance, rel=1e-10)
    found = informed(fit, [Known("b", -1.3, 0.0)])[0]
    assert found.values == pytest.approx([np.mean(measured + 1.3 * regressors[:, 1]), -1.3])
    assert found.covariance == pytest.approx(np.diag([1.0 / len(measured), 0.0]), abs=1e-15)


def test_a_known_inertia_is_met():
    """Assert that an exactly known inertia is met, and that correlated values follow."""
    for inertia in (0.1, 0.25, 0.3, 0.6, 1.5):
        found, _ = informed(drive(), [Known("motor_inertia", inertia, 0.0)], PARAMETERS)
        assert 1.0 / found.values[1] == pytest.approx(inertia, rel=1e-9)
    found, _ = informed(drive(), [Known("motor_inertia", 0.3 / 1.02, 0.0)], PARAMETERS)
    assert found.values[0] == pytest.approx(1000 / 3 * (1 + 0.8 * 0.02), rel=1e-9)


def test_what_is_unknown_or_free_is_refused(refusals):
    """Assert that an unknown name and an undetermined coefficient are errors."""
    fit = drive()
    free = Estimate(fit.names, fit.values, np.diag([1.0, np.inf]), (12.0, 0.0))
    calls = {
        "a wrong name": partial(informed, fit, [Known("inertia", 0.3, 0.01)], PARAMETERS),
        "an inertia": partial(informed, free, [Known("motor_inertia", 0.3, 0.01)], PARAMETERS),
        "a gain": partial(informed, free, [Known("beta1", 3.0, 0.01)], PARAMETERS),
    }
    refusals(calls | {f"± {s}": partial(Known, "beta1", 3.0, s) for s in (-0.1, np.nan, np.inf)})
    found, _ = informed(free, [Known("alpha1", 300.0, 0.1)])
    assert np.isinf(found.covariance[1, 1])  # another undetermined coefficient stays so
    assert found.degrees_of_freedom[1] == 0.0


@pytest.mark.parametrize("std", [0.03, 0.3, 3.0])
def test_coverage_with_an_estimated_covariance(std):
    """Assert that combined intervals cover 93 to 97 % with a covariance of 12 degrees of freedom.

    The truth is drawn from the prior and the covariance from a Wishart distribution. The share of
    2000 draws has a standard error of 0.5 %.
    """
    generator = np.random.default_rng(8)
    root = np.linalg.cholesky(np.array([[1.0, 0.7], [0.7, 2.0]]))
    freedom, drawn = 12, []  # errors, degrees of freedom and variances
    for _ in range(2000):
        truth = np.array([0.5, 3.0 + std * generator.standard_normal()])
        values = truth + root @ generator.standard_normal(2)
        samples = root @ generator.standard_normal((2, freedom))
        fit = Estimate(("a", "b"), values, samples @ samples.T / freedom, (float(freedom),) * 2)
        found, _ = informed(fit, [Known("b", 3.0, std)])
        drawn.append((found.values - truth, found.degrees_of_freedom, np.diag(found.covariance)))
    errors, freedoms, variances = np.array(drawn).swapaxes(0, 1)
    held = np.mean(np.abs(errors) <= t.ppf(0.975, freedoms) * np.sqrt(variances), axis=0)
    assert np.all((held > 0.93) & (held < 0.97))


@pytest.mark.parametrize(
    ("apart", "limit", "said"),
    [
        (2.9, 3.0, False),
        (3.1, 3.0, True),
        (-2.9, 3.0, False),
        (-3.1, 3.0, True),
        (10.0, 9.9, True),
        (10.0, 10.1, False),
    ],
)
def test_a_contradiction_spans_both(apart, limit, said):
    """Assert that beyond the limit a standard error equal to the shift from the log is added.

    2 ± 0.4 from the log and 0.3 known: together 0.5 for the difference, and 0.24 for the joined
    value, which lies 0.64 of the difference from the log.
    """
    fit = Estimate(("a",), np.array([2.0]), np.array([[0.16]]), (np.inf,))
    known = Known("a", 2.0 + 0.5 * apart, 0.3)
    found, contradicted = informed(fit, [known], contradiction=limit)
    assert [*contradicted] == (["a"] if said else [])
    moved = 0.64 * 0.5 * apart
    assert found.values == pytest.approx([2.0 + moved])
    assert found.covariance == pytest.approx(np.array([[0.24**2 + said * moved**2]]))
    # If the log alone decides, two standard deviations reach the known value.
    sharp = Estimate(("a",), np.array([2.0]), np.array([[1e-6]]), (np.inf,))
    found, contradicted = informed(sharp, [Known("a", 7.0, 1.0)])
    assert contradicted
    assert found.values[0] + 2.0 * found.deviations[0] >= 7.0


@pytest.fixture(scope="module")
def log() -> Data:
    """Return five seconds of a motor of 0.3 kg m² and a spring of 100 N m/rad."""
    return data(made(31, 5.0))


def said(log: Data, given: dict[str, float], **changed: float) -> tuple[str, ...]:
    """Return the contradictions between the log and exactly known values."""
    reported = made_fit(by_name=COEFFICIENTS, at_bound={}, data=log)
    full = replace(PAPER, fixed=given)
    return contradictions(given, reported, full, replace(THRESHOLDS, **changed))


@pytest.mark.parametrize(
    ("given", "named"),
    [
        ({}, []),
        ({"beta1": 10 / 3, "theta2": 100.0}, []),
        ({"beta1": 10 / 3, "theta2": 120.0, "theta1": 4.0}, ["theta1", "theta2"]),
        ({"theta2": 100.8}, []),
        ({"theta2": 101.2}, ["theta2"]),
    ],
)
def test_each_wrong_value_is_told(log, given, named):
    """Assert that a value 1.2 % off is named, unless the limit is raised."""
    assert sorted(sentence.split()[0] for sentence in said(log, given)) == named
    assert said(log, given, contradiction=1e6) == ()
