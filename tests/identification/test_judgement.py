"""Intervals by the delta method and their verdicts."""

from collections.abc import Mapping
from dataclasses import fields, replace

import numpy as np
import pytest
from scipy.stats import t

import flexid.identification.vocabulary.evidence as intervals
from flexid.errors import SettingError
from flexid.estimators.unknowns import Unknowns
from flexid.identification.judgement import (
    Judge,
    constant_estimates,
    judged_function,
    judged_value,
    verdict,
)
from flexid.identification.preparation.joint import flexible
from flexid.identification.vocabulary.evidence import Estimate, ValueEstimate
from flexid.identification.vocabulary.thresholds import THRESHOLDS, Thresholds, table
from flexid.models.flexible_joint import PAPER_TERMS
from flexid.models.physical import ZeroAngle, physical_parameters


def verdict_on(half: float, value: float = 10.0, effect: float = np.inf) -> str:
    """Return the verdict on a value with this half width of its interval."""
    return verdict(value, (value - half, value + half), effect)[0]


@pytest.mark.parametrize(
    ("half", "expected", "words"),
    [
        (1.0, "determined", ""),
        (1.99, "determined", ""),
        (2.01, "weak", "20 %"),
        (9.99, "weak", "100 %"),
        (10.01, "undetermined", "100 %"),
        (50.0, "undetermined", "500 %"),
        (101.0, "undetermined", "far"),
    ],
)
@pytest.mark.parametrize("value", [10.0, -10.0])
def test_width_decides(value, half, expected, words):
    """Assert the limits of 20 and 100 %, with a reason unless determined."""
    status, reason = verdict(value, (value - half, value + half))
    assert status == expected
    assert (reason == "") == (words == "")
    assert words in reason


def test_what_else_counts():
    """Assert how the effect, a zero value, an asymmetric and an infinite interval count."""
    assert verdict_on(1.9, effect=1.0) == "determined"
    assert verdict_on(1e-12, 0.0) == "undetermined"
    assert verdict_on(0.0, 0.0) == "determined"  # it was given
    assert verdict_on(1.0, 0.0, 0.039) == "determined"
    assert verdict(10.0, (9.0, 12.9))[0] == "determined"
    assert verdict(10.0, (9.0, 13.1))[0] == "weak"
    for ends in ((-np.inf, np.inf), (0.0, np.inf)):
        status, reason = verdict(1.0, ends, effect=0.0)
        assert status == "undetermined"
        assert "no information" in reason


def test_table_lists_every_threshold():
    """Assert that the table lists each threshold with a unit and a reason."""
    rows = table(replace(THRESHOLDS, weak_width=0.7))
    assert [row[0] for row in rows] == [f.name for f in fields(Thresholds)]
    assert {row[0]: row[1] for row in rows}["weak_width"] == 0.7
    assert all(unit and reason for _, _, unit, reason in rows)


JOINT = flexible()
UNKNOWNS, DAMPED = (
    JOINT.unknowns(JOINT.optional - {c for t in terms for c in JOINT.terms[t]}, {})
    for terms in (PAPER_TERMS, (*PAPER_TERMS, "joint_damping"))
)
VALUES = {"theta1": 5.0, "theta2": 100.0, "alpha1": 300.0, "alpha2": 0.7, "beta1": 0.3}
MOTOR = {"alpha1", "alpha2", "beta1"}
HALF = 0.005 * float(t.ppf(0.975, 50.0))
"""Relative half width of an interval with a standard error of 0.5 %."""

Judged = tuple[dict[str, ValueEstimate], dict[str, ValueEstimate]]


def judged(
    values: Mapping[str, float],
    deviations: Mapping[str, float] | None = None,
    fixed: Mapping[str, tuple[float, str]] | None = None,
    sizes: Mapping[str, float] | None = None,
    exact: Mapping[str, tuple[float, str]] | None = None,
    unknowns: Unknowns = UNKNOWNS,
) -> Judged:
    """Return coefficients and parameters of a drive; deviations are 0.5 % unless given."""
    found = np.array([*values.values()])
    spread = [(deviations or {}).get(name, 0.005 * abs(v)) for name, v in values.items()]
    estimate = Estimate(tuple(values), found, np.diag(np.square(spread)), (50.0,) * len(values))
    return Judge(JOINT, unknowns, "N m").judged(estimate, fixed or {}, sizes, exact)


@pytest.mark.parametrize("theta2", [-100.0, -1e-3])
def test_a_negative_stiffness_leaves_the_motor_s_parameters_alone(theta2):
    """Assert that parameters of the link are undetermined, and those of the motor determined."""
    found = {**(both := judged({**VALUES, "theta2": theta2}))[0], **both[1]}
    determined = {name for name, each in found.items() if each.verdict == "determined"}
    assert determined == MOTOR | {"joint_stiffness", "motor_inertia", "motor_viscous_friction"}
    free, parameters = judged({**VALUES, "theta2": theta2}, {"theta2": np.inf})
    assert {free[name].verdict for name in MOTOR | {"theta1"}} == {"determined"}
    assert free["theta2"].verdict == "undetermined"
    assert parameters["motor_inertia"].verdict == "determined"


def test_coefficients_and_parameters_by_hand():
    """Assert values, intervals and slopes of coefficients and of derived parameters."""
    coefficients, parameters = judged({"input_delay": 0.0, **VALUES})
    assert {*coefficients} == {*VALUES}
    for name, value in VALUES.items():
        found = coefficients[name]
        assert found.slopes == {name: 1.0}
        assert found.verdict == "determined"
        assert found.interval == pytest.approx((value * (1.0 - HALF), value * (1.0 + HALF)))
    stiffness = parameters["joint_stiffness"]  # alpha1 / beta1, with independent errors
    assert stiffness.value == pytest.approx(1000.0)
    assert stiffness.std == pytest.approx(1000.0 * 0.005 * 2.0**0.5)
    assert stiffness.slopes == pytest.approx({"alpha1": 1.0 / 0.3, "beta1": -1000.0 / 0.3})


def test_what_is_given_has_no_width_and_says_so():
    """Assert that a fixed coefficient, and parameters that depend on it alone, are given."""
    free = {name: value for name, value in VALUES.items() if name != "beta1"}
    coefficients, parameters = judged(free, fixed={"beta1": (0.3, "given")})
    for found in (coefficients["beta1"], parameters["motor_inertia"]):
        assert (found.std, found.verdict, found.reason) == (0.0, "determined", "given")
        assert found.interval == (found.value, found.value)
    assert parameters["joint_stiffness"].reason == ""
    _, parameters = judged(VALUES, exact={"motor_inertia": (3.0, "known")})
    inertia = parameters["motor_inertia"]
    assert (inertia.value, inertia.std, inertia.reason) == (3.0, 0.0, "known")
    assert {"joint_stiffness", "link_inertia", "motor_viscous_friction"} <= {*parameters}


@pytest.mark.parametrize(("effect", "expected"), [(0.039, "determined"), (0.041, "undetermined")])
def test_what_hardly_moves_its_row_is_determined(effect, expected):
    """Assert that a value near zero is judged by its effect, as are parameters derived from it."""
    half = float(t.ppf(0.975, 50.0)) * 0.1
    coefficients, parameters = judged(
        VALUES | {"alpha2": 0.01}, {"alpha2": 0.1}, sizes={"alpha2": effect / half}
    )
    assert coefficients["alpha2"].verdict == expected
    assert parameters["motor_viscous_friction"].verdict == expected
    assert bool(parameters["motor_viscous_friction"].reason) == (expected != "determined")
    damping, sizes = {"alpha_damping": 0.01}, {"alpha_damping": effect / half}
    found, _ = judged(VALUES | damping, {"alpha_damping": 0.1}, sizes=sizes, unknowns=DAMPED)
    assert found["alpha_damping"].verdict == found["theta_damping"].verdict == expected


@pytest.mark.parametrize(("width", "known"), [(1.2, True), (0.05, False)])
def test_slow_moves_know_the_whole_drive(width, known):
    """Assert that friction and total inertia are determined while their coefficients are not.

    Of 10 kg m² the motor has 2.5; how they are divided moves alpha1, alpha2 and beta1 together. The
    sum is then reported in addition.
    """
    values = {"theta2": 100.0, "alpha1": 300.0, "alpha2": 0.8, "beta1": 0.4}
    divided = width * 0.4 * np.array([0.0, 100.0 * 10.0, 2.0, 1.0])
    own = 0.002 * np.array([*values.values()])
    found = np.outer(divided, divided) + np.diag(own**2)
    estimate = Estimate(tuple(values), np.array([*values.values()]), found, (50.0,) * 4)
    unknowns = JOINT.unknowns(JOINT.optional - {"alpha2"}, {})
    coefficients, parameters = Judge(JOINT, unknowns, "N m").judged(estimate, {})
    verdicts = {name: each.verdict for name, each in (coefficients | parameters).items()}
    expected = "undetermined" if known else "determined"
    assert {verdicts[name] for name in ("alpha2", "beta1", "motor_inertia")} == {expected}
    assert verdicts["motor_viscous_friction"] == "determined"
    assert parameters["motor_viscous_friction"].value == pytest.approx(2.0)
    assert ("total_inertia" in parameters) == known
    if known:
        total = parameters["total_inertia"]
        assert (total.value, total.verdict) == (pytest.approx(10.0), "determined")
        assert verdicts["joint_stiffness"] == "weak"


def test_constants_of_shapes_are_judged_by_their_width():
    """Assert value, interval, unit and verdict of a constant, fitted or fixed.

    If all parameters of its term are undetermined or may be zero, the constant is undetermined.
    """
    constants = {
        "stribeck_velocity": (0.15, 0.01, 50.0),
        "bend_deflection": (0.3, 0.1, 50.0),
        "ripple_number": (7.0, np.inf, 0.0),  # fixed
    }
    parameters = {"bend_stiffness": judged_value("alpha_bend", "", 1.0, 0.1, 50.0)}
    found = constant_estimates(flexible(), constants, parameters)
    slopes = [dict(each.slopes) for each in found.values()]
    assert slopes == [{"stribeck_velocity": 1.0}, {"bend_deflection": 1.0}, {}]
    assert found["ripple_number"].verdict == "undetermined"
    velocity, bend = found["stribeck_velocity"], found["bend_deflection"]
    half = 0.01 * float(t.ppf(0.975, 50.0))
    assert velocity.interval == pytest.approx((0.15 - half, 0.15 + half))
    assert (velocity.unit, velocity.verdict) == ("rad/s", "determined")
    assert velocity.degrees_of_freedom == 50.0
    assert (bend.unit, bend.verdict) == ("rad", "weak")
    unsure = judged_value("alpha_bend", "", 1.0, 0.6, 50.0)
    negligible = judged_value("alpha_bend", "", 1.0, 0.6, 50.0, 1e-6)
    for of_term in (unsure, negligible):
        unknown = constant_estimates(flexible(), constants, {"bend_stiffness": of_term})
        assert unknown["bend_deflection"].verdict == "undetermined"
        assert unknown["bend_deflection"].reason == "its term is undetermined"


NAMES = ("theta1", "theta2", "alpha1", "alpha2", "beta1")
TABLE_1 = np.array([5.0, 100.0, 1000 / 3, 1 / 3, 10 / 3])


def of(
    name: str,
    covariance: np.ndarray,
    fitted: tuple[str, ...] = NAMES,
    freedom: tuple[float, ...] = (np.inf,) * 5,
) -> ValueEstimate:
    """Return a physical parameter of a fit to the true values, which are exact outside it."""
    (own,) = (p for p in physical_parameters(NAMES, input_is_torque=True) if p.name == name)
    values: dict[str, float] = dict(zip(NAMES, TABLE_1.tolist(), strict=True))
    fit = Estimate(fitted, TABLE_1[: len(fitted)], covariance, freedom)
    return judged_function(own, values, fit)


@pytest.mark.parametrize(
    ("deviation", "verdict", "reason"),
    [
        (0.09, "determined", ""),
        (0.11, "weak", "its interval reaches 0.22 rad to either side"),
        (0.49, "weak", "its interval reaches 0.96 rad to either side"),
        (0.52, "undetermined", "its interval reaches 1 rad to either side"),
        (np.inf, "undetermined", "the log has no information on it"),
    ],
)
def test_an_angle_is_judged_by_its_width(deviation, verdict, reason):
    """Assert the verdict on an angle near zero, of a sine with amplitude 1."""
    angle = ZeroAngle("ripple_angle", "rad", "sine", "cosine")
    values = {"sine": 1.0, "cosine": 1e-3}
    fit = Estimate(("cosine",), np.array([1e-3]), np.array([[deviation**2]]), (np.inf,))
    found = judged_function(angle, values, fit)
    assert (found.verdict, found.reason) == (verdict, reason)


@pytest.mark.parametrize(
    ("std", "freedom", "ends", "logarithmic"),
    [
        (np.inf, 5.0, (-np.inf, np.inf), (0.0, np.inf)),
        (1.0, 0.0, (-np.inf, np.inf), (0.0, np.inf)),
        (np.inf, 0.0, (-np.inf, np.inf), (0.0, np.inf)),
        (0.0, 0.0, (2.0, 2.0), (2.0, 2.0)),
    ],
)
def test_nothing_known_is_the_whole_line(std, freedom, ends, logarithmic):
    """Assert that without information the interval is the real line, or the positive half line."""
    assert intervals.interval(2.0, std, freedom) == ends
    assert intervals.logarithmic_interval(2.0, std, freedom) == logarithmic


def test_ends_that_are_many_powers_of_ten_apart_say_nothing():
    """Assert that an interval of more than six powers of ten to either side becomes infinite."""
    deviation = np.log(1e6) / t.ppf(0.975, 9)  # of the logarithm
    low, high = intervals.logarithmic_interval(2.0, 1.99 * deviation, 9)
    assert (low, high) == pytest.approx((2e-6, 2e6), rel=0.1)
    assert intervals.logarithmic_interval(2.0, 2.01 * deviation, 9) == (0.0, np.inf)


def test_the_least_known_coefficient_decides():
    """Assert that the fewest degrees of freedom and infinite variances among its inputs count."""
    covariance = np.diag((0.01 * TABLE_1) ** 2)
    found = of("joint_stiffness", covariance, freedom=(2.0, 9.0, 8.0, 2.0, 7.0))
    assert found.degrees_of_freedom == 7.0
    covariance[4, 4] = np.inf
    found = of("motor_inertia", covariance)
    assert (found.std, found.interval) == (np.inf, (0.0, np.inf))
    assert of("motor_inertia", np.eye(4), NAMES[:4], (5.0,) * 4).interval == (0.3, 0.3)


@pytest.mark.parametrize(
    ("name", "fitted", "expected"),
    [
        ("motor_inertia", NAMES, True),
        ("link_inertia", NAMES, True),
        ("link_inertia", NAMES[:4], False),  # alpha1 / theta2, as beta1 is fixed
        ("joint_stiffness", NAMES, False),
        ("joint_stiffness", NAMES[:4], False),
        ("gravity_torque", NAMES, False),
        ("motor_viscous_friction", NAMES, False),
    ],
)
def test_logarithm_where_division_prevails(name, fitted, expected):
    """Assert that functions of negative total degree have logarithmic intervals, and no others."""
    k = len(fitted)
    covariance = np.diag((0.1 * TABLE_1[:k]) ** 2)
    assert of(name, covariance, fitted, (20.0,) * k).logarithmic is expected


@pytest.mark.parametrize("logarithmic", [False, True])
def test_an_interval_has_any_level(logarithmic):
    """Assert that an interval is Student's t interval at the requested level."""
    level, freedom = 0.8, 7.0
    half = t.ppf(0.5 + level / 2, freedom) * 0.3
    found = ValueEstimate(
        "x", "m", 2.0, 0.3, (1.0, 3.0), "weak", "", freedom, logarithmic
    ).interval_at(level)
    ends = 2.0 * np.exp(np.array([-half, half]) / 2.0) if logarithmic else (2.0 - half, 2.0 + half)
    assert found == pytest.approx(tuple(ends), rel=1e-12)


@pytest.mark.parametrize("level", [0.0, 1.0, 95, -0.5, float("nan"), "0.95"])
def test_what_is_no_level_is_refused(level):
    """Assert that a percentage or a text is refused, with an example of a valid level."""
    with pytest.raises(SettingError, match=r"0\.95"):
        ValueEstimate("x", "m", 2.0, 0.3, (1.0, 3.0), "weak").interval_at(level)


COVARIANCE = np.array([[4.0, 1.0, 0.0], [1.0, 9.0, 0.0], [0.0, 0.0, np.inf]])
ESTIMATE = Estimate(("a", "b", "c"), np.array([1.0, 2.0, 3.0]), COVARIANCE, (5.0, 7.0, 0.0))


def test_widening_adds_covariances_and_scaling_keeps_correlations():
    """Assert that widening adds covariances, scaling keeps correlations, and infinities remain."""
    assert ESTIMATE.deviations.tolist() == [2.0, 3.0, np.inf]
    for more in (2.0, np.nan_to_num(np.inf)):
        found = ESTIMATE.widened(np.array([[1.0, 0.5, more], [0.5, 2.0, more], [more] * 3]))
        assert found.covariance[:2, :2].tolist() == [[5.0, 1.5], [1.5, 11.0]]
        assert found.covariance[2].tolist() == [0.0, 0.0, np.inf]
        assert found.values is ESTIMATE.values
        assert found.degrees_of_freedom == ESTIMATE.degrees_of_freedom
    found = ESTIMATE.scaled(np.array([2.0, 3.0, 5.0]))
    assert found.deviations.tolist() == [4.0, 9.0, np.inf]
    assert found.covariance[0, 1] == 6.0
    assert found.covariance[2, :2].tolist() == [0.0, 0.0]
