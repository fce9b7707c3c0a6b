"""Shapes whose constants follow from the log, and fits and estimates with them."""

import numpy as np

from flexid.arrays import FloatArray
from flexid.identification.full_model.model import Fitted
from flexid.identification.structure.bend import BEND
from flexid.identification.structure.gap import as_wide_as_its_gap, with_free_width
from flexid.identification.structure.ripple import RIPPLE
from flexid.identification.structure.sought_shape import (
    at_its_constant,
    constant_of,
    moved_by_constant,
    with_free_constant,
)
from flexid.identification.structure.stribeck import STRIBECK
from flexid.identification.vocabulary.estimate import Estimate

SOUGHT = (STRIBECK, RIPPLE, BEND)
"""Terms that join the model by themselves, each with a constant that is sought."""

SOUGHT_COEFFICIENTS = frozenset(c for shape in SOUGHT for c in shape.coefficients)
"""Their coefficients."""


def settled(fitted: Fitted) -> Fitted:
    """A fit whose shapes have the constants that suit it best."""
    fitted = as_wide_as_its_gap(fitted)
    for shape in SOUGHT:
        fitted = at_its_constant(shape, fitted)
    return fitted


def free_information(fitted: Fitted) -> FloatArray:
    """The quadratic form of a fit, shape (k, k), where the constants of its shapes follow.

    With I the form while a constant stays, and d what the values move by with its standard
    deviation, their covariance is I⁻¹ + d dᵀ, and the form that of Sherman and Morrison.
    """
    information = fitted.information
    for shape in SOUGHT:
        moved = moved_by_constant(shape, fitted)
        along = information @ moved
        information = information - np.outer(along, along) / (1.0 + moved @ along)
    return information


def with_free_shapes(estimate: Estimate, fitted: Fitted) -> Estimate:
    """The estimate with the uncertainty of such constants in its covariance."""
    estimate = with_free_width(estimate, fitted)
    for shape in SOUGHT:
        estimate = with_free_constant(shape, estimate, fitted)
    return estimate


def sought_constants(estimate: Estimate, fitted: Fitted) -> dict[str, tuple[float, float, float]]:
    """Value, standard deviation and degrees of freedom of each constant that was sought."""
    return {
        shape.constant: constant_of(shape, estimate, fitted)
        for shape in SOUGHT
        if shape.is_in(fitted)
    }
