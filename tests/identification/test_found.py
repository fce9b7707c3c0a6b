"""Estimates from logs of an independent simulator, and warnings where the model lacks a term."""

import json
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from benchmarks.trials.generate import make_trial
from made_joint import JOINT, assert_holds, data, log, made, pushed, recording, seen, turned
from simulated_cases import BENT, BRISTLES, DRY, HYSTERESIS, RIPPLED, SLID, STICTION, Case

from flexid.arrays import to_json
from flexid.errors import SettingError
from flexid.estimators.channel_timing import Timing
from flexid.estimators.unknowns import Unknowns
from flexid.exports.request import request_of_identification
from flexid.identification.full_model.amplifier import DrivenBalance
from flexid.identification.full_model.model import Structure
from flexid.identification.full_model.starting import smooth_unknowns
from flexid.identification.identify import identify
from flexid.identification.preparation.recordings import IDEAL
from flexid.identification.preparation.settings import Settings
from flexid.identification.result import Identification
from flexid.models.flexible_joint import PAPER_TERMS, SQUARES, TIES
from flexid.stored_estimates.estimate_file import estimate_document, read_estimate
from flexid.stored_estimates.frequency_response import linear_joint
from flexid.stored_estimates.structure import structure_of, values_of
from flexid.stored_estimates.validate_estimate import validate_estimate
from flexid.streaming.options import StreamChannels, options_of_stream

PAPER = Settings(terms=PAPER_TERMS)
LINK = Settings(model="link")

LATE = {"input_delay": 3e-3, "link_delay": 0.7e-3}
WEAK = {"motor_coulomb_up": 0.1, "motor_coulomb_down": 0.1, "motor_static": 0.05}
WEAK |= {"stribeck_velocity": 0.8, "size": 0.15, "noise": 2e-4}
ECCENTRIC: dict[str, Any] = {"eccentricity": 0.02, "eccentricity_phase": 0.6}  # rad
TRANSMISSION = {
    "transmission_number": 10.0,
    "transmission_error": 3e-4,  # rad
    "transmission_phase": 0.6,
    "second_transmission_error": 2e-4,
    "second_transmission_phase": -0.4,
}
DAMPED = {**DRY, "held": True, "joint_damping": 0.4}
SATURATION = {"saturation": 0.1, "peak_torque": 30.0}
SATURATED = {"torque_saturation": 0.1 / 30.0**2}
WRONG_SCALE = {"scale_error": 0.002 / 1.002}
WRONG_SCALE |= {"motor_inertia": 0.3 / 1.002, "motor_viscous_friction": 0.2 / 1.002}
LONG: dict[str, Any] = {"seconds": {3: 12.0}}

CASES = {
    "nothing more": Case(),
    "a light motor": Case({"motor_inertia": 0.002}, settings=PAPER, accuracy=2e-4, **LONG),
    "given delays": Case(
        LATE, settings=replace(PAPER, **LATE, hold="cubic", segment_duration=1.0), seconds={4: 8.0}
    ),
    "unknown delays": Case(LATE, settings=PAPER, seconds={4: 10.0}),
    "a known inertia": Case(settings=replace(PAPER, known={"motor_inertia": 0.3})),
    "a known spring": Case(settings=Settings(known={"theta2": 100.0})),
    "friction of the motor": Case(DRY, ("motor_coulomb",)),
    "friction, damping and a held torque": Case(
        DAMPED, ("joint_damping", "motor_coulomb"), seconds={5: 8.0}, hold="zero"
    ),
    "friction of the link": Case({"link_coulomb": 1.0}, ("link_coulomb",)),
    "friction that falls off": Case(
        {**DRY, **STICTION}, ("motor_coulomb", "motor_stribeck"), accuracy=0.03, **LONG
    ),
    # A friction of the squared velocity explains this log nearly as well.
    "friction that falls off in slow motion": Case(
        WEAK, ("motor_coulomb", "motor_stribeck"), settings=Settings(hold="cubic"), accuracy=0.03
    ),
    "a spring that hardens": Case({"cubic_stiffness": 2000.0}, ("cubic_stiffness",)),
    "friction of the load": Case(
        {**DRY, "load_friction": 0.05}, ("motor_coulomb", "load_friction"), seconds={2: 8.0}
    ),
    "a spring that stiffens": Case({"progressive_stiffness": 50.0}, ("progressive_spring",)),
    "a spring to the base": Case({"parallel_stiffness": 1.0}, ("parallel_spring",)),
    "an error of scales": Case(
        {"motor_scale": 1.002}, ("scale_error",), WRONG_SCALE, accuracy=1e-3
    ),
    "a spring that remembers": Case(HYSTERESIS, ("spring_hysteresis",)),
    "a torque that saturates": Case(SATURATION, ("torque_saturation",), SATURATED),
    "an eccentric gear": Case(ECCENTRIC, ("eccentricity",), **LONG),
    "an error of the transmission": Case(
        TRANSMISSION, ("transmission_error",), seconds={4: 12.0}, accuracy=0.01
    ),
    "presliding": Case(
        BRISTLES, ("motor_coulomb", "motor_presliding"), SLID, seconds={2: 12.0}, accuracy=0.01
    ),
    "a ripple": Case(RIPPLED, ("torque_ripple",), seconds={1: 12.0}, accuracy=2e-4),
    "a ripple and a bend": Case(
        {**RIPPLED, **BENT}, ("torque_ripple", "bent_spring"), accuracy=1e-3, **LONG
    ),
    "a bend of the link alone": Case(
        BENT, ("bent_spring",), settings=LINK, seconds={2: 12.0}, accuracy=0.01
    ),
    "an error of the transmission of the link alone": Case(
        TRANSMISSION,
        ("transmission_error",),
        settings=LINK,
        seconds={4: 12.0},
        accuracy=0.02,
        rough="second_transmission_error_angle",
    ),
    "a gap of the link alone": Case(
        {"half_gap": 2e-3}, ("backlash",), settings=LINK, accuracy=0.01
    ),
    "the link alone, late": Case(
        {"link_delay": 2e-3}, settings=LINK, seconds={3: 8.0}, accuracy=0.025
    ),
    "the link alone, whatever the motor does": Case(
        {"motor_coulomb_up": 3.0, "motor_coulomb_down": 3.0, "torque_noise": 0.5},
        settings=LINK,
        seconds={2: 10.0},
        accuracy=1e-3,
    ),
}


@cache
def identified_case(name: str) -> Identification:
    """Return the result for the logs of a case."""
    return CASES[name].identified()


@pytest.mark.parametrize("name", CASES)
def test_what_a_log_shows_is_found(name):
    """Assert that terms, hold and values are right, and that intervals are wide enough."""
    CASES[name].check(identified_case(name))


def test_friction_of_the_load_is_no_limit_of_the_input():
    """Assert that a slow torque against a heavy link, behind a lossy gear, is not called limited.

    Least squares without the friction of the load found a limit of 17 N m.
    """
    tones = np.array([0.9, 1.7, 2.9, 4.3, 6.1, 9.0])
    phases = np.random.default_rng(2).uniform(0.0, 6.0, 6)

    def torque(at: np.ndarray) -> np.ndarray:
        return np.sin(np.outer(at, tones) + phases) @ np.array([12.0, 9.0, 6.0, 4.0, 3.0, 3.0])

    acts: dict[str, Any] = {**DRY, "load_friction": 0.3, "gravity_torque": 60.0}
    slow = data(made(2, 12.0, torque=torque, **acts))
    joint = JOINT.scaled(slow.samples)
    balance = DrivenBalance(Structure(joint, joint.shapes, Timing("zero")), slow)
    assert balance.amplifier(is_voltage=False) == IDEAL


def test_springs_are_found_among_disturbances():
    """Assert both springs where the exact search, which tries one term at a time, ends early."""
    found = identify([log(made(1, 8.0, progressive_stiffness=50.0, parallel_stiffness=3.0))])
    assert found.disturbances is not None
    truth = {"joint_stiffness": 100.0, "gravity_torque": 5.0}
    truth |= {"progressive_stiffness": 50.0, "parallel_stiffness": 3.0}
    assert_holds(found, truth)
    assert {n: found.parameters[n].value for n in truth} == pytest.approx(truth, rel=0.02)


def test_an_error_of_scales_is_found_among_disturbances():
    """Assert the error, and narrow intervals of spring and gravity.

    The first fit of all terms is in a wrong minimum, where removed terms seem to matter.
    """
    push = dict.fromkeys(("link_push", "motor_push"), 1.0)
    shown = pushed(1, 12.0, gravity_torque=5.0, **push)
    found = identify([log(seen(shown, 0.0 * shown.time, 0.005 * shown.motor_position))])
    assert found.disturbances is not None
    assert_holds(found, {"scale_error": 0.005}, 0.6)
    assert_holds(found, {"joint_stiffness": 150.0}, 0.1)
    assert_holds(found, {"gravity_torque": 5.0}, 0.4)


def test_a_spring_to_the_base_of_a_link_alone_is_no_error_of_scales():
    """Assert the spring, where the link's balance alone cannot tell one from the other."""
    found = identify([log(made(1, 8.0, parallel_stiffness=1.0))], LINK)
    assert found.choices.terms == ("gravity", "parallel_spring")
    assert_holds(found, {"joint_stiffness_per_link_inertia": 100.0})


def test_an_error_of_scales_may_go_again():
    """Assert that an error of scales, which this hysteresis first looks like, is not left."""
    trial = make_trial("hysteresis_other", 310)
    found = identify(
        [log(recording(trial.time, trial.link_position, trial.motor_position, trial.torque))]
    )
    assert found.disturbances is not None
    assert "spring_hysteresis" in found.choices.terms
    assert "scale_error" not in found.choices.terms


def test_presliding_is_found_among_disturbances():
    """Assert the reach of presliding where the torque's noise hides it in the exact fit."""
    drive: dict[str, Any] = BRISTLES | {"bristle_stiffness": 100.0, "torque_noise": 1.0}
    found = identify([log(made(3, 12.0, **drive))])
    assert found.disturbances is not None
    assert "motor_presliding" in found.choices.terms
    assert_holds(found, {"motor_inertia": 0.3, "presliding_friction": 2.0})
    assert found.parameters["presliding_reach"].value == pytest.approx(0.02, rel=0.3)


@pytest.mark.parametrize(("known", "contradicted"), [(0.005, False), (0.015, True)])
def test_a_known_reach_is_compared_with_the_fit_that_it_leads_to(known, contradicted):
    """Assert that the true reach is not contradicted by a wrong minimum, and a wrong one is."""
    settings = Settings(known={"presliding_reach": known})
    found = identify([log(made(3, 8.0, **BRISTLES))], settings)
    assert any("contradicts the log" in warning for warning in found.warnings) == contradicted
    assert found.verdict == ("undetermined" if contradicted else "determined")


def test_a_needed_term_is_not_lost_to_few_blocks():
    """Assert that friction stays whose value few blocks show; its test alone has no power."""
    found = identify([log(made(6, 12.0, **DRY, **STICTION))])
    assert found.choices.terms == (*PAPER_TERMS, "motor_coulomb", "motor_stribeck")
    assert max(found.residual_excess.values()) < 1.1
    assert found.parameters["motor_coulomb_friction"].value == pytest.approx(1.0, rel=1e-3)


def test_evidence_is_given_for_each_term():
    """Assert evidence for kept and removed terms, and small intervals of removed ones."""
    found = identified_case("nothing more")
    lower, upper = found.removed["motor_coulomb_friction"].interval
    assert -1e-3 < lower <= upper < 1e-3
    assert "motor_inertia" not in found.removed
    evidence = {e.name: e for e in found.choices.term_evidence}
    assert {"alpha_coulomb", "theta_viscous", "input_delay"} <= set(evidence)
    assert evidence["theta1"].kept
    assert evidence["theta1"].probability < 1e-6
    assert evidence["theta1"].value == pytest.approx(5.0, rel=0.01)


OF_PRESLIDING = ("presliding_reach", "presliding_grip", "alpha_presliding")


@pytest.mark.parametrize(
    ("asked", "names", "verdict"),
    [
        ({}, OF_PRESLIDING, "determined"),
        ({}, ("motor_coulomb_friction",), "undetermined"),
        ({"known": {"presliding_friction": 2.0}}, OF_PRESLIDING, "undetermined"),
        ({"bounds": {"presliding_grip": [1.0, 1e3]}}, OF_PRESLIDING, "undetermined"),
        ({"known": {"motor_inertia": 0.3}}, OF_PRESLIDING, "determined"),
        ({"terms": ["gravity", "motor_presliding"]}, OF_PRESLIDING, "undetermined"),
    ],
)
def test_an_unusual_term_counts_only_if_a_setting_asks_for_it(asked, names, verdict):
    """Assert the verdict if one value is undetermined, of presliding or of a usual term."""
    found = identified_case("presliding")
    settings = {**found.provenance["settings"], **asked}
    for name in names:
        kind = "parameters" if name in found.parameters else "coefficients"
        values = getattr(found, kind)
        changed: Any = {kind: {**values, name: values[name].unknown("for want of motion")}}
        judged = replace(found, **changed, provenance={"settings": settings})
        assert judged.verdict == verdict, name
        assert judged.supports(strict=True) == (verdict == "determined"), name


def test_option_of_the_same_name_repeats_the_choice():
    """Assert that every choice is recorded, and repeats the values if given as a setting."""
    found = identified_case("nothing more")
    chosen = dict(found.provenance["chosen"])
    not_choices = {"known", "known_deviations", "bounds", "validation_share"}
    assert set(found.provenance["settings"]) - not_choices <= set(chosen)
    assert chosen["terms"] == list(PAPER_TERMS)
    names = ("hold", "input_delay", "link_delay", "segment_duration")
    by_hand = Settings(terms=tuple(chosen["terms"]), **{name: chosen[name] for name in names})
    repeated = identify([log(made(1, 8.0))], by_hand)
    for name, coefficient in found.coefficients.items():
        low, high = coefficient.interval
        assert low - 1e-12 <= repeated.coefficients[name].value <= high + 1e-12, name


def test_a_ripple_far_from_zero_counts_from_where_it_is():
    """Assert that thirty turns away the estimate is the same, and that the origin is reported."""
    near = identified_case("a ripple")
    far = identify([log(turned(made(1, 12.0, **RIPPLED), -30))])
    origin = -30.0 * 2.0 * np.pi
    assert far.choices.shapes["angle_origin"] == pytest.approx(origin)
    assert f"its angle counted from {origin:.5g})" in far.summary[0]
    for name in ("ripple_number", "ripple_angle", "torque_ripple", "motor_inertia"):
        a, b = near.parameters[name], far.parameters[name]
        assert b.value == pytest.approx(a.value, abs=a.std)
        assert b.std == pytest.approx(a.std, rel=0.2)


@pytest.mark.parametrize(
    ("term", "size", "constant", "largest"),
    [
        ("torque_ripple", "torque_ripple", "ripple_number", 1e-3),
        ("bent_spring", "bend_stiffness", "bend_deflection", 0.1),
    ],
)
def test_a_shape_that_is_asked_for_and_not_there_has_no_size(term, size, constant, largest):
    """Assert that an absent shape has a small size and an undetermined constant, with no harm."""
    absent = identify([log(made(1, 12.0))], Settings(terms=(*PAPER_TERMS, term)))
    assert np.abs(absent.parameters[size].interval).max() < largest
    assert absent.parameters[constant].verdict == "undetermined"
    assert absent.parameters["joint_stiffness"].value == pytest.approx(100.0, rel=1e-4)


def test_what_becomes_of_an_estimate_with_hysteresis():
    """Assert that the stored estimate predicts another log, and has no linear or exported form."""
    found = identified_case("a spring that remembers")
    document = json.loads(to_json(estimate_document(found)))
    answer = validate_estimate(read_estimate(document), [log(made(2, **HYSTERESIS))])
    assert min(answer.fit_percent.values()) > 99.0
    assert "hysteresis_grip" not in linear_joint(found).names
    with pytest.raises(SettingError, match="identify with --terms gravity,motor_viscous"):
        request_of_identification(found)


def test_what_becomes_of_an_estimate_with_squares():
    """Assert that a square is a tied coefficient, and a constant in an exported estimator."""
    gear = identified_case("an eccentric gear")
    values = {name: c.value for name, c in gear.coefficients.items()}
    for name, (a, b, d) in TIES.items():
        if name in values:
            assert values[name] == pytest.approx(values[a] * values[b] / values[d], rel=1e-9)
    assert values.keys() >= SQUARES
    again = structure_of(gear, values_of(gear, 0))
    assert set(again.unknowns(()).names) == {c for c in values if c not in TIES}
    source = request_of_identification(gear)
    assert not SQUARES & {*source.system.coefficients}
    assert source.system.constants.keys() >= SQUARES
    assert Unknowns(source.system).names == source.system.coefficients
    channels = StreamChannels("flexible", "N m", False, ())
    assert not options_of_stream({"terms": PAPER_TERMS}, gear, channels, 2e-3).given
    none = replace(gear.coefficients["alpha_ecc_product"], value=np.nan)
    coefficients = {**gear.coefficients, "alpha_ecc_product": none}
    with pytest.raises(SettingError, match="alpha_ecc_product"):
        request_of_identification(replace(gear, coefficients=coefficients))


def test_least_squares_seeks_no_square():
    """Assert that coefficients identified only by ties to squares are left out of least squares."""
    joint = JOINT.scaled(data(made(3, 12.0, **ECCENTRIC)).samples).with_shapes_in_least_squares
    structure = Structure(joint, frozenset(), Timing("cubic"))
    unknowns = smooth_unknowns(structure, (0,))
    assert not SQUARES & {*unknowns.names}
    assert {"alpha_ecc_sine", "alpha_ecc_cosine"} <= {*unknowns.names}
