"""Logs of a joint that more moves than its model has; integrated here, by Runge and Kutta."""

from collections.abc import Callable

import numpy as np
from numba import njit

from flexid.identification.full_model.model import Data, data_of
from flexid.identification.preparation.joint import flexible
from flexid.recording.recording import Log, Recording
from flexid.recording.velocities import with_velocities

TRUTH = {"theta2": 150.0, "alpha1": 250.0, "alpha2": 1.5, "beta1": 4.0}
"""Coefficients; the resonance lies at 20 rad/s."""

NOISE = 2e-5  # rad
_STEP = 2e-3  # s
_TONES = np.geomspace(1.0, 26.0, 15)  # rad/s


def coloured(rng: np.random.Generator, n: int, size: float, correlation: float) -> np.ndarray:
    """Random numbers that forget themselves within a correlation time in s."""
    keep = np.exp(-_STEP / correlation)
    shocks = np.sqrt(1.0 - keep**2) * rng.standard_normal(n)
    found = np.empty(n)
    last = rng.standard_normal()
    for i in range(n):
        last = keep * last + shocks[i]
        found[i] = last
    return size * found


def torque(rng: np.random.Generator, n: int, size: float) -> np.ndarray:
    """Many tones at half steps, from before the resonance to beyond it, shape (2 n,)."""
    phases = rng.uniform(0.0, 2.0 * np.pi, len(_TONES))
    time = 0.5 * _STEP * np.arange(2 * n)
    return size * np.sin(np.outer(time, _TONES) + phases).sum(axis=1)


def drive(
    seed: int,
    duration: float = 16.0,
    *,
    size: float = 1.0,
    link_push: float = 0.0,
    motor_push: float = 0.0,
    gravity: float = 0.0,
    stiffer: Callable[[float], float] = lambda _: 1.0,
    rigid: bool = False,
    half_gap: float = 0.0,
    hardening: float = 0.0,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time, positions of link and motor, shape (n, 2), and torque, every 2 ms.

    The size is that of each tone of the torque. Pushes are disturbances, RMS in rad/s²,
    forgotten within 0.1 s; the stiffness may change with time, or the link be fixed to the motor.
    The joint may have play, in rad, or harden, in 1/rad².
    """
    rng = np.random.default_rng(seed)
    n = round(duration / _STEP)
    inputs = torque(rng, n, size)
    pushes = [coloured(rng, n, push, 0.1) for push in (link_push, motor_push)]
    theta2, alpha1, alpha2, beta1 = TRUTH.values()
    x, states = np.zeros(4), np.empty((n, 4))

    def rates(x: np.ndarray, i: int, half: int) -> np.ndarray:
        factor = 0.0 if rigid else stiffer(i * _STEP)
        twist = x[0] - x[2]
        twist -= min(max(twist, -half_gap), half_gap)
        twist *= factor * (1.0 + hardening * twist**2)
        link = -gravity * np.sin(x[0]) - theta2 * twist + pushes[0][i]
        motor = alpha1 * twist - alpha2 * x[3] + beta1 * inputs[2 * i + half] + pushes[1][i]
        return np.array([x[1], link, x[3], motor])

    for i in range(n):
        states[i] = x
        if i == n - 1:
            break
        a = rates(x, i, 0)
        b = rates(x + 0.5 * _STEP * a, i, 1)
        c = rates(x + 0.5 * _STEP * b, i, 1)
        d = rates(x + _STEP * c, i, 2)
        x = x + _STEP / 6.0 * (a + 2.0 * b + 2.0 * c + d)
    positions = states[:, [2, 2]] if rigid else states[:, [0, 2]]
    return _STEP * np.arange(n), positions, inputs[::2]


STICTION = 6.0  # rad/s², of the motor at rest
COULOMB = 4.0  # the same, far beyond `_FADES`
_FADES = 0.15  # rad/s, by which the friction of rest has faded


@njit
def _moved(goal: np.ndarray, per_step: int, out: np.ndarray, inputs: np.ndarray) -> None:
    """Euler's steps of a drive that a controller moves to a goal, friction holding it at rest."""
    theta2, alpha1, alpha2, beta1 = 150.0, 250.0, 1.5, 4.0
    link, link_speed, motor, speed = 0.0, 0.0, 0.0, 0.0
    h = _STEP / per_step
    for k in range(len(goal)):
        out[k, 0], out[k, 1] = link, motor
        inputs[k] = 40.0 * (goal[k] - motor) - 4.0 * speed
        for _ in range(per_step):
            twist = link - motor
            pull = alpha1 * twist - alpha2 * speed + beta1 * inputs[k]
            friction = COULOMB + (STICTION - COULOMB) * np.exp(-((speed / _FADES) ** 2))
            if speed == 0.0 and abs(pull) <= friction:
                change = 0.0
            else:
                way = np.sign(speed) if speed != 0.0 else np.sign(pull)
                change = h * (pull - friction * way)
                if speed * (speed + change) < 0.0:
                    change = -speed  # it stops, and may start again
            speed += change
            link_speed += h * (-theta2 * twist)
            motor += h * speed
            link += h * link_speed


def stopping(seed: int, duration: float = 24.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """As `drive`, of one with dry friction that is moved from stop to stop."""
    rng = np.random.default_rng(seed)
    n = round(duration / _STEP)
    goals = np.repeat(rng.uniform(-1.5, 1.5, 40), round(1.2 / _STEP))[:n]
    keep = np.exp(-_STEP / 0.08)
    goal = np.empty(n)
    last = 0.0
    for k in range(n):  # a goal that the motor follows in a fraction of a second
        last = keep * last + (1.0 - keep) * goals[k]
        goal[k] = last
    positions, inputs = np.empty((n, 2)), np.empty(n)
    _moved(goal, 100, positions, inputs)
    return _STEP * np.arange(n), positions, inputs


def recording(
    time: np.ndarray, positions: np.ndarray, inputs: np.ndarray, every: int = 1
) -> Recording:
    """A recording of every so many samples, with the noise of two encoders."""
    rng = np.random.default_rng(len(time))
    noisy = positions + NOISE * rng.standard_normal(positions.shape)
    link, motor = noisy[::every].T
    return Recording(every * _STEP, float(time[0]), link, motor, inputs[::every], "N m", source="x")


def log(made: Recording) -> Log:
    """A log of one recording."""
    return Log((made,), (), made.source, made.source)


def data(made: Recording) -> Data:
    """A recording as a fit takes it."""
    return data_of(flexible(), [with_velocities(made)], (0,))
