"""The Cramér-Rao bound of segmented fits, by finite differences of free runs."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from noisy_joint import POSITION_NOISE, SAMPLE_TIME, VALUES, clean_motion, torque

from flexid.models.flexible_joint import flexible_joint
from flexid.simulation.free_run import free_run


def run(values: Sequence[float], state: np.ndarray, part: slice) -> np.ndarray:
    """Return positions of link and motor along a segment, one after the other."""
    time, _ = clean_motion()
    joint = flexible_joint()
    coefficients = dict(zip(joint.coefficients, values, strict=True))
    x = free_run(joint, coefficients, state, torque(time[part]), SAMPLE_TIME)
    return x[:, [0, 2]].T.ravel()


def segment_derivatives(part: slice) -> np.ndarray:
    """Return derivatives of `run` at the truth by the initial state, then by the coefficients."""
    _, states = clean_motion()
    unknowns = np.concatenate((states[part.start], VALUES))
    columns = []
    for place, size in enumerate(np.concatenate((np.ones(4), VALUES))):
        step = np.zeros(9)
        step[place] = 1e-4 * size
        high, low = unknowns + step, unknowns - step
        difference = run(high[4:].tolist(), high[:4], part) - run(low[4:].tolist(), low[:4], part)
        columns.append(difference / (2e-4 * size))
    return np.column_stack(columns)


def cramer_rao_bound(n_segments: int) -> np.ndarray:
    """Return the least standard error of each coefficient for white noise, shape (5,).

    The initial state of every segment is unknown too. Each column of the coefficients counts only
    with its part orthogonal to the columns of the initial state.
    """
    time, _ = clean_motion()
    edges = np.linspace(0, len(time), n_segments + 1).round().astype(int)
    information = np.zeros((5, 5))
    for first, stop in pairwise(edges):
        columns = segment_derivatives(slice(first, stop))
        basis, _ = np.linalg.qr(columns[:, :4])
        own = columns[:, 4:] - basis @ (basis.T @ columns[:, 4:])
        information += own.T @ own
    scale = np.outer(VALUES, VALUES)
    inverse = np.linalg.inv(information * scale) * scale
    return POSITION_NOISE * np.sqrt(np.diag(inverse))
