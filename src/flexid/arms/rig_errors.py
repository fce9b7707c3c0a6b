"""Errors of a rig that its log may show: of encoders, scales and lengths.

Each has a size that good rigs keep to, its standard deviation before the log has its say. About a
fit residuals are linear in all errors, as values and initial states follow them. So the log tells
which errors are there, and which are smaller than they might be.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from flexid.arms.unusual import FittedArm
from flexid.arrays import FloatArray
from flexid.errors import ConvergenceError
from flexid.estimators.segmented_motion import Equations, SegmentedMotion
from flexid.identification.estimation.doubts import CALIBRATION, ECCENTRICITY, GAUGE

LENGTH = 0.005  # of a length, standard deviation: a rule misses joints by 1 or 2 mm
SHARE = 0.3  # of an error's size, at which it is tried: a larger one bends the motion elsewhere


def rig_errors(fitted: FittedArm, deflections: Sequence[int]) -> Iterator[SegmentedMotion]:
    """The motion of a fit on rigs that err otherwise by `SHARE` of a standard deviation.

    `deflections` are the places of links whose position is from a deflection.
    """
    outputs = fitted.problem.segments.outputs
    for motor in range(1, outputs.shape[1], 2):
        yield _otherwise_shown(fitted, motor, CALIBRATION * outputs[:, motor])
        link = motor - 1
        if link in deflections:
            bent = outputs[:, link] - outputs[:, motor]
            yield _otherwise_shown(fitted, link, GAUGE * bent)
        else:  # once per turn, at any angle
            for wave in (np.sin, np.cos):
                error = ECCENTRICITY / np.sqrt(2.0) * wave(outputs[:, link])
                yield _otherwise_shown(fitted, link, error)
    names = [*fitted.structure.joint.balance.constants]
    for joint in range(1, fitted.structure.joint.balance.joints):  # the last length has no effect
        constants = fitted.problem.constants.copy()
        constants[names.index(f"l{joint}")] *= 1.0 + SHARE * LENGTH
        yield replace(fitted.problem, constants=constants)


def _otherwise_shown(fitted: FittedArm, row: int, error: FloatArray) -> SegmentedMotion:
    segments = fitted.problem.segments
    outputs = segments.outputs.copy()
    outputs[:, row] += SHARE * error
    return replace(fitted.problem, segments=replace(segments, outputs=outputs))


def likely_changes(fitted: FittedArm, rigs: Sequence[SegmentedMotion]) -> FloatArray:
    """Changes of the values by errors that are as likely as the log lets them be.

    Returns directions, shape (k, n_rigs + 1): of what the log leaves open, and what it tells.
    """
    size = np.sqrt(max(fitted.excess, 1.0))
    before = _innovations(fitted.problem, fitted.minimum.equations) / size
    followed = [_followed(fitted, rig) for rig in rigs]
    steps = np.array([step for step, _ in followed]) / SHARE
    changes = np.array([after / size - before for _, after in followed]) / SHARE
    covariance = np.linalg.inv(changes @ changes.T + np.eye(len(rigs)))
    told = -covariance @ (changes @ before)
    return steps.T @ np.column_stack((np.linalg.cholesky(covariance), told))


def _followed(fitted: FittedArm, rig: SegmentedMotion) -> tuple[FloatArray, FloatArray]:
    """The step of the values, shape (k,), that suits another rig, and its innovations, flat."""
    point, before = fitted.minimum.point, fitted.minimum.reduced
    reduced = rig.solve(rig.equations(point))
    step = reduced.values_step - before.values_step
    states = point.initial_states + reduced.states_step - before.states_step
    there = replace(point, values=point.values + step, initial_states=states)
    equations = rig.equations(there, "nothing")
    if not np.isfinite(equations.cost):
        raise ConvergenceError("arm", "the motion of a rig with small errors diverges")
    return step, _innovations(rig, equations)


def _innovations(problem: SegmentedMotion, equations: Equations) -> FloatArray:
    """All innovations in standard deviations, flat."""
    assert problem.observer is not None
    # The observer of a longer log has more segments, all alike.
    parts = zip(problem.segments.of(equations.residuals), problem.observer.whitening, strict=False)
    return np.concatenate([(part @ white.T).ravel() for part, white in parts])
