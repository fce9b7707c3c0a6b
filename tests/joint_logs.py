"""Logs of Table I's joint: from rest under any torque, and in periodic motion on one sine."""

import numpy as np

from flexid.models.flexible_joint import flexible_joint
from flexid.simulation.free_run import free_run
from made_estimates import TRUE

SAMPLE_TIME = 0.002
FINE = SAMPLE_TIME / 10
NOISE = 1e-4


def steady_sine(amplitude, frequency, duration=20.0, sample_time=SAMPLE_TIME):
    """Return the torque, shape (n,), and the initial state for a sine of the link."""
    t = sample_time * np.arange(round(duration / sample_time))
    q = amplitude * np.sin(frequency * t)
    rates = [amplitude * frequency**n * np.cos(frequency * t) for n in (1, 3)]
    velocity, acceleration = rates[0], -(frequency**2) * q
    theta1, theta2, alpha1, alpha2, beta1 = TRUE.values()
    twist = -(acceleration + theta1 * np.sin(q)) / theta2  # from the link's equation
    twist_rate = (rates[1] - theta1 * np.cos(q) * velocity) / theta2
    fourth = frequency**4 * q
    curve = theta1 * (np.cos(q) * acceleration - np.sin(q) * velocity**2)
    motor_acceleration = acceleration + (fourth + curve) / theta2
    motor_velocity = velocity - twist_rate
    torque = (motor_acceleration - alpha1 * twist + alpha2 * motor_velocity) / beta1
    return torque, np.array([q[0], velocity[0], q[0] - twist[0], motor_velocity[0]])


def write_log(path, torque, start, seed=11):
    """Run the joint under a smooth torque, given at `FINE`, and write readings of two encoders."""
    x = free_run(flexible_joint(), TRUE, start, torque, FINE)[::10]
    return save(path, x, torque[::10], NOISE, seed)


def write_held_log(path, torque, noise=NOISE, seed=3, column="motor_torque [N m]"):
    """Run the joint from rest under a torque held between samples, and write the readings."""
    x = free_run(flexible_joint(), TRUE, np.zeros(4), torque, SAMPLE_TIME, "zero")
    return save(path, x, torque, noise, seed, column)


def save(path, x, torque, noise, seed, column="motor_torque [N m]"):
    """Write times, positions with noise, and torques."""
    t = SAMPLE_TIME * np.arange(len(x))
    positions = x[:, [0, 2]] + noise * np.random.default_rng(seed).standard_normal((len(t), 2))
    table = np.column_stack([t, positions, torque])
    header = f"time [s],link_position [rad],motor_position [rad],{column}"
    np.savetxt(path, table, delimiter=",", header=header, comments="", fmt="%.9g")
    return path
