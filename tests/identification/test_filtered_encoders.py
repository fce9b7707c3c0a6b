"""Encoders that were low-passed before the log."""

from dataclasses import replace

import numpy as np
import pytest
from made_joint import CORE, PAPER, assert_holds, data, log, made
from scipy.signal import lfilter

from flexid.estimators.channel_timing import INPUT
from flexid.identification.estimation.encoder_lag import likely_encoder_lag
from flexid.identification.full_model.model import LINK
from flexid.identification.identify import identify
from flexid.identification.preparation.recordings import IDEAL
from flexid.recording.recording import Recording

SIDES = ("link_position", "motor_position")
FULL = replace(PAPER, absent=PAPER.joint.shapes)


def filtered(recording: Recording, lag: float, *sides: str) -> Recording:
    """Return a recording with positions behind a first-order lag in s.

    Slow motions are late by the lag without half a sample.
    """
    kept = np.exp(-recording.sample_time / lag)

    def passed(values: np.ndarray) -> np.ndarray:
        return values[0] + lfilter([1.0 - kept], [1.0, -kept], values - values[0])

    return replace(recording, **{side: passed(getattr(recording, side)) for side in sides})


@pytest.mark.parametrize(
    ("sides", "delays"),
    [
        (SIDES[:1], {LINK: 9e-3}),
        (SIDES[1:], {LINK: -9e-3, INPUT: 9e-3}),
        (SIDES, {INPUT: 9e-3}),
    ],
)
def test_lags_of_encoders_are_sought_in_place_of_delays(sides, delays):
    """Assert the lag of one encoder or both, with its effect on the coefficients."""
    own = data(filtered(made(1), 10e-3, *sides))
    of_both = len(sides) > 1
    found = likely_encoder_lag(FULL, own, IDEAL, delays, 5e-4, of_both=of_both)
    assert found is not None
    lags = {"link_position": found.amplifier.link_lag, "motor_position": found.amplifier.motor_lag}
    assert lags == pytest.approx({side: 10e-3 * (side in sides) for side in SIDES}, rel=0.05)
    # Without the encoder's attenuation the spring seems softer.
    assert 0.0 < abs(found.errors["theta2"]) < 0.05


@pytest.mark.parametrize("delays", [{LINK: 3e-3}, {INPUT: 3e-3}, {INPUT: 1e-4}])
def test_a_delay_is_no_filter(delays):
    """Assert no lag of an encoder for a delay of the link, of the input, or for none."""
    recording = made(1, input_delay=delays.get(INPUT, 0.0), link_delay=delays.get(LINK, 0.0))
    of_both = LINK not in delays
    rest = data(recording), IDEAL, delays, 5e-4
    assert likely_encoder_lag(FULL, *rest, of_both=of_both) is None


def test_a_lag_of_the_input_is_none_of_the_encoders():
    """Assert that an amplifier's lag, which does about the same, is preferred."""
    recording = made(1)
    torque = recording.needed_input
    ahead = replace(recording, input=torque + 6e-3 * np.gradient(torque, recording.sample_time))
    rest = data(ahead), IDEAL, {INPUT: 5e-3}, 5e-4
    assert likely_encoder_lag(FULL, *rest, of_both=True) is None


def test_a_filtered_encoder_is_corrected():
    """Assert the lag of an encoder, a warning, and that the intervals hold, and are narrow."""
    found = identify([log(filtered(made(1), 10e-3, "link_position"))])
    assert found.choices.amplifier.link_lag == pytest.approx(10e-3, rel=0.02)
    assert any("its link_position had been low-passed" in warning for warning in found.warnings)
    assert_holds(found, CORE | {"gravity_torque": 5.0}, 2e-3)


def test_filters_of_a_deflection_act_on_it_alone():
    """Assert that a measured deflection and the motor's position are corrected separately."""
    plain = replace(made(1), link_from_deflection=True)
    motor, bent = plain.motor_position, plain.deflection
    lagged = filtered(plain, 10e-3, "motor_position")
    logged = replace(lagged, link_position=lagged.motor_position + bent)
    corrected = replace(IDEAL, motor_lag=10e-3).behind(logged)
    np.testing.assert_allclose(corrected.deflection, bent, rtol=0.0, atol=1e-12)
    assert np.abs(corrected.motor_position - motor)[50:].max() < 0.02 * np.ptp(bent)
