"""The integrator of the blind trials against SciPy's, and against what physics conserves."""

import numpy as np
import pytest
from benchmarks.trials.integrator import Drive, Law, Smooth, simulate

from stick_slip import motion

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


def played(drive, times, held, start=0.0, smooth=EMPTY):
    """States at the times, under a torque that is held from each time on."""
    course, nothing = np.zeros((len(times), 3)), np.zeros(len(times))
    rest = held.copy(), nothing, smooth, Law(), course, start, 5e-5
    return simulate(drive, times, times, times, *rest)


class Joint:
    """The same drive as `stick_slip` wants it, under a smooth torque."""

    limits = np.array([[0.25, 0.25], [0.9, 0.6]])

    def masses(self, _: np.ndarray) -> np.ndarray:
        """Inertias of link and motor."""
        return np.diag([0.3, 0.4])

    def forces(self, time: float, x: np.ndarray) -> np.ndarray:
        """Torques on link and motor beside Coulomb friction."""
        q, w, p, v = x
        spring = 60.0 * (q - p) + 0.1 * (w - v)
        return np.array([-2.0 * np.sin(q - 0.2) - spring, spring - 0.2 * v + torque(time)])


def torque(time):
    """What makes both sides stick and slip."""
    return 2.0 * np.sin(5.0 * time) + 0.8 * np.sin(1.3 * time + 0.4)


def test_stick_and_slip_are_those_of_scipy():
    """Assert that a joint that sticks on both sides moves as SciPy with events says."""
    times, grid = np.arange(4001) * 1e-3, np.arange(-200, 40300) * 1e-4
    smooth = Smooth(torque(grid), grid[0], 1e-4)
    states, _ = played(STUCK_AND_SLIPPING, times, np.zeros(len(times)), 0.2, smooth=smooth)
    # SciPy begins where the other is after its first millisecond, at which nothing moves yet.
    expected, ended = motion(Joint(), times, states[0])
    assert ended > 15
    np.testing.assert_allclose(states, expected, atol=2e-8)


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
