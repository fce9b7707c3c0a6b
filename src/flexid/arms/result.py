"""What was found of an arm."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from flexid.arrays import FloatArray
from flexid.identification.vocabulary.evidence import Verdict
from flexid.models.planar_arm import PlanarArm


@dataclass(frozen=True)
class ArmParameter:
    """One parameter.

    Parameters
    ----------
    name : str
        With the joint's number.
    joint : int
        That number.
    value : float
        In `unit`.
    interval : tuple of float
        That holds the true value with a probability of 95 %.
    unit : str
        SI; where no torque is calibrated, relative to the inertia that was fixed at 1.
    verdict : {"determined", "weak", "undetermined"}
        From the interval's width.
    reason : str
        Why it is not determined.
    """

    name: str
    joint: int
    value: float
    interval: tuple[float, float]
    unit: str
    verdict: Verdict
    reason: str


@dataclass(frozen=True, eq=False)
class ArmIdentification:
    """The answer for an arm.

    Parameters
    ----------
    arm : PlanarArm
        What was known.
    parameters : mapping of str to ArmParameter
        By name, joint by joint.
    names : tuple of str
        What was fitted.
    covariance : array, shape (k, k)
        Of these.
    fixed : mapping of str to float
        What was not sought.
    free_run : mapping of str to float
        Share of each channel's motion, in per cent, that a free run over the last third explains
        with parameters from the first two; ``motor_1``, ``link_1``, ``deflection_1``, ...
    residual_excess : mapping of str to float
        Of each channel, what is left over the encoder's noise.
    hold : str
        How the inputs behave between samples.
    input_delay : float
        In s.
    segment_duration : float
        In s.
    condition_number : float
        Of the normalised information: how alike the parameters look in this motion.
    warnings : tuple of str
        In the order in which to act on them.
    provenance : mapping of str to object
        File, digest and columns.
    """

    arm: PlanarArm
    parameters: Mapping[str, ArmParameter]
    names: tuple[str, ...]
    covariance: FloatArray
    fixed: Mapping[str, float]
    free_run: Mapping[str, float]
    residual_excess: Mapping[str, float]
    hold: str
    input_delay: float
    segment_duration: float
    condition_number: float
    warnings: tuple[str, ...]
    provenance: Mapping[str, Any]

    def of_joint(self, joint: int) -> list[ArmParameter]:
        """The parameters in the table of one joint."""
        return [p for p in self.parameters.values() if p.joint == joint]

    def supports(self, *, strict: bool) -> bool:
        """Whether all parameters are determined, be it weakly unless strict."""
        wanted = ("determined",) if strict else ("determined", "weak")
        return all(p.verdict in wanted for p in self.parameters.values())
