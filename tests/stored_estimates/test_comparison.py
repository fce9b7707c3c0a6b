"""Two estimates side by side: closed forms, SciPy's tests, and how often chance is a change."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.stats import ttest_ind

from flexid.errors import SettingError
from flexid.identification.judgement import verdict
from flexid.identification.vocabulary.estimate import interval, logarithmic_interval
from flexid.identification.vocabulary.evidence import Disturbances, ModelError, ParameterEstimate
from flexid.stored_estimates.comparison import compare_estimates, holm
from made_estimates import STIFFER, TRUE, drawn, estimate_of, exact, with_parameter


def number(value, std, freedom=np.inf, *, unit="N m", name="gravity_torque", logarithmic=False):
    """A parameter with its interval."""
    ends = (logarithmic_interval if logarithmic else interval)(value, std, freedom)
    judged = verdict(value, ends)
    return ParameterEstimate(
        name, unit, value, std, ends, *judged, freedom, logarithmic, {"theta1": 1.0}
    )


TWO = [drawn(np.random.default_rng(seed)) for seed in (1, 2)]


def two(seed=9, true=TRUE, **keywords):
    """Two estimates of one drive, drawn one after the other."""
    rng = np.random.default_rng(seed)
    return drawn(rng, true, **keywords), drawn(rng, true, **keywords)


def compared(a, b, *, same_log=False):
    """The difference of one number in two estimates that hold nothing else."""
    first, second = (replace(e, parameters={p.name: p}) for e, p in zip(TWO, (a, b), strict=True))
    if same_log:
        settings = {**first.provenance, "settings": {"hold": "linear"}}
        second = replace(second, provenance=settings)
    return compare_estimates(first, second).parameters[a.name]


def test_two_samples_as_scipy_tests_them():
    """Assert that difference, interval and probability are those of Welch's test of two samples."""
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


def test_a_ratio_has_its_interval_on_the_logarithm():
    """Assert that of two reciprocals the ratio is compared, and turned round is the reciprocal."""
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


def test_no_percentage_is_made_of_angles_and_of_what_may_be_zero():
    """Assert that 3.1 and -3.1 rad are 0.083 rad apart, and a friction differs in its unit."""
    found = compared(*(number(x, 0.01, name="gravity_angle", unit="rad") for x in (3.1, -3.1)))
    assert found.value == pytest.approx(2.0 * np.pi - 6.2)
    assert np.isnan(found.percent)
    found = compared(number(0.01, 0.02), number(0.5, 0.02))
    assert found.outcome == "changed"
    assert np.isnan(found.percent)
    assert found.interval[0] > 0.4


@pytest.mark.parametrize("correlation", [0.0, 0.9])
def test_one_drive_twice_is_said_to_have_changed_in_one_comparison_of_twenty(correlation):
    """Assert that the answer of all numbers errs no more often."""
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


def test_a_change_is_named():
    """Assert that 10 % more stiffness is found in stiffness alone, with its size."""
    rng = np.random.default_rng(8)
    found = compare_estimates(drawn(rng, correlation=0.0), drawn(rng, STIFFER, correlation=0.0))
    assert [d.name for d in found.having("changed")] == ["joint_stiffness"]
    low, high = found.parameters["joint_stiffness"].percent_interval
    assert low < 10.0 < high
    assert found.differ
    assert not found.agree


def test_holm_lies_between_one_by_one_and_all_times_their_number():
    """Assert Holm's steps on a case counted by hand."""
    assert holm([0.01, 0.04, 0.03, 0.005], 0.05) == [True, False, False, True]
    assert holm([0.012, 0.016, 0.024, 0.05], 0.05) == [True, True, True, True]
    assert holm([0.013, 0.016, 0.024, 0.05], 0.05) == [False] * 4
    assert holm([], 0.05) == []


def test_what_chance_explains_among_several_is_perhaps_a_change():
    """Assert that one number beyond its own interval alone is named, and decides nothing."""
    rng = np.random.default_rng(1)
    a = drawn(rng, freedom=40, correlation=0.0)
    b = estimate_of(a.fit, "another log")
    p = b.parameters["gravity_torque"]
    b = with_parameter(b, "gravity_torque", value=p.value + 2.3 * np.sqrt(2.0) * p.std)
    found = compare_estimates(a, b)
    assert found.parameters["gravity_torque"].outcome == "perhaps changed"
    assert found.agree


def test_one_log_cannot_have_changed():
    """Assert that estimates of one log are compared by the sum of their deviations."""
    near, far = (compared(number(5.0, 0.1), number(b, 0.1), same_log=True) for b in (5.37, 5.43))
    assert near.outcome == "compatible"
    assert far.outcome == "contradictory"
    assert near.interval == pytest.approx((0.37 - 1.959964 * 0.2, 0.37 + 1.959964 * 0.2))
    rng = np.random.default_rng(4)
    a, b = drawn(rng, log="one"), drawn(rng, log="one", hold="linear")
    found = compare_estimates(a, b)
    assert found.logs == "same"
    outcomes = {d.outcome for d in (*found.parameters.values(), *found.coefficients.values())}
    assert outcomes <= {"compatible", "contradictory"}


def test_what_one_model_does_without_is_compared_by_its_bound():
    """Assert that a friction that one log does not show is compared with how large it could be."""
    friction = number(0.5, 0.02, 30.0, name="motor_coulomb_friction")
    bound = number(0.001, 0.01, 30.0, name="motor_coulomb_friction")
    a, b = two(7)
    a = replace(a, parameters={**a.parameters, friction.name: friction})
    unknown = compare_estimates(a, b)
    assert unknown.lacking == (unknown.parameters[friction.name],)
    assert not unknown.agree
    found = compare_estimates(a, replace(b, removed={bound.name: bound}))
    d = found.parameters[friction.name]
    assert d.without == ("B",)
    assert d.outcome == "changed"
    assert d.value == pytest.approx(-0.499)
    assert found.lacking == ()


def test_values_of_one_log_each_are_not_compared():
    """Assert that an offset that was found log by log is left out."""
    offset = number(0.1, 0.01, name="motor_offset_torque[1]")
    a, b = (replace(e, parameters={**e.parameters, offset.name: offset}) for e in two())
    found = compare_estimates(a, b)
    assert found.parameters["motor_offset_torque[1]"].reason == "each log has its own"
    assert found.agree


def test_other_models_share_what_means_the_same():
    """Assert that a rigid joint's coefficients, named alike, are left alone, with a warning."""
    a, b = two()
    b = replace(b, model="rigid", parameters={"gravity_torque": b.parameters["gravity_torque"]})
    found = compare_estimates(a, b)
    assert found.coefficients == {}
    assert found.parameters["gravity_torque"].compared
    assert found.parameters["joint_stiffness"].b is None
    assert found.lacking == ()
    assert "A is of a flexible joint and B of a rigid joint" in found.warnings[0]
    nothing = compare_estimates(a, replace(b, parameters={}, coefficients={}))
    assert (nothing.agree, nothing.differ) == (False, False)


def test_doubts_are_said():
    """Assert that common knowledge, logs without a name and warnings of either are passed on."""
    a, b = two(known={"motor_inertia": 0.3})
    b = replace(b, provenance={**b.provenance, "inputs": []}, warnings=("the joint hardly moves",))
    unnamed, knowledge, passed = compare_estimates(a, b).warnings
    assert "both rest on what was said of motor_inertia" in knowledge
    assert unnamed.startswith("B does not say which logs")
    assert passed == "B: the joint hardly moves"


@pytest.mark.parametrize(
    "unexplained",
    [
        {"model_error": ModelError(2.0, 0.9, 0.5)},
        {"disturbances": Disturbances({"link": 0.3, "motor": 0.1}, 1e-3)},
    ],
)
def test_what_no_term_describes_may_look_like_a_change(unexplained):
    """Assert that an estimate with a model error or with disturbances is named, and no other."""
    a, b = exact(TRUE, "a"), replace(exact(TRUE, "b"), **unexplained)
    (said,) = compare_estimates(a, b).warnings
    assert said.startswith("in B the residuals hold something that no term describes")


def test_an_estimate_and_itself_are_refused():
    """Assert that one estimate twice is refused, and the same numbers of another log are not."""
    a = drawn(np.random.default_rng(9))
    with pytest.raises(SettingError, match="A and B hold the same estimate"):
        compare_estimates(a, a)
    found = compare_estimates(a, estimate_of(a.fit, "another log"))
    assert found.agree
    assert all(d.value == 0.0 for d in found.parameters.values())


def read_from(estimate, *columns):
    """The same, with the columns that the positions of its log came from."""
    channels = ("motor_position", "link_position")
    said = {c: {"columns": {x: 1.0}} for c, x in zip(channels, columns, strict=True)}
    said["motor_torque"] = {"columns": {"u": 1.0}}
    log = {**estimate.provenance["inputs"][0], "columns": said}
    return replace(estimate, provenance={**estimate.provenance, "inputs": [log]})


def test_two_axes_of_one_file_are_two_logs():
    """Assert that a file read by other columns of the positions is another log."""
    rng = np.random.default_rng(4)
    a, b = drawn(rng, log="one"), drawn(rng, log="one", hold="linear")
    first = read_from(a, "q1_motor", "q1_link")
    assert compare_estimates(first, read_from(b, "q2_motor", "q2_link")).logs == "different"
    for same in (read_from(b, "q1_motor", "q1_link"), read_from(b, "q1_motor", "other"), b):
        assert compare_estimates(first, same).logs == "same"


OPEN = {"std": np.inf, "interval": (-np.inf, np.inf), "verdict": "undetermined"}
GIVEN = {"value": 100.0, "std": 0.0, "interval": (100.0, 100.0)}


@pytest.mark.parametrize(
    ("change", "outcome", "reason"),
    [
        (OPEN | {"reason": "the log is silent"}, "not determined", "in B the log is silent"),
        ({"verdict": "undetermined", "reason": "x"}, "not determined", "in B x"),
        (GIVEN, "not compared", "in B it was not estimated: it follows from what was given"),
        ({"unit": "V/rad"}, "not compared", "A has it in N m/rad, B in V/rad"),
    ],
    ids=["nothing known", "contradicted", "given", "another unit"],
)
def test_what_cannot_be_compared_says_why(change, outcome, reason):
    """Assert that each obstacle is one reason, and that only what the data lack is a lack."""
    a, b = two()
    found = compare_estimates(a, with_parameter(b, "joint_stiffness", **change))
    d = found.parameters["joint_stiffness"]
    assert (d.outcome, d.reason) == (outcome, reason)
    assert np.isnan(d.value)
    assert found.agree is (outcome == "not compared")


def with_term(seed, names, value=0.5, **shapes):
    """A drive with a term, by parameter and coefficient, that rests on constants of shapes."""
    made, (parameter, coefficient) = drawn(np.random.default_rng(seed)), names
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
PLAY = ("half_backlash", "alpha_backlash")
ALL, SIZE, NOTHING = (True, True), (True, False), (False, False)


@pytest.mark.parametrize(
    ("names", "shape", "first", "second", "size", "compared"),
    [
        (STRIBECK, "stribeck_velocity", 0.1, 0.19, 0.5, ALL),
        (STRIBECK, "stribeck_velocity", 0.1, 0.21, 0.5, NOTHING),
        (RIPPLE, "ripple_number", 23.4, 23.6, 0.5, ALL),
        (RIPPLE, "ripple_number", 23.4, 24.0, 0.5, NOTHING),
        # The amplitude does not depend on where a ripple counts from.
        *((RIPPLE, "ripple_origin", 6.28, origin, 0.5, SIZE) for origin in (0.0, -6.28, 12.56)),
        # A gap has its own width, unless one was chosen for the motion.
        (PLAY, "backlash_width", 0.5, 1.5, 1.5, ALL),
        (PLAY, "backlash_width", 0.5, 3.05, 1.5, NOTHING),
        (PLAY, "backlash_width", 0.5, 1.5, -1.5, NOTHING),
    ],
)
def test_what_rests_on_a_shape_is_compared_with_the_same(
    names, shape, first, second, size, compared
):
    """Assert that amplitudes of unlike widths, and phases of unlike ripples, are not compared."""
    a, b = with_term(9, names, **{shape: first}), with_term(10, names, size, **{shape: second})
    found = compare_estimates(a, b)
    coefficient = found.coefficients[names[1]]
    assert (found.parameters[names[0]].compared, coefficient.compared) == compared
    reason = f"it rests on a {shape} of {first:g} in A and of {second:g} in B"
    assert coefficient.reason.startswith("" if coefficient.compared else reason)
    assert found.parameters["joint_stiffness"].compared
