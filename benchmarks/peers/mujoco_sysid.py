"""MuJoCo's sysid: the parameters of a scene are fitted until it moves like the log.

The scene is a pendulum and a motor on one axis with a spring (a tendon) between them. The log is
cut into sequences with fixed initial states, which come from cubics fitted to the measurements.
Short sequences converge from distant starting values; long ones are less sensitive to errors of the
initial states. So sequences of 1 s are fitted first, then those of 5 s. Positions and velocities
are compared with the states of the simulation, as its sensors lag by a step. Intervals of
parameter ratios are computed from sysid's Gauss-Newton covariance.
"""

import contextlib

import numpy as np
from mujoco import MjSpec, sysid
from scipy.signal import savgol_filter

from benchmarks.peers.problem import COEFFICIENTS, Answer, Log

_SEQUENCES = (1.0, 5.0)  # s
_WINDOW = 41  # samples for each cubic


def identify(log: Log) -> Answer:
    # user code begins
    lever, weight = 0.25, 9.81
    kinds = ["jointpos"] if log.velocities is None else ["jointpos", "jointvel"]
    sensors = "".join(f'<{kind} joint="{j}"/>' for kind in kinds for j in ("link", "motor"))
    scene = f"""<mujoco>
      <option timestep="{log.sample_time}" integrator="RK4" gravity="0 0 -{weight}"/>
      <worldbody>
        <body name="link"><joint name="link" type="hinge" axis="0 1 0"/>
          <inertial pos="0 0 -{lever}" mass="1" diaginertia="1e-5 1e-5 1e-5"/></body>
        <body name="motor"><joint name="motor" type="hinge" axis="0 1 0"/>
          <inertial pos="0 0 0" mass="1" diaginertia="1e-5 1e-5 1e-5"/></body>
      </worldbody>
      <tendon><fixed name="spring" springlength="0">
        <joint joint="link" coef="1"/><joint joint="motor" coef="-1"/></fixed></tendon>
      <actuator><motor name="motor" joint="motor"/></actuator>
      <sensor>{sensors}</sensor>
    </mujoco>"""

    def set_gravity(spec, p):
        spec.body("link").mass = p.value[0] / (weight * lever)

    def set_link_inertia(spec, p):
        link = spec.body("link")
        spec.joint("link").armature = p.value[0] - link.mass * lever**2 - 1e-5

    def set_motor_inertia(spec, p):
        spec.joint("motor").armature = p.value[0] - 1e-5

    def set_friction(spec, p):
        spec.joint("motor").damping = np.array([p.value[0], 0.0, 0.0])

    def set_stiffness(spec, p):
        spec.tendon("spring").stiffness = np.array([p.value[0], 0.0, 0.0])

    theta1, theta2, alpha1, alpha2, beta1 = (log.guess[name] for name in COEFFICIENTS)
    stiffness = alpha1 / beta1
    parameters = sysid.ParameterDict()
    for name, guess, modifier in (
        ("gravity", theta1 / theta2 * stiffness, set_gravity),
        ("link_inertia", stiffness / theta2, set_link_inertia),
        ("motor_inertia", 1.0 / beta1, set_motor_inertia),
        ("friction", alpha2 / beta1, set_friction),
        ("stiffness", stiffness, set_stiffness),
    ):
        parameters.add(sysid.Parameter(name, guess, 0.2 * guess, 5.0 * guess, modifier=modifier))
    spec = MjSpec.from_string(scene)
    model = spec.compile()
    smooth = savgol_filter(log.positions, _WINDOW, 3, axis=0)
    if log.velocities is None:
        speeds = savgol_filter(log.positions, _WINDOW, 3, deriv=1, delta=log.sample_time, axis=0)
        data, names = log.positions, ["link_qpos", "motor_qpos"]
    else:
        speeds = savgol_filter(log.velocities, _WINDOW, 3, axis=0)
        data = np.hstack([log.positions, log.velocities])
        names = ["link_qpos", "motor_qpos", "link_qvel", "motor_qvel"]
    torque = np.append(log.mean_torque, log.torque[-1])[:, None]  # constant during a step
    for duration in _SEQUENCES:
        length = min(round(duration / log.sample_time), len(log.time) - 1)
        firsts = range(0, len(log.time) - length, length)
        time = log.sample_time * np.arange(length + 1)  # the clock starts at zero again
        states, controls, measurements = [], [], []
        for first in firsts:
            part = slice(first, first + length + 1)
            states.append(sysid.create_initial_state(model, smooth[first], speeds[first]))
            controls.append(sysid.TimeSeries.from_control_names(time, torque[part], model))
            measurements.append(sysid.TimeSeries.from_names(time, data[part], model, names))
        titles = [f"from sample {first}" for first in firsts]
        sequences = sysid.ModelSequences("joint", spec, titles, states, controls, measurements)
        residual = sysid.build_residual_fn(models_sequences=[sequences])
        with contextlib.redirect_stdout(None):
            parameters, result = sysid.optimize(parameters, residual, verbose=False)
    residuals, _, _ = residual(result.x, parameters, return_pred_all=True)
    covariance, _ = sysid.calculate_intervals(residuals, result.jac)
    # user code ends
    gravity, link_inertia, motor_inertia, friction, stiffness = result.x.tolist()
    values = {
        "theta1": gravity / link_inertia,
        "theta2": stiffness / link_inertia,
        "alpha1": stiffness / motor_inertia,
        "alpha2": friction / motor_inertia,
        "beta1": 1.0 / motor_inertia,
    }
    ratios = np.array(
        [[1, -1, 0, 0, 0], [0, -1, 0, 0, 1], [0, 0, -1, 0, 1], [0, 0, -1, 1, 0], [0, 0, -1, 0, 0]]
    )
    jacobian = ratios / result.x  # of the logarithms
    deviations = np.sqrt(np.diag(jacobian @ covariance @ jacobian.T)).tolist()
    return Answer(
        values,
        {
            name: (values[name] * np.exp(-1.96 * d), values[name] * np.exp(1.96 * d))
            for name, d in zip(COEFFICIENTS, deviations, strict=True)
        },
    )
