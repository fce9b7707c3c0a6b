"""Measures of a simulated run, and its columns for files."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexid.estimators.excitation import Excitation
from flexid.models.flexible_joint import COEFFICIENT_UNITS
from flexid.simulation.closed_loop import Run
from flexid.simulation.lyapunov import row_excitation

SETTLED = 0.05  # largest relative error of a settled estimate


@dataclass(frozen=True, eq=False)
class Measures:
    """Measures of a simulated run, in SI units."""

    final_states: Mapping[str, float]  # x at the end
    final_errors: Mapping[str, float]  # p̂ - p at the end, by coefficient
    # last time in s at which |p̂ - p| exceeded 5 % of |p|; 0 if it never did, NaN if it still does
    # at the end
    settling_times: Mapping[str, float]
    tracking_rms: float  # root mean square of the tracking error
    tracking_peak: float  # its largest magnitude
    peak_inputs: Mapping[str, float]  # largest magnitude of each input
    excitation: Mapping[str, Excitation]  # of each row, from the mean of r rᵀ over the run


def measure(run: Run) -> Measures:
    """Return the measures of a run, from its samples only."""
    system = run.loop.system
    settled = settling_times(run.time, run.parameter_errors, run.loop.true_coefficients)
    return Measures(
        dict(zip(system.states, run.states[-1].tolist(), strict=True)),
        run.final_errors(),
        dict(zip(system.coefficients, settled.tolist(), strict=True)),
        float(np.sqrt(np.mean(run.tracking_error**2))),
        float(np.max(np.abs(run.tracking_error))),
        dict(zip(system.inputs, np.abs(run.inputs).max(axis=0).tolist(), strict=True)),
        row_excitation(run),
    )


def settling_times(
    time: NDArray[np.float64], errors: NDArray[np.float64], true: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the last time of each error, (n, m), beyond `SETTLED`: 0 if never, NaN at the end."""
    beyond = np.abs(errors) > SETTLED * np.abs(true)
    last = len(time) - 1 - np.argmax(beyond[::-1], axis=0)
    settled = np.where(beyond.any(axis=0), time[last], 0.0)
    return np.where(beyond[-1], np.nan, settled)


Columns = dict[str, NDArray[np.float64]]

_CHANNELS = {"time": "s", "position": "rad", "velocity": "rad/s", "torque": "N m"}


def log_columns(run: Run) -> Columns:
    """Return the columns that a drive would have logged, as ``flexid identify`` reads them."""
    joint = is_joint(run)
    return {
        f"{name} [{_CHANNELS[name.rpartition('_')[2]]}]" if joint else name: values
        for name, values in run.log().items()
    }


def run_columns(run: Run) -> Columns:
    """Return all columns of a run: log, true states if measured, reference and estimates."""
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
    """Whether the model is a flexible joint, so that units are known."""
    system = run.loop.system
    rows = tuple(row.name for row in system.rows)
    own = rows == ("link", "motor") and len(system.inputs) == 1
    return own and set(system.coefficients) <= set(COEFFICIENT_UNITS)


def coefficient_unit(run: Run, name: str) -> str:
    """Return the SI unit of a coefficient, or empty text for a model of the user."""
    return COEFFICIENT_UNITS[name].format(input="(N m)") if is_joint(run) else ""
