"""Families of steps, moves and fast joints draw what the page says of them."""

import numpy as np
import pytest
from benchmarks.trials.drafts import Draft
from benchmarks.trials.families import FAMILIES
from benchmarks.trials.generate import Recorded, make_trial, record, run_play
from benchmarks.trials.motions import Moves, Steps
from benchmarks.trials.sensors import draw_noise

DRAFTS = 400


def drafts(family: str) -> list[Draft]:
    """Many drives of a family."""
    rng = np.random.default_rng(5)
    return [FAMILIES[family].draw(rng) for _ in range(DRAFTS)]


def drawn(family: str, seed: int) -> tuple[np.random.Generator, Draft, Recorded]:
    """A drive that moves, with its log."""
    rng = np.random.default_rng(seed)
    for _ in range(50):
        draft = FAMILIES[family].draw(rng)
        found = record(rng, family, seed, draft)
        if found is not None:
            return rng, draft, found
    raise AssertionError(family)


def error_of(trial) -> float:
    """Standard deviation of a reading."""
    return trial.metadata["encoder_count"] / np.sqrt(12.0) or trial.metadata["encoder_noise"]


@pytest.mark.parametrize("family", ["torque_steps", "point_to_point", "fast_joint"])
def test_half_of_them_have_coulomb_friction(family):
    """Assert that friction acts in half of the drives, on the motor, by the same level each way."""
    having = [draft.of_torque for draft in drafts(family) if draft.of_torque]
    assert 0.4 * DRAFTS < len(having) < 0.6 * DRAFTS
    for shares in having:
        assert set(shares) == {"motor_coulomb_up", "motor_coulomb_down"}
        assert 0.05 <= shares["motor_coulomb_up"] == shares["motor_coulomb_down"] <= 0.2


def test_half_of_the_steps_begin_with_a_jolt():
    """Assert that half are in motion where the log begins, in which the torque steps there."""
    assert 0.4 * DRAFTS < sum(draft.jolted for draft in drafts("torque_steps")) < 0.6 * DRAFTS
    jolts = set()
    for seed in range(8):
        _, draft, (trial, _, sensors, play, _) = drawn("torque_steps", seed)
        jolts.add(draft.jolted)
        assert isinstance(play.motion, Steps)
        assert trial.hold == "zero"
        first = 50 * sensors.sample_time
        moved = np.ptp(trial.motor_position[trial.time < first])
        if draft.jolted:
            assert trial.torque[0] != 0.0
            assert moved > 3.0 * error_of(trial)
        else:
            still = trial.time < 0.1
            assert np.all(trial.torque[still] == 0.0)
            noise = 6.0 * sensors.noise + 1.01 * sensors.count
            assert np.ptp(trial.link_position[still]) <= 2.0 * noise
    assert jolts == {True, False}


def test_torque_steps_are_held():
    """Assert that the torque changes at few samples, a hundredth of them, or with the clock."""
    for seed in range(6):
        trial = make_trial("torque_steps", seed)
        changes = np.count_nonzero(np.diff(trial.torque))
        if trial.metadata["motion"] == "steps":
            assert 4 <= changes <= trial.time[-1] / 0.1
        else:
            assert len(set(trial.torque) - {0.0}) == 2
            tick = 0.2 * np.pi / trial.metadata["resonance"]
            assert 4 <= changes <= trial.time[-1] / tick


def test_moves_are_followed_by_a_controller():
    """Assert that a controller follows moves, and that some drives are damped or late."""
    _, draft, (trial, _, _, play, _) = drawn("point_to_point", 0)
    assert isinstance(play.motion, Moves)
    assert draft.controlled
    assert play.law.proportional > 0.0
    reference = play.amplitude * play.motion.at(trial.time)
    assert np.corrcoef(reference, trial.motor_position)[0, 1] > 0.5
    many = drafts("point_to_point")
    for has in (
        lambda draft: draft.base.joint_damping > 0.0,
        lambda draft: draft.base.link_viscous > 0.0,
        lambda draft: draft.input_delay > 0.0,
    ):
        assert 0.2 * DRAFTS < sum(map(has, many)) < 0.4 * DRAFTS
    assert max(draft.input_delay for draft in many) <= 5e-3


def test_a_fast_joint_is_sampled_ten_times_a_period():
    """Assert resonance, samples in its period, and a torque that reaches towards it."""
    for draft in drafts("fast_joint"):
        assert 94.0 <= draft.resonance <= 314.0
        assert 0.4 <= draft.band / draft.resonance <= 0.75
    for seed in range(4):
        trial = make_trial("fast_joint", seed)
        link, motor = trial.truth["link_inertia"], trial.truth["motor_inertia"]
        resonance = np.sqrt(trial.truth["joint_stiffness"] * (1.0 / link + 1.0 / motor))
        assert 94.0 <= resonance <= 314.0
        assert 2.0 * np.pi / resonance >= 10.0 * trial.metadata["sample_time"]


@pytest.mark.parametrize("family", ["torque_steps", "point_to_point", "fast_joint"])
def test_the_encoders_show_the_deflection_and_no_link_goes_over(family):
    """Assert a deflection of 20 times the encoder's error, and a link that hangs."""
    for seed in range(4):
        trial = make_trial(family, seed)
        assert (trial.link_position - trial.motor_position).std() > 20.0 * error_of(trial)
        assert np.abs(trial.link_position).max() < 2.3
        assert family == "fast_joint" or 5.9 < trial.time[-1] < 20.1


@pytest.mark.parametrize("family", ["torque_steps", "point_to_point", "fast_joint"])
def test_half_the_step_changes_nothing_that_an_encoder_shows(family):
    """Assert that the integrator's step is short enough for jolts, rests and fast joints."""
    for seed in range(3):
        rng, draft, (_, drive, sensors, play, _) = drawn(family, seed)
        noise = draw_noise(rng, draft, sensors)
        whole, half = (
            run_play(draft, drive, play, sensors.instants, noise, 0.0, by * draft.longest)
            for by in (1.0, 0.5)
        )
        apart = np.abs(whole.states - half.states)[:, (0, 2)]
        assert np.ptp(whole.link) > 0.2
        assert apart.max() < 1e-9


def test_two_at_once_are_two():
    """Assert that each draft has two of what there is, each of it in some, and no spring twice."""
    seen: dict[str, int] = {}
    for draft in drafts("two_at_once"):
        drive, shares = draft.base, draft.of_torque
        having = {
            "stribeck": "motor_static" in shares,
            "ripple": "ripple_torque" in shares,
            "eccentricity": drive.eccentricity > 0.0,
            "play": drive.half_gap > 0.0,
            "bend": drive.bend_stiffness != 0.0,
        }
        assert sum(having.values()) == 2
        assert not (having["play"] and having["bend"])
        for name, there in having.items():
            seen[name] = seen.get(name, 0) + there
    assert min(seen.values()) > DRAFTS / 10
