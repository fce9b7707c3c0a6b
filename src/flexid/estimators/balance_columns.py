"""Regressors of a torque balance along a motion."""

from typing import Any

import numpy as np

from flexid.arrays import FloatArray
from flexid.estimators.segmented_motion import motion_kernel
from flexid.models.torque_balance import TorqueBalance


def balance_columns(
    balance: TorqueBalance,
    signals: FloatArray,  # (n_samples, n_rows, 3)
    inputs: FloatArray,  # (n_samples, n_joints)
    modes: FloatArray | None = None,  # (n_samples, n_rows): of friction; by default sign(velocity)
) -> FloatArray:
    """Return the regressors of all parameters, shape (n_samples, n_rows, n_parameters)."""
    kernel: Any = motion_kernel(balance)
    constants = np.array(list(balance.constants.values()), dtype=np.float64)
    found = np.zeros((len(signals), len(balance.rows), len(balance.coefficients)))
    states = np.ascontiguousarray(signals[:, :, :2].reshape(len(signals), -1))
    modes = np.ascontiguousarray(np.sign(signals[:, :, 1]) if modes is None else modes)
    accelerations = np.ascontiguousarray(signals[:, :, 2])
    kernel.columns(states, np.ascontiguousarray(inputs), modes, constants, accelerations, found)
    return found
