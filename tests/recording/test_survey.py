"""What a log shows at a glance."""

from dataclasses import replace

import numpy as np
import pytest

from flexid.recording.overview import survey
from flexid.recording.recording import Log, Recording

RATE = 200.0  # Hz
NOISE = 1e-4  # rad


def log(**changes: object) -> Log:
    """Return 20 s in which a motor goes to and fro at 0.5 Hz, and the link a little less."""
    random = np.random.default_rng(1)
    time = np.arange(4000) / RATE
    motor = np.sin(np.pi * time)
    recording = Recording(
        sample_time=1 / RATE,
        start_time=0.0,
        link_position=0.9 * motor + NOISE * random.standard_normal(len(time)),
        motor_position=motor + NOISE * random.standard_normal(len(time)),
        input=3.0 * np.sin(2 * np.pi * 2.0 * time),
        input_unit="N m",
    )
    return Log((replace(recording, **changes),), (), "log", "")  # type: ignore[arg-type]


def test_figures_of_a_known_motion():
    """Assert that rate, duration, reversals, bandwidth and deflection are those of the motion."""
    found = survey(log())
    assert found.model == "flexible"
    assert (found.samples, found.recordings) == (4000, 1)
    assert found.duration == pytest.approx(20.0)
    assert found.reversals == 20
    assert found.resting < 0.05
    assert found.input_bandwidth == pytest.approx(2.0, abs=0.1)
    truth = 0.1 / np.sqrt(2) / (NOISE * np.sqrt(2))
    assert found.deflection_over_noise == pytest.approx(truth, rel=0.2)
    assert found.remarks == ()
    channels = {channel.name: channel for channel in found.channels}
    assert list(channels) == ["link_position", "motor_position", "input"]
    assert channels["motor_position"].noise == pytest.approx(NOISE, rel=0.2)
    assert channels["input"].highest == pytest.approx(3.0, rel=1e-3)
    assert channels["input"].unit == "N m"


def test_model_follows_from_the_channels():
    """Assert that what is missing says what can be asked for."""
    assert survey(log(input=None, input_unit="")).model == "link"
    rigid = survey(log(link_position=None))
    assert rigid.model == "rigid"
    assert np.isnan(rigid.deflection_over_noise)


def test_what_stands_against_an_answer():
    """Assert that a motion that does not turn, hides the spring, or is short, is remarked."""
    base = log().recordings[0]
    time = base.time
    onward = survey(log(motor_position=time, link_position=time + 0.1 * np.sin(time)))
    assert any("turns back 0 times" in text for text in onward.remarks)
    once = survey(log(motor_position=np.abs(time - time.mean())))
    assert any("turns back 1 time," in text for text in once.remarks)
    random = np.random.default_rng(2)
    stiff = survey(log(link_position=base.motor_position + NOISE * random.standard_normal(4000)))
    assert any("encoders' noise" in text for text in stiff.remarks)
    short = survey(Log((base.window(0, 60),), (), "log", ""))
    assert any("60 samples" in text for text in short.remarks)


def test_several_recordings():
    """Assert that gaps are counted, and all stretches looked at."""
    base = log().recordings[0]
    found = survey(Log((base.window(0, 1000), base.window(2000, 4000)), (), "log", ""))
    assert found.recordings == 2
    assert found.samples == 3000
    assert found.duration == pytest.approx(15.0)
