"""Logs become recordings with held-out ends."""

from dataclasses import replace

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


def test_a_model_leaves_channels_aside():
    """Assert that a rigid joint leaves the link's, and that naming what a log shows leaves none."""
    whole = log(recording())
    (kept,) = prepare([whole], SHARE, "rigid")[0].recorded
    assert kept.link_position is kept.link_velocity is None
    assert kept.input is not None
    assert prepare([whole], SHARE, "flexible")[0].recorded == prepare([whole], SHARE)[0].recorded


@pytest.mark.parametrize(
    ("channel", "model", "remedy"),
    [
        ("input", "flexible", "link"),
        ("input", "rigid", "link"),
        ("link position", "flexible", "rigid"),
        ("link position", "link", "rigid"),
    ],
)
def test_what_a_model_needs_is_asked_for(channel, model, remedy):
    """Assert that a model without its channels is refused, with one that the log has."""
    whole = recording(link=channel == "input")
    lacking = replace(whole, input=None, input_unit="") if channel == "input" else whole
    with pytest.raises(SettingError, match=f"has no {channel}, which {model} needs: give {remedy}"):
        prepare([log(lacking)], SHARE, model)


def test_end_of_every_recording_is_held_out():
    """Assert that the last third of each recording is cut off, and that logs are told apart."""
    recordings, warnings = prepare(
        [log(recording(300), recording(600, start=9.0)), log(recording(900))], SHARE
    )
    assert recordings.starts == (200, 400, 600)
    assert recordings.groups == (0, 0, 1)
    assert warnings == ()
    assert [len(part) for part in recordings.fitted] == [200, 400, 600]


LINKLESS = {"link": False}


@pytest.mark.parametrize(
    ("first", "second", "digest", "words"),
    [
        ({}, {"seed": 1}, "abc", r"b\.csv.*same data as a\.csv"),
        ({}, {"unit": "V"}, "", r"b\.csv.*input.*is in V, and in a\.csv in N m"),
        (LINKLESS, {}, "", r"b\.csv.*link_position.*is there, and in a\.csv missing"),
        ({}, LINKLESS, "", r"b\.csv.*is missing, and in a\.csv there"),
    ],
)
def test_logs_that_do_not_go_together_are_refused(first, second, digest, words):
    """Assert that the log that has the same bytes, another input or one encoder is named."""
    logs = [
        log(recording(source="a.csv", **first), digest=digest),
        log(recording(source="b.csv", **second), digest=digest),
    ]
    with pytest.raises(RecordingError, match=words):
        prepare(logs, SHARE)


def test_short_recordings_cost_one_warning_for_a_log():
    """Assert that recordings too short to fit are left out where others are not, and counted."""
    short = [recording(40, start=float(n)) for n in range(9)]
    first, second = log(recording(300), *short), log(recording(300, source="b.csv"), short[0])
    recordings, warnings = prepare([first, second], SHARE)
    assert len(recordings.recorded) == len(warnings) == 2
    assert "the 40 samples from 2 s on and 6 more recordings are too few" in warnings[0]
    assert "40 samples from 0 s on are too few" in warnings[1]


def test_the_shortest_recordings_of_a_log_are_left_out():
    """Assert that those go that hold up to 3 % of a log, however short another log is."""
    parts = [recording(count) for count in (100, 4000, 85, 135, 6000)]
    split, (warning,) = prepare([log(*parts), log(recording(90))], SHARE)
    assert [len(own) for own in split.recorded] == [4000, 135, 6000, 90]
    assert "the 100 samples" in warning
    assert "the 85 samples" in warning


def test_too_little_to_fit_or_to_test_on_is_refused():
    """Assert that a log too short to fit is refused, with the length that the reader names."""
    prepare([log(recording(FEWEST_TO_IDENTIFY))], SHARE)
    with pytest.raises(RecordingError, match=f"record {FEWEST_TO_IDENTIFY} or more without a gap"):
        prepare([log(recording(FEWEST_TO_IDENTIFY - 1))], SHARE)
    with pytest.raises(SettingError, match="validation_share"):  # fewer than ten samples
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
