"""Intervals and verdicts: from a least-squares fit to coefficients and physical parameters."""

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.special import stdtrit

from flexid.analysis.excitation import Excitation
from flexid.estimators.state_variable_filter import LeastSquaresFit
from flexid.identification.result import CoefficientEstimate, ParameterEstimate
from flexid.identification.verdict import Evidence, verdict, worst
from flexid.models.flexible_joint import COEFFICIENT_UNITS
from flexid.models.physical import PhysicalParameter, physical_parameters

CONFIDENCE = 0.95
"""Nominal coverage of every interval."""

# One is enough: where the model lacks something, the same lack widens the standard deviations.
_NOISE_DEVIATIONS = 1.0


def coefficient_estimates(
    fit: LeastSquaresFit,
    shifts: Mapping[str, float],
    residual_excess: Mapping[str, float],
    excitation: Mapping[str, Excitation],
    fit_percent: Mapping[str, float],
    known: Mapping[str, float],
    input_unit: str,
) -> dict[str, CoefficientEstimate]:
    """Estimate with interval and verdict for every coefficient; known ones have no width."""
    deviations = dict(zip(fit.names, map(float, fit.standard_deviations), strict=True))
    values = dict(zip(fit.names, map(float, fit.values), strict=True))
    estimates = {}
    for row in fit.rows:
        names = row.coefficients
        sizes = np.sqrt(np.diag(row.gram) / max(row.total_sum, np.finfo(float).tiny))
        evidence = Evidence(
            {name: values[name] for name in names},
            {name: deviations[name] for name in names},
            {name: shifts[name] for name in names},
            dict(zip(names, map(float, sizes), strict=True)),
            residual_excess[row.name],
            excitation[row.name],
            fit_percent,
        )
        for name in names:
            value, std = values[name], deviations[name]
            interval = _interval(value, std, row.degrees_of_freedom)
            unit = _unit(COEFFICIENT_UNITS[name], input_unit)
            estimates[name] = CoefficientEstimate(
                name, unit, value, std, interval, *verdict(name, evidence)
            )
    for name, value in known.items():
        unit = _unit(COEFFICIENT_UNITS[name], input_unit)
        estimates[name] = CoefficientEstimate(
            name, unit, value, 0.0, (value, value), "determined", "given"
        )
    return estimates


def filter_shifts(fit: LeastSquaresFit, others: Sequence[LeastSquaresFit]) -> dict[str, float]:
    """How far each coefficient moves from a fit to fits at other filter rates, beyond noise.

    Parameters
    ----------
    fit, others : LeastSquaresFit
        Of the same data and model. Their noise is partly the same, so the root of the sum of their
        variances is a cautious bound on what noise alone can do to the difference.

    Returns
    -------
    dict of str to float
        In the coefficients' units; 0 where noise explains it all.
    """
    excess = np.zeros(len(fit.names))
    for other in others:
        with np.errstate(invalid="ignore"):
            noise = np.sqrt(fit.standard_deviations**2 + other.standard_deviations**2)
        beyond = np.abs(other.values - fit.values) - _NOISE_DEVIATIONS * noise
        excess = np.fmax(excess, np.where(np.isfinite(beyond), beyond, 0.0))
    return dict(zip(fit.names, map(float, excess), strict=True))


def parameter_estimates(
    fit: LeastSquaresFit, coefficients: Mapping[str, CoefficientEstimate], input_unit: str
) -> dict[str, ParameterEstimate]:
    """Physical parameters that the coefficients determine, by the delta method."""
    values = {name: c.value for name, c in coefficients.items()}
    estimates = {}
    for parameter in physical_parameters(values, input_is_torque=input_unit == "N m"):
        value = parameter.value(values)
        std, freedom = _propagated(parameter, values, fit)
        estimates[parameter.name] = ParameterEstimate(
            parameter.name,
            _unit(parameter.unit, input_unit),
            value,
            std,
            _interval(value, std, freedom) if std else (value, value),
            worst(coefficients[name].status for name in parameter.coefficients),
        )
    return estimates


def _propagated(
    parameter: PhysicalParameter, values: Mapping[str, float], fit: LeastSquaresFit
) -> tuple[float, int]:
    """Standard deviation by the delta method, and the fewest degrees of freedom involved."""
    places = [i for i, name in enumerate(fit.names) if name in parameter.coefficients]
    if not places:  # follows from what the user gave
        return 0.0, 0
    gradient = parameter.gradient(values, [fit.names[i] for i in places])
    covariance = fit.covariance[np.ix_(places, places)]
    if not np.all(np.isfinite(covariance)):
        return np.inf, 0
    freedom = min(fit.degrees_of_freedom[i] for i in places)
    return float(np.sqrt(gradient @ covariance @ gradient)), freedom


def _unit(template: str, input_unit: str) -> str:
    return template.format(input=f"({input_unit})" if " " in input_unit else input_unit)


def _interval(value: float, std: float, degrees_of_freedom: int) -> tuple[float, float]:
    if degrees_of_freedom < 1 or not np.isfinite(std):
        return -np.inf, np.inf
    half_width = float(stdtrit(degrees_of_freedom, (1 + CONFIDENCE) / 2)) * std
    return value - half_width, value + half_width
