"""Logs become recordings with held-out ends."""

import numpy as np
import pytest

from flexid.errors import RecordingError, SettingError
from flexid.identification.preparation.recordings import SplitRecordings, prepare
from flexid.recording.recording import Log, Recording
from flexid.recording.sampling import FEWEST_TO_IDENTIFY

SHARE = 1 / 3


def recording(n=300, *, unit="N m", link=True, start=0.0, seed=0, source="a.csv"):
    """Noise in every channel, sampled at 100 Hz."""
    link_position, motor, drive = np.random.default_rng(seed).standard_normal((3, n))
    return Recording(
        0.01, start, link_position if link else None, motor, drive, unit, source=source
    )


def log(*recordings, digest=""):
    """Return a log of some recordings."""
    return Log(recordings, (), recordings[0].source, digest)


def test_end_of_every_recording_is_held_out():
    """Assert that the last third of each recording is cut off, and that logs are told apart."""
    recordings, warnings = prepare(
        [log(recording(300), recording(600, start=9.0)), log(recording(900))], SHARE
    )
    assert recordings.starts == (200, 400, 600)
    assert recordings.groups == (0, 0, 1)
    assert warnings == ()
    assert [len(part) for part in recordings.fitted] == [200, 400, 600]


def test_same_data_twice_is_refused():
    """Assert that two files with the same bytes are not taken for two experiments."""
    first, second = recording(source="a.csv"), recording(source="b.csv")
    with pytest.raises(RecordingError, match=r"b\.csv.*same data as a\.csv"):
        prepare([log(first, digest="abc"), log(second, digest="abc")], SHARE)


def test_inputs_of_two_kinds_are_refused():
    """Assert that a log with a voltage does not join one with a torque."""
    with pytest.raises(RecordingError, match=r"b\.csv.*input.*is in V where a\.csv has N m"):
        prepare([log(recording()), log(recording(unit="V", source="b.csv"))], SHARE)


@pytest.mark.parametrize("first_has_link", [True, False])
def test_one_encoder_does_not_join_two(first_has_link):
    """Assert that the log without the link's encoder is named, whichever comes first."""
    logs = [
        log(recording(link=first_has_link, source="a.csv")),
        log(recording(link=not first_has_link, source="b.csv")),
    ]
    missing, other = ("b", "a") if first_has_link else ("a", "b")
    with pytest.raises(RecordingError, match=rf"{missing}\.csv.*missing where {other}\.csv has it"):
        prepare(logs, SHARE)


def test_short_recording_costs_a_warning():
    """Assert that a recording too short to fit is left out where others are not."""
    recordings, (warning,) = prepare([log(recording(300), recording(70, start=9.0))], SHARE)
    assert len(recordings.recorded) == 1
    assert "70 samples from 9 s on are too few" in warning


def test_many_short_recordings_cost_one_warning_for_a_log():
    """Assert that a log with many gaps says so once, and how many recordings it lost."""
    short = [recording(40, start=float(n)) for n in range(9)]
    first, second = log(recording(300), *short), log(recording(300, source="b.csv"), short[0])
    _, warnings = prepare([first, second], SHARE)
    assert len(warnings) == 2
    assert "the 40 samples from 2 s on and 6 more recordings are too few" in warnings[0]


def test_nothing_but_short_recordings_is_refused():
    """Assert that a log too short to fit is refused, with the length that the reader names."""
    prepare([log(recording(FEWEST_TO_IDENTIFY))], SHARE)
    with pytest.raises(RecordingError, match=f"record {FEWEST_TO_IDENTIFY} or more without a gap"):
        prepare([log(recording(FEWEST_TO_IDENTIFY - 1))], SHARE)


def test_share_that_tests_on_nothing_is_refused():
    """Assert that fewer than ten samples to test on are too few."""
    with pytest.raises(SettingError, match="validation-share"):
        prepare([log(recording(300))], 0.01)


def test_fitted_velocities_do_not_know_of_held_out_positions():
    """Assert that other held-out positions change no velocity before them."""
    known = recording(300)
    spoilt = Recording(
        0.01,
        0.0,
        np.where(np.arange(300) < 200, known.needed_link_position, 50.0),
        np.where(np.arange(300) < 200, known.motor_position, -50.0),
        known.input,
        "N m",
    )
    one, other = (
        SplitRecordings((recording,), (200,), (0,)).fitted[0] for recording in (known, spoilt)
    )
    np.testing.assert_array_equal(one.link_velocity, other.link_velocity)
    np.testing.assert_array_equal(one.motor_velocity, other.motor_velocity)
