"""A two-link arm by the textbook."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

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
    """States are link 1, motor 1, link 2, motor 2, each with its velocity; see `stick_slip`."""

    torque: FloatArray
    gravity: float = 9.81
    limits = np.array(
        [[TRUTH[f"{side}_coulomb_friction_{i}"]] * 2 for i in (1, 2) for side in ("link", "motor")]
    )

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

    def forces(self, _: float, x: FloatArray) -> FloatArray:
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
