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
    own, before = fitted.minimum, _innovations(fitted.problem, fitted.minimum.equations)
    steps, changes = [], []
    for rig in rigs:
        reduced = rig.solve(rig.equations(own.point))
        step = reduced.values_step - own.reduced.values_step
        states_step = reduced.states_step - own.reduced.states_step
        there = replace(
            own.point,
            values=own.point.values + step,
            initial_states=own.point.initial_states + states_step,
        )
        after = _innovations(rig, rig.equations(there, "nothing"))
        steps.append(step / SHARE)
        changes.append((after - before) / SHARE)
    steps, changes = np.array(steps), np.array(changes) / np.sqrt(max(fitted.excess, 1.0))
    before /= np.sqrt(max(fitted.excess, 1.0))
    covariance = np.linalg.inv(changes @ changes.T + np.eye(len(rigs)))
    told = -covariance @ (changes @ before)
    return steps.T @ np.column_stack((np.linalg.cholesky(covariance), told))


def _innovations(problem: SegmentedMotion, equations: Equations) -> FloatArray:
    """All innovations in standard deviations, flat."""
    assert problem.observer is not None
    parts = zip(problem.segments.of(equations.residuals), problem.observer.whitening, strict=False)
    return np.concatenate([(part @ white.T).ravel() for part, white in parts])
