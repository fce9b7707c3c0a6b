"""Parametric observer of Huang (2003) in discrete time, as an online estimator."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import ModuleType
from typing import ClassVar

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import SettingError
from flexid.estimators.online import OnlineEstimator, checked_sample_time
from flexid.estimators.samples import Samples
from flexid.estimators.state_variable_filter import regressors
from flexid.kernels.store import load_kernel
from flexid.models.parametric_system import ParametricSystem
from flexid.recording.recording import Hold


# The estimates obey p' = G r (v' - rᵀp - k), eqs. (2)-(3). Over an interval the integral of r v' is
# r̄ Δv with r̄ the mean of both ends, so neither accelerations nor the immersion are needed. The
# status is never `USED`: with a constant gain there is no measure of what the motion determines.
@dataclass(frozen=True, eq=False)
class ParametricObserver(OnlineEstimator):
    """Observer with constant gains; made by `parametric_observer`."""

    # (n_coefficients,): diagonal of G; in the paper c1 for the link's coefficients, c2 for the
    # motor's
    gains: FloatArray
    _first_coefficient: ClassVar[int] = 1


def parametric_observer(
    system: ParametricSystem, gain: Mapping[str, float], sample_time: float, hold: Hold = "linear"
) -> ParametricObserver:
    """Build the observer of a model.

    Parameters
    ----------
    system : ParametricSystem
        Model, with the values of its constants.
    gain : mapping of str to float
        Gain of each coefficient, or of all coefficients of a row under the row's name: the paper's
        c1 and c2 are ``{"link": c1, "motor": c2}``.
    sample_time : float
        Time between samples in s.
    hold : {"linear", "zero"}, optional
        Whether the inputs are linear between samples or constant until the next one.

    Returns
    -------
    ParametricObserver

    Raises
    ------
    SettingError
        If a gain is missing or negative, or the sample time is not positive.
    """
    h = checked_sample_time(sample_time)
    diagonal = np.array(
        [_checked(gain, row.name, name) for row in system.rows for name in row.coefficients]
    )
    constants = list(system.constants.values())
    settings = np.array([h, float(hold == "zero"), *diagonal, *constants])
    kernel = _kernel(system)
    state = np.zeros(kernel.STATE_SIZE)
    return ParametricObserver(system, h, hold, True, kernel, settings, (), state, diagonal)


def suggest_gains(
    samples: Samples, system: ParametricSystem, convergence_rate: float = 1.0
) -> dict[str, float]:
    """Return gains rate / (k mean r²), with which errors decay at about the given rate in 1/s."""
    # The k coefficients of a row then have equal shares of r̄ᵀG r̄, independent of their units.
    squares = [np.mean(signal**2) for signal in regressors(samples, system)]
    counts = [len(row.coefficients) for row in system.rows for _ in row.coefficients]
    return {
        name: float(convergence_rate / (count * square)) if square > 0.0 else 0.0
        for name, count, square in zip(system.coefficients, counts, squares, strict=True)
    }


def _checked(gain: Mapping[str, float], row: str, coefficient: str) -> float:
    own = gain.get(coefficient, gain.get(row))
    if own is None:
        raise SettingError("gain", f"give one for {coefficient!r}, or for its row {row!r}")
    if not (np.isfinite(own) and own >= 0.0):
        raise SettingError("gain", f"must be 0 or more, got {own} for {coefficient!r}")
    return float(own)


def _kernel(system: ParametricSystem) -> ModuleType:
    def build() -> str:
        from flexid.paper.sampled_loop import sampled_observer_functions

        return sampled_observer_functions(system, "Parametric observer, sampled")

    templates = ["sin_cos", "parametric_observer"]
    return load_kernel("parametric_observer", [system.digest], build, templates)
