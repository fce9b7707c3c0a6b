"""Intervals and verdicts: from a least-squares fit to coefficients and physical parameters."""

from collections.abc import Mapping

import numpy as np
from scipy.special import stdtrit

from flexid.analysis.excitation import Excitation
from flexid.estimators.state_variable_filter import LeastSquaresFit
from flexid.identification.result import CoefficientEstimate, ParameterEstimate
from flexid.identification.verdict import verdict, worst
from flexid.models.flexible_joint import COEFFICIENT_UNITS
from flexid.models.physical import physical_parameters

CONFIDENCE = 0.95
"""Nominal coverage of every interval."""


def coefficient_estimates(
    fit: LeastSquaresFit,
    excitation: Mapping[str, Excitation],
    fit_percent: Mapping[str, float],
    input_unit: str,
) -> dict[str, CoefficientEstimate]:
    """Estimate with interval and verdict for every coefficient of a fit."""
    deviations = dict(zip(fit.names, map(float, fit.standard_deviations), strict=True))
    values = dict(zip(fit.names, map(float, fit.values), strict=True))
    estimates = {}
    for row in fit.rows:
        sizes = np.sqrt(np.diag(row.gram) / row.total_sum) if row.total_sum else np.zeros(0)
        for name, size in zip(row.coefficients, map(float, sizes), strict=True):
            value, std = values[name], deviations[name]
            share = std * size if np.isfinite(std) else np.inf
            status, reason = verdict(name, value, std, share, excitation[row.name], fit_percent)
            estimates[name] = CoefficientEstimate(
                name,
                COEFFICIENT_UNITS[name].format(input=f"({input_unit})"),
                value,
                std,
                _interval(value, std, row.degrees_of_freedom),
                status,
                reason,
            )
    return estimates


def parameter_estimates(
    fit: LeastSquaresFit,
    coefficients: Mapping[str, CoefficientEstimate],
    known: Mapping[str, float],
    input_unit: str,
) -> dict[str, ParameterEstimate]:
    """Physical parameters that the coefficients determine, by the delta method."""
    values = {name: c.value for name, c in coefficients.items()} | dict(known)
    freedom = dict(zip(fit.names, fit.degrees_of_freedom, strict=True))
    estimates = {}
    for parameter in physical_parameters(values, input_is_torque=input_unit == "N m"):
        used = [name for name in fit.names if name in parameter.exponents]
        if not used:  # follows from what the user knows
            continue
        places = [fit.names.index(name) for name in used]
        gradient = parameter.gradient(values, used)
        covariance = fit.covariance[np.ix_(places, places)]
        with np.errstate(invalid="ignore"):  # 0 * inf where a coefficient is undetermined
            variance = float(gradient @ covariance @ gradient)
        std = np.sqrt(variance) if np.isfinite(variance) else np.inf
        value = parameter.value(values)
        estimates[parameter.name] = ParameterEstimate(
            parameter.name,
            parameter.unit.format(input=f"({input_unit})"),
            value,
            float(std),
            _interval(value, float(std), min(freedom[name] for name in used)),
            worst(*(coefficients[name].status for name in used)),
        )
    return estimates


def _interval(value: float, std: float, degrees_of_freedom: int) -> tuple[float, float]:
    if degrees_of_freedom < 1 or not np.isfinite(std):
        return -np.inf, np.inf
    half_width = float(stdtrit(degrees_of_freedom, (1 + CONFIDENCE) / 2)) * std
    return value - half_width, value + half_width
