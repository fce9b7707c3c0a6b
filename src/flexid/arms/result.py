"""What was found of an arm."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from flexid.identification.vocabulary.evidence import Estimate, Validation, ValueEstimate
from flexid.models.planar_arm import PlanarArm
from flexid.recording.recording import Hold


@dataclass(frozen=True, eq=False)
class ArmIdentification:
    """The answer for an arm, which is stored as it is."""

    model: Literal["arm"]
    arm: PlanarArm  # what was known
    parameters: Mapping[str, ValueEstimate]  # by name with the joint's number, joint by joint
    fit: Estimate  # names, values, covariance and degrees of freedom of what was estimated
    fixed: Mapping[str, float]  # what was not sought
    input_units: tuple[str, ...]  # of each joint
    # share of each balance's acceleration that no term describes; None where the model explains all
    disturbances: Mapping[str, float] | None
    disturbed_because: str  # why fits without disturbances were left out; empty where they were not
    residual_excess: Mapping[str, float]  # of each channel, what is left over the encoder's noise
    hold: Hold  # how the inputs behave between samples
    input_delay: float  # in s
    segment_duration: float  # in s
    # of the normalised information: how alike the parameters look in this motion
    condition_number: float
    warnings: tuple[str, ...]  # in the order in which to act on them
    provenance: Mapping[str, Any]  # file, digest and columns
    # in s, by joint such as ``link_1``: by how much a link's encoder is later than the motor's
    encoder_delays: Mapping[str, float] = field(default_factory=dict)
    log_lag: float = 0.0  # in s, of a filter of the inputs on their way into the log
    # predictions of the last third with parameters from the first two, by channel such as
    # ``motor_position_1`` and ``deflection_1``; empty where there are none
    validation: Validation = field(default_factory=lambda: Validation({}))

    def of_joint(self, joint: int) -> dict[str, ValueEstimate]:
        """The parameters in the table of one joint."""
        return {n: p for n, p in self.parameters.items() if joint_of_name(n) == joint}

    def supports(self, *, strict: bool) -> bool:
        """Whether all parameters are determined, be it weakly unless strict."""
        wanted = ("determined",) if strict else ("determined", "weak")
        return all(p.verdict in wanted for p in self.parameters.values())


def joint_of_name(name: str) -> int:
    """The joint whose number a parameter's name ends with."""
    return int(name.rpartition("_")[2])
