"""Hold and delays, from logs made with known ones."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from flexid.errors import SettingError
from flexid.identification.alignment import aligned, estimate_alignment
from flexid.models.flexible_joint import flexible_joint
from flexid.recording.recording import Recording
from flexid.simulation.free_run import free_run

SAMPLE_TIME = 2e-3
FINE = 4  # steps of the simulation in a sample
TRUE = {"theta1": 5.0, "theta2": 100.0, "alpha1": 1000 / 3, "alpha2": 1 / 3, "beta1": 10 / 3}
TONES = ((1.1, 8.0), (3.7, 8.0), (8.3, 6.0), (14.0, 5.0), (23.0, 5.0))  # rad/s, N m


def torque(time):
    """Return the torque of five tones, in N m."""
    return sum(amplitude * np.sin(frequency * time) for frequency, amplitude in TONES)


@cache
def motion(held=False, **more):
    """Time and torque at the samples, and both positions as functions of time, over 20 s."""
    fine = SAMPLE_TIME / FINE * np.arange(20 * 500 * FINE)
    u = torque(SAMPLE_TIME * np.floor(fine / SAMPLE_TIME + 1e-9)) if held else torque(fine)
    terms = ["gravity", "motor_viscous", *(("link_viscous",) if more else ())]
    hold = "zero" if held else "linear"
    x = free_run(flexible_joint(terms), TRUE | more, np.zeros(4), u, SAMPLE_TIME / FINE, hold)
    return fine[::FINE], *(make_interp_spline(fine, x[:, column], k=5) for column in (0, 2))


def log(seed=0, skew=0.0, delay=0.0, noise=1e-4, bits=None, held=False, **more):
    """A log of the link encoder `skew` late and of a torque that acts `delay` late."""
    time, link, motor = motion(held, **more)
    inside = slice(50, -50)
    positions = np.array([link(time - skew), motor(time)])
    positions += noise * np.random.default_rng(seed).standard_normal(positions.shape)
    if bits:
        step = 2 * np.pi / 2**bits
        positions = step * np.rint(positions / step)
    link_encoder, motor_encoder = positions
    acting = np.asarray(torque(time + delay), dtype=np.float64)
    recording = Recording(SAMPLE_TIME, 0.0, link_encoder, motor_encoder, acting, "N m")
    return recording.window(*inside.indices(len(time))[:2])


def test_nothing_is_claimed_of_a_log_in_time():
    """Assert that a log in time is left as it is, and intervals are a small part of a sample."""
    piece = log()
    found = estimate_alignment([piece])
    assert (found.link_delay.status, found.input_delay.status) == ("none", "none")
    assert max(np.abs(found.link_delay.interval)) < 0.05 * SAMPLE_TIME
    assert max(np.abs(found.input_delay.interval)) < 0.05 * SAMPLE_TIME
    assert aligned(piece, found) is piece


@pytest.mark.parametrize("friction", [0.5, 5.0])
def test_friction_of_the_link_is_no_skew(friction):
    """Assert that viscous friction of the link, which looks like a late encoder, is not one."""
    assert estimate_alignment([log(theta_viscous=friction)]).link_delay.status == "none"


@pytest.mark.parametrize("bits", [None, 14])
@pytest.mark.parametrize("skew", [0.3e-3, 1e-3, 3e-3, -1e-3])
def test_skew_is_found(skew, bits):
    """Assert that a late link encoder is found to a hundredth of a sample, part or many."""
    found = estimate_alignment([log(skew=skew, bits=bits)]).link_delay
    assert found.status == "found"
    assert found.value == pytest.approx(skew, abs=0.02 * SAMPLE_TIME)
    assert found.interval[0] <= skew <= found.interval[1]


@pytest.mark.parametrize("delay", [0.3e-3, 1.4e-3, 2.5e-3, 20e-3, -4e-3])
def test_input_delay_is_found(delay):
    """Assert that a torque that acts late, by a part of a sample or by many, is found.

    Half a sample is left out: nothing tells it from a held torque.
    """
    found = estimate_alignment([log(delay=delay)])
    assert found.input_delay.status == "found"
    assert found.input_delay.value == pytest.approx(delay, abs=0.02 * SAMPLE_TIME)
    assert found.link_delay.status == "none"


def test_held_input_is_told_from_a_delay():
    """Assert that a held torque is called held, not half a sample late."""
    found = estimate_alignment([log(held=True)])
    assert found.hold == "zero"
    assert found.input_delay.status == "none"


def test_intervals_cover():
    """Assert that 95 % intervals of both delays hold the truth in 17 of 20 logs at least."""
    both = [estimate_alignment([log(seed, 1e-3, 0.7e-3)], filter_rate=10.0) for seed in range(20)]
    links = [d.link_delay.interval for d in both]
    inputs = [d.input_delay.interval for d in both]
    assert sum(low <= 1e-3 <= high for low, high in links) >= 17
    assert sum(low <= 0.7e-3 <= high for low, high in inputs) >= 17


def test_aligned_log_is_in_time():
    """Assert that the aligned recording is the log that would have been in time."""
    piece, right = log(skew=1.3e-3, delay=0.7e-3, noise=0.0), log(noise=0.0)
    given = estimate_alignment([piece], "linear", input_delay=0.7e-3, link_delay=1.3e-3)
    moved = aligned(piece, given)
    first = round((moved.start_time - right.start_time) / SAMPLE_TIME)
    right = right.window(first, first + len(moved))
    assert len(moved) > len(piece) - 40
    assert moved.motor_position == pytest.approx(right.motor_position, abs=1e-12)
    assert moved.link_position == pytest.approx(right.link_position, abs=1e-7)
    assert moved.input == pytest.approx(right.input, abs=2e-2)


def test_one_encoder_has_an_input_delay():
    """Assert that a rigid log's input delay is found though there is no link encoder."""
    time, link, _ = motion(theta_viscous=0.0)
    speed, acceleration = link.derivative(1)(time), link.derivative(2)(time)
    drive = 0.5 * acceleration + 2.0 * np.sin(link(time)) + 0.3 * speed
    late = make_interp_spline(time, drive, k=5)(time + 1.5e-3)
    noise = 1e-5 * np.random.default_rng(0).standard_normal(len(time))
    piece = Recording(SAMPLE_TIME, 0.0, None, link(time) + noise, late, "N m").window(50, 9900)
    found = estimate_alignment([piece], "linear")
    assert found.link_delay.value == 0.0
    assert found.input_delay.value == pytest.approx(1.5e-3, abs=0.05 * SAMPLE_TIME)


def test_given_delays_are_taken():
    """Assert that given delays and hold are not estimated, with sense in what is reported."""
    found = estimate_alignment([log()], "zero", input_delay=1e-3, link_delay=-1e-3)
    assert found.hold == "zero"
    assert (found.input_delay.status, found.link_delay.status) == ("given", "given")
    assert (found.input_delay.value, found.link_delay.value) == (1e-3, -1e-3)
    assert found.deflection_doubt == 0.0


def test_velocities_move_with_their_positions():
    """Assert that a logged link velocity is moved as far as the link's position."""
    piece = log(skew=1e-3, noise=0.0)
    speed = np.gradient(piece.needed_link_position, SAMPLE_TIME)
    given = estimate_alignment([piece], "linear", input_delay=0.0, link_delay=1e-3)
    moved = aligned(replace(piece, link_velocity=speed), given)
    derived = np.gradient(moved.needed_link_position, SAMPLE_TIME)
    assert moved.link_velocity is not None
    assert moved.link_velocity[5:-5] == pytest.approx(derived[5:-5], abs=1e-4)


@pytest.mark.parametrize("value", [float("nan"), 1.0])
def test_impossible_delay_is_refused(value):
    """Assert that a delay that the log cannot have is refused."""
    with pytest.raises(SettingError, match="input-delay"):
        estimate_alignment([log()], input_delay=value)
