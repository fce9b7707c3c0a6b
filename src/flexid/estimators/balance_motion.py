"""The motion of a torque balance over segments, as `segmented_motion` has that of explicit rows."""

from types import ModuleType
from typing import Any, cast

import numpy as np

from flexid.arrays import FloatArray
from flexid.estimators.channel_timing import Timing
from flexid.estimators.segmented_motion import MOTION, SegmentedMotion
from flexid.estimators.segments import Segments
from flexid.estimators.unknowns import Unknowns
from flexid.kernels.store import load_kernel
from flexid.models.parametric_system import ParametricSystem
from flexid.models.torque_balance import TorqueBalance


def balance_kernel(balance: TorqueBalance) -> ModuleType:
    """The compiled module of a balance: one for all arms of as many joints."""

    def build() -> str:
        from flexid.derivation.torque_balance import balance_functions

        return balance_functions(balance)

    return load_kernel("torque_balance", [balance.digest], build, MOTION)


def balance_unknowns(balance: TorqueBalance, fixed: dict[str, float]) -> Unknowns:
    """Parameters that are sought, but for those that keep a value."""
    # Of a system, `Unknowns` takes the names alone.
    return Unknowns(cast(ParametricSystem, balance), fixed=fixed)


def balance_motion(
    balance: TorqueBalance, segments: Segments, timing: Timing, unknowns: Unknowns
) -> SegmentedMotion:
    """The motion of a torque balance over segments, all outputs of the same weight."""
    constants = np.array(list(balance.constants.values()), dtype=np.float64)
    weights = np.ones(segments.outputs.shape[1])
    kernel = balance_kernel(balance)
    return SegmentedMotion(segments, unknowns, timing, constants, 1, weights, kernel)


def balance_columns(
    balance: TorqueBalance,
    signals: FloatArray,  # (n_samples, n_rows, 3)
    inputs: FloatArray,  # (n_samples, n_joints)
    modes: FloatArray | None = None,  # (n_samples, n_rows): of friction, if not the motion's
) -> FloatArray:
    """φ of every parameter along a motion, shape (n_samples, n_rows, n_parameters)."""
    kernel: Any = balance_kernel(balance)
    constants = np.array(list(balance.constants.values()), dtype=np.float64)
    found = np.zeros((len(signals), len(balance.rows), len(balance.coefficients)))
    states = np.ascontiguousarray(signals[:, :, :2].reshape(len(signals), -1))
    modes = np.ascontiguousarray(np.sign(signals[:, :, 1]) if modes is None else modes)
    accelerations = np.ascontiguousarray(signals[:, :, 2])
    kernel.columns(states, np.ascontiguousarray(inputs), modes, constants, accelerations, found)
    return found
