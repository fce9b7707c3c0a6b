"""MuJoCo's sysid on a trial: a scene with the terms that act is fitted to the log.

Like `benchmarks/peers/mujoco_sysid.py`, but with friction, and starting from least squares.
"""

import contextlib

import numpy as np
from mujoco import MjSpec, sysid
from scipy.signal import savgol_filter

from benchmarks.rivals.given import Answer, Given

_SEQUENCE = 1.0  # s; longer ones were worse on most of the seeds used for tuning
_SMOOTHED = 1.5  # rad of the resonance's phase, window of the cubics for the initial states
_DRY_STEP = 5e-4  # s, longest step of the engine with dry friction
_RANGE = 5.0  # largest ratio between a parameter and its starting value
_SMALL = 1e-3  # start of a friction that was estimated as negative, over the stiffness
_LEVER, _WEIGHT = 0.25, 9.81

_FRICTIONS = {
    "motor_viscous": ("motor_viscous_friction", "motor"),
    "link_viscous": ("link_viscous_friction", "link"),
    "motor_coulomb": ("motor_coulomb_friction", "motor"),
    "link_coulomb": ("link_coulomb_friction", "link"),
}


def identify(log: Given) -> Answer:
    """Return the physical parameters of a joint with gravity and frictions."""
    dry = any(term.endswith("coulomb") for term in log.terms)
    steps = int(np.ceil(log.sample_time / _DRY_STEP - 1e-9)) if dry else 1
    spec = MjSpec.from_string(_scene(log.sample_time / steps))
    parameters = _parameters(log)
    window = log.window(_SMOOTHED)
    smooth = savgol_filter(log.positions, window, 3, axis=0)
    speeds = savgol_filter(log.positions, window, 3, deriv=1, delta=log.sample_time, axis=0)
    model = spec.compile()
    length = round(_SEQUENCE / log.sample_time)
    fine = log.sample_time / steps * np.arange(length * steps + 1)
    states, controls, measurements = [], [], []
    firsts = range(0, len(log.time) - length, length)
    for first in firsts:
        torque = log.mean_torque(log.time[first] + np.append(fine, fine[-1] + fine[1]))
        times = log.sample_time * np.arange(length + 1)
        measured = log.positions[first : first + length + 1]
        states.append(sysid.create_initial_state(model, smooth[first], speeds[first]))
        controls.append(sysid.TimeSeries.from_control_names(fine, torque[:, None], model))
        measurements.append(
            sysid.TimeSeries.from_names(times, measured, model, ["link_qpos", "motor_qpos"])
        )
    titles = [f"from sample {first}" for first in firsts]
    sequences = sysid.ModelSequences("joint", spec, titles, states, controls, measurements)
    residual = sysid.build_residual_fn(models_sequences=[sequences])
    with contextlib.redirect_stdout(None):
        parameters, result = sysid.optimize(parameters, residual, verbose=False)
    residuals, _, _ = residual(result.x, parameters, return_pred_all=True)
    covariance, _ = sysid.calculate_intervals(residuals, result.jac)
    deviations = np.sqrt(np.diag(covariance)).tolist()
    values = dict(zip(parameters.keys(), result.x.tolist(), strict=True))
    intervals = {
        name: (value - 1.96 * d, value + 1.96 * d)
        for (name, value), d in zip(values.items(), deviations, strict=True)
    }
    return Answer(values, intervals)


def _scene(step: float) -> str:
    # The stiffest dry friction that the step allows; with the engine's default a joint creeps.
    friction = f'solreffriction="{2.0 * step} 1" solimpfriction="0.9999 0.9999 0.001"'
    return f"""<mujoco>
      <option timestep="{step}" integrator="RK4" gravity="0 0 -{_WEIGHT}"/>
      <worldbody>
        <body name="link"><joint name="link" type="hinge" axis="0 1 0" {friction}/>
          <inertial pos="0 0 -{_LEVER}" mass="1" diaginertia="1e-6 1e-6 1e-6"/></body>
        <body name="motor"><joint name="motor" type="hinge" axis="0 1 0" {friction}/>
          <inertial pos="0 0 0" mass="1" diaginertia="1e-6 1e-6 1e-6"/></body>
      </worldbody>
      <tendon><fixed name="spring" springlength="0">
        <joint joint="link" coef="1"/><joint joint="motor" coef="-1"/></fixed></tendon>
      <actuator><motor name="motor" joint="motor"/></actuator>
      <sensor><jointpos joint="link"/><jointpos joint="motor"/></sensor>
    </mujoco>"""


def _parameters(log: Given) -> sysid.ParameterDict:
    """Return the unknown parameters, with starting values from least squares."""

    def set_gravity(spec, p):
        spec.body("link").mass = p.value[0] / (_WEIGHT * _LEVER)

    def set_link_inertia(spec, p):  # set after the mass
        spec.joint("link").armature = p.value[0] - spec.body("link").mass * _LEVER**2 - 1e-6

    def set_motor_inertia(spec, p):
        spec.joint("motor").armature = p.value[0] - 1e-6

    def set_stiffness(spec, p):
        spec.tendon("spring").stiffness = np.array([p.value[0], 0.0, 0.0])

    parameters = sysid.ParameterDict()
    for name, modifier in (
        ("gravity_torque", set_gravity),
        ("link_inertia", set_link_inertia),
        ("motor_inertia", set_motor_inertia),
        ("joint_stiffness", set_stiffness),
    ):
        start = log.start[name]
        low, high = start / _RANGE, start * _RANGE
        parameters.add(sysid.Parameter(name, start, low, high, modifier=modifier))
    for term in log.terms:
        if term == "gravity":
            continue
        name, side = _FRICTIONS[term]
        start = log.start[name]
        if start <= 0.0:
            start = _SMALL * log.start["joint_stiffness"]

        def set_coulomb(spec, p, side=side):
            spec.joint(side).frictionloss = p.value[0]

        def set_viscous(spec, p, side=side):
            spec.joint(side).damping = np.array([p.value[0], 0.0, 0.0])

        modifier = set_coulomb if term.endswith("coulomb") else set_viscous
        parameters.add(sysid.Parameter(name, start, 0.0, _RANGE * start, modifier=modifier))
    return parameters
