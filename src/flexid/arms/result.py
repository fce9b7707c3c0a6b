"""What was found of an arm."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from flexid.arrays import FloatArray
from flexid.identification.vocabulary.evidence import Verdict
from flexid.models.planar_arm import PlanarArm


@dataclass(frozen=True)
class ArmParameter:
    """One parameter."""

    name: str  # with the joint's number
    joint: int  # that number
    value: float  # in `unit`
    interval: tuple[float, float]  # that holds the true value with a probability of 95 %
    unit: str  # SI; where no torque is calibrated, relative to the inertia that was fixed at 1
    verdict: Verdict  # from the interval's width
    reason: str  # why it is not determined


@dataclass(frozen=True, eq=False)
class ArmIdentification:
    """The answer for an arm."""

    arm: PlanarArm  # what was known
    parameters: Mapping[str, ArmParameter]  # by name, joint by joint
    names: tuple[str, ...]  # what was fitted
    covariance: FloatArray  # (k, k): of these
    fixed: Mapping[str, float]  # what was not sought
    # share of each channel's motion, in per cent, that a free run over the last third explains with
    # parameters from the first two; ``motor_1``, ``link_1``, ``deflection_1``,
    free_run: Mapping[str, float]
    # share of each balance's acceleration that no term describes; None where the model explains all
    disturbances: Mapping[str, float] | None
    residual_excess: Mapping[str, float]  # of each channel, what is left over the encoder's noise
    hold: str  # how the inputs behave between samples
    input_delay: float  # in s
    segment_duration: float  # in s
    # of the normalised information: how alike the parameters look in this motion
    condition_number: float
    warnings: tuple[str, ...]  # in the order in which to act on them
    provenance: Mapping[str, Any]  # file, digest and columns

    def of_joint(self, joint: int) -> list[ArmParameter]:
        """The parameters in the table of one joint."""
        return [p for p in self.parameters.values() if p.joint == joint]

    def supports(self, *, strict: bool) -> bool:
        """Whether all parameters are determined, be it weakly unless strict."""
        wanted = ("determined",) if strict else ("determined", "weak")
        return all(p.verdict in wanted for p in self.parameters.values())
