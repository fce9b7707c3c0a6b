"""Intervals and verdicts: from a fit to coefficients and physical parameters."""

from collections.abc import Mapping, Sequence

import numpy as np

from flexid.analysis.excitation import Excitation
from flexid.estimators.state_variable_filter import LeastSquaresFit
from flexid.estimators.streamed_least_squares import StreamedFit
from flexid.estimators.unknowns import FIXED, Unknowns
from flexid.identification.intervals import Fitted, interval, propagated
from flexid.identification.joint import Joint
from flexid.identification.result import CoefficientEstimate, ParameterEstimate
from flexid.identification.verdict import Evidence, verdict, worst

# One is enough: where the model lacks something, the same lack widens the standard deviations.
_NOISE_DEVIATIONS = 1.0
_ESTIMATOR_DEVIATIONS = 2.0  # two estimators share less of their noise than two filter rates

_HELPERS = ("alpha_holding",)  # carries the uncertainty of the stopping time to the others


def coefficient_estimates(
    fit: Fitted,
    evidence: Mapping[str, Evidence],
    units: Mapping[str, str],
    fixed: Mapping[str, tuple[float, str]],
    input_unit: str,
) -> dict[str, CoefficientEstimate]:
    """Estimate with interval and verdict for every coefficient; what is fixed has no width.

    Parameters
    ----------
    fit : Fitted
        Values with their covariance.
    evidence : mapping of str to Evidence
        By coefficient, that of its row.
    units : mapping of str to str
        Units of the coefficients, groups not told apart.
    fixed : mapping of str to tuple of float and str
        What was not estimated, and why.
    input_unit : str
        Unit of the input.
    """
    estimates = {}
    deviations = np.sqrt(np.diag(fit.covariance))
    for place, name in enumerate(fit.names):
        if name not in evidence:  # of no meaning but for the uncertainty of the others
            continue
        value, std = float(fit.values[place]), float(deviations[place])
        ends = interval(value, std, fit.degrees_of_freedom[place])
        unit = _unit(units[_base(name)], input_unit)
        status, reason = verdict(name, evidence[name])
        estimates[name] = CoefficientEstimate(name, unit, value, std, ends, status, reason)
    for name, (value, reason) in fixed.items():
        unit = _unit(units[_base(name)], input_unit)
        estimates[name] = CoefficientEstimate(
            name, unit, value, 0.0, (value, value), "determined", reason
        )
    order = list(units)
    return dict(sorted(estimates.items(), key=lambda item: order.index(_base(item[0]))))


def row_evidence(
    fit: Fitted,
    start: LeastSquaresFit | StreamedFit,
    shifts: Mapping[str, float],
    residual_excess: Mapping[str, float],
    excitation: Mapping[str, Excitation],
    fit_percent: Mapping[str, float],
    deflection_doubt: float,
) -> dict[str, Evidence]:
    """What is known about each coefficient: the evidence of its row.

    Parameters
    ----------
    fit : Fitted
        Values and covariance that are reported.
    start : LeastSquaresFit or StreamedFit
        Of the same unknowns; its rows say what each coefficient does to the motion.
    shifts : mapping of str to float
        How far each coefficient moves, beyond noise, with what should not move it.
    residual_excess, excitation, fit_percent : mapping
        By row, by row, by channel.
    deflection_doubt : float
        Share of the deflection that another delay between the encoders could make.
    """
    deviations = dict(zip(fit.names, np.sqrt(np.diag(fit.covariance)).tolist(), strict=True))
    values = dict(zip(fit.names, np.asarray(fit.values).tolist(), strict=True))
    found = {}
    for row in start.rows:
        names = tuple(name for name in row.coefficients if name not in _HELPERS)
        if not names:
            continue
        squares = dict(zip(row.coefficients, np.diag(row.gram).tolist(), strict=True))
        total = max(row.total_sum, np.finfo(float).tiny)
        evidence = Evidence(
            {name: values[name] for name in names},
            {name: deviations[name] for name in names},
            {name: shifts.get(name, 0.0) for name in names},
            {name: (squares[name] / total) ** 0.5 for name in names},
            residual_excess[row.name],
            excitation[row.name],
            fit_percent,
            deflection_doubt,
        )
        found |= dict.fromkeys(names, evidence)
    return found


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


def estimator_shifts(fit: Fitted, start: LeastSquaresFit) -> dict[str, float]:
    """How far each coefficient moves from least squares to the fit that is reported, beyond noise.

    Returns
    -------
    dict of str to float
        In the coefficients' units; 0 where noise explains it all.
    """
    with np.errstate(invalid="ignore"):
        noise = np.sqrt(start.standard_deviations**2 + np.diag(fit.covariance))
        beyond = np.abs(fit.values - start.values) - _ESTIMATOR_DEVIATIONS * noise
    excess = np.where(np.isfinite(beyond), np.maximum(beyond, 0.0), 0.0)
    return dict(zip(fit.names, map(float, excess), strict=True))


def parameter_estimates(
    joint: Joint,
    fit: Fitted,
    unknowns: Unknowns,
    coefficients: Mapping[str, CoefficientEstimate],
    input_unit: str,
) -> dict[str, ParameterEstimate]:
    """Physical parameters that the coefficients determine, by the delta method.

    A parameter that depends on a coefficient of each log its own is given for each log.
    """
    estimates = {}
    for piece in _one_piece_of_each_group(unknowns):
        labels = _labels(unknowns, piece, coefficients)
        values = {c: coefficients[label].value for c, label in labels.items()}
        for parameter in joint.parameters(labels, input_is_torque=input_unit == "N m"):
            own = [labels[c] for c in parameter.coefficients]
            of_group = next((label[label.index("[") :] for label in own if "[" in label), "")
            found = propagated(parameter, values, _Renamed(fit, labels))
            name = parameter.name + of_group
            estimates[name] = ParameterEstimate(
                name,
                _unit(parameter.unit, input_unit),
                found.value,
                found.std,
                found.interval,
                worst(coefficients[label].status for label in own),
            )
    return estimates


class _Renamed:
    """A fit under the names that the coefficients have in one piece."""

    def __init__(self, fit: Fitted, labels: Mapping[str, str]) -> None:
        base = {label: c for c, label in labels.items()}
        self.names = tuple(base.get(name, name) for name in fit.names)
        self.values = fit.values
        self.covariance = fit.covariance
        self.degrees_of_freedom = fit.degrees_of_freedom


def _one_piece_of_each_group(unknowns: Unknowns) -> list[int]:
    groups = unknowns.groups or (0,)
    return [groups.index(group) for group in sorted(set(groups))]


def _labels(
    unknowns: Unknowns, piece: int, coefficients: Mapping[str, CoefficientEstimate]
) -> dict[str, str]:
    """Each coefficient of the system that is on, and its name among the estimates."""
    columns = unknowns.columns(piece)
    group = unknowns.groups[piece] + 1 if unknowns.groups else 1
    labels = {}
    for c, column in zip(unknowns.system.coefficients, columns, strict=True):
        own = unknowns.names[column] if column != FIXED else f"{c}[{group}]"
        label = own if own in coefficients else c
        if label in coefficients:
            labels[c] = label
    return labels


def _base(name: str) -> str:
    return name.partition("[")[0]


def _unit(template: str, input_unit: str) -> str:
    return template.format(input=f"({input_unit})" if " " in input_unit else input_unit)
