"""A log with all its channels on one clock, against the motion that was simulated."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from flexid.identification.preparation.recordings import Alignment, Delay, aligned
from flexid.models.flexible_joint import flexible_joint
from flexid.recording.recording import Recording
from flexid.simulation.free_run import free_run
from made_estimates import TRUE

SAMPLE_TIME = 2e-3
FINE = 4  # steps of the simulation in a sample
TONES = ((1.1, 8.0), (3.7, 8.0), (8.3, 6.0), (14.0, 5.0), (23.0, 5.0))  # rad/s, N m


def torque(time):
    """Return the torque of five tones, in N m."""
    return sum(amplitude * np.sin(frequency * time) for frequency, amplitude in TONES)


@cache
def motion():
    """Time at the samples, and both positions as functions of time, over 6 s."""
    fine = SAMPLE_TIME / FINE * np.arange(6 * 500 * FINE)
    x = free_run(flexible_joint(), TRUE, np.zeros(4), torque(fine), SAMPLE_TIME / FINE)
    return fine[::FINE], *(make_interp_spline(fine, x[:, column], k=5) for column in (0, 2))


def log(link_delay=0.0, input_delay=0.0, by_deflection=False):
    """A log of a link encoder, or a deflection, and a torque that are late."""
    time, link, motor = motion()
    late = time - link_delay
    seen = motor(time) + link(late) - motor(late) if by_deflection else link(late)
    acting = np.asarray(torque(time + input_delay), dtype=np.float64)
    whole = Recording(SAMPLE_TIME, 0.0, seen, motor(time), acting, "N m")
    return replace(whole, link_from_deflection=by_deflection).window(50, len(time) - 50)


def delays(input_delay=0.0, link_delay=0.0):
    """An alignment with these delays."""
    input_, link = (Delay(d, 0.0, (d, d), "given") for d in (input_delay, link_delay))
    return Alignment("linear", input_, link, "")


def expected(moved):
    """What the log in time holds over the same stretch."""
    right = log()
    first = round((moved.start_time - right.start_time) / SAMPLE_TIME)
    return right.window(first, first + len(moved))


@pytest.mark.parametrize("by_deflection", [False, True])
@pytest.mark.parametrize(("link_delay", "input_delay"), [(1.3e-3, 0.7e-3), (-3.1e-3, -4.4e-3)])
def test_aligned_log_is_in_time(link_delay, input_delay, by_deflection):
    """Assert that the aligned recording is the log that would have been in time."""
    recording = log(link_delay, input_delay, by_deflection)
    moved = aligned(recording, delays(input_delay, link_delay))
    right = expected(moved)
    assert len(moved) > len(recording) - 40
    assert moved.motor_position == pytest.approx(right.motor_position, abs=1e-12)
    assert moved.link_position == pytest.approx(right.link_position, abs=1e-7)
    assert moved.input == pytest.approx(right.input, abs=3e-2)


@pytest.mark.parametrize("encoders", [1, 2])
def test_input_late_by_samples_keeps_its_values(encoders):
    """Assert that a torque three samples late is that of three samples before, to the bit.

    A rigid log's input is moved though there is no link encoder. Without delays nothing is touched.
    """
    recording = log() if encoders == 2 else replace(log(), link_position=None)
    assert aligned(recording, delays()) is recording
    moved = aligned(recording, delays(input_delay=3 * SAMPLE_TIME))
    assert moved.start_time == pytest.approx(recording.start_time + 3 * SAMPLE_TIME)
    np.testing.assert_array_equal(moved.needed_input, recording.needed_input[:-3])
    assert (moved.link_position is None) == (encoders == 1)


def test_velocities_move_with_their_positions():
    """Assert that a logged link velocity is moved as far as the link's position."""
    recording = log(link_delay=1e-3)
    speed = np.gradient(recording.needed_link_position, SAMPLE_TIME)
    moved = aligned(replace(recording, link_velocity=speed), delays(link_delay=1e-3))
    derived = np.gradient(moved.needed_link_position, SAMPLE_TIME)
    assert moved.link_velocity is not None
    assert moved.link_velocity[5:-5] == pytest.approx(derived[5:-5], abs=1e-4)
