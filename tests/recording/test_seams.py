"""Logs that were joined without a trace in the time are cut at the seam, and others are not."""

from collections.abc import Callable

import numpy as np
import pytest
from joint_log import joint_columns, read_columns, without

from flexid import RecordingError
from flexid.arrays import FloatArray
from flexid.recording import Log
from flexid.recording.frame import table_of_arrays
from flexid.recording.read import logs_of_joints

STEP = 0.004  # s
COUNT = 1500  # samples of each log
TIME = STEP * np.arange(2 * COUNT, dtype=np.float64)
ENCODERS = ("link_position", "motor_position")
Columns = dict[str, FloatArray]
WHOLE = without(joint_columns(2 * COUNT, STEP), "velocity")


def joined(seam: float = 0.12, noise: float = 1e-5) -> Columns:
    """Return two logs in one, the second of which begins off the end of the first, in rad."""
    rng = np.random.default_rng(4)
    found = {name: values.copy() for name, values in WHOLE.items()}
    for name, share in zip(ENCODERS, (1.0, 0.85), strict=True):
        found[name][COUNT:] += share * seam
        found[name] += noise * rng.standard_normal(2 * COUNT)
    return found


def about_jumps(log: Log) -> list[str]:
    """Return the warnings of jumps."""
    return [text for text in log.warnings if "within one sample" in text]


@pytest.mark.parametrize(
    ("seam", "left_out"),
    [(0.12, "nothing"), (0.12, "link"), (-0.3, "nothing"), (-0.3, "link"), (4.0, "nothing")],
)
def test_joined_logs_are_cut_at_the_seam(seam: float, left_out: str):
    """Assert that each log is a recording with its own samples and times, and one warning."""
    columns = without(joined(seam), left_out)
    log = read_columns(columns)
    first, second = log.recordings
    assert second.start_time == pytest.approx(COUNT * STEP)
    np.testing.assert_array_equal(first.motor_position, columns["motor_position"][:COUNT])
    np.testing.assert_array_equal(second.motor_position, columns["motor_position"][COUNT:])
    (warning,) = (text for text in log.warnings if "jumps" in text)
    assert "at 6 s), as where logs were joined, so the log was cut there" in warning


def test_a_short_log_may_have_one_seam():
    """Assert that a log is cut that is shorter than what many jumps must be apart."""
    log = read_columns({name: v[COUNT - 200 : COUNT + 200] for name, v in joined().items()})
    assert [len(one) for one in log.recordings] == [200, 200]


def counted(period: float) -> Columns:
    """Return a joint whose motor counts from -period / 2 to period / 2, in rad."""
    found = shifted(lambda t: 0.25 * t + 0.1 * np.sin(t))
    motor = found["motor_position"]
    return found | {"motor_position": (motor + 0.5 * period) % period - 0.5 * period}


@pytest.mark.parametrize("left_out", ["link", "nothing"])
def test_a_counter_that_overflows_is_no_seam(left_out: str):
    """Assert that a jump over most of a position's range is refused, or cuts nothing."""
    with pytest.raises(RecordingError, match="which is not a whole turn of an encoder"):
        read_columns(without(counted(4.0), left_out))
    log = read_columns(without(counted(2.6), left_out))
    assert len(log.recordings) == 1
    assert not about_jumps(log)
    assert any("if a counter overflows, unwrap it" in text for text in log.warnings)


def test_an_overflow_among_other_jumps_is_no_seam():
    """Assert that both positions of joined logs must jump alike if one jumps that far."""
    found = counted(2.6)
    overflow = int(np.argmax(np.abs(np.diff(found["motor_position"]))))
    found["link_position"][overflow + 1 :] -= 0.3
    log = read_columns(found)
    assert len(log.recordings) == 1
    assert not about_jumps(log)


def test_a_deflection_may_go_on_at_a_seam():
    """Assert that the motor alone shows a seam if the link is known by its deflection."""
    found = joined()
    deflection = WHOLE["link_position"] - WHOLE["motor_position"]
    log = read_columns(without(found, "link") | {"deflection": deflection})
    assert [len(one) for one in log.recordings] == [COUNT, COUNT]


@pytest.mark.parametrize("which", [0, 1])
def test_a_seam_of_one_joint_cuts_the_logs_of_all(which: int):
    """Assert that an arm is cut where one joint jumps, though another began where it ended."""
    seams = [0.12 * (joint == which) for joint in range(2)]
    logs = logs_of_joints([(table_of_arrays(joined(seam)), None) for seam in seams])
    for log in logs:
        assert [len(one) for one in log.recordings] == [COUNT, COUNT]
    assert about_jumps(logs[which])
    assert not about_jumps(logs[1 - which])


def test_a_gap_at_the_seam_is_named_once():
    """Assert that logs joined with a pause are cut by the time, without a warning of a jump."""
    found = joined()
    found["time"] = TIME + 2.0 * (TIME > (COUNT - 0.5) * STEP)
    log = read_columns(found)
    assert len(log.recordings) == 2
    assert not about_jumps(log)


def test_a_position_may_change_across_a_gap_only():
    """Assert that a link that is clamped at two places has no seam."""
    second = TIME > (COUNT - 0.5) * STEP
    log = read_columns(WHOLE | {"time": TIME + 1.0 * second, "link_position": 0.3 * second})
    assert len(log.recordings) == 2
    assert not about_jumps(log)


@pytest.mark.parametrize("slipped", ENCODERS)
def test_one_encoder_that_slips_cuts_nothing(slipped: str):
    """Assert that a jump of one encoder, in fast motion, is another fault with its own warning."""
    found = joined(0.0)
    fastest = np.argmax(np.abs(np.diff(found[slipped])))
    found[slipped][fastest + 1 :] += 0.3
    log = read_columns(found)
    assert len(log.recordings) == 1
    (warning,) = about_jumps(log)
    assert f"{slipped} jumps within one sample (by up to 0.3" in warning
    assert "as if the encoder slipped" in warning


def shifted(motion: Callable[[FloatArray], FloatArray], bits: int = 0) -> Columns:
    """Return a joint that follows a motion of time, with coarse encoders of some bits."""
    link = motion(TIME) + 0.002 * np.sin(11.0 * TIME)
    found = WHOLE | {"motor_position": motion(TIME), "link_position": link}
    step = 2.0 * np.pi / 2**bits
    return found | {name: step * np.round(found[name] / step) for name in ENCODERS if bits}


def without_samples(count: int) -> Columns:
    """Return a log that lacks samples in two places, in a time that was counted without them."""
    kept = np.delete(np.arange(2 * COUNT), np.add.outer([900, 2200], np.arange(count)).ravel())
    return {name: values[kept] for name, values in joined(0.0).items()} | {
        "time": TIME[: len(kept)]
    }


def displaced(count: int) -> Columns:
    """Return a log in which both positions are off by 0.3 rad in some samples."""
    found = joined(0.0)
    for name in ENCODERS:
        found[name][COUNT : COUNT + count] += 0.3
    return found


def held(columns: Columns, every: int) -> Columns:
    """Return a log whose encoders are read in every n-th sample only."""
    last = np.arange(2 * COUNT) // every * every
    return columns | {name: columns[name][last] for name in ENCODERS}


def moved_once(time: FloatArray) -> FloatArray:
    """Return a joint that rests, and moves within 0.25 s."""
    return 0.3 * np.sin(0.5 * np.pi * np.clip(4.0 * time - 20.0, 0.0, 1.0)) ** 2


def stepped(size: float, every: float) -> Callable[[FloatArray], FloatArray]:
    """Return a slow motion with steps within one sample, as dry friction causes them."""
    return lambda time: 0.3 * np.sin(0.5 * time) + size * np.floor(time / every)


def slips(time: FloatArray) -> FloatArray:
    """Return a motion that sticks, and slips by 0.1 rad within three samples, again and again."""
    return 0.1 * np.floor(time) + 0.1 * np.clip((time % 1.0) / (3.0 * STEP), 0.0, 1.0)


def kicked(time: FloatArray) -> FloatArray:
    """Return a joint that rests, and is struck so that it swings with 30 Hz."""
    after = np.maximum(time - 3.0013, 0.0)
    return 0.05 * np.exp(-3.0 * after) * np.sin(190.0 * after)


def released(time: FloatArray) -> FloatArray:
    """Return a joint that is released from a clamp, and decays."""
    return 0.3 * np.cos(25.0 * np.maximum(time - 2.0, 0.0)) * np.exp(-np.maximum(time - 2.0, 0.0))


SMOOTH: dict[str, Columns] = {
    "a whole log": joined(0.0),
    "coarse encoders": shifted(lambda t: 0.4 * np.sin(2.0 * t), 9),
    "stick and slip": shifted(slips),
    "a struck joint": shifted(kicked),
    "a struck joint with coarse encoders": shifted(kicked, 12),
    "a free decay": shifted(released),
    "a sudden stop": shifted(lambda t: np.minimum(2.0 * t, 3.0 + 0.01 * np.sin(t))),
    "turns": shifted(lambda t: np.mod(1.5 * t + 1.0, 2.0 * np.pi)),
    "steps again and again": shifted(stepped(0.1, 1.0)),
    "a step of 0.1 rad every 6 s": shifted(stepped(0.1, 2.0)) | {"time": 3.0 * TIME},
    "a small step": shifted(stepped(0.003, 7.0)),
    "a small step of coarse encoders": shifted(stepped(0.06, 7.0), 9),
    **{f"{count} lost samples": without_samples(count) for count in (1, 3)},
    **{f"{count} samples displaced": displaced(count) for count in (1, 2, 5)},
    **{f"readings in every {every}th sample": held(joined(0.0), every) for every in (5, 40)},
    "a move that is read slowly": held(shifted(moved_once), 12),
}


@pytest.mark.parametrize("name", SMOOTH)
def test_what_is_no_seam(name: str):
    """Assert that a motion with impacts, and other faults of a log, are neither cut nor named."""
    log = read_columns(SMOOTH[name])
    assert not about_jumps(log)
    assert len(log.recordings) == 1
