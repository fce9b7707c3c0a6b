"""Is the compliance visible in this log? The rigid joint as a rival."""

from contextlib import suppress
from dataclasses import replace

import numpy as np

from flexid.errors import ConvergenceError
from flexid.estimators.prediction_error import PredictionErrorFit
from flexid.estimators.state_variable_filter import LeastSquaresFit
from flexid.identification.candidate import Candidate, Fitted
from flexid.identification.joint import rigid
from flexid.identification.preparation import Pieces
from flexid.identification.result import Compliance, Validation
from flexid.identification.validation import validate
from flexid.identification.verdict import WEAK_FIT
from flexid.models.rigid_joint import rigid_terms
from flexid.recording.velocities import position_noise

_MANY_SAMPLES = 100_000  # from which on the rival is fitted by least squares alone
_BEYOND_NOISE = 3.0  # times its noise that a deflection must have to be one


def compare_with_rigid(candidate: Candidate, pieces: Pieces, flexible: Validation) -> Compliance:
    """Hold the rigid joint against the same data as the flexible one.

    Parameters
    ----------
    candidate : Candidate
        The flexible joint with what was chosen about it.
    pieces : Pieces
        With two encoders.
    flexible : Validation
        Of the flexible joint over the held-out ends.
    """
    rival = replace(
        candidate, joint=rigid(), terms=rigid_terms(candidate.terms), fixed={}, bounds={}
    ).with_own_filter_rate(pieces)
    if sum(pieces.starts) > _MANY_SAMPLES:  # a wrong model's prediction error takes long
        rival = replace(rival, segment_duration=0.0)
    coefficients = _fitted(rival, pieces).coefficients(len(pieces.recorded))
    fits = validate(rival.joint, pieces, coefficients, rival.hold).fit_percent
    ends = [p.deflection[s:] for p, s in zip(pieces.recorded, pieces.starts, strict=True)]
    squares = sum(float(np.sum((end - end.mean()) ** 2)) for end in ends)
    moved = float(np.sqrt(squares / sum(map(len, ends))))
    noise = max(
        float(np.hypot(position_noise(p.needed_link_position), position_noise(p.motor_position)))
        for p in pieces.recorded
    )
    visible, reason = _judge(flexible.fit_percent["deflection"], moved, noise)
    return Compliance(visible, reason, fits, moved, noise)


def _fitted(
    rival: Candidate, pieces: Pieces
) -> Fitted[LeastSquaresFit] | Fitted[PredictionErrorFit]:
    """Prediction error where it is wanted and converges, else least squares."""
    if rival.segment_duration > 0:
        with suppress(ConvergenceError):
            return rival.prediction_error(pieces.fitted, pieces.groups)
    return rival.least_squares(pieces.fitted, pieces.groups)


def one_encoder() -> Compliance:
    """The answer for a log with one encoder."""
    reason = "the log has one encoder, so there is no compliance to see"
    return Compliance(False, reason, {}, np.nan, np.nan)


def _judge(fit: float, deflection: float, noise: float) -> tuple[bool, str]:
    size = f"the deflection moves by {deflection:.2g} rad"
    # A sparsely sampled motion passes for noise; but no spring explains noise in a free run.
    explained = fit >= 100 * (1 - 1 / _BEYOND_NOISE)
    if deflection < _BEYOND_NOISE * noise and not explained:
        return False, f"{size}, hardly more than its noise of {noise:.2g} rad"
    if np.isnan(fit):
        return False, f"{size} where it is held out, too little to be tested"
    if fit < WEAK_FIT:
        return False, f"{size}, but the spring explains only {max(fit, 0.0):.0f} % of it"
    return True, f"{size}, of which the spring explains {fit:.0f} % in a free run"
