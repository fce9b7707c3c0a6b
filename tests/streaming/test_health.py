"""Rules of a stream's health, on both sides of their limits, and streams without an input."""

from pathlib import Path

import numpy as np
import pytest
from moving_joint import (
    LINK,
    MOTOR,
    NOISE,
    TIME,
    TORQUE,
    TRUTH,
    H,
    all_hold,
    followed,
    log_text,
    same,
    stream,
    torque,
    watched,
)

from flexid.identification.judgement import verdict
from flexid.models.flexible_joint import flexible_joint
from flexid.simulation.free_run import free_run
from flexid.streaming.health import Evidence, Health, Recent, Width, contradicts, judge
from flexid.streaming.options import WatchOptions

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
        ({"determined": False, "settled": 41.0}, Health.NOT_EXCITED, "does not separate"),
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


OPTIONS = WatchOptions(H, ("gravity",), "link")
DAMPED = WatchOptions(H, ("gravity", "joint_damping"), "link")


def motion(duration: float = 8.0, seed: int = 1) -> np.ndarray:
    """Return samples without the torque."""
    return stream(duration, seed)[:, [TIME, LINK, MOTOR]]


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
        chosen = {"terms": OPTIONS.terms, "sample_time": H, "kind": model}
        session = followed(tmp_path / "log.csv", chosen).result
        assert same(session, watched(motion(2.0), OPTIONS))
