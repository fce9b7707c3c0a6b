"""Logs that were joined without a trace in the time are cut at the seam, and others are not."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from joint_log import joint_columns, read_columns, said, without

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


def counted(period: float) -> Columns:
    """Return a joint whose motor counts from -period / 2 to period / 2, in rad."""
    found = shifted(lambda t: 0.25 * t + 0.1 * np.sin(t))
    motor = found["motor_position"]
    return found | {"motor_position": (motor + 0.5 * period) % period - 0.5 * period}


@pytest.mark.parametrize("which", [0, 1])
def test_a_seam_of_one_joint_cuts_the_logs_of_all(which: int):
    """Assert that an arm is cut where one joint jumps, though another began where it ended."""
    seams = [0.12 * (joint == which) for joint in range(2)]
    logs = logs_of_joints([(table_of_arrays(joined(seam)), None) for seam in seams])
    for log in logs:
        assert [len(one) for one in log.recordings] == [COUNT, COUNT]
    assert about_jumps(logs[which])
    assert not about_jumps(logs[1 - which])


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


def stepped(size: float, every: float) -> Callable[[FloatArray], FloatArray]:
    """Return a slow motion with steps within one sample, as dry friction causes them."""
    return lambda time: 0.3 * np.sin(0.5 * time) + size * np.floor(time / every)


def kicked(time: FloatArray) -> FloatArray:
    """Return a joint that rests, and is struck so that it swings with 30 Hz."""
    after = np.maximum(time - 3.0013, 0.0)
    return 0.05 * np.exp(-3.0 * after) * np.sin(190.0 * after)


def jumping(found: Columns, fastest: str, jumps: str, by: float) -> Columns:
    """Return a log in which one position jumps where one is fastest."""
    place = int(np.argmax(np.abs(np.diff(found[fastest]))))
    found[jumps][place + 1 :] += by
    return found


SECOND = TIME > (COUNT - 0.5) * STEP
BENT = WHOLE["link_position"] - WHOLE["motor_position"]
LOGS: dict[str, Columns] = {
    "a seam in a short log": {n: v[COUNT - 200 : COUNT + 200] for n, v in joined().items()},
    "one of a motor whose deflection goes on": without(joined(), "link") | {"deflection": BENT},
    "one with a pause": joined() | {"time": TIME + 2.0 * SECOND},
    "a link that is clamped at two places": WHOLE
    | {"time": TIME + 1.0 * SECOND, "link_position": 0.3 * SECOND},
    "a counter that overflows": counted(2.6),
    "one of a motor alone": without(counted(2.6), "link"),
    "one of another range": counted(4.0),
    "that of a motor alone": without(counted(4.0), "link"),
    "an overflow among other jumps": jumping(counted(2.6), ENCODERS[1], ENCODERS[0], -0.3),
    **{f"a slip of {name}": jumping(joined(0.0), name, name, 0.3) for name in ENCODERS},
    "a whole log": joined(0.0),
    "coarse encoders": shifted(lambda t: 0.4 * np.sin(2.0 * t), 9),
    # It slips by 0.1 rad within three samples, again and again.
    "stick and slip": shifted(
        lambda t: 0.1 * np.floor(t) + 0.1 * np.clip((t % 1.0) / (3.0 * STEP), 0.0, 1.0)
    ),
    "a struck joint": shifted(kicked),
    "a struck joint with coarse encoders": shifted(kicked, 12),
    "a free decay": shifted(
        lambda t: 0.3 * np.cos(25.0 * np.maximum(t - 2.0, 0.0)) * np.exp(-np.maximum(t - 2.0, 0.0))
    ),
    "a sudden stop": shifted(lambda t: np.minimum(2.0 * t, 3.0 + 0.01 * np.sin(t))),
    "turns": shifted(lambda t: np.mod(1.5 * t + 1.0, 2.0 * np.pi)),
    "steps again and again": shifted(stepped(0.1, 1.0)),
    "a step of 0.1 rad every 6 s": shifted(stepped(0.1, 2.0)) | {"time": 3.0 * TIME},
    "a small step": shifted(stepped(0.003, 7.0)),
    "a small step of coarse encoders": shifted(stepped(0.06, 7.0), 9),
    **{f"{count} lost samples": without_samples(count) for count in (1, 3)},
    **{f"{count} samples displaced": displaced(count) for count in (1, 2, 5)},
    **{f"readings in every {every}th sample": held(joined(0.0), every) for every in (5, 40)},
    "a move within 0.25 s that is read slowly": held(
        shifted(lambda t: 0.3 * np.sin(0.5 * np.pi * np.clip(4.0 * t - 20.0, 0.0, 1.0)) ** 2), 12
    ),
}


def test_seams_and_other_jumps(golden: Any):
    """Assert that logs are cut at seams, and not by impacts, slips, overflows and other faults."""
    golden({name: said(read_columns, columns) for name, columns in LOGS.items()})
