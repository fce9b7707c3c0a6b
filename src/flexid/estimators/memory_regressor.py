"""Estimators with a memory: gradient after Kreisselmeier, and DREM.

Both keep a fading memory of all rows, A' = -A/τ + r rᵀ and B' = -B/τ + r v', so that A p = B holds
for the true coefficients at any time. The gradient law p' = G (B - A p) then sees all directions of
the motion of the last τ at once, where the paper's observer sees one at a time (Kreisselmeier, IEEE
Trans. Automatic Control 22, 1977). DREM multiplies by the adjugate of A first, which leaves one
scalar equation per coefficient, p_i' = g Δ (Y_i - Δ p_i) with Δ = det A, Y = adj(A) B; each error
falls monotonically, whatever the others do (Aranovskiy, Bobtsov, Ortega, Pyrkin, IEEE Trans.
Automatic Control 62, 2017).
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from flexid.errors import SettingError
from flexid.estimators.online import (
    CompiledEstimator,
    checked_sample_time,
    fading_factor,
    row_starts,
)
from flexid.kernels.store import load_kernel
from flexid.models.parametric_system import ParametricSystem
from flexid.recording.recording import Hold

MemoryLaw = Literal["gradient", "drem"]

_RATES = {"gradient": 1e5, "drem": 10.0}  # 1/s
_FIRST = 0.5  # s before anything is called determined


@dataclass(frozen=True, eq=False)
class MemoryRegressor(CompiledEstimator):
    """A memory with its law; made by `memory_regressor`.

    The innovations are accelerations: those of the increments of the velocities.
    """


def memory_regressor(
    system: ParametricSystem,
    sample_time: float,
    law: MemoryLaw = "drem",
    hold: Hold = "linear",
    memory_time: float = np.inf,
    convergence_rate: float | None = None,
) -> MemoryRegressor:
    """Build a memory estimator on increments of velocities, as `parametric_observer` takes them.

    Parameters
    ----------
    system : ParametricSystem
        The model.
    sample_time : float
        Time between samples in s.
    law : {"gradient", "drem"}, optional
        How the estimate follows from the memory.
    hold : {"linear", "zero"}, optional
        Whether the inputs run linearly between samples or are constant until the next one.
    memory_time : float, optional
        τ in s; infinite: nothing is forgotten.
    convergence_rate : float, optional
        In 1/s. Gradient: G is this rate over the largest that the diagonal of A has been, so a
        direction decays at this rate times its eigenvalue of the normalised A; the default is high
        (1e5), since eigenvalues are small. DREM: g is this rate over the largest Δ² so far, so
        every error decays at this rate (10) where excitation is best. Both are stable at any rate.

    Returns
    -------
    MemoryRegressor

    Raises
    ------
    SettingError
        If a setting is out of its range.
    """
    if law not in _RATES:
        raise SettingError("law", f"{law!r} is none: give 'gradient' or 'drem'")
    rate = _RATES[law] if convergence_rate is None else convergence_rate
    if not (np.isfinite(rate) and rate > 0.0):
        raise SettingError("convergence rate", f"{rate} is no rate: give a positive number, 1/s")

    def build() -> str:
        from flexid.derivation.model_functions import model_functions

        source = model_functions(system, "Memory regressor")
        sizes = row_starts(system) + f"ADJUGATE = {law == 'drem'}\n"
        return source + "\n\n" + sizes

    h = checked_sample_time(sample_time)
    templates = ["status", "velocity_rows", "memory_gain", "online"]
    kernel = load_kernel("memory_regressor", [system.digest, law], build, templates)
    settings = [fading_factor(memory_time, h), rate, np.ceil(_FIRST / h)]
    settings += [h, float(hold == "zero"), *system.constants.values()]
    state = np.zeros(kernel.STATE_SIZE)
    return MemoryRegressor(system, h, hold, True, kernel, np.array(settings), state)
