"""Result of the identification of an arm."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from flexid.identification.vocabulary.evidence import Estimate, Validation, ValueEstimate
from flexid.models.planar_arm import PlanarArm
from flexid.recording.recording import Hold


@dataclass(frozen=True, eq=False)
class ArmIdentification:
    """Result for an arm, as stored in ``estimate.json``."""

    model: Literal["arm"]
    arm: PlanarArm  # given lengths, gravity and directions of slides
    parameters: Mapping[str, ValueEstimate]  # by name with the joint's number, joint by joint
    fit: Estimate  # estimated parameters with covariance and degrees of freedom
    fixed: Mapping[str, float]  # parameters that were not estimated
    input_units: tuple[str, ...]  # of each joint
    # RMS disturbance over RMS acceleration of each balance; None if no disturbances were fitted
    disturbances: Mapping[str, float] | None
    disturbed_because: str  # why disturbances were needed, or empty
    residual_excess: Mapping[str, float]  # of each channel: RMS residual over noise
    hold: Hold  # how the inputs behave between samples
    input_delay: float  # in s
    segment_duration: float  # in s
    # of the normalised information: large if the motion does not separate the parameters
    condition_number: float
    warnings: tuple[str, ...]  # most important first
    provenance: Mapping[str, Any]  # file, digest and columns
    # in s, by row such as ``link_1``: delay of an encoder after the others
    encoder_delays: Mapping[str, float] = field(default_factory=dict)
    log_lag: float = 0.0  # in s, of a filter through which the inputs were logged
    # predictions of the last third with parameters from the first two, by channel such as
    # ``motor_position_1`` and ``deflection_1``; empty if the fit failed
    validation: Validation = field(default_factory=lambda: Validation({}))

    def of_joint(self, joint: int) -> dict[str, ValueEstimate]:
        """Return the parameters of one joint by name."""
        return {n: p for n, p in self.parameters.items() if joint_of_name(n) == joint}

    def supports(self, *, strict: bool) -> bool:
        """Whether all parameters are determined; ``weak`` counts too unless `strict`."""
        wanted = ("determined",) if strict else ("determined", "weak")
        return all(p.verdict in wanted for p in self.parameters.values())


def joint_of_name(name: str) -> int:
    """Return the joint number at the end of a parameter's name."""
    return int(name.rpartition("_")[2])
