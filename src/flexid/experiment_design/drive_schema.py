"""Keys and types of a drive file. Apart from `drive_file`, so that pydantic is loaded late."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

Number = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)


class Parameters(_Table):
    """Physical parameters in SI units; those left out are no part of the model."""

    link_inertia: Positive
    motor_inertia: Positive
    joint_stiffness: Positive
    gravity_torque: Number | None = None
    motor_viscous_friction: Positive | None = None
    link_viscous_friction: Positive | None = None
    joint_damping: Positive | None = None
    motor_coulomb_friction: Positive | None = None
    link_coulomb_friction: Positive | None = None
    cubic_joint_stiffness: Number | None = None
    link_offset_torque: Number | None = None
    motor_offset_torque: Number | None = None


class LimitsTable(_Table):
    """Largest magnitudes."""

    torque: Positive
    velocity: Positive
    position: Positive
    deflection: Positive


class Sensors(_Table):
    """Noise of both encoders: in rad, or as bits per turn of the joint."""

    position_noise: Positive | None = None
    encoder_bits: Annotated[int, Field(ge=6, le=32)] | None = None

    @model_validator(mode="after")
    def _one_of_two(self) -> "Sensors":
        if (self.position_noise is None) == (self.encoder_bits is None):
            raise ValueError("give position_noise or encoder_bits, and only one of them")
        return self


class Experiment(_Table):
    """What is to be designed."""

    duration: Annotated[float, Field(ge=1, le=600, allow_inf_nan=False)]
    sample_time: Annotated[float, Field(ge=1e-5, le=0.05, allow_inf_nan=False)]
    kind: Literal["multisine", "trajectory"] = "multisine"
    criterion: Literal["E", "D"] = "E"
    harmonics: Annotated[int, Field(ge=2, le=40)] = 8
    highest_frequency: Positive | None = None
    ramp: Positive | None = None
    bandwidth: Positive | None = None


class DriveContent(_Table):
    """The whole file."""

    known: list[str] = []
    parameters: Parameters
    limits: LimitsTable
    sensors: Sensors
    experiment: Experiment
