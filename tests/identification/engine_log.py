"""Logs of a flexible joint that MuJoCo simulates, with friction that is not flexid's.

A pendulum on one hinge, a motor on a second one about the same axis, a damped spring (a fixed
tendon) between them. The motor has viscous damping and MuJoCo's ``frictionloss``: a regularised
constraint, not a function of the velocity. The torque is held over each sample; two encoders of
14 bit give degrees.
"""

# MuJoCo's compiled half has no type stubs, so pyright cannot see what it exports.
# pyright: reportAttributeAccessIssue=false

import mujoco
import numpy as np

from flexid.recording.recording import Recording

TRUTH = {
    "gravity_torque": 5.0,
    "link_inertia": 1.0,
    "joint_stiffness": 100.0,
    "joint_damping": 0.4,
    "motor_inertia": 0.3,
    "motor_viscous_friction": 0.2,
    "motor_coulomb_friction": 0.5,
}
"""Physical parameters of every log, in SI units."""

SAMPLE_TIME = 1e-3  # s, of the torque's hold and of the log
ENGINE_STEPS_PER_SAMPLE = 4
COUNTS = 2**14  # per turn, both encoders

# Slow tones swing the link, those around the resonance at 20.8 rad/s load the spring.
TONE_FREQUENCIES = np.array([0.7, 3.3, 5.3, 8.1, 12.0, 17.0, 21.0, 25.0, 31.0])  # rad/s
TONE_AMPLITUDES = np.array([2.5, 3.0, 4.0, 4.0, 4.0, 4.0, 4.0, 6.0, 8.0])  # N m


def scene(solref: str = "0.02 1") -> str:
    """The joint as a MuJoCo scene (XML); the link hangs down at angle zero."""
    mass, gravity = 2.0, 9.81
    lever = TRUTH["gravity_torque"] / (mass * gravity)
    inertia = TRUTH["link_inertia"] - mass * lever**2
    rotor = TRUTH["motor_inertia"]
    return f"""
    <mujoco>
      <option timestep="{SAMPLE_TIME / ENGINE_STEPS_PER_SAMPLE!r}" integrator="RK4"
              gravity="0 0 {-gravity!r}"/>
      <worldbody>
        <body name="link">
          <joint name="link" type="hinge" axis="0 1 0"/>
          <inertial pos="0 0 {-lever!r}" mass="{mass!r}"
                    diaginertia="{inertia!r} {inertia!r} 0.1"/>
        </body>
        <body name="motor">
          <joint name="motor" type="hinge" axis="0 1 0"
                 damping="{TRUTH["motor_viscous_friction"]!r}"
                 frictionloss="{TRUTH["motor_coulomb_friction"]!r}" solreffriction="{solref}"/>
          <inertial pos="0 0 0" mass="1" diaginertia="{rotor!r} {rotor!r} {rotor!r}"/>
        </body>
      </worldbody>
      <tendon>
        <fixed name="spring" stiffness="{TRUTH["joint_stiffness"]!r}"
               damping="{TRUTH["joint_damping"]!r}" springlength="0">
          <joint joint="link" coef="1"/>
          <joint joint="motor" coef="-1"/>
        </fixed>
      </tendon>
      <actuator><motor joint="motor"/></actuator>
    </mujoco>
    """


def engine_log(seed: int, duration: float = 30.0, solref: str = "0.02 1") -> Recording:
    """One log: tones of random phases, rounding encoders."""
    rng = np.random.default_rng(seed)
    time = SAMPLE_TIME * np.arange(round(duration / SAMPLE_TIME))
    phases = rng.uniform(0.0, 2.0 * np.pi, len(TONE_FREQUENCIES))
    torque = np.sin(np.outer(time, TONE_FREQUENCIES) + phases) @ TONE_AMPLITUDES
    model = mujoco.MjModel.from_xml_string(scene(solref))
    state = mujoco.MjData(model)
    angles = np.empty((len(time), 2))
    for sample, held in enumerate(torque):
        angles[sample] = state.qpos
        state.ctrl[0] = held
        mujoco.mj_step(model, state, nstep=ENGINE_STEPS_PER_SAMPLE)
    step = 360.0 / COUNTS

    degrees = step * np.rint(np.degrees(angles) / step)
    link, motor = np.radians(degrees).T.copy()
    return Recording(SAMPLE_TIME, 0.0, link, motor, torque, "N m", source=f"engine {seed}")
