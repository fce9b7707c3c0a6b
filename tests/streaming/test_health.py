"""Rules of a stream's health, streams without an input, and comparison with what is known."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from moving_joint import (
    LINK,
    MOTOR,
    NOISE,
    OPTIONS,
    TIME,
    TORQUE,
    TRUTH,
    H,
    all_hold,
    followed,
    log_text,
    options_of,
    same,
    stream,
    torque,
    watched,
)

from flexid.identification.judgement import verdict
from flexid.identification.preparation.recordings import Amplifier, Delay
from flexid.identification.vocabulary.evidence import ValueEstimate
from flexid.models.flexible_joint import flexible_joint
from flexid.report.terminal import as_text
from flexid.report.watch import parts
from flexid.simulation.free_run import free_run
from flexid.streaming.health import Evidence, Health, Recent, Width, contradicts, judge
from flexid.streaming.learner import departures
from flexid.streaming.options import WatchOptions, not_accounted_for, wanted_kind

GOOD = Evidence(
    bad_share=0.0,
    bad_cause="a position jumps",
    is_stuck=False,
    settled=100.0,
    determined=True,
    open_direction=(),
    widths=(Width("theta2", 100.0, 1.0, 0.1), Width("beta1", 3.0, 0.1, 0.0)),
    changed="",
)


def widths(half: float, apart: float = 0.0, value: float = 100.0):
    """Return the widths of one coefficient."""
    return (Width("theta2", value, half, apart),)


@pytest.mark.parametrize(
    ("changes", "health", "words"),
    [
        ({}, Health.CONVERGED, "within 3 %, beta1 least precisely"),
        ({"is_stuck": True}, Health.SENSOR_FAULT, "stands still"),
        ({"bad_share": 0.21}, Health.SENSOR_FAULT, "21 % of the latest samples"),
        ({"bad_share": 0.19}, Health.CONVERGED, ""),
        ({"widths": widths(19.9)}, Health.CONVERGED, ""),
        ({"widths": widths(0.0012)}, Health.CONVERGED, "theta2 is known within 0.0012 %"),
        ({"widths": widths(20.1)}, Health.CONVERGING, "within 20 % so far"),
        ({"widths": widths(float("inf"))}, Health.CONVERGING, "no bounds"),
        ({"widths": widths(90.0, 99.0)}, Health.CONVERGING, ""),
        ({"widths": widths(90.0, 101.0)}, Health.INCONSISTENT, "disagree on theta2 by 101 %"),
        ({"widths": widths(90.0, 101.0), "settled": 39.0}, Health.CONVERGING, ""),
        ({"widths": widths(9.0, 0.0, -10.0)}, Health.INCONSISTENT, "theta2 is negative"),
        ({"widths": widths(11.0, 0.0, -10.0)}, Health.CONVERGING, ""),
        ({"contradicted": "a has changed"}, Health.INCONSISTENT, "a has changed"),
        ({"contradicted": "a has changed", "settled": 39.0}, Health.CONVERGED, ""),
        ({"contradicted": "a", "changed": "b", "widths": widths(21.0)}, Health.INCONSISTENT, "b"),
        ({"determined": False, "settled": 39.0}, Health.CONVERGING, "too few samples"),
        ({"determined": False, "settled": 41.0}, Health.NOT_EXCITED, "check the gear ratio"),
        ({"determined": False, "between": 0.9}, Health.NOT_EXCITED, "lost so often"),
        ({"determined": False, "between": 1.1}, Health.NOT_EXCITED, "does not separate"),
        ({"between": 0.9}, Health.CONVERGED, ""),
        ({"changed": "it moves otherwise"}, Health.CONVERGED, ""),
        ({"changed": "it did", "widths": widths(50.0)}, Health.INCONSISTENT, "it did"),
        ({"changed": "it did", "determined": False}, Health.INCONSISTENT, "it did"),
    ],
)
def test_rules(changes: dict, health: Health, words: str):
    """Assert that each rule gives its state and reason just beyond its limit, and not before."""
    judgement = judge(GOOD._replace(**changes))
    assert judgement.health is health
    assert words in judgement.reason


@pytest.mark.parametrize(
    ("changes", "contradicted"),
    [
        ({}, False),
        ({"error": 0.0109}, False),  # allowance and ten times the usual error
        ({"error": 0.0111}, True),
        ({"error": 0.0149, "usual_error": 5e-4}, False),
        ({"error": 0.0151, "usual_error": 5e-4}, True),
        ({"power": 0.0, "error": 0.0009}, False),  # at rest the noise remains
        ({"power": 0.0, "error": 0.0011}, True),
        ({"power": 4.0, "error": 0.0439}, False),  # errors grow with the motion
        ({"power": 4.0, "error": 0.0441}, True),
    ],
)
def test_contradiction(changes: dict, contradicted: bool):
    """Assert the limit of the latest motion's prediction error, from both sides."""
    usual = Recent("link", error=1e-4, power=1.0, usual_error=1e-4, usual_power=1.0)
    assert contradicts(usual._replace(**changes)) is contradicted


def test_values_are_those_of_the_exported_c():
    """Assert the numbers of the states, as in exported C."""
    words = ["converging", "converged", "not excited", "inconsistent", "sensor fault"]
    assert [health.words for health in Health] == words
    assert [*map(int, Health)] == [0, 1, 2, 3, 4]


WITH_COULOMB = WatchOptions(H, ("gravity", "motor_viscous", "motor_coulomb"), hold="linear")


@pytest.mark.parametrize(("noise", "expected"), [(3.0, "determined"), (30.0, "undetermined")])
def test_a_friction_that_is_not_there_is_judged_by_what_it_could_do(noise, expected):
    """Assert that a friction near zero is judged by its share of the acceleration."""
    samples = stream(3.0)
    acceleration = np.gradient(np.gradient(samples[::25, MOTOR], 25 * H), 25 * H)
    rng = np.random.default_rng(2)
    samples[:, [LINK, MOTOR]] += noise * NOISE * rng.standard_normal((len(samples), 2))
    found = watched(samples, WITH_COULOMB).coefficients["alpha_coulomb"]
    low, high = found.interval
    assert low < 0.0 < high
    effect = 0.5 * (high - low) / float(np.sqrt(np.mean(acceleration**2)))
    assert found.verdict == verdict(found.value, found.interval, effect)[0] == expected
    assert found.verdict != "determined" or verdict(found.value, found.interval)[0] != "determined"


LINK_ALONE = WatchOptions(H, ("gravity",), "link")
DAMPED = WatchOptions(H, ("gravity", "joint_damping"), "link")


def test_damping_is_found():
    """Assert narrow intervals that cover the truth, of damping too: velocities have their size."""
    damped = {"theta_damping": 0.5, "alpha_damping": 0.5 / 0.3}
    time = H * np.arange(4000)
    system = flexible_joint(("gravity", "motor_viscous", "joint_damping"))
    states = free_run(system, TRUTH | damped, np.zeros(4), torque(time)[:, None], H)
    positions = states[:, ::2] + 1e-5 * np.random.default_rng(3).standard_normal((len(time), 2))
    session = watched(np.column_stack((time, positions)), DAMPED)
    assert all_hold(session, {"theta1": 5.0, "theta2": 100.0, "theta_damping": 0.5})
    for name, width in (("theta2", 1.0), ("theta_damping", 0.02)):
        assert np.diff(session.coefficients[name].interval)[0] < width
    assert session.health.reason.startswith("theta2 is known within")


def test_a_log_without_a_torque_is_followed(tmp_path: Path):
    """Assert that columns decide the model, and that --model link ignores a torque."""
    for columns, model in (([TIME, LINK, MOTOR], "auto"), ([TIME, LINK, MOTOR, TORQUE], "link")):
        (tmp_path / "log.csv").write_text(log_text(stream(2.0), *columns))
        chosen = {"terms": LINK_ALONE.terms, "sample_time": H, "kind": model}
        session = followed(tmp_path / "log.csv", chosen).result
        assert same(session, watched(stream(2.0)[:, [TIME, LINK, MOTOR]], LINK_ALONE))


PHYSICAL = {
    "joint_stiffness": 100.0,
    "link_inertia": 1.0,
    "motor_inertia": 0.3,
    "gravity_torque": 5.0,
}


def estimated(value: float, half: float) -> dict[str, ValueEstimate]:
    """Return a parameter with its interval."""
    ends = (value - half, value + half)
    return {"a": ValueEstimate("a", "N m", value, half / 2.0, ends, "determined")}


@pytest.mark.parametrize(
    ("now", "half", "count"),
    [(109.0, 0.1, 0), (111.0, 0.1, 1), (120.0, 11.0, 0), (120.0, 9.0, 1), (89.0, 0.1, 1)],
)
def test_what_counts_as_a_departure(now: float, half: float, count: int):
    """Assert that a departure needs a tenth of the value, and twice the half widths."""
    reference = {"a": (100.0, 1.0), "b": (1.0, 0.1)}
    assert len(departures(reference, estimated(now, half), widths=2.0, least=0.1)) == count


@pytest.mark.parametrize(("was", "now", "count"), [(3.1, -3.1, 0), (0.0, 0.09, 0), (3.1, -3.0, 1)])
def test_an_angle_departs_round_the_circle(was: float, now: float, count: int):
    """Assert that angles differ by the shorter way, with a limit in rad."""
    angle = replace(estimated(now, 0.01)["a"], name="gravity_angle", unit="rad")
    found = departures({angle.name: (was, 0.01)}, {angle.name: angle}, widths=2.0, least=0.1)
    assert len(found) == count
    for one in found:
        assert one.sentence == "gravity_angle is -3 rad, and 3.1 in the estimate"
        assert np.isnan(one.change)


@pytest.fixture(scope="module")
def result(example_estimate):
    """Return an identification of the example."""
    return example_estimate.result


def test_terms_and_filter_of_a_stream(result):
    """Assert those of the estimate unless given, and those of a rigid joint by either name."""
    options = options_of(result)
    assert (options.terms, options.hold) == (("gravity", "motor_viscous"), "zero")
    assert options.filter_rate == result.choices.filter_rate
    assert options.reference.keys() >= PHYSICAL.keys()
    options = options_of(result, terms=("gravity",), hold="linear", filter_rate=10.0)
    assert (options.terms, options.hold, options.filter_rate) == (("gravity",), "linear", 10.0)
    assert wanted_kind({}, replace(result, model="link")) == "link"
    beta = replace(result.coefficients["beta1"], value=3.0, std=0.0)  # given instead of estimated
    options = options_of(replace(result, coefficients=result.coefficients | {"beta1": beta}))
    assert options.given == {"beta1": 3.0}
    assert "beta1" not in options.system.coefficients
    assert options_of(kind="rigid").terms == ("gravity", "viscous", "coulomb")
    options = options_of(kind="rigid", terms=("motor_viscous", "viscous_asymmetry"))
    assert options.terms == ("viscous", "viscous_asymmetry")
    assert options_of(h=0.02).filter_rate == pytest.approx(0.125 / 0.02)


@pytest.mark.parametrize("part", ["value", "std", "interval"])
def test_a_number_that_is_missing_is_compared_with_nothing(result, part: str):
    """Assert that a parameter without a finite value or interval is not compared."""
    missing = {"value": np.nan, "std": np.inf, "interval": (-np.inf, 1.0)}[part]
    stiffness = replace(result.parameters["joint_stiffness"], **{part: missing})
    parameters = result.parameters | {"joint_stiffness": stiffness}
    options = options_of(replace(result, parameters=parameters))
    assert {*PHYSICAL} - {*options.reference} == {"joint_stiffness"}


def test_what_a_stream_is_not_corrected_by_is_warned_of(result):
    """Assert warnings of a delay above a tenth of a sample, and of an amplifier's dead zone."""
    late = Delay(0.002, 1e-4, (0.0018, 0.0022), "found")
    alignment = replace(result.choices.alignment, input_delay=late)
    made = replace(result, choices=replace(result.choices, alignment=alignment))
    (warning,) = not_accounted_for(made, 0.019)
    assert "the input late by 2 ms" in warning
    assert [*not_accounted_for(made, 0.021)] == []
    choices = replace(result.choices, amplifier=Amplifier(dead_zone=0.2))
    (warning,) = not_accounted_for(replace(result, choices=choices), 0.01)
    assert "send the input that reaches the motor" in warning


def test_what_is_known_narrows_or_is_contradicted():
    """Assert that known inertias narrow other intervals, and that a wrong one is named."""
    free, fixed, nearly = (
        watched(stream(), replace(OPTIONS, known=known, known_deviations=deviations))
        for known, deviations in (
            ({}, {}), ({"motor_inertia": 0.3}, {}), ({"link_inertia": 1.0}, {"link_inertia": 1e-4})
        )
    )  # fmt: skip
    assert fixed.options.given == {"beta1": pytest.approx(1.0 / 0.3)}
    assert fixed.coefficients["beta1"].std == 0.0
    assert fixed.health.health is Health.CONVERGED
    for session, name, share in ((fixed, "joint_stiffness", 0.8), (nearly, "link_inertia", 0.5)):
        widths = [np.diff(s.parameters[name].interval)[0] for s in (free, session)]
        assert widths[1] < share * widths[0]
    low, high = nearly.parameters["joint_stiffness"].interval
    assert low < 100.0 < high
    known = replace(OPTIONS, known={"link_inertia": 2.0}, known_deviations={"link_inertia": 0.01})
    health, reason = watched(stream(), known).health
    assert health is Health.INCONSISTENT
    assert "link_inertia is known as 2" in reason


def test_a_drive_that_has_departed_is_said_to():
    """Assert the largest difference by name, in per cent, or in units if zero is possible."""
    values = PHYSICAL | {"joint_stiffness": 125.0, "motor_inertia": 0.26}
    reference = {name: (value, 1e-3 * value) for name, value in values.items()}
    session = watched(stream(), replace(OPTIONS, reference=reference))
    assert [d.name for d in session.departures] == ["joint_stiffness", "motor_inertia"]
    assert session.departures[0].change == pytest.approx(-0.2, abs=0.005)
    health, reason = session.health
    assert health is Health.INCONSISTENT
    assert reason.startswith("joint_stiffness is ")
    assert reason.endswith("N m/rad (-20 %), and 125 in the estimate")
    reference = {"joint_stiffness": (100.0, 0.1), "gravity_torque": (0.5, 0.6)}
    text = as_text(parts(watched(stream(), replace(OPTIONS, reference=reference))))
    assert re.search(r"joint_stiffness .* [+-]\d\.\d %\n", text)
    assert re.search(r"gravity_torque .* \+4\.\d+ N m\n", text)
