"""What the user knows, held against what the log says by itself."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from flexid.errors import ConvergenceError
from flexid.identification.estimate import Estimate
from flexid.identification.fitting import START_RATES, climb, least_squares_start, lengths
from flexid.identification.full_model import Data, Structure
from flexid.identification.joint import Joint
from flexid.identification.judgement import Thresholds
from flexid.identification.prior_knowledge import Known, contradiction_warning, informed
from flexid.identification.settings import Settings

_DURATION = 1.0  # s, segments of a fit that says whether something known is wrong altogether
_LEAST = 0.01  # relative difference from which on a contradiction matters


def contradictions(
    given: Mapping[str, float], full: Structure, data: Data, thresholds: Thresholds
) -> tuple[str, ...]:
    """A sentence for each exactly known coefficient that the log contradicts.

    Parameters
    ----------
    given : mapping of str to float
        Coefficients known exactly.
    full : Structure
        The full model with these fixed.
    data : Data
        The log.
    thresholds : Thresholds
        When they contradict each other.
    """
    if not given:
        return ()
    free = replace(full, fixed={}, bounds={})
    try:
        start, _ = least_squares_start(free, data, START_RATES[0])
        found = climb(free, data, start, lengths(data, _DURATION))[-1]
    except ConvergenceError:
        return ()
    deviations = found.fit.standard_deviations
    sentences = []
    for name, known in given.items():
        if name not in found.names:
            continue
        place = found.names.index(name)
        value, std = float(found.values[place]), float(deviations[place])
        apart = abs(value - known)
        if np.isfinite(std) and apart > max(thresholds.contradiction * std, _LEAST * abs(known)):
            sentences.append(_sentence(name, known, value, std))
    return tuple(sentences)


def _sentence(name: str, known: float, value: float, std: float) -> str:
    if name != "beta1":
        return contradiction_warning(Known(name, known, 0.0), value, std)
    inertia = Known("motor_inertia", 1.0 / known, 0.0)
    return contradiction_warning(inertia, 1.0 / value, std / value**2)


def with_prior_knowledge(
    joint: Joint,
    estimate: Estimate,
    given: Mapping[str, float],
    settings: Settings,
    input_unit: str,
    thresholds: Thresholds,
) -> tuple[Estimate, tuple[str, ...]]:
    """The estimate with what is known uncertainly joined to it, and what contradicts the log."""
    uncertain = [
        Known(name, settings.known[name], std)
        for name, std in settings.known_deviations.items()
        if std > 0
    ]
    if not uncertain:
        return estimate, ()
    parameters = joint.parameters({*estimate.names, *given}, input_unit == "N m")
    return informed(estimate, uncertain, parameters, given, thresholds.contradiction)
