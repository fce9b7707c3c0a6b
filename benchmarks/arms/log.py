"""Log of a random arm: controlled motion in MuJoCo, with encoder steps and noise."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.arms.arm import Arm, mjcf
from benchmarks.size import sized
from flexid.models.motion import JointType, unit_of
from flexid.models.planar_arm import carried_links, planar_arm

Array = NDArray[np.float64]

_PER_RADIAN: Mapping[JointType, float] = {"revolute": 1.0, "prismatic": 0.3}  # rad or m


@dataclass(frozen=True)
class Motion:
    """Motion, controller and sensors of an arm's log."""

    duration: float = sized(20.0, 4.0)
    sample_time: float = 1e-3
    bits: int = 17
    noise: float = 1.0  # of an encoder, in steps
    amplitude: float = 0.6  # rad, of the slow reference; a third of that in m for a sliding joint
    shake: float = 1.0  # added torque, over the torque that the inertia needs
    torque_noise: float = 0.0  # of the logged torque, over its root mean square
    quiet_joint: int = 0  # joint with a tenth of the motion; 0 for none
    gain: float = 1.0  # of the controller


@dataclass(frozen=True)
class Log:
    """Logged arrays, with one column per joint."""

    time: Array
    motor: Array
    link: Array
    torque: Array
    types: tuple[JointType, ...]  # of each joint


def random_motion(rng: np.random.Generator, harsh: bool = False) -> Motion:
    """Draw a motion; harsh ones may be slow, small in one joint, or with noisy torque."""
    usual = Motion(
        sample_time=float(rng.choice([1e-3, 2e-3])),
        bits=int(rng.integers(14, 19)),
        noise=float(rng.uniform(0.3, 2.0)),
        amplitude=float(rng.uniform(0.3, 1.0)),
        shake=float(rng.uniform(0.5, 2.0)),
    )
    if not harsh:
        return usual
    return Motion(
        sample_time=usual.sample_time,
        bits=usual.bits,
        noise=usual.noise,
        amplitude=usual.amplitude * float(rng.uniform(0.2, 1.0)),
        shake=float(np.exp(rng.uniform(np.log(0.05), np.log(2.0)))),
        torque_noise=float(rng.choice([0.0, 0.01, 0.05])),
        quiet_joint=int(rng.integers(0, 3)),
        gain=float(rng.choice([0.1, 1.0])),
    )


def _sines(rng: np.random.Generator, band: tuple[float, float], count: int, t: Array) -> Array:
    """Return a sum of sines of random phase, with a peak of about 1 at most."""
    frequencies = np.exp(rng.uniform(np.log(band[0]), np.log(band[1]), count))
    phases = rng.uniform(0.0, 2.0 * np.pi, count)
    return np.sin(2.0 * np.pi * np.outer(t, frequencies) + phases).sum(axis=1) / np.sqrt(count)


def simulate(arm: Arm, motion: Motion, rng: np.random.Generator) -> Log:
    """Simulate an arm with a controller whose torque is constant between samples."""
    import mujoco

    fastest = max(
        np.sqrt(link.stiffness * (1.0 / link.motor_inertia + 1.0 / min(link.inertia, 1e9)))
        for link in arm.links
    )
    substeps = int(np.clip(np.ceil(motion.sample_time * fastest / 0.1), 4, 40))
    model = mujoco.MjModel.from_xml_string(mjcf(arm, motion.sample_time / substeps))
    data = mujoco.MjData(model)
    n = arm.joints
    places = {
        name: [model.joint(f"{name}_{i}").qposadr[0] for i in range(1, n + 1)]
        for name in ("link", "motor")
    }
    count = round(motion.duration / motion.sample_time)
    t = motion.sample_time * np.arange(count)
    truth = arm.truth()
    balance = planar_arm(arm.known)
    inertia = np.array(
        [truth[f"motor_inertia_{i}"] + truth[carried_links(balance, i)[0]] for i in range(1, n + 1)]
    )
    per_radian = np.array([_PER_RADIAN[joint_type] for joint_type in balance.types])
    scale = per_radian.copy()
    if motion.quiet_joint:
        scale[motion.quiet_joint - 1] = 0.1
    reference = np.stack([_sines(rng, (0.1, 1.5), 5, t) for _ in range(n)], axis=1)
    reference = motion.amplitude * scale * (reference - reference[0])
    shake = np.stack([_sines(rng, (1.0, 25.0), 20, t) for _ in range(n)], axis=1)
    shake = 8.0 * motion.shake * scale * inertia * shake
    kp, kd = motion.gain * inertia * 60.0, motion.gain**0.5 * inertia * 10.0
    step = per_radian * 2.0 * np.pi / 2**motion.bits
    motor, link, torque = (np.zeros((count, n)) for _ in range(3))
    for k in range(count):
        theta = data.qpos[places["motor"]]
        q = data.qpos[places["link"]] + theta * arm.spun
        noise = motion.noise * step * rng.standard_normal((2, n))
        motor[k] = step * np.rint((theta + noise[0]) / step)
        link[k] = step * np.rint((q + noise[1]) / step)
        speed = data.qvel[places["motor"]]
        torque[k] = kp * (reference[k] - motor[k]) - kd * speed + shake[k]
        data.qfrc_applied[:] = 0.0
        data.qfrc_applied[places["motor"]] = torque[k]
        mujoco.mj_step(model, data, nstep=substeps)
    rms = np.sqrt(np.mean(torque**2, axis=0))
    logged = torque + motion.torque_noise * rms * rng.standard_normal(torque.shape)
    return Log(t, motor, link, logged, balance.types)


def save(log: Log, path: Path) -> None:
    """Write a log as a CSV file."""
    n = log.motor.shape[1]
    names, columns = ["time [s]"], [log.time]
    for i in range(n):
        names += [f"{kind}_{i + 1} [{unit_of(unit, log.types[i])}]" for kind, unit in _CHANNELS]
        columns += [log.motor[:, i], log.link[:, i], log.torque[:, i]]
    np.savetxt(path, np.column_stack(columns), "%.12g", ",", header=",".join(names), comments="")


_CHANNELS = (("motor_position", "rad"), ("link_position", "rad"), ("motor_torque", "N m"))
