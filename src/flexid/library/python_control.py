"""Identified drives in python-control.

The package python-control (the extra ``control``) is not `flexid.control`, which declares
controllers.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from flexid.arrays import FloatArray
from flexid.errors import SettingError
from flexid.library.arguments import entrance
from flexid.models.parametric_system import ParametricSystem
from flexid.simulation.closed_loop import check_values
from flexid.simulation.sampled import plain_model

if TYPE_CHECKING:
    from control import NonlinearIOSystem

    from flexid.library.arguments import FilePath
    from flexid.library.joint_estimate import JointEstimate


@entrance
def plant_io_system(
    model: JointEstimate | ParametricSystem | FilePath,
    coefficients: Mapping[str, float] | None = None,
    *,
    name: str = "plant",
) -> NonlinearIOSystem:
    """What was identified, or a model, as a system of python-control.

    Parameters
    ----------
    model : JointEstimate, ParametricSystem or path
        What `flexid.identify` returned, an ``estimate.json``, a model or a TOML model file. Coulomb
        friction is smoothed over the constant ``coulomb_velocity``.
    coefficients : mapping of str to float, optional
        A value for each coefficient; of an estimate, those that are to be others.
    name : str, optional
        Of the system.

    Returns
    -------
    control.NonlinearIOSystem
        In continuous time, from the model's inputs to its states, with its coefficients and
        constants as ``params``. Its signals have the names that the model gives them.
    """
    from flexid.exports.request import ExportRequest
    from flexid.library.export import what_is_meant

    try:
        import control
    except ImportError:
        raise SettingError(
            "python-control", "is not installed: pip install 'flexid[control]'"
        ) from None
    meant = what_is_meant(model)
    assert isinstance(meant, ExportRequest)  # no arm
    system, values = meant.system, {**meant.values, **(coefficients or {})}
    check_values("coefficients", values, system.coefficients)
    numbers, count = plain_model(system), len(system.states)

    def update(_t: float, x: Any, u: Any, given: Mapping[str, float]) -> FloatArray:
        rates = np.empty(count)
        p = np.array([given[c] for c in system.coefficients], dtype=np.float64)
        c = np.array([given[c] for c in system.constants], dtype=np.float64)
        with np.errstate(all="ignore"):
            numbers.right_hand_side(_vector(x), _vector(u), p, c, rates)
        return rates

    return control.nlsys(
        update,
        lambda _t, x, _u, _params: x,
        inputs=list(system.inputs),
        outputs=list(system.states),
        states=list(system.states),
        params={**{c: float(values[c]) for c in system.coefficients}, **system.constants},
        name=name,
    )


def _vector(values: Any) -> NDArray[np.float64]:
    return np.ascontiguousarray(values, dtype=np.float64).reshape(-1)
