"""Simulation of a flexible joint that shares no code with flexid.

    Jl q'' = -G sin(q - a) - s(q - p) - link friction + link offset
    Jm p'' =  s(q - p) - motor friction + motor offset + torque

Fourth-order Runge-Kutta steps. Coulomb friction is set-valued on both sides: a side slips in one of
two directions or sticks. Bisection finds the instants at which this mode changes, and no step
contains such an instant inside. The same holds for the instants at which a constant torque or
disturbance changes.
"""

from typing import NamedTuple

import numpy as np
from numba import njit  # pyright: ignore[reportMissingTypeStubs]

from benchmarks.trials.arrays import FloatArray

_BISECTIONS = 45  # of a step, to full precision
_BEFORE = 1e-3  # s, from rest to the first sample
_BRISTLE_SHARE = 0.5  # longest step of LuGre friction, over the bristle's decay time


class Drive(NamedTuple):
    """Parameters of a drive in SI units; zero if an effect is absent.

    Coulomb levels are those of either direction: `motor_coulomb_up` opposes positive velocity.
    """

    link_inertia: float
    motor_inertia: float
    joint_stiffness: float
    gravity_torque: float = 0.0
    gravity_angle: float = 0.0  # rad, at which the link hangs straight down
    payload_torque: float = 0.0  # of a second mass on the link
    payload_angle: float = 0.0  # rad, at which that mass hangs straight down
    motor_viscous: float = 0.0
    link_viscous: float = 0.0
    joint_damping: float = 0.0
    cubic_stiffness: float = 0.0
    motor_coulomb_up: float = 0.0
    motor_coulomb_down: float = 0.0
    link_coulomb: float = 0.0
    motor_offset: float = 0.0
    link_offset: float = 0.0
    bristle_stiffness: float = 0.0  # LuGre, N m/rad
    bristle_damping: float = 0.0  # N m s/rad
    bristle_coulomb: float = 0.0  # N m
    bristle_static: float = 0.0  # N m
    stribeck_velocity: float = 1.0  # rad/s
    stribeck_exponent: float = 2.0  # dry friction falls as exp(-|v/velocity|^exponent)
    motor_static: float = 0.0  # N m, excess of dry friction at rest over that in slip
    load_friction: float = 0.0  # dry friction of the motor over the spring's torque
    progressive_stiffness: float = 0.0  # N m/rad^2
    parallel_stiffness: float = 0.0  # N m/rad, between the link and the base
    ripple_torque: float = 0.0  # N m
    ripple_number: float = 0.0  # per turn of the joint
    ripple_phase: float = 0.0
    half_gap: float = 0.0  # rad, half the spring's dead zone
    contact_damping: float = 0.0  # N m s/rad, of the spring outside its dead zone alone
    bend: float = 0.0  # rad, deflection at which the spring's stiffness changes
    bend_stiffness: float = 0.0  # N m/rad, change of the stiffness there
    hysteresis_torque: float = 0.0  # N m
    hysteresis_reach: float = 1.0  # rad of deflection
    hysteresis_power: float = 1.0  # exponent of Bouc and Wen's model; larger ones bend more sharply
    eccentricity: float = 0.0  # rad
    eccentricity_phase: float = 0.0
    transmission_number: float = 0.0  # periods of the transmission's error per turn of the joint
    transmission_error: float = 0.0  # rad
    transmission_phase: float = 0.0
    second_transmission_error: float = 0.0  # rad, with half the period
    second_transmission_phase: float = 0.0
    saturation: float = 0.0  # share of the torque that is lost at the peak
    peak_torque: float = 1.0  # N m


class Law(NamedTuple):
    """Controller on the motor's encoder; without gains an open loop.

    If `count` is not zero, the encoder is rounded to steps of `count` rad about `zero`.
    """

    proportional: float = 0.0
    derivative: float = 0.0
    integral: float = 0.0
    smoothing: float = 1.0  # share of a new velocity in the filtered one
    count: float = 0.0  # pyright: ignore[reportIncompatibleMethodOverride]
    zero: float = 0.0


class Smooth(NamedTuple):
    """Continuous torque as a fine table; empty if the torque is constant between samples."""

    values: FloatArray
    start: float
    step: float


@njit(cache=True)
def torque_at(smooth, value, time):
    """Return the torque: the constant part plus the table's cubic interpolation."""
    if smooth.values.size == 0:
        return value
    place = (time - smooth.start) / smooth.step
    index = min(max(int(np.floor(place)), 1), smooth.values.size - 3)
    x = place - index
    y0, y1 = smooth.values[index - 1], smooth.values[index]
    y2, y3 = smooth.values[index + 1], smooth.values[index + 2]
    return value + (
        -x * (x - 1.0) * (x - 2.0) / 6.0 * y0
        + (x + 1.0) * (x - 1.0) * (x - 2.0) / 2.0 * y1
        - (x + 1.0) * x * (x - 2.0) / 2.0 * y2
        + (x + 1.0) * x * (x - 1.0) / 6.0 * y3
    )


@njit(cache=True)
def spring_torque(drive, deflection):
    """Return the elastic torque of the joint, without damping and hysteresis."""
    if drive.half_gap > 0.0:
        if abs(deflection) <= drive.half_gap:
            return 0.0
        deflection -= drive.half_gap * np.sign(deflection)
    torque = drive.joint_stiffness * deflection + drive.cubic_stiffness * deflection**3
    torque += drive.progressive_stiffness * deflection * abs(deflection)
    if drive.bend > 0.0 and abs(deflection) > drive.bend:
        torque += drive.bend_stiffness * (abs(deflection) - drive.bend) * np.sign(deflection)
    return torque


@njit(cache=True)
def gravity_torque(drive, position):
    """Return the torque of gravity on the link, positive towards negative angles."""
    torque = 0.0
    if drive.gravity_torque != 0.0:
        torque += drive.gravity_torque * np.sin(position - drive.gravity_angle)
    if drive.payload_torque != 0.0:
        torque += drive.payload_torque * np.sin(position - drive.payload_angle)
    return torque


@njit(cache=True)
def _loads(drive, state, torque):
    """Return the torques on link and motor without dry friction, deflection rate and load."""
    q, w, p, v, _, h = state
    joint, slope = p, 1.0
    if drive.eccentricity != 0.0:
        joint += drive.eccentricity * np.sin(p + drive.eccentricity_phase)
        slope += drive.eccentricity * np.cos(p + drive.eccentricity_phase)
    if drive.transmission_number > 0.0:
        number = drive.transmission_number
        angle = number * p + drive.transmission_phase
        twice = 2.0 * number * p + drive.second_transmission_phase
        joint += drive.transmission_error * np.sin(angle)
        joint += drive.second_transmission_error * np.sin(twice)
        slope += number * drive.transmission_error * np.cos(angle)
        slope += 2.0 * number * drive.second_transmission_error * np.cos(twice)
    rate = w - slope * v
    damping = drive.joint_damping
    if abs(q - joint) > drive.half_gap:
        damping += drive.contact_damping
    elastic = spring_torque(drive, q - joint)
    spring = elastic + damping * rate
    spring += drive.hysteresis_torque * h
    link = drive.link_offset - gravity_torque(drive, q) - spring - drive.link_viscous * w
    link -= drive.parallel_stiffness * q
    if drive.saturation > 0.0:
        torque *= 1.0 - drive.saturation * (torque / drive.peak_torque) ** 2
    motor = drive.motor_offset + slope * spring - drive.motor_viscous * v + torque
    if drive.ripple_torque != 0.0:
        motor += drive.ripple_torque * np.sin(drive.ripple_number * p + drive.ripple_phase)
    return link, motor, rate, drive.load_friction * abs(elastic)


@njit(cache=True)
def _friction(drive, mode, velocity, load, is_link):
    """Return the dry friction of a side that slips in the direction of its mode."""
    if is_link:
        return -mode * drive.link_coulomb
    friction = -drive.motor_coulomb_up if mode > 0 else drive.motor_coulomb_down
    friction -= mode * load
    if drive.motor_static > 0.0:
        share = (abs(velocity) / drive.stribeck_velocity) ** drive.stribeck_exponent
        friction -= mode * drive.motor_static * np.exp(-share)
    return friction


@njit(cache=True)
def _derivative(drive, state, torque, link_mode, motor_mode):
    _, w, _, v, z, h = state
    link, motor, rate, load = _loads(drive, state, torque)
    bristle = 0.0
    if drive.bristle_stiffness > 0.0:
        level = drive.bristle_coulomb + (drive.bristle_static - drive.bristle_coulomb) * np.exp(
            -((v / drive.stribeck_velocity) ** 2)
        )
        bristle = v - drive.bristle_stiffness * abs(v) / level * z
        motor -= drive.bristle_stiffness * z + drive.bristle_damping * bristle
    hysteresis = 0.0
    if drive.hysteresis_torque > 0.0:
        bent = abs(h) ** drive.hysteresis_power * np.sign(h)
        hysteresis = (rate - abs(rate) * bent) / drive.hysteresis_reach
    link = 0.0 if link_mode == 0 else link + _friction(drive, link_mode, w, load, True)
    motor = 0.0 if motor_mode == 0 else motor + _friction(drive, motor_mode, v, load, False)
    return (w, link / drive.link_inertia, v, motor / drive.motor_inertia, bristle, hysteresis)


@njit(cache=True)
def _moved(state, rate, by):
    return (
        state[0] + by * rate[0],
        state[1] + by * rate[1],
        state[2] + by * rate[2],
        state[3] + by * rate[3],
        state[4] + by * rate[4],
        state[5] + by * rate[5],
    )


@njit(cache=True)
def _step(drive, smooth, value, time, by, state, link_mode, motor_mode):
    """Return the state after a Runge-Kutta step with fixed modes."""
    middle = torque_at(smooth, value, time + 0.5 * by)
    k1 = _derivative(drive, state, torque_at(smooth, value, time), link_mode, motor_mode)
    k2 = _derivative(drive, _moved(state, k1, 0.5 * by), middle, link_mode, motor_mode)
    k3 = _derivative(drive, _moved(state, k2, 0.5 * by), middle, link_mode, motor_mode)
    last = torque_at(smooth, value, time + by)
    k4 = _derivative(drive, _moved(state, k3, by), last, link_mode, motor_mode)
    state = _moved(state, k1, by / 6.0)
    state = _moved(state, k2, by / 3.0)
    state = _moved(state, k3, by / 3.0)
    return _moved(state, k4, by / 6.0)


@njit(cache=True)
def _mode_at_rest(drive, torque, load, is_link):
    """Return the mode of a side at rest: 0 if it sticks, else the direction of slip."""
    more = drive.motor_static + load
    up = drive.link_coulomb if is_link else drive.motor_coulomb_up + more
    down = drive.link_coulomb if is_link else drive.motor_coulomb_down + more
    if torque > up:
        return 1
    return -1 if torque < -down else 0


@njit(cache=True)
def _over(drive, torque, load, velocity, mode, is_link):
    """Return whether a side has left its mode."""
    if mode == 0:
        return _mode_at_rest(drive, torque, load, is_link) != 0
    return mode * velocity < 0.0


@njit(cache=True)
def _left(drive, smooth, value, time, state, link_mode, motor_mode):
    """Return which sides have left their modes."""
    link, motor, _, load = _loads(drive, state, torque_at(smooth, value, time))
    link_left = drive.link_coulomb > 0.0 and _over(drive, link, load, state[1], link_mode, True)
    motor_left = drive.motor_coulomb_up + drive.motor_coulomb_down > 0.0 and _over(
        drive, motor, load, state[3], motor_mode, False
    )
    return link_left, motor_left


@njit(cache=True)
def _settled(drive, smooth, value, time, state, link_mode, motor_mode, link_left, motor_left):
    """Return state and modes after an event; a side at zero velocity sticks or slips on."""
    q, w, p, v, z, h = state
    w = 0.0 if link_left and link_mode != 0 else w
    v = 0.0 if motor_left and motor_mode != 0 else v
    state = (q, w, p, v, z, h)
    link, motor, _, load = _loads(drive, state, torque_at(smooth, value, time))
    if link_left:
        link_mode = _mode_at_rest(drive, link, load, True)
    if motor_left:
        motor_mode = _mode_at_rest(drive, motor, load, False)
    return state, link_mode, motor_mode


@njit(cache=True)
def _advance(drive, smooth, value, time, end, state, link_mode, motor_mode, longest):
    """Integrate from one instant to another, with the events in between."""
    has_friction = drive.motor_coulomb_up + drive.motor_coulomb_down + drive.link_coulomb > 0.0
    while time < end:
        by = min(longest, end - time)
        if drive.bristle_stiffness > 0.0 and state[3] != 0.0:
            reach = drive.bristle_coulomb / drive.bristle_stiffness
            by = min(by, max(_BRISTLE_SHARE * reach / abs(state[3]), 1e-7))
        moved = _step(drive, smooth, value, time, by, state, link_mode, motor_mode)
        left = (False, False)
        if has_friction:
            left = _left(drive, smooth, value, time + by, moved, link_mode, motor_mode)
        if left[0] or left[1]:
            low, high = 0.0, by
            for _ in range(_BISECTIONS):
                middle = 0.5 * (low + high)
                tried = _step(drive, smooth, value, time, middle, state, link_mode, motor_mode)
                there = _left(drive, smooth, value, time + middle, tried, link_mode, motor_mode)
                if there[0] or there[1]:
                    high, moved, left = middle, tried, there
                else:
                    low = middle
            moved, link_mode, motor_mode = _settled(
                drive, smooth, value, time + high, moved, link_mode, motor_mode, left[0], left[1]
            )
            by = high
        state = moved
        time = end if by >= end - time else time + by
    return state, link_mode, motor_mode


@njit(cache=True)
def controlled(law, course, position, sample, memory):
    """Return the controller's torque and its state: summed error, speed and reading."""
    summed, speed, before = memory
    read = position + course[2]
    if law.count > 0.0:
        read = np.rint((read + law.zero) / law.count) * law.count - law.zero
    if sample > 0.0:
        speed += law.smoothing * ((read - before) / sample - speed)
        summed += sample * (course[0] - read)
    torque = (
        law.proportional * (course[0] - read)
        + law.derivative * (course[1] - speed)
        + law.integral * summed
    )
    return torque, (summed, speed, read)


@njit(cache=True)
def simulate(
    drive, times, link_times, switch_times, held, disturbance, smooth, law, course, start, longest
):
    """Simulate a drive.

    Parameters
    ----------
    drive : Drive
    times : (n,) array
        Instants of the motor's encoder and of the controller, in s.
    link_times, switch_times : (n,) array
        Instants of the link's encoder, and those from which each sample's torque acts.
    held : (n,) array
        Torque of each sample; overwritten with the controller's torque, if any.
    disturbance : (n,) array
        Unlogged torque that acts with each sample's torque.
    smooth : Smooth
        Continuous torque, if any.
    law : Law
    course : (n, 3) array
        Reference position and velocity of the motor, and noise of the controller's encoder.
    start : float
        Initial angle of link and motor, which start at rest.
    longest : float
        Longest step in s.

    Returns
    -------
    states : (n, 4) array
        Position and velocity of link and motor at the times.
    link : (n,) array
        Position of the link at `link_times`.
    """
    count = len(times)
    states, link = np.empty((count, 4)), np.empty(count)
    state = (start, 0.0, start, 0.0, 0.0, 0.0)
    time = min(times[0], min(link_times[0], switch_times[0])) - _BEFORE
    value = 0.0 if law.proportional > 0.0 else held[0]
    link_mode, motor_mode = 0, 0
    if drive.link_coulomb == 0.0:
        link_mode = 1
    if drive.motor_coulomb_up + drive.motor_coulomb_down == 0.0:
        motor_mode = 1
    reads, links, switches = 0, 0, 0
    memory = (0.0, 0.0, 0.0)
    while reads < count or links < count:
        at = times[reads] if reads < count else np.inf
        at = min(at, link_times[links] if links < count else np.inf)
        at = min(at, switch_times[switches] if switches < count else np.inf)
        state, link_mode, motor_mode = _advance(
            drive, smooth, value, time, at, state, link_mode, motor_mode, longest
        )
        time = at
        if reads < count and times[reads] <= time:
            states[reads] = state[0], state[1], state[2], state[3]
            if law.proportional > 0.0:
                sample = times[reads] - times[reads - 1] if reads > 0 else 0.0
                held[reads], memory = controlled(law, course[reads], state[2], sample, memory)
            reads += 1
        if links < count and link_times[links] <= time:
            link[links] = state[0]
            links += 1
        if switches < count and switch_times[switches] <= time and switches < reads:
            value = disturbance[switches] + (held[switches] if smooth.values.size == 0 else 0.0)
            switches += 1
    return states, link
