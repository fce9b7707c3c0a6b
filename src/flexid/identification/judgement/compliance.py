"""Whether a log shows that its joint is compliant."""

from dataclasses import replace

import numpy as np

from flexid.identification.preparation.recordings import SplitRecordings
from flexid.identification.vocabulary.evidence import CoefficientEstimate, Compliance, Validation
from flexid.models.motion import unit_of
from flexid.recording.velocities import position_noise

WEAK_FIT = 50.0
"""Part of the deflection, in per cent, that the spring has to explain in a free run to be one."""

_BEYOND_NOISE = 3.0  # times its noise that a deflection must have to be one


def of_joint(recordings: SplitRecordings, found: Validation) -> Compliance:
    """Whether the spring explains the deflection that is held out."""
    ends = [p.deflection[s:] for p, s in zip(recordings.recorded, recordings.starts, strict=True)]
    squares = sum(float(np.sum((end - end.mean()) ** 2)) for end in ends)
    moved = float(np.sqrt(squares / sum(map(len, ends))))
    noise = max(
        float(np.hypot(position_noise(p.needed_link_position), position_noise(p.motor_position)))
        for p in recordings.recorded
    )
    unit = unit_of("rad", recordings.recorded[0].joint)
    visible, reason = _judge(found.fit_percent["deflection"], moved, noise, unit)
    return Compliance(visible, reason, moved, noise)


def of_link_alone(
    recordings: SplitRecordings, driven: Validation, stiffness: CoefficientEstimate
) -> Compliance:
    """Whether the spring explains the deflection that the motor's motion causes."""
    found = of_joint(recordings, driven)
    if found.visible and stiffness.verdict == "undetermined":
        unit = unit_of("rad", recordings.recorded[0].joint)
        reason = (
            f"the deflection moves by {found.deflection:.2g} {unit}, which another stiffness would "
            f"explain as well"
        )
        return replace(found, visible=False, reason=reason)
    return found


def one_encoder() -> Compliance:
    """The answer for a log with one encoder."""
    reason = "the joint was taken as rigid, so there is no compliance to see"
    return Compliance(False, reason, np.nan, np.nan)


def _judge(fit: float, deflection: float, noise: float, unit: str) -> tuple[bool, str]:
    size = f"the deflection moves by {deflection:.2g} {unit}"
    # A sparsely sampled motion passes for noise; but no spring explains noise in a free run.
    explained = fit >= 100 * (1 - 1 / _BEYOND_NOISE)
    if deflection < _BEYOND_NOISE * noise and not explained:
        return False, f"{size}, hardly more than its noise of {noise:.2g} {unit}"
    if np.isnan(fit):
        return False, f"{size} where it is held out, too little to be tested"
    if fit < WEAK_FIT:
        return False, f"{size}, but the spring explains only {max(fit, 0.0):.0f} % of it"
    return True, f"{size}, of which the spring explains {fit:.0f} % in a free run"
