"""Comparison of two estimates: closed forms, SciPy's tests, and the rate of false alarms."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.stats import ttest_ind

from flexid.errors import SettingError
from flexid.identification.judgement import verdict
from flexid.identification.vocabulary.evidence import (
    Disturbances,
    ModelError,
    ValueEstimate,
    interval,
    logarithmic_interval,
)
from flexid.stored_estimates.comparison import compare_estimates, holm
from made_estimates import STIFFER, TRUE, drawn, estimate_of, exact, with_parameter


def number(value, std, freedom=np.inf, *, unit="N m", name="gravity_torque", logarithmic=False):
    """Return a parameter with its interval."""
    ends = (logarithmic_interval if logarithmic else interval)(value, std, freedom)
    judged = verdict(value, ends)
    return ValueEstimate(
        name, unit, value, std, ends, *judged, freedom, logarithmic, {"theta1": 1.0}
    )


A, B = exact(TRUE, "a"), exact(TRUE, "b")


def compared(a, b, *, same_log=False):
    """Return the difference of one value in two estimates of this value alone."""
    first, second = (
        replace(e, parameters={p.name: p}) for e, p in zip((A, B), (a, b), strict=True)
    )
    if same_log:
        settings = {**first.provenance, "settings": {"hold": "linear"}}
        second = replace(second, provenance=settings)
    return compare_estimates(first, second).parameters[a.name]


def test_ratios_and_what_has_none():
    """Assert ratios on the logarithm; angles and possible zeros are compared in their unit."""
    a = number(2.0, 0.1, name="motor_inertia", logarithmic=True)
    b = number(2.4, 0.3, name="motor_inertia", logarithmic=True)
    found, back = compared(a, b), compared(b, a)
    reach = 1.959964 * np.hypot(0.05, 0.125)
    ends = [100.0 * (1.2 * np.exp(sign * reach) - 1.0) for sign in (-1, 1)]
    assert found.percent == pytest.approx(20.0)
    assert found.percent_interval == pytest.approx(ends, rel=1e-6)
    assert found.interval == pytest.approx([2.0 * end / 100.0 for end in ends], rel=1e-6)
    turned = [100.0 * (1.0 / (1.0 + end / 100.0) - 1.0) for end in found.percent_interval[::-1]]
    assert back.percent_interval == pytest.approx(turned)
    assert back.probability == pytest.approx(found.probability)
    found = compared(*(number(x, 0.01, name="gravity_angle", unit="rad") for x in (3.1, -3.1)))
    assert found.value == pytest.approx(2.0 * np.pi - 6.2)
    assert np.isnan(found.percent)
    found = compared(number(0.01, 0.02), number(0.5, 0.02))
    assert found.outcome == "changed"
    assert np.isnan(found.percent)
    assert found.interval[0] > 0.4


@pytest.mark.parametrize("correlation", [0.0, 0.9])
def test_one_drive_twice_is_said_to_have_changed_in_one_comparison_of_twenty(correlation):
    """Assert a rate of false alarms of at most 5 % for one drive compared twice."""
    rng = np.random.default_rng(5)
    count, freedom = 500, 15
    found = [
        compare_estimates(
            drawn(rng, None, freedom, correlation), drawn(rng, None, freedom, correlation)
        )
        for _ in range(count)
    ]
    alarms = sum(comparison.differ for comparison in found)
    assert alarms / count < 0.05 + 3.0 * np.sqrt(0.05 * 0.95 / count)
    single = sum(d.probability < 0.05 for c in found for d in c.parameters.values())
    intervals = sum(len(c.parameters) for c in found)
    assert 0.03 < single / intervals < 0.07
    assert all(c.differ is not c.agree for c in found)


def test_differences_as_scipy_and_holm_test_them():
    """Assert Welch's test of two samples, and Holm's steps by hand."""
    rng = np.random.default_rng(3)
    before, after = rng.normal(10.0, 1.0, 12), rng.normal(10.8, 0.4, 25)
    a, b = (number(x.mean(), x.std(ddof=1) / len(x) ** 0.5, len(x) - 1.0) for x in (before, after))
    found = compared(a, b)
    truth: Any = ttest_ind(after, before, equal_var=False)
    ends = truth.confidence_interval(0.95)
    assert found.value == pytest.approx(after.mean() - before.mean(), rel=1e-12)
    assert found.interval == pytest.approx((ends.low, ends.high), rel=1e-9)
    assert found.probability == pytest.approx(truth.pvalue, rel=1e-9)
    scale = 100.0 / before.mean()
    assert found.percent_interval == pytest.approx((scale * ends.low, scale * ends.high))
    assert holm([0.01, 0.04, 0.03, 0.005], 0.05) == [True, False, False, True]
    assert holm([0.012, 0.016, 0.024, 0.05], 0.05) == [True, True, True, True]
    assert holm([0.013, 0.016, 0.024, 0.05], 0.05) == [False] * 4
    assert holm([], 0.05) == []


def test_one_log_or_estimate_twice():
    """Assert that one log's standard errors add up, and that one estimate twice is refused."""
    near, far = (compared(number(5.0, 0.1), number(b, 0.1), same_log=True) for b in (5.37, 5.43))
    assert near.outcome == "compatible"
    assert far.outcome == "contradictory"
    assert near.interval == pytest.approx((0.37 - 1.959964 * 0.2, 0.37 + 1.959964 * 0.2))
    a = drawn(np.random.default_rng(9))
    with pytest.raises(SettingError, match="A and B are the same estimate"):
        compare_estimates(a, a)
    found = compare_estimates(a, estimate_of(a.fit, "another log"))
    assert found.agree
    assert all(d.value == 0.0 for d in found.parameters.values())


def read_from(estimate, *columns):
    """Return the estimate with other source columns of its positions."""
    channels = ("motor_position", "link_position")
    said = {c: {"columns": {x: 1.0}} for c, x in zip(channels, columns, strict=True)}
    said["motor_torque"] = {"columns": {"u": 1.0}}
    log = {**estimate.provenance["inputs"][0], "columns": said}
    return replace(estimate, provenance={**estimate.provenance, "inputs": [log]})


OPEN = {"std": np.inf, "interval": (-np.inf, np.inf), "verdict": "undetermined"}
GIVEN = {"value": 100.0, "std": 0.0, "interval": (100.0, 100.0)}


def with_term(log, names, value=0.5, **shapes):
    """Return a drive with a term, by parameter and coefficient, that depends on constants."""
    made, (parameter, coefficient) = exact(TRUE, log), names
    slopes = {coefficient: 1.0}
    size = replace(number(value, 0.01 * value, 30.0, name=parameter), slopes=slopes)
    own = replace(made.coefficients["alpha1"], name=coefficient, slopes=slopes)
    return replace(
        made,
        parameters={**made.parameters, parameter: size},
        coefficients={**made.coefficients, coefficient: own},
        choices=replace(made.choices, shapes=shapes),
    )


STRIBECK = ("motor_stribeck_friction", "alpha_stribeck")
RIPPLE = ("torque_ripple", "alpha_ripple_sine")
UNEVEN = ("transmission_error", "alpha_error_sine")
PLAY = ("half_backlash", "alpha_backlash")


def beside(estimate, *more):
    """Return the estimate with more parameters."""
    return replace(estimate, parameters={**estimate.parameters, **{p.name: p for p in more}})


def moved(estimate, deviations):
    """Return an estimate of another log, with gravity shifted by these standard errors."""
    other, p = estimate_of(estimate.fit, "another log"), estimate.parameters["gravity_torque"]
    away = deviations * np.sqrt(2.0) * p.std
    return with_parameter(other, "gravity_torque", value=p.value + away)


def of_shapes(names, shape, first, second, size=0.5):
    """Return two drives with a term of one shape."""
    return with_term("a", names, **{shape: first}), with_term("b", names, size, **{shape: second})


FRICTION, BOUND = (
    number(value, std, 30.0, name="motor_coulomb_friction")
    for value, std in ((0.5, 0.02), (0.001, 0.01))
)
OFFSET = number(0.1, 0.01, name="motor_offset_torque[1]")
RIGID = replace(B, model="rigid", parameters={"gravity_torque": B.parameters["gravity_torque"]})
ONCE, AGAIN = (estimate_of(A.fit, "one", hold=hold) for hold in ("zero", "linear"))
AXIS = read_from(ONCE, "q1_motor", "q1_link")
KNOWING = estimate_of(A.fit, "a", known={"motor_inertia": 0.3})
NAMELESS = replace(KNOWING, provenance={**KNOWING.provenance, "inputs": []}, warnings=("it rests",))
PAIRS = {
    "one drive twice": (A, B),
    "a stiffer one": (A, exact(STIFFER, "b")),
    "what chance explains among several": (A, moved(A, 2.3)),
    "a friction of one alone": (beside(A, FRICTION), B),
    "its bound in the other": (beside(A, FRICTION), replace(B, removed={BOUND.name: BOUND})),
    "an offset of each log": (beside(A, OFFSET), beside(B, OFFSET)),
    "a rigid joint": (A, RIGID),
    "nothing in common": (A, replace(RIGID, parameters={}, coefficients={})),
    "common knowledge, no name, a warning": (KNOWING, NAMELESS),
    "a model error": (A, replace(B, model_error=ModelError(2.0, 0.9, 0.5))),
    "disturbances": (A, replace(B, disturbances=Disturbances({"link": 0.3}, 1e-3))),
    "one log": (ONCE, AGAIN),
    "two axes of one file": (AXIS, read_from(AGAIN, "q2_motor", "q2_link")),
    "one axis": (AXIS, read_from(AGAIN, "q1_motor", "q1_link")),
    "an encoder of it": (AXIS, read_from(AGAIN, "q1_motor", "other")),
    "columns without a name": (AXIS, AGAIN),
    **{
        f"a stiffness, {name}": (A, with_parameter(B, "joint_stiffness", **change))
        for name, change in {
            "nothing known": OPEN | {"reason": "the log is silent"},
            "contradicted": {"verdict": "undetermined", "reason": "x"},
            "given": GIVEN,
            "another unit": {"unit": "V/rad"},
        }.items()
    },
    **{
        f"velocities of {first} and {second}": of_shapes(
            STRIBECK, "stribeck_velocity", first, second
        )
        for first, second in ((0.1, 0.19), (0.1, 0.21))
    },
    **{
        f"ripples of {first} and {second}": of_shapes(RIPPLE, "ripple_number", first, second)
        for first, second in ((23.4, 23.6), (23.4, 24.0))
    },
    "two laws of friction": of_shapes(STRIBECK, "stribeck_exponent", 2.0, 1.0),
    "one law of friction": of_shapes(STRIBECK, "stribeck_exponent", 1.0, 1.0),
    "damping of a gap and of contact": of_shapes(
        ("joint_damping", "alpha_damping"), "contact_damping", 0.0, 1.0
    ),
    **{
        f"errors of {first} and {second} periods": of_shapes(UNEVEN, "error_number", first, second)
        for first, second in ((100.0, 101.0), (100.0, 103.0))
    },
    "errors from 0 and 6.28": of_shapes(UNEVEN, "angle_origin", 0.0, 6.28),
    # The amplitude does not depend on the origin of a ripple.
    **{
        f"ripples from {origin}": of_shapes(RIPPLE, "angle_origin", 6.28, origin)
        for origin in (0.0, -6.28, 12.56)
    },
    # A gap has its own width, unless the width was chosen by the motion.
    **{
        f"a gap of 0.5, {width} wide, {size}": of_shapes(PLAY, "backlash_width", 0.5, width, size)
        for width, size in ((1.5, 1.5), (3.05, 1.5), (1.5, -1.5))
    },
}


def said(a, b):
    """Return the answer, disagreements with reasons, and limits of the comparison."""
    found = compare_estimates(a, b)
    answer = "agree" if found.agree else "differ" if found.differ else "no answer"
    differences = (*found.parameters.values(), *found.coefficients.values())
    parts = [f"{found.logs} logs, {sum(d.compared for d in differences)} compared, {answer}"]
    for d in differences:
        if d.compared and (d.without or d.outcome not in ("no change", "compatible")):
            bound = f", by its bound in {d.without[0]}" if d.without else ""
            parts.append(f"{d.name} {d.outcome} by {d.value:.3g} {d.unit}{bound}")
        elif not d.compared:
            parts.append(f"{d.name} {d.outcome}: {d.reason}")
    return "; ".join([*parts, *found.warnings])


def test_what_is_compared(golden):
    """Assert the changes, values that are not compared with reasons, and limits."""
    golden({name: said(*pair) for name, pair in PAIRS.items()})
