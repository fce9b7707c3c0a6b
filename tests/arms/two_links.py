"""A two-link arm by the textbook, and its motion with dry friction by SciPy's integrator."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.integrate import solve_ivp

from flexid.arrays import FloatArray
from flexid.models.planar_arm import PlanarArm, planar_arm

ARM = PlanarArm((0.4, 0.3), (9.81, 0.0))
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


def truth_values() -> FloatArray:
    """The parameters in the model's order."""
    return np.array([TRUTH.get(name, 0.0) for name in planar_arm(ARM).coefficients])


@dataclass
class TwoLinks:
    """States are link 1, motor 1, link 2, motor 2, each with its velocity; modes by row."""

    torque: FloatArray
    gravity: float = 9.81

    def masses(self, x: FloatArray) -> FloatArray:
        """Mass matrix by row."""
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

    def forces(self, x: FloatArray) -> FloatArray:
        """Torques on each row but for dry friction."""
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
        spring_2 = t["joint_stiffness_2"] * (m2 - q2) + t["joint_damping_2"] * (w2 - v2)
        spring_2 += t["cubic_joint_stiffness_2"] * (m2 - q2) ** 3
        return np.array(
            [
                spring_1 - coriolis[0] - weight_1 - t["link_viscous_friction_1"] * v1,
                self.torque[0] - spring_1 - t["motor_viscous_friction_1"] * w1,
                spring_2 - coriolis[1] - weight_2 - t["link_viscous_friction_2"] * v2,
                self.torque[1] - spring_2 - t["motor_viscous_friction_2"] * w2,
            ]
        )

    def accelerations(self, x: FloatArray, modes: FloatArray) -> FloatArray:
        """Of each row; what sticks has none."""
        moves = modes != 0.0
        found = np.zeros(4)
        force = self.forces(x) - modes * LIMITS
        found[moves] = np.linalg.solve(self.masses(x)[np.ix_(moves, moves)], force[moves])
        return found

    def holding(self, x: FloatArray, modes: FloatArray) -> FloatArray:
        """What friction has to hold in each row that sticks."""
        return self.forces(x) - self.masses(x) @ self.accelerations(x, modes)


LIMITS = np.array(
    [TRUTH[f"{side}_coulomb_friction_{i}"] for i in (1, 2) for side in ("link", "motor")]
)


def first_modes(arm: TwoLinks, x: FloatArray) -> FloatArray:
    """Modes that contradict nothing: rows at rest stick or slide as their forces say."""
    free = [i for i in range(4) if abs(x[2 * i + 1]) < 1e-12]
    modes = np.sign(x[1::2])
    for trial in product((0.0, 1.0, -1.0), repeat=len(free)):
        modes[free] = trial
        pushed, held = arm.accelerations(x, modes), arm.holding(x, modes)
        stuck = modes == 0.0
        if (np.abs(held[stuck]) <= (1.0 - 1e-9) * LIMITS[stuck]).all() and all(
            modes[i] * pushed[i] >= -1e-9 for i in free if modes[i] != 0.0
        ):
            return modes
    raise AssertionError("no modes agree with the forces")


def motion(start: FloatArray, torques: FloatArray, h: float) -> tuple[FloatArray, int]:
    """States at the start of every interval of held torques, and the number of changes of mode."""
    x, found, changes = start.copy(), [start.copy()], 0
    modes = first_modes(TwoLinks(torques[0]), x)
    for torque in torques[:-1]:
        arm, t = TwoLinks(torque), 0.0
        while t < h:
            x[1::2][np.abs(x[1::2]) < 1e-10] = 0.0
            before, modes = modes, first_modes(arm, x)
            changes += int(np.any(before != modes))

            def turns(_t: float, y: FloatArray, i: int, m: FloatArray) -> float:
                if m[i] == 0.0:
                    return LIMITS[i] - abs(arm.holding(y, m)[i])  # noqa: B023 - used at once
                return m[i] * y[2 * i + 1]

            def rates(_t: float, y: FloatArray, m: FloatArray = modes) -> FloatArray:
                found = np.empty(8)
                found[::2] = np.where(m == 0.0, 0.0, y[1::2])
                found[1::2] = arm.accelerations(y, m)  # noqa: B023 - used at once
                return found

            events = []
            for i in range(4):

                def event(_t: float, y: FloatArray, i: int = i, m: FloatArray = modes) -> float:
                    return turns(_t, y, i, m)

                event.terminal = True  # type: ignore[attr-defined] - SciPy's way
                event.direction = -1.0  # type: ignore[attr-defined]
                events.append(event)
            step = solve_ivp(rates, (t, h), x, "DOP853", rtol=1e-10, atol=1e-12, events=events)
            t, x = float(step.t[-1]), step.y[:, -1].copy()
            for i, times in enumerate(step.t_events):
                if len(times) and modes[i] != 0.0:
                    x[2 * i + 1] = 0.0
        found.append(x.copy())
    return np.array(found), changes
