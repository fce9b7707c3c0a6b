"""Textbook model of a two-link arm, with dry friction by event-driven integration."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from flexid.arrays import FloatArray
from flexid.models.planar_arm import PlanarArm

ARM = PlanarArm((0.4, 0.3), (9.81, 0.0), stribeck=((0.3, 2.0), (1.0, 2.0)))
TRUTH = {
    "joint_stiffness_1": 300.0,
    "cubic_joint_stiffness_1": 100.0,
    "joint_damping_1": 0.3,
    "motor_inertia_1": 0.25,
    "motor_viscous_friction_1": 0.6,
    "motor_coulomb_friction_1": 0.8,
    "link_viscous_friction_1": 0.1,
    "link_coulomb_friction_1": 0.5,
    "torque_constant_1": 1.0,
    "link_inertia_1": 0.5,
    "link_moment_along_1": 0.9,
    "link_moment_across_1": 0.05,
    "joint_stiffness_2": 80.0,
    "cubic_joint_stiffness_2": 40.0,
    "joint_damping_2": 0.05,
    "motor_inertia_2": 0.06,
    "motor_viscous_friction_2": 0.1,
    "motor_coulomb_friction_2": 0.2,
    "link_viscous_friction_2": 0.02,
    "link_coulomb_friction_2": 0.15,
    "torque_constant_2": 1.0,
    "link_inertia_2": 0.06,
    "link_moment_along_2": 0.25,
    "link_moment_across_2": 0.01,
    "rotor_coupling_2": 0.02,
}


@dataclass
class TwoLinks:
    """Two links; states are link 1, motor 1, link 2, motor 2, each with its velocity."""

    torque: FloatArray
    gravity: float = 9.81
    stribeck: float = 0.0  # N m, friction of motor 1 that only acts at rest and at low speed

    @property
    def limits(self) -> FloatArray:
        """Return the friction torque of each row at rest, in both directions."""
        sides = [f"{side}_coulomb_friction_{i}" for i in (1, 2) for side in ("link", "motor")]
        found = np.array([[TRUTH[side]] * 2 for side in sides])
        found[1] += self.stribeck
        return found

    def masses(self, x: FloatArray) -> FloatArray:
        """Return the mass matrix."""
        t, length = TRUTH, ARM.lengths[0]
        i1, i2 = t["link_inertia_1"], t["link_inertia_2"]
        across = t["link_moment_across_2"]
        h = length * (t["link_moment_along_2"] * np.cos(x[4]) - across * np.sin(x[4]))
        s = t["rotor_coupling_2"]
        return np.array(
            [
                [i1 + i2 + 2.0 * h, 0.0, i2 + h, s],
                [0.0, t["motor_inertia_1"], 0.0, 0.0],
                [i2 + h, 0.0, i2, 0.0],
                [s, 0.0, 0.0, t["motor_inertia_2"]],
            ]
        )

    def forces(self, _: float, x: FloatArray) -> FloatArray:
        """Return the torque on each row without dry friction."""
        t, length, g = TRUTH, ARM.lengths[0], self.gravity
        q1, v1, m1, w1, q2, v2, m2, w2 = x
        along, across = t["link_moment_along_2"], t["link_moment_across_2"]
        slope = -length * (along * np.sin(q2) + across * np.cos(q2))
        coriolis = slope * np.array([2.0 * v1 * v2 + v2**2, -(v1**2)])
        weight_2 = g * (along * np.sin(q1 + q2) + across * np.cos(q1 + q2))
        weight_1 = weight_2 + g * (
            t["link_moment_along_1"] * np.sin(q1) + t["link_moment_across_1"] * np.cos(q1)
        )
        spring_1 = t["joint_stiffness_1"] * (m1 - q1) + t["joint_damping_1"] * (w1 - v1)
        spring_1 += t["cubic_joint_stiffness_1"] * (m1 - q1) ** 3
        fallen = self.stribeck * (1.0 - np.exp(-((w1 / ARM.stribeck[0][0]) ** 2)))
        spring_2 = t["joint_stiffness_2"] * (m2 - q2) + t["joint_damping_2"] * (w2 - v2)
        spring_2 += t["cubic_joint_stiffness_2"] * (m2 - q2) ** 3
        return np.array(
            [
                spring_1 - coriolis[0] - weight_1 - t["link_viscous_friction_1"] * v1,
                self.torque[0]
                - spring_1
                - t["motor_viscous_friction_1"] * w1
                + np.sign(w1) * fallen,
                spring_2 - coriolis[1] - weight_2 - t["link_viscous_friction_2"] * v2,
                self.torque[1] - spring_2 - t["motor_viscous_friction_2"] * w2,
            ]
        )


def accelerations(system: TwoLinks, time: float, x: FloatArray, modes: FloatArray) -> FloatArray:
    """Return accelerations; modes are signs of sliding, and rows of mode 0 stick."""
    moves = modes != 0.0
    up, down = system.limits.T
    force = system.forces(time, x) - np.where(modes > 0.0, up, -down)
    found = np.zeros(len(modes))
    found[moves] = np.linalg.solve(system.masses(x)[np.ix_(moves, moves)], force[moves])
    return found


def holding(system: TwoLinks, time: float, x: FloatArray, modes: FloatArray) -> FloatArray:
    """Return the friction torque that keeps each sticking row at rest."""
    return system.forces(time, x) - system.masses(x) @ accelerations(system, time, x, modes)


def first_modes(system: TwoLinks, time: float, x: FloatArray) -> FloatArray:
    """Return consistent modes: rows at rest stick or slide according to their forces."""
    free = [i for i, velocity in enumerate(x[1::2]) if abs(velocity) < 1e-10]
    modes = np.sign(x[1::2])
    up, down = (1.0 - 1e-9) * system.limits.T
    for trial in product((0.0, 1.0, -1.0), repeat=len(free)):
        modes[free] = trial
        pushed, held = accelerations(system, time, x, modes), holding(system, time, x, modes)
        stuck = modes == 0.0
        sticks = (held[stuck] <= up[stuck]) & (held[stuck] >= -down[stuck])
        if sticks.all() and all(modes[i] * pushed[i] >= -1e-9 for i in free if modes[i]):
            return modes
    raise AssertionError("no modes agree with the forces")


@dataclass
class Leaving:
    """Event function of a row's mode, which ends where the function falls through zero."""

    system: TwoLinks
    modes: FloatArray
    row: int
    terminal = True
    direction = -1.0

    def __call__(self, time: float, x: FloatArray) -> float:
        """Return the sliding velocity, or the margin of the friction that holds."""
        mode = self.modes[self.row]
        if mode != 0.0:
            return mode * x[2 * self.row + 1]
        held, (up, down) = holding(self.system, time, x, self.modes), self.system.limits[self.row]
        return min(up - held[self.row], held[self.row] + down)


def motion(system: TwoLinks, times: np.ndarray, start: FloatArray) -> tuple[FloatArray, int]:
    """Return the states at some times, and the number of changes of modes."""
    now, x, found, ended = times[0], start.copy(), [start], 0
    while now < times[-1]:
        modes = first_modes(system, now, x)

        def rates(time: float, y: FloatArray, modes: FloatArray = modes) -> FloatArray:
            velocities = np.where(modes == 0.0, 0.0, y[1::2])
            return np.column_stack((velocities, accelerations(system, time, y, modes))).ravel()

        exact: dict[str, Any] = {"method": "DOP853", "rtol": 1e-11, "atol": 1e-12}
        exact["events"] = [Leaving(system, modes, row) for row in range(len(modes))]
        run = solve_ivp(rates, (now, times[-1]), x, t_eval=times[times > now], **exact)
        found.extend(run.y.T if len(run.t) else ())
        if run.status == 0:
            break
        row = next(i for i, at in enumerate(run.t_events) if len(at))
        now, x, ended = float(run.t_events[row][0]), run.y_events[row][0].copy(), ended + 1
        if modes[row] != 0.0:
            x[2 * row + 1] = 0.0
    return np.array(found), ended
