"""Plant of the realistic trials and its integrator. Nothing here imports flexid.

    Jn q'' = -Gn sin q - c(q) - k (q - p) - d (q' - p') - bl q' + kt (r - q) + dt (r' - q') + nl
    Jt r'' = -Gt sin r - kt (r - q) - dt (r' - q')
    Jm p'' = k (q - p) + d (q' - p') - f(p', t) + ripple(p) + x + nm
    T  x'  = a(u) - e p' - x
    Tg g'  = (q - p) - g

q and p are link and motor angle, r the tip of the link, x the acting torque, u the input, g the
gauge. Fourth-order Runge-Kutta steps. The friction is smooth, with short steps where it changes
sign. The input is constant over a period of the controller. Disturbances nl and nm are linear
between its instants.
"""

from typing import NamedTuple

import numpy as np
from numba import njit  # pyright: ignore[reportMissingTypeStubs]

from benchmarks.trials.integrator import controlled

_NEAR = 6.0  # speed below which steps are short, over the width of the friction's change of sign
_CROSSING = 2000.0  # 1/s, ratio of the step, over the longest one, to the time of the sign's change
_SHORTEST = 1.0 / 64.0  # shortest step over the longest one
_LAST = 1e-9  # of a period, neglected at its end


class Plant(NamedTuple):
    """A drive with imperfections, in SI units on the link's side; the input is in N m."""

    near_inertia: float  # of the link, at the joint
    motor_inertia: float
    joint_stiffness: float
    joint_damping: float = 0.0
    tip_inertia: float = 0.0  # of the link beyond its own spring; zero for a rigid link
    tip_stiffness: float = 0.0
    tip_damping: float = 0.0
    gravity_torque: float = 0.0  # shared between near part and tip like the inertia
    link_viscous: float = 0.0
    motor_viscous: float = 0.0
    coulomb: float = 0.0
    static_extra: float = 0.0  # excess of dry friction at rest over Coulomb friction
    stribeck_velocity: float = 1.0  # rad/s
    friction_width: float = 1e-3  # rad/s, of the smooth change of sign
    drift: float = 0.0  # share of the friction lost by warming up
    drift_time: float = 10.0  # s
    cable_stiffness: float = 0.0
    cable_cubic: float = 0.0
    cable_angle: float = 0.0  # rad, at which the cable exerts no torque
    ripple: float = 0.0  # N m
    ripple_second: float = 0.0  # N m, at twice the number
    ripple_number: float = 0.0  # per turn of the joint
    ripple_phase: float = 0.0
    back_emf: float = 0.0  # N m s/rad
    dead_zone: float = 0.0  # N m of input
    saturation: float = np.inf  # N m of input, after the dead zone
    lag: float = 0.0  # s, of the current
    gauge_lag: float = 1e-3  # s
    cubic_stiffness: float = 0.0  # N m/rad^3
    half_gap: float = 0.0  # rad, of the joint's spring


COLUMNS = ("link", "link_rate", "motor", "motor_rate", "gauge", "input")
"""Columns of the result of `simulate`."""


@njit(cache=True)
def amplified(plant, command):
    """Return the input after dead zone and saturation."""
    beyond = max(abs(command) - plant.dead_zone, 0.0)
    return min(beyond, plant.saturation) * np.sign(command)


@njit(cache=True)
def friction(plant, velocity, warmth):
    """Return the friction of the motor, scaled by `warmth`."""
    dry = plant.coulomb
    if plant.static_extra > 0.0:
        dry += plant.static_extra * np.exp(-((velocity / plant.stribeck_velocity) ** 2))
    return warmth * (
        plant.motor_viscous * velocity + dry * np.tanh(velocity / plant.friction_width)
    )


@njit(cache=True)
def warmth_at(plant, time):
    """Return the remaining share of the initial friction as the drive warms up."""
    return 1.0 - plant.drift * (1.0 - np.exp(-max(time, 0.0) / plant.drift_time))


@njit(cache=True)
def _slope(plant, state, wanted, link_push, motor_push, warmth, out):
    """Return the derivatives of q, q', r, r', p, p', x, g."""
    q, w, r, s, p, v, x, g = state
    twist = q - p - min(max(q - p, -plant.half_gap), plant.half_gap)
    joint = plant.joint_stiffness * twist + plant.joint_damping * (w - v)
    joint += plant.cubic_stiffness * twist**3
    whole = plant.near_inertia + plant.tip_inertia
    bend = 0.0
    if plant.tip_inertia > 0.0:
        bend = plant.tip_stiffness * (r - q) + plant.tip_damping * (s - w)
        pull = plant.gravity_torque / whole * np.sin(r)
        out[2], out[3] = s, -pull - bend / plant.tip_inertia
    else:
        out[2], out[3] = 0.0, 0.0
    away = q - plant.cable_angle
    link = bend - joint - plant.link_viscous * w + link_push
    link -= plant.gravity_torque * plant.near_inertia / whole * np.sin(q)
    link -= plant.cable_stiffness * away + plant.cable_cubic * away**3
    acting = wanted - plant.back_emf * v
    if plant.lag > 0.0:
        out[6] = (acting - x) / plant.lag
        acting = x
    else:
        out[6] = 0.0
    motor = joint - friction(plant, v, warmth) + acting + motor_push
    if plant.ripple > 0.0:
        angle = plant.ripple_number * p + plant.ripple_phase
        motor += plant.ripple * np.sin(angle) + plant.ripple_second * np.sin(2.0 * angle)
    out[0], out[1] = w, link / plant.near_inertia
    out[4], out[5] = v, motor / plant.motor_inertia
    out[7] = (q - p - g) / plant.gauge_lag


@njit(cache=True)
def _length(plant, speed, acceleration, longest):
    """Return the length of a step, which is short while the friction changes its sign."""
    near = _NEAR * plant.friction_width + 2.0 * longest * acceleration
    if plant.coulomb == 0.0 or speed > near or acceleration == 0.0:
        return longest
    share = _CROSSING * plant.friction_width / acceleration
    return longest * min(max(share, _SHORTEST), 1.0)


@njit(cache=True)
def _advance(plant, state, wanted, pushes, time, period, longest, work):
    """Integrate over one period of the controller; `pushes` are disturbances at both ends."""
    shares = (0.0, 0.5, 0.5, 1.0)
    weights = (1.0, 2.0, 2.0, 1.0)
    slopes, tried, total = work[0], work[1], work[2]
    gone, by = 0.0, 0.0
    while gone < period:
        total[:] = 0.0
        for stage in range(4):
            at = min((gone + shares[stage] * by) / period, 1.0)
            for i in range(8):
                tried[i] = state[i] + shares[stage] * by * slopes[i]
            _slope(
                plant,
                tried,
                wanted,
                pushes[0, 0] + at * (pushes[1, 0] - pushes[0, 0]),
                pushes[0, 1] + at * (pushes[1, 1] - pushes[0, 1]),
                warmth_at(plant, time + at * period),
                slopes,
            )
            if stage == 0:
                by = _length(plant, abs(state[5]), abs(slopes[5]), longest)
                if gone + by > period * (1.0 - _LAST):
                    by = period - gone
            for i in range(8):
                total[i] += weights[stage] * slopes[i]
        for i in range(8):
            state[i] += by / 6.0 * total[i]
        gone = period if gone + by > period * (1.0 - _LAST) else gone + by


@njit(cache=True)
def simulate(plant, times, excitation, law, course, pushes, start, longest):
    """Simulate a drive.

    Parameters
    ----------
    plant : Plant
    times : (n,) array
        Instants of the controller in s, evenly spaced; the friction drifts from time zero on.
    excitation : (n,) array
        Input that is added to the controller's, in N m.
    law : Law
    course : (n, 3) array
        Reference position and velocity of the motor, and error of the controller's sensor.
    pushes : (n, 2) array
        Disturbing torques on link and motor in N m.
    start : float
        Initial angle of link and motor, which start at rest.
    longest : float
        Longest step in s.

    Returns
    -------
    (n, 6) array
        `COLUMNS` at the times.
    """
    count = len(times)
    period = times[1] - times[0]
    longest = period / np.ceil(period / longest)
    found = np.empty((count, 6))
    state, work = np.zeros(8), np.zeros((3, 8))
    state[0], state[2], state[4] = start, start, start
    memory = (0.0, 0.0, start)
    for i in range(count):
        command = excitation[i]
        if law.proportional > 0.0:
            torque, memory = controlled(law, course[i], state[4], period if i > 0 else 0.0, memory)
            command += torque
        found[i] = state[0], state[1], state[4], state[5], state[7], command
        if i + 1 < count:
            wanted = amplified(plant, command)
            _advance(plant, state, wanted, pushes[i : i + 2], times[i], period, longest, work)
    return found
