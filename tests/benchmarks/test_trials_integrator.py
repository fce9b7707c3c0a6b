"""The integrator of the blind trials against SciPy's, and against what physics conserves."""

import numpy as np
import pytest
from benchmarks.trials.integrator import Drive, Law, Smooth, simulate
from scipy.integrate import solve_ivp

EMPTY = Smooth(np.empty(0), 0.0, 1.0)
STUCK_AND_SLIPPING = Drive(
    link_inertia=0.3,
    motor_inertia=0.4,
    joint_stiffness=60.0,
    gravity_torque=2.0,
    gravity_angle=0.2,
    joint_damping=0.1,
    motor_viscous=0.2,
    motor_coulomb_up=0.9,
    motor_coulomb_down=0.6,
    link_coulomb=0.25,
)


def played(drive, times, held, start=0.0, longest=5e-5, smooth=EMPTY, shift=0.0):
    """States at the times, under a torque that is held from each time on."""
    nothing = np.zeros(len(times))
    course = np.zeros((len(times), 3))
    return simulate(
        drive,
        times,
        times - shift,
        times,
        held.copy(),
        nothing,
        smooth,
        Law(),
        course,
        start,
        longest,
    )


def loads(drive, torque, time, state):
    """Torques on link and motor beside Coulomb friction."""
    q, w, p, v = state
    spring = drive.joint_stiffness * (q - p) + drive.joint_damping * (w - v)
    link = -drive.gravity_torque * np.sin(q - drive.gravity_angle) - spring
    return link, spring - drive.motor_viscous * v + torque(time)


class Event:
    """A function whose zero ends a run, crossed in one direction."""

    terminal = True

    def __init__(self, function, direction):
        self.function, self.direction = function, direction

    def __call__(self, time, state):
        """Its value."""
        return self.function(time, state)


def by_scipy(drive, torque, times, state):
    """The same drive by solve_ivp: it starts again at each event of stick and slip."""
    levels = ((drive.link_coulomb,) * 2, (drive.motor_coulomb_up, drive.motor_coulomb_down))
    inertias = (drive.link_inertia, drive.motor_inertia)

    def at_rest(side, load):
        up, down = levels[side]
        return 1 if load > up else -1 if load < -down else 0

    def slope(time, x):
        found = [x[1], 0.0, x[3], 0.0]
        for side, load in enumerate(loads(drive, torque, time, x)):
            if modes[side]:
                up, down = levels[side]
                against = up if modes[side] > 0 else -down
                found[2 * side + 1] = (load - against) / inertias[side]
        return found

    def crossings():
        for side in (0, 1):
            if modes[side]:
                yield side, None, Event(lambda _, x, i=2 * side + 1: x[i], -modes[side])
                continue
            for level, sign in zip(levels[side], (1, -1), strict=True):
                over = lambda t, x, i=side, s=sign, f=level: (  # noqa: E731
                    s * loads(drive, torque, t, x)[i] - f
                )
                yield side, sign, Event(over, 1)

    modes = [at_rest(i, load) for i, load in enumerate(loads(drive, torque, times[0], state))]
    now, found, events = times[0], np.empty((len(times), 4)), 0
    found[0] = state
    while now < times[-1]:
        watched = list(crossings())
        ahead = times[times > now]
        run = solve_ivp(
            slope,
            (now, times[-1]),
            state,
            "DOP853",
            t_eval=ahead,
            events=[event for *_, event in watched],
            rtol=1e-11,
            atol=1e-12,
        )
        if len(run.t):
            found[np.searchsorted(times, run.t)] = run.y.T
        if run.status == 0:
            break
        here = next(i for i, at in enumerate(run.t_events) if len(at))
        side, breaks_away, _ = watched[here]
        now, state = run.t_events[here][0], run.y_events[here][0].copy()
        state[2 * side + 1] = 0.0
        load = loads(drive, torque, now, state)[side]
        modes[side] = breaks_away or at_rest(side, load)
        events += 1
    return found, events


def test_stick_and_slip_are_those_of_scipy():
    """Assert that a joint that sticks on both sides moves as SciPy with events says."""
    times = np.arange(4001) * 1e-3

    def torque(time):
        return 2.0 * np.sin(5.0 * time) + 0.8 * np.sin(1.3 * time + 0.4)

    grid = np.arange(-200, 40300) * 1e-4
    smooth = Smooth(torque(grid), grid[0], 1e-4)
    states, _ = played(STUCK_AND_SLIPPING, times, np.zeros(len(times)), 0.2, smooth=smooth)
    # SciPy begins where the other is after its first millisecond, at which nothing moves yet.
    expected, events = by_scipy(STUCK_AND_SLIPPING, torque, times, states[0].copy())
    assert events > 15
    np.testing.assert_allclose(states, expected, atol=2e-8)


def energy(drive, states):
    """Kinetic energy, and that of spring and gravity."""
    q, w, p, v = states.T
    kinetic = 0.5 * drive.link_inertia * w**2 + 0.5 * drive.motor_inertia * v**2
    spring = 0.5 * drive.joint_stiffness * (q - p) ** 2
    spring += 0.25 * drive.cubic_stiffness * (q - p) ** 4
    return kinetic + spring - drive.gravity_torque * np.cos(q - drive.gravity_angle)


def test_energy_is_what_the_torque_puts_in():
    """Assert that without friction the torque's work is the energy, to the last digits."""
    drive = Drive(0.3, 0.2, 50.0, gravity_torque=3.0, gravity_angle=0.3, cubic_stiffness=400.0)
    times = np.arange(8001) * 1e-3
    held = np.sin(3.0 * times) + 0.7 * np.sin(11.0 * times)
    states, _ = played(drive, times, held)
    work = np.append(0.0, np.cumsum(held[:-1] * np.diff(states[:, 2])))
    gained = energy(drive, states) - energy(drive, states[:1])
    assert np.ptp(gained) > 0.5
    np.testing.assert_allclose(gained, work, atol=1e-9)


def test_lugre_creeps_before_it_breaks_away():
    """Assert that a load below the static friction stretches the bristles and does no more."""
    drive = Drive(
        0.01,
        0.1,
        10.0,
        bristle_stiffness=2000.0,
        bristle_damping=14.0,
        bristle_coulomb=1.0,
        bristle_static=1.5,
        stribeck_velocity=0.05,
        link_viscous=1.0,
    )
    times = np.arange(3001) * 1e-3
    states, _ = played(drive, times, 0.8 * np.minimum(times, 1.0))
    # Bristles that are pulled slowly: load = static (1 - exp(-stiffness x / static)).
    assert states[-1, 2] == pytest.approx(-np.log(1.0 - 0.8 / 1.5) * 1.5 / 2000.0, rel=0.02)
    states, _ = played(drive, times, np.full(len(times), 1.6))
    assert states[-1, 2] > 0.5
