"""Is the compliance visible in this log? The rigid joint as a rival."""

from dataclasses import replace

import numpy as np

from flexid.errors import ConvergenceError, SettingError
from flexid.estimators.channel_timing import Timing
from flexid.identification.full_model.fitting import fit_by_length, lengths
from flexid.identification.full_model.model import Structure, data_of
from flexid.identification.full_model.starting import starts
from flexid.identification.preparation.joint import rigid
from flexid.identification.preparation.recordings import SplitRecordings
from flexid.identification.structure.validation import validate
from flexid.identification.vocabulary.evidence import CoefficientEstimate, Compliance, Validation
from flexid.models.rigid_joint import rigid_terms
from flexid.recording.velocities import position_noise

WEAK_FIT = 50.0
"""Part of the deflection, in per cent, that the spring has to explain in a free run to be one."""

_DURATION = 2.0  # s, of the segments of the rival's fit: over 0.3 s it fits the noise of its speed
_ITERATIONS = 3  # of that fit: a model that is far off has no best fit to end at
_BEYOND_NOISE = 3.0  # times its noise that a deflection must have to be one


def compare_with_rigid(
    structure: Structure, recordings: SplitRecordings, flexible: Validation
) -> Compliance:
    """Hold the rigid joint against the same data as the flexible one."""
    return _compliance(recordings, flexible, _rigid_fits(structure, recordings))


def of_link_alone(
    recordings: SplitRecordings, driven: Validation, stiffness: CoefficientEstimate
) -> Compliance:
    """Whether the spring explains the deflection that the motor's motion causes.

    There is no rigid joint to compare with, where no input drives it.
    """
    found = _compliance(recordings, driven, {})
    if found.visible and stiffness.verdict == "undetermined":
        reason = (
            f"the deflection moves by {found.deflection:.2g} rad, which another stiffness would "
            f"explain as well"
        )
        return replace(found, visible=False, reason=reason)
    return found


def _compliance(
    recordings: SplitRecordings, found: Validation, rigid_fits: dict[str, float]
) -> Compliance:
    ends = [p.deflection[s:] for p, s in zip(recordings.recorded, recordings.starts, strict=True)]
    squares = sum(float(np.sum((end - end.mean()) ** 2)) for end in ends)
    moved = float(np.sqrt(squares / sum(map(len, ends))))
    noise = max(
        float(np.hypot(position_noise(p.needed_link_position), position_noise(p.motor_position)))
        for p in recordings.recorded
    )
    visible, reason = _judge(found.fit_percent["deflection"], moved, noise)
    return Compliance(visible, reason, rigid_fits, moved, noise)


def _rigid_fits(structure: Structure, recordings: SplitRecordings) -> dict[str, float]:
    """Free run of the rigid joint with the same terms; NaN where it cannot be fitted."""
    joint = rigid()
    terms = rigid_terms(structure.terms)
    absent = joint.optional - {c for term in terms for c in joint.terms[term]}
    timing = Timing(structure.timing.hold, dict(structure.timing.delays), ("input_delay",))
    training = data_of(joint, recordings.fitted, recordings.groups)
    rival = Structure(joint.scaled(training.samples), frozenset(absent), timing)
    whole = data_of(joint, recordings.whole, recordings.groups)
    try:
        divisions = lengths(training, _DURATION, _DURATION)
        start = starts(rival, training, divisions[0])[0]
        found = fit_by_length(
            rival, training, start, divisions, insist=False, iterations=_ITERATIONS
        )
    except (ConvergenceError, SettingError):
        return dict.fromkeys(joint.channels, np.nan)
    return dict(validate(found[-1], whole, recordings.starts, horizons=()).fit_percent)


def one_encoder() -> Compliance:
    """The answer for a log with one encoder."""
    reason = "the joint was taken as rigid, so there is no compliance to see"
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
