"""Both sides of every row, sampled: what least squares on positions starts from.

Over two sampling intervals a row v' = rᵀp + k is integrated twice, which turns v' into a second
difference of the position. What follows of the coefficients that are fixed goes to the left.
"""

from collections.abc import Sequence
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from flexid.arrays import FloatArray
from flexid.errors import SettingError
from flexid.estimators.samples import Samples
from flexid.estimators.unknowns import FIXED, Unknowns
from flexid.kernels.store import load_kernel
from flexid.models.parametric_system import ParametricSystem
from flexid.recording.recording import Hold


def fill_row_signals(
    signals: FloatArray,
    first: int,
    recording: Samples,
    system: ParametricSystem,
    hold: Hold,
    pole: float,
    wanted: NDArray[np.int64] | None = None,
) -> None:
    """Regressors of all coefficients and left-hand sides of all rows over a recording."""
    kernel = _kernel(system)
    velocities = (
        np.zeros_like(recording.positions) if recording.velocities is None else recording.velocities
    )
    if wanted is None:
        wanted = np.arange(kernel.N_SIGNALS, dtype=np.int64)
    record = (
        np.ascontiguousarray(recording.positions, dtype=np.float64),
        np.ascontiguousarray(velocities, dtype=np.float64),
        np.ascontiguousarray(recording.inputs, dtype=np.float64),
    )
    kernel.filter_recording(
        record,
        np.array(list(system.constants.values()), dtype=np.float64),
        float(recording.sample_time),
        pole,
        hold == "zero",
        wanted,
        signals,
        first,
    )


def check_velocities(
    recordings: Sequence[Samples], usable: Sequence[int], unknowns: Unknowns
) -> None:
    """Refuse a recording without velocities where a term that is not switched off needs one."""
    needed = _kernel(unknowns.system).VELOCITY_NEEDED
    for place in usable:
        if recordings[place].velocities is not None:
            continue
        absent = unknowns.absent(place)
        for name in needed:
            if name not in absent:
                raise SettingError(
                    "velocities",
                    f"the regressor of {name!r} is nonlinear in a velocity but there are none: "
                    f"derive velocities first, or drop the term",
                )


def needs_velocities(unknowns: Unknowns) -> bool:
    """Whether a term that is on in the first recording is nonlinear in a velocity."""
    return any(c not in unknowns.absent(0) for c in _kernel(unknowns.system).VELOCITY_NEEDED)


def wanted_signals(unknowns: Unknowns, usable: Sequence[int]) -> NDArray[np.int64]:
    """Places of the signals of least squares: left-hand sides, and regressors that are on."""
    system = unknowns.system
    absent = [unknowns.absent(place) for place in usable] or [frozenset()]
    off = frozenset.intersection(*absent)
    coefficients = [i for i, name in enumerate(system.coefficients) if name not in off]
    rows = [len(system.coefficients) + j for j in range(len(system.rows))]
    return np.array(coefficients + rows, dtype=np.int64)


def sought_signals(
    signals: FloatArray, unknowns: Unknowns, usable: Sequence[int], lengths: Sequence[int]
) -> tuple[FloatArray, FloatArray]:
    """Regressors of what is sought, and left-hand sides less what is fixed."""
    system = unknowns.system
    n_coefficients = len(system.coefficients)
    regressors = np.zeros((len(unknowns.names), signals.shape[1]))
    left_hand_sides = signals[n_coefficients:].copy()
    stop = 0
    for place, length in zip(usable, lengths, strict=True):
        equations = slice(stop, stop + length)
        stop = equations.stop
        columns = unknowns.columns(place)
        sought = columns != FIXED
        regressors[columns[sought], equations] = signals[:n_coefficients][sought, equations]
        fixed = unknowns.coefficients(np.zeros(len(unknowns.names)), place)
        for row, (_, part) in enumerate(system.row_slices()):
            # A term that is off stays out even where its regressor is not finite.
            for coefficient in part.start + np.flatnonzero(fixed[part]):
                left_hand_sides[row, equations] -= (
                    fixed[coefficient] * signals[coefficient, equations]
                )
    return regressors, left_hand_sides


def _kernel(system: ParametricSystem) -> ModuleType:
    def build() -> str:
        from flexid.derivation.regressor_classes import filter_functions

        return filter_functions(system, "State-variable filter on positions")

    return load_kernel("state_variable_filter", [system.digest], build, ["state_variable_filter"])
