"""Fits that keep to bounds: no negative friction, no stiffness beyond the catalogue's.

A sum of squares is a quadratic form about its minimum, (p - p̂)ᵀ M (p - p̂) with the information M.
Its minimum within bounds is a small quadratic programme; the coefficients that end at their bound
there are fixed, and the estimator runs again for the others. Their values and intervals are then
what they are given those bounds, and a coefficient at its bound has no interval of its own.
"""

from collections.abc import Callable, Mapping
from typing import Protocol, TypeVar

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import SettingError
from flexid.estimators.normal_equations import NULL
from flexid.estimators.unknowns import Unknowns

Bounds = Mapping[str, tuple[float, float]]


class Fit(Protocol):
    """What a fit has to have: values of what is sought, and the information on it."""

    @property
    def names(self) -> tuple[str, ...]:
        """What is sought, k of them."""
        ...

    @property
    def values(self) -> FloatArray:
        """Their values, shape (k,)."""
        ...

    @property
    def information(self) -> FloatArray:
        """The sum of squares' quadratic form about them, up to a factor, shape (k, k)."""
        ...


AnyFit = TypeVar("AnyFit", bound=Fit)


def bounded_fit(
    fit_with: Callable[[Unknowns], AnyFit], unknowns: Unknowns, bounds: Bounds
) -> tuple[AnyFit, dict[str, float]]:
    """Fit within bounds.

    Parameters
    ----------
    fit_with : callable
        Runs an estimator for given unknowns.
    unknowns : Unknowns
        What is sought.
    bounds : mapping of str to (lower, upper)
        By name; infinite where there is no bound. The bounds of a coefficient that is sought for
        each group hold in all of them; those of a fixed one are of no account.

    Returns
    -------
    fit : as `fit_with` returns it
        Of the coefficients that are within their bounds. Least squares: the minimum within the
        bounds. Prediction error: so too, if the coefficients at their bounds are those of the
        quadratic form about the minimum without bounds.
    at_bound : dict of str to float
        The others, each with the bound at which it was fixed.

    Raises
    ------
    SettingError
        If a bound is of no coefficient of the system, its lower end is not below its upper, or
        every coefficient ends at one.
    """
    _check(unknowns, bounds)
    at_bound: dict[str, float] = {}
    fit = fit_with(unknowns)
    # The rest may leave its bounds in its turn; each round fixes one coefficient at least.
    while ends := _ends(fit, unknowns, bounds):
        at_bound |= ends
        if len(ends) == len(fit.names):
            raise SettingError(
                "bounds", "every coefficient ends at its bound: widen them, or check the units"
            )
        unknowns = unknowns.fixing(ends)
        fit = fit_with(unknowns)
    return fit, at_bound


def _check(unknowns: Unknowns, bounds: Bounds) -> None:
    coefficients = unknowns.system.coefficients
    for name, (lower, upper) in bounds.items():
        if name not in (*coefficients, *unknowns.names):
            raise SettingError(
                "bounds",
                f"{name!r} is no coefficient of this model; it has {', '.join(coefficients)}",
            )
        if not lower < upper:
            raise SettingError(
                "bounds", f"those of {name!r}, {lower:g} and {upper:g}, leave no room: correct them"
            )


def _ends(fit: Fit, unknowns: Unknowns, bounds: Bounds) -> dict[str, float]:
    """Coefficients that end at a bound in the quadratic programme, with the bound."""
    coefficient_of = unknowns.coefficient_of  # what else a fit seeks has no bounds
    own = {name: bounds.get(name, bounds.get(coefficient_of.get(name, name))) for name in fit.names}
    unbounded = (-np.inf, np.inf)
    lower, upper = np.array([own[name] or unbounded for name in fit.names], dtype=np.float64).T
    if np.all((fit.values >= lower) & (fit.values <= upper)):
        return {}
    from scipy.optimize import lsq_linear  # late: it takes a third of a second to import

    scale = np.sqrt(np.diag(fit.information))
    scale = np.where(scale > 0.0, scale, 1.0)
    # Along directions that the data leave open the least departure from the fit decides.
    normalised = fit.information / np.outer(scale, scale) + NULL * np.eye(len(scale))
    root = np.linalg.cholesky(normalised).T
    found = lsq_linear(
        root, root @ (scale * fit.values), (scale * lower, scale * upper), method="bvls"
    )
    return {
        name: float(low if side < 0 else high)
        for name, low, high, side in zip(fit.names, lower, upper, found.active_mask, strict=True)
        if side
    }
