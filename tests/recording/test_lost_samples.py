"""Lost samples in logs with a counted time, and frozen sensors, whose samples are left out."""

from typing import Any

import numpy as np
import pytest
from joint_log import joint_columns, read_columns, said, without

from flexid.arrays import FloatArray
from flexid.recording.lost_samples import (
    _local_inflation,
    all_times,
    even_times,
    lost_samples,
    with_hidden_losses,
)

STEP = 0.01


def motion(noise: float, seed: int = 1, rate: float = 100.0) -> np.ndarray:
    """Return positions of a swinging link and motor, shape (2, 3000), in rad."""
    rng = np.random.default_rng(seed)
    time = np.arange(3000) / rate
    motor = 0.8 * np.sin(3.0 * time) + 0.3 * np.sin(7.1 * time + 1.0)
    link = motor + 0.02 * np.sin(3.0 * time + 0.3)
    return np.stack([link, motor]) + noise * rng.standard_normal((2, len(time)))


def lost_of(positions: np.ndarray | list[np.ndarray]) -> np.ndarray:
    """Return the number lost after each sample, for positions with a counted time."""
    return lost_samples([*positions], STEP * np.arange(len(positions[0]), dtype=np.float64))


def dropping(positions: np.ndarray, lost: np.ndarray) -> tuple[list[np.ndarray], np.ndarray]:
    """Return positions without some samples, and the number missing after each one."""
    kept = np.delete(np.arange(positions.shape[1]), lost)
    return list(positions[:, kept]), np.diff(kept) - 1


SWING = 0.02 * np.sin(2.0 * np.pi * np.arange(3000) / 12.0)  # not described by a parabola
RESONANCE = motion(1e-5) + np.outer([1.0, -0.5], SWING)


@pytest.mark.parametrize(
    ("positions", "seed", "share"),
    [*((motion(1e-4, seed), seed, 0.8) for seed in range(5)), (RESONANCE, 7, 0.95)],
)
def test_lost_samples_are_found_where_they_are(positions: np.ndarray, seed: int, share: float):
    """Assert that most losses are found, with their number, and that no other place is named."""
    lost = np.random.default_rng(seed).choice(np.arange(10, 2990), 60, replace=False)
    kept, true = dropping(positions, lost)
    found = lost_of(kept)
    assert not found[true == 0].any()
    assert np.count_nonzero(found == true) > 0.99 * len(true)
    assert found.sum() > share * true.sum()


@pytest.mark.parametrize("seed", range(4))
def test_losses_hidden_by_noise_are_counted(seed: int):
    """Assert that the clock stays right where noise hides a third of the losses."""
    lost = np.random.default_rng(seed).choice(np.arange(10, 2990), 60, replace=False)
    kept, true = dropping(motion(3e-3, seed), lost)
    seen = lost_of(kept)
    every = with_hidden_losses(kept, seen)
    assert np.all(every >= seen)
    assert seen.sum() < 50 < every.sum() < 70
    late = [np.abs(np.cumsum(found - true)).max() for found in (seen, every)]
    assert late[1] < 0.4 * late[0]


def test_a_leap_of_half_a_step_more_is_no_hidden_loss():
    """Assert that a place whose error a loss does not explain is not counted later either."""
    kept, _ = dropping(motion(1e-5), np.arange(100, 2900, 140))
    leap = [np.append(p[:1570], p[1570:] + 0.6 * (p[1570] - p[1569])) for p in kept]
    found = lost_of(leap)
    assert np.count_nonzero(found) > 15
    assert not with_hidden_losses(leap, found)[1569]


@pytest.mark.parametrize("noise", [0.0, 1e-5, 1e-3])
def test_nothing_is_found_where_nothing_is_lost(noise: float):
    """Assert that nothing is found in smooth motion, with stop and go, or with jumps."""
    positions = motion(noise)
    for other in (positions, np.maximum(positions, 0.2), np.sign(positions)):
        assert not lost_of(other).any()


@pytest.mark.parametrize(("shift", "found"), [(1, False), (8, True)])
def test_what_happens_only_where_a_motion_turns_is_no_loss(shift: int, found: bool):
    """Assert that kinks by friction at reversals are not lost samples, and others are."""
    turns = np.flatnonzero(np.diff(np.sign(np.diff(motion(0.0)[1]))))
    lost = lost_of(dropping(motion(1e-5), turns[2:-2] + shift)[0])
    assert np.count_nonzero(lost) == found * len(turns[2:-2])


def test_an_error_that_is_usual_nearby_shows_less():
    """Assert that squares are normalised by nearby ones, as in the fastest part of a chirp."""
    squares = np.random.default_rng(3).chisquare(2, 2400)
    squares[2000:] *= 4.0
    found = _local_inflation(squares, 2)
    assert found[:2000] == pytest.approx(np.ones(2000), rel=0.4)
    assert found[2000:] == pytest.approx(np.full(400, 4.0), rel=0.4)
    assert found.min() == 1.0  # a calm stretch does not count more


def test_nothing_is_sought_in_other_logs():
    """Assert no losses if as many samples repeat, or if the time itself shows them."""
    positions, _ = dropping(motion(1e-5), np.arange(100, 2900, 140))
    repeated = [np.insert(p, np.arange(50, 2900, 140), p[50:2900:140]) for p in positions]
    assert not lost_of(repeated).any()
    positions, true = dropping(motion(1e-5), np.arange(100, 2900, 50))
    read = STEP * np.append(0, np.cumsum(1.0 + true))
    assert not lost_samples(positions, read).any()


def coarse(rate: float, lost: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
    """Return times in hundredths of a second, and positions, without some samples."""
    kept = np.setdiff1d(np.arange(3000), lost)
    return np.round(kept / rate, 2), [*motion(1e-4, 3, rate)[:, kept]]


@pytest.mark.parametrize("lost", [[], [*range(20, 2900, 90)]])
def test_double_steps_of_a_coarse_clock_are_no_losses(lost: list[int]):
    """Assert that 97 samples per second in whole 10 ms are even, with other losses found."""
    time, positions = coarse(97.0, np.array(lost, dtype=int))
    counted = even_times(time, positions)
    assert counted is not None
    found = all_times(counted, lost_samples(positions, counted), is_span=True)
    assert 2998 <= len(found) <= 3000
    assert 1.0 / np.diff(found).mean() == pytest.approx(97.0, rel=1e-3)


def test_positions_decide_what_double_steps_are():
    """Assert losses if positions show them, and else a coarse clock, even with random steps."""
    time, positions = coarse(100.0, np.arange(20, 3000, 32))
    assert even_times(time, positions) is None
    still = [0.0 * values for values in positions]
    assert even_times(time, still) is not None
    time = STEP * np.arange(3000, dtype=np.float64)
    for place in np.random.default_rng(5).choice(np.arange(20, 2980), 40, replace=False):
        time[place:] += STEP
    counted = even_times(time, [*motion(1e-5)])
    assert counted is not None
    np.testing.assert_allclose(np.diff(counted), np.diff(counted)[0], rtol=1e-9)


PERIOD = 0.005  # s
ENCODERS = ("link_position", "motor_position")
Columns = dict[str, FloatArray]


def columns(count: int = 400, noise: float = 1e-5) -> Columns:
    """Return a motion with noise in rad on both positions, and its torque."""
    rng = np.random.default_rng(3)
    found = without(joint_columns(count, PERIOD), "velocity")
    for name in ENCODERS:
        found[name] += noise * rng.standard_normal(count)
    return found


def repeated(found: Columns, start: int = 320, stop: int = 400) -> Columns:
    """Return the log with one sample repeated over a range."""
    for name, values in found.items():
        if name != "time":
            values[start:stop] = values[start]
    return found


def quantised(found: Columns, bits: int) -> Columns:
    """Return the log with encoders of this many bits; 0 changes nothing."""
    step = 2.0 * np.pi / 2**bits
    for name in ENCODERS if bits else ():
        found[name] = step * np.round(found[name] / step)
    return found


def braked(deceleration: float, bits: int = 0, jump: float = 0.0) -> Columns:
    """Return a joint that turns back and forth, brakes evenly from 1 s on, and rests."""
    found, place = columns(noise=0.0), 200
    after = np.maximum(found["time"] - 1.0, 0.0)
    for name in ENCODERS:
        values = found[name]
        speed = (values[place] - values[place - 1]) / PERIOD
        braking = np.minimum(after, abs(speed) / deceleration)
        stop = speed * braking - 0.5 * np.sign(speed) * deceleration * braking**2
        values[place:] = values[place] + stop[place:]
        values[340:] += jump
    found["motor_torque"][300:] = 0.0
    return quantised(found, bits)


def at_rest(found: Columns, part: slice, place: int, *names: str) -> Columns:
    """Return the log with some channels constant over a part."""
    for name in names:
        found[name][part] = found[name][place]
    return found


COLUMNS = {"motor_position": "m", "link_position": "l", "motor_torque": "u", "gear_ratio": 50.0}


def test_a_noisy_log_has_all_its_samples_again():
    """Assert the number of samples, and the warning, if noise hides a third of the losses."""
    found = without(joint_columns(6000, 0.005), "velocity")
    kept = np.setdiff1d(np.arange(6000), np.random.default_rng(1).choice(5990, 60) + 5)
    noise = np.random.default_rng(2).standard_normal((2, 6000))
    for name, deviation in zip(ENCODERS, 3e-3 * noise, strict=True):
        found[name] += deviation
    logged = {name: values[kept] for name, values in found.items()}
    log = read_columns(logged | {"time": found["time"][: len(kept)]})
    assert len(kept) < 5950
    assert abs(len(log.recordings[0]) - 6000) < 12
    (warning,) = (text for text in log.warnings if "were lost" in text)
    assert "more where noise hides them, and the time" in warning


@pytest.mark.parametrize("is_counted", [False, True])
@pytest.mark.parametrize("wrapped", ["l", "m", "lm"])
def test_a_wrap_within_a_gap(wrapped: str, is_counted: bool):
    """Assert smooth positions at all times if encoders wrap where up to three samples are lost."""
    true, count = without(joint_columns(3000, 0.001), "velocity"), 3000
    for name, seed in zip(ENCODERS, (4, 5), strict=True):
        true[name] += 1e-5 * np.random.default_rng(seed).standard_normal(count)
    link, motor = (true[name] for name in ENCODERS)
    logged = {"time": true["time"], "u": true["motor_torque"], "l": link, "m": 50.0 * motor}
    lost = {*range(40, 2960, 60)}
    for name in wrapped:
        logged[name] = np.mod(logged[name], 2.0 * np.pi)
        wraps = np.flatnonzero(np.abs(np.diff(logged[name])) > np.pi)
        places = wraps[:: 1 + len(wraps) // 10].tolist()
        lost |= {place + each for n, place in enumerate(places) for each in range(3 - n % 3)}
    kept = np.setdiff1d(np.arange(count), [*lost])
    logged = {name: values[kept] for name, values in logged.items()}
    if is_counted:
        logged["time"] = true["time"][: len(kept)]
    (found,) = read_columns(logged, COLUMNS).recordings
    assert len(found) == count
    assert np.ptp(found.needed_link_position - link) < 2e-4
    assert np.ptp(found.motor_position - motor) < 2e-4


def test_a_wrap_of_one_sample_is_no_spike():
    """Assert that an encoder near zero, which wraps for one sample, is not repaired."""
    found = columns(600, noise=0.0)  # the link turns back once
    link = found["link_position"] - np.min(found["link_position"]) - 1e-9
    log = read_columns(found | {"link_position": np.mod(link, 2.0 * np.pi)})
    assert sum("jumps by a turn" in text for text in log.warnings) == 1
    assert not any("off the neighbouring ones" in text for text in log.warnings)


CASES: dict[str, Columns] = {
    "the beginning": at_rest(columns(), slice(100), 100, *ENCODERS, "motor_torque"),
    "a link to the end": at_rest(columns(), slice(290, None), 290, "link_position"),
    "19 samples of it": at_rest(columns(), slice(381, None), 381, "link_position"),
    "a link in the middle": at_rest(columns(), slice(100, 140), 100, "link_position"),
    "19 samples of that": at_rest(columns(), slice(100, 119), 100, "link_position"),
    "a rest that jumps": braked(50.0, jump=0.3),
    "braking": braked(50.0),
    **{
        f"{moving} goes on": {**repeated(columns()), moving: columns()[moving]}
        for moving in ("motor_torque", "link_position")  # a brake, a stop
    },
}


def test_what_is_left_out(golden: Any):
    """Assert that repeated samples are left out in motion only."""
    golden({name: said(read_columns, found) for name, found in CASES.items()})


@pytest.mark.parametrize("bits", [0, 11, 12, 13, 14])
@pytest.mark.parametrize("braking", [1, 2, 5])
def test_a_drive_from_point_to_point_rests(bits: int, braking: int):
    """Assert that a drive that stops abruptly, rests without torque, and moves on is read whole."""
    run = np.r_[np.full(60, 0.8), np.linspace(0.8, 0.0, braking), np.zeros(70)]
    speed = np.concatenate([run] * 4)
    torque = np.where(speed == 0.0, 0.0, speed + np.sin(np.arange(len(speed))))
    link = np.cumsum(speed) * PERIOD
    found = {"time": PERIOD * np.arange(len(speed)), "motor_torque": torque}
    found |= {"link_position": link, "motor_position": link + 0.01 * torque}
    (recording,) = read_columns(quantised(found, bits)).recordings
    # At the very end a rest and a frozen logger look the same.
    assert len(recording) >= len(speed) - 70 + 1
