"""Small campaigns: Table I's joint under PD control, sampled, for a tenth of a second."""

from pathlib import Path

import numpy as np
import polars as pl

EXPERIMENT = """
[plant]
gravity_torque = 5.0
link_inertia = 1.0
joint_stiffness = 100.0
motor_inertia = 0.3
motor_viscous_friction = 0.1

[controller]
law = "pd-gravity"
proportional = 50.0
derivative = 10.0

[controller.nominal]
gravity_torque = 4.5
joint_stiffness = 75.0

[reference]
kind = "sine"
amplitude = 1.0
angular_frequency = 5.0

[observer]
link = 2.0
motor = 2.0

[initial_estimates]
theta1 = 2.5
theta2 = 50.0
alpha1 = 167.0

[run]
duration = 0.1

[sampling]
sample_time = 1e-3
velocity_noise = 1e-3
"""

CAMPAIGN = """
[campaign]
kind = "sobol"
runs = 12
seed = 3
runs_per_part = 3

[campaign.vary]
controller.proportional = { uniform = [10.0, 50.0] }
sampling.position_noise = { log_uniform = [1e-6, 1e-4] }
"""


def write_experiment(path: Path, campaign: str = CAMPAIGN, experiment: str = EXPERIMENT) -> Path:
    """Write an experiment file."""
    path.write_text(experiment + campaign)
    return path


def rows_of(directory: Path) -> pl.DataFrame:
    """Return all rows of a finished campaign."""
    return pl.concat(pl.read_parquet(path) for path in sorted(directory.glob("runs/*.parquet")))


def same_bits(one: pl.DataFrame, other: pl.DataFrame) -> bool:
    """Whether two tables agree to the last bit, NaN included."""
    return one.schema == other.schema and all(
        np.array_equal(_bits(one[name]), _bits(other[name])) for name in one.columns
    )


def _bits(column: pl.Series) -> np.ndarray:
    values = column.to_numpy()
    return values.view(np.int64) if values.dtype == np.float64 else values
