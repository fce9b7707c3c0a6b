"""Synthetic estimates with a known covariance, drawn about the true values of a drive."""

import json
from copy import deepcopy
from dataclasses import replace
from functools import reduce

import numpy as np

from flexid.arrays import to_json
from flexid.estimators.excitation import excitation_of_gram
from flexid.identification.judgement import Compliance, judged_function, judged_value
from flexid.identification.preparation.recordings import Alignment, Delay
from flexid.identification.result import Choices, Identification
from flexid.identification.vocabulary import evidence
from flexid.identification.vocabulary.evidence import Estimate
from flexid.models.flexible_joint import COEFFICIENT_UNITS
from flexid.models.physical import Sum, physical_parameters
from flexid.stored_estimates.estimate_file import estimate_document

TRUE = {"theta1": 5.0, "theta2": 100.0, "alpha1": 1000 / 3, "alpha2": 1 / 3, "beta1": 10 / 3}
STIFFER = {**TRUE, "theta2": 1.1 * TRUE["theta2"], "alpha1": 1.1 * TRUE["alpha1"]}
RELATIVE = 0.01
"""Relative standard error of each coefficient."""

NOTHING = Delay(0.0, 0.0, (0.0, 0.0), "none")
SETTINGS = {"model": "auto", "terms": "auto", "known": {}, "hold": "auto"}


def wishart(rng, covariance, freedom):
    """Return a covariance estimated with these degrees of freedom."""
    errors = rng.multivariate_normal(np.zeros(len(covariance)), covariance, round(freedom))
    return errors.T @ errors / round(freedom)


def drawn(rng, true=None, freedom=20, correlation=0.5, **about):
    """Return an estimate of a drive from its own log, with random errors."""
    true = TRUE if true is None else true
    covariance = covariance_of(true, correlation)
    values = rng.multivariate_normal(list(true.values()), covariance)
    estimated = wishart(rng, covariance, freedom)
    found = Estimate(tuple(true), values, estimated, (float(freedom),) * len(true))
    return estimate_of(found, **{"log": str(rng.integers(2**60)), **about})


def exact(true, log):
    """Return an estimate with the true values and independent errors."""
    values = np.array(list(true.values()))
    covariance = covariance_of(true, 0.0)
    return estimate_of(Estimate(tuple(true), values, covariance, (30.0,) * len(true)), log)


def covariance_of(true, correlation):
    """Return the covariance of coefficients with relative standard errors of 1 %."""
    deviations = RELATIVE * np.abs(list(true.values()))
    return np.outer(deviations, deviations) * np.where(np.eye(len(true)) == 1, 1.0, correlation)


def estimate_of(fit, log="a log", **settings):
    """Return the identification that follows from a fit."""
    coefficients = {}
    for name, value, std, freedom in zip(
        fit.names, fit.values.tolist(), fit.deviations.tolist(), fit.degrees_of_freedom, strict=True
    ):
        unit = COEFFICIENT_UNITS[name.partition("[")[0]].format(input="(N m)")
        coefficients[name] = judged_value(name, unit, value, std, freedom)
    values = fit.by_name
    parameters = {}
    for parameter in physical_parameters(values, input_is_torque=True):
        if not isinstance(parameter, Sum):  # the parts are known
            parameters[parameter.name] = judged_function(parameter, values, fit)
    gram = np.array([[1.0, 0.3], [0.3, 1.0]])
    return Identification(
        model="flexible",
        coefficients=coefficients,
        parameters=parameters,
        least_squares={},
        excitation={"link": excitation_of_gram("link", ["theta1", "theta2"], gram)},
        residual_excess={"link_position": 1.0},
        model_error=evidence.ModelError(0.0, 3.0, 0.0),
        validation=evidence.Validation({"link_position": 99.0}, ()),
        compliance=Compliance(True, "the deflection moves", 0.1, 1e-4),
        removed={},
        fit=fit,
        choices=Choices(
            terms=("gravity", "motor_viscous"),
            alignment=Alignment("zero", NOTHING, NOTHING, ""),
            hold="zero",
            coulomb_velocity=None,
            filter_rate=20.0,
            estimator="prediction-error",
            segment_duration=1.0,
            term_evidence=(),
            segment_evidence=(),
        ),
        summary=(),
        warnings=(),
        provenance={
            "flexid_version": "0.1.0",
            "settings": SETTINGS | settings,
            "inputs": [{"file": f"{log}.csv", "sha256": log}],
        },
    )


def with_parameter(estimate, name, **changed):
    """Return the estimate with one parameter changed."""
    parameters = dict(estimate.parameters)
    parameters[name] = replace(parameters[name], **changed)
    return replace(estimate, parameters=parameters)


MISSING = object()


def altered(document, keys, value):
    """Return the document with one value replaced or removed."""
    made = deepcopy(document)
    *folders, last = keys.split(".")
    part = reduce(dict.__getitem__, folders, made)
    part[last] = value
    if value is MISSING:
        del part[last]
    return made


def stored_value(value, **changed):
    """Return a coefficient or a parameter as in a file."""
    ends = {"std": 0.0, "interval": [value, value], "degrees_of_freedom": None}
    about = {"unit": "", "verdict": "determined", "reason": "", "logarithmic": False, "slopes": {}}
    return {"value": value, **ends, **about, **changed}


def stored_document(coefficients, parameters=None):
    """Return the document of an estimate with these values and no fit; without a seal."""
    document = json.loads(to_json(estimate_document(exact(TRUE, "another log"))))
    kinds = {"coefficients": coefficients, "parameters": parameters or {}}
    document["fit"] = {"names": [], "values": [], "covariance": [], "degrees_of_freedom": []}
    for kind, values in kinds.items():
        document[kind] = {n: stored_value(value, name=n) for n, value in values.items()}
    return document
