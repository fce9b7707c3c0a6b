"""A model linearised about a state, by central differences of its compiled equations."""

from types import ModuleType

import numpy as np

from flexid.arrays import FloatArray

_NUDGE = 1e-6  # rad or rad/s


def jacobian(
    kernel: ModuleType, x: FloatArray, u: FloatArray, p: FloatArray, c: FloatArray
) -> FloatArray:
    """Derivative of x' with respect to x.

    Parameters
    ----------
    kernel : module
        With the model's ``right_hand_side``.
    x, u, p, c : ndarray
        State, input, coefficients and constants.

    Returns
    -------
    (n_states, n_states) ndarray
        Row i belongs to the rate of state i. Not finite where the model has no linearisation.
    """
    rates = np.empty((2, len(x), len(x)))
    for side, nudge in enumerate((_NUDGE, -_NUDGE)):
        for place in range(len(x)):
            nudged = x.copy()
            nudged[place] += nudge
            kernel.right_hand_side(nudged, u, p, c, rates[side, place])
    return (rates[0] - rates[1]).T / (2.0 * _NUDGE)
