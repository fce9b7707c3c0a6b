"""Text files that are cut, written again or replaced while they are watched."""

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from moving_joint import CHOSEN, H, same, stream, watched

from flexid.errors import RecordingError
from flexid.streaming import sources
from flexid.streaming.checkpoint import read_session, save_session
from flexid.streaming.follower import Follower
from flexid.streaming.session import Session

HEADER = "time [s],link_position [rad],motor_position [rad],motor_torque [N m]"
OTHER = "motor_torque [N m],time [ms],motor_position [deg],link_position [rad]"
SAMPLES = stream(6.0)
CUT = 1500


def text(samples: np.ndarray, header: str | None = HEADER) -> str:
    """A log of samples; numbers come back as they were."""
    rows = [",".join(map(repr, row)) for row in samples.tolist()]
    return "\n".join([*([header] if header else []), *rows, ""])


def others(samples: np.ndarray) -> np.ndarray:
    """The same samples in the columns of `OTHER`."""
    time, link, motor, torque = samples.T
    return np.column_stack((torque, 1e3 * time, np.degrees(motor), link))


def followed(path: Path, then: Sequence[object], checkpoint: Path | None = None) -> Follower:
    """A follower whose file has something done to it whenever nothing more has come."""
    follower = Follower(str(path), CHOSEN, checkpoint=checkpoint)
    left = list(then)
    fed = -1
    for _ in follower.turns(1.0):
        now = follower.session.fed if follower.session is not None else 0
        if now == fed:
            if not left:
                break
            left.pop(0)()  # type: ignore[operator]
            fed = -1
        else:
            fed = now
    return follower


def session_of(follower: Follower) -> Session:
    """What a follower learnt."""
    assert follower.session is not None
    return follower.session


@pytest.fixture(autouse=True)
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave a file that was replaced at once."""
    monkeypatch.setattr(sources, "LINGER", 0.0)


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """The first part of a log."""
    path = tmp_path / "log.csv"
    path.write_text(text(SAMPLES[:CUT]))
    return path


def renamed(log: Path, content: str):
    """Rotate a log as a recorder does: by its name."""

    def act() -> None:
        log.rename(log.with_suffix(".1"))
        log.write_text(content)

    return act


def cut(log: Path, content: str):
    """Rotate a log that stays: copy it elsewhere and cut it."""
    return lambda: log.write_text(content)


@pytest.mark.parametrize("rotate", [renamed, cut])
@pytest.mark.parametrize("header", [HEADER, None])
def test_a_rotated_log_is_one_stream(log: Path, rotate, header: str | None):
    """Assert that no sample is lost nor comes twice, whether the next file has a header or not."""
    follower = followed(log, [rotate(log, text(SAMPLES[CUT:], header))])
    assert same(session_of(follower), watched(SAMPLES))
    (warning,) = follower.warnings
    assert "rewritten" in warning


def of_day(samples: np.ndarray, header: str | None = "time,") -> str:
    """A log whose times of day pass midnight where it is rotated."""
    begin = datetime(2024, 5, 1, tzinfo=UTC) - timedelta(seconds=CUT * H)
    lines = text(samples, HEADER if header else None).splitlines()
    stamps = [begin + timedelta(seconds=time) for time in samples[:, 0]]
    rows = [
        f"{stamp:%H:%M:%S.%f}{line[line.index(',') :]}"
        for stamp, line in zip(stamps, lines[-len(stamps) :], strict=True)
    ]
    names = [header + HEADER.partition(",")[2]] if header else []
    return "\n".join([*names, *rows, ""])


@pytest.mark.parametrize("header", ["time,", None])
def test_a_log_rotated_at_midnight(log: Path, header: str | None):
    """Assert that times of day go on into the next file."""
    log.write_text(of_day(SAMPLES[:CUT]))
    follower = followed(log, [renamed(log, of_day(SAMPLES[CUT:], header))])
    counts = session_of(follower).counts
    assert counts == watched(SAMPLES).counts
    assert session_of(follower).fed == len(SAMPLES)


def test_a_log_whose_stamps_are_written_otherwise(log: Path):
    """Assert that the next file may have dates where there were times of day."""
    dated = of_day(SAMPLES[CUT:]).replace("\n00:00:", "\n2024-05-02T00:00:")
    log.write_text(of_day(SAMPLES[:CUT]))
    counts = session_of(followed(log, [renamed(log, dated)])).counts
    assert counts.taken > len(SAMPLES) - 60


@pytest.mark.parametrize("before", ["", "# goes on\n\n"])
@pytest.mark.parametrize("other", ["2024-05-01", "", "fault"])
def test_a_column_that_is_not_read_need_not_hold_numbers(log: Path, other: str, before: str):
    """Assert that a file without header goes on, whatever stands in such a column."""

    def wide(part: str) -> str:
        return "".join(f"{line},{other}\n" for line in part.splitlines())

    log.write_text(wide(text(SAMPLES[:CUT])).replace(f"],{other}\n", "],other\n", 1))
    follower = followed(log, [renamed(log, before + wide(text(SAMPLES[CUT:], None)))])
    assert same(session_of(follower), watched(SAMPLES))


@pytest.mark.parametrize("comment", ["", "# another order\n"])
def test_its_columns_may_stand_otherwise(log: Path, comment: str):
    """Assert that the next file is read by its own header, also below a comment."""
    follower = followed(log, [renamed(log, comment + text(others(SAMPLES[CUT:]), OTHER))])
    session, straight = session_of(follower), watched(SAMPLES)
    assert session.counts == straight.counts
    found, right = (s.learner.values(s.now.states) for s in (session, straight))
    np.testing.assert_allclose(found, right, rtol=1e-9)


def test_other_channels_are_refused(log: Path):
    """Assert that a current is not learnt from as a torque."""
    with pytest.raises(RecordingError, match=r"input in A where there was .* input in N m"):
        followed(
            log, [renamed(log, text(SAMPLES[CUT:], HEADER.replace("torque [N m]", "current [A]")))]
        )


def test_half_a_line_is_no_sample(log: Path):
    """Assert that what a rotation leaves of a line is not joined to the next file, and said."""
    whole = text(SAMPLES[:CUT])
    log.write_text(whole[:-9])
    follower = followed(log, [renamed(log, text(SAMPLES[CUT:]))])
    session = session_of(follower)
    assert same(session, watched(np.delete(SAMPLES, CUT - 1, axis=0)))
    assert session.counts.missing == 1
    assert "half a sample" in follower.warnings[-1]


def test_half_a_line_at_the_end(log: Path):
    """Assert the same of a file that ends so, and that it is learnt from when it is whole."""
    whole = log.read_text()
    log.write_text(whole[:-9])
    follower = Follower(str(log), CHOSEN, stop_at_end=True)
    list(follower.turns(1.0))
    assert same(session_of(follower), watched(SAMPLES[: CUT - 1]))
    assert "half a sample" in follower.warnings[-1]
    state = log.with_name("state.json")
    save_session(session_of(follower), state)
    log.write_text(whole)
    follower = Follower(str(log), CHOSEN, stop_at_end=True, checkpoint=state)
    list(follower.turns(1.0))
    assert same(session_of(follower), watched(SAMPLES[:CUT]))
    assert follower.warnings == ()


def test_a_checkpoint_knows_the_file_that_was_read_last(log: Path, tmp_path: Path):
    """Assert that after a rotation nothing of the new file is learnt from twice."""
    middle = CUT + 700
    first = followed(log, [renamed(log, text(SAMPLES[CUT:middle]))])
    save_session(session_of(first), tmp_path / "state.json")
    assert read_session(tmp_path / "state.json").n_read == middle - CUT
    log.write_text(text(SAMPLES[CUT:]))
    second = followed(log, [], checkpoint=tmp_path / "state.json")
    assert same(session_of(second), watched(SAMPLES))


def test_a_clock_that_begins_anew_with_the_file(log: Path):
    """Assert that a new recording is learnt from beside the one before."""
    again = stream(3.0, seed=2)
    follower = followed(log, [renamed(log, text(again))])
    counts = session_of(follower).counts
    assert counts.restarts == 1
    assert counts.taken > CUT + len(again) - 30


@pytest.mark.parametrize("n_rows", [0, 2])
@pytest.mark.parametrize("header", [HEADER, None])
def test_a_rotation_just_before_the_end(
    log: Path, n_rows: int, header: str | None, monkeypatch: pytest.MonkeyPatch
):
    """Assert that a file too short to be understood ends nothing, and is said to be left out."""
    clock = [0.0]
    monkeypatch.setattr("flexid.streaming.follower.time.monotonic", lambda: clock[0])
    follower = Follower(str(log), CHOSEN, duration=1.0)
    for _ in follower.turns(1.0):
        if follower.session is not None and follower.session.fed == CUT and clock[0] == 0.0:
            renamed(log, text(SAMPLES[CUT : CUT + n_rows], header))()
            clock[0] = 2.0
    goes_on = n_rows if header is None else 0
    assert same(session_of(follower), watched(SAMPLES[: CUT + goes_on]))
    left_out = [w for w in follower.warnings if "what came is left out" in w]
    assert len(left_out) == (header is not None)
    save_session(session_of(follower), log.with_name("state.json"))
