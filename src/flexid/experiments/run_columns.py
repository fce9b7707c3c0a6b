"""A run as columns of a table: what a drive would log, and everything."""

import numpy as np
from numpy.typing import NDArray

from flexid.models.flexible_joint import COEFFICIENT_UNITS
from flexid.simulation.run import Run

Columns = dict[str, NDArray[np.float64]]

_CHANNELS = {"time": "s", "position": "rad", "velocity": "rad/s", "torque": "N m"}


def log_columns(run: Run) -> Columns:
    """What a drive would have logged, under the names that ``flexid identify`` reads."""
    joint = is_joint(run)
    return {
        f"{name} [{_CHANNELS[name.rpartition('_')[2]]}]" if joint else name: values
        for name, values in run.log().items()
    }


def run_columns(run: Run) -> Columns:
    """Everything of a run: the log, the true states where sensors err, reference, estimates."""
    columns = log_columns(run)
    if run.measured is not None:
        names = list(columns)[1 : 1 + run.states.shape[1]]
        columns |= {f"true_{name}": run.states[:, place] for place, name in enumerate(names)}
    angle = " [rad]" if is_joint(run) else ""
    columns[f"reference{angle}"] = run.reference[:, 0]
    columns[f"tracking_error{angle}"] = run.tracking_error
    for place, name in enumerate(run.loop.system.coefficients):
        unit = f" [{coefficient_unit(run, name)}]" if is_joint(run) else ""
        columns[f"{name}_estimate{unit}"] = run.estimates[:, place]
        columns[f"{name}_error{unit}"] = run.parameter_errors[:, place]
    return {name: np.ascontiguousarray(values) for name, values in columns.items()}


def is_joint(run: Run) -> bool:
    """Whether the model is the flexible joint, whose units are known."""
    system = run.loop.system
    rows = tuple(row.name for row in system.rows)
    own = rows == ("link", "motor") and len(system.inputs) == 1
    return own and set(system.coefficients) <= set(COEFFICIENT_UNITS)


def coefficient_unit(run: Run, name: str) -> str:
    """SI unit of a coefficient; nothing where the model is the user's own."""
    return COEFFICIENT_UNITS[name].format(input="(N m)") if is_joint(run) else ""
