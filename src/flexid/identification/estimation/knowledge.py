"""Prior knowledge compared with the log and joined to the estimate."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np

from flexid.errors import ConvergenceError
from flexid.identification.full_model.fitting import fit_by_length, lengths
from flexid.identification.full_model.model import Data, Fitted, Structure
from flexid.identification.full_model.starting import starts
from flexid.identification.preparation.joint import Joint
from flexid.identification.preparation.stated import Known, Stated, contradiction_warning, informed
from flexid.identification.vocabulary.evidence import Estimate
from flexid.identification.vocabulary.thresholds import Thresholds

_DURATION = 1.0  # s, segments of the fit that checks known values
_SLACK = 1e-9  # relative tolerance of a value at its bound
_ROUNDS = 4  # of activating and releasing bounds, for each bound
_LEAST = 0.01  # least relative difference of a contradiction


def contradictions(
    given: Mapping[str, float], reported: Fitted, full: Structure, thresholds: Thresholds
) -> tuple[str, ...]:
    """Return a sentence for each coefficient, known or at its bound, that the log contradicts."""
    at_bound = reported.at_bound.items()
    wanted = [Known(name, value, 0.0) for name, value in given.items()]
    wanted += [Known(name, value, 0.0, bound=True) for name, value in at_bound if value]
    if not wanted:
        return ()
    known = {**reported.by_name, **given}
    found = _freed(replace(full, fixed={}, bounds={}), reported.data, known)
    if found is None:
        return ()
    fit = found.fit
    sentences = []
    for known in wanted:
        if known.name not in found.names:
            continue
        value, std, _ = fit.of(known.name)
        apart = abs(value - known.value)
        least = max(thresholds.contradiction * std, _LEAST * abs(known.value))
        if np.isfinite(std) and apart > least:
            sentences.append(_sentence(known, value, std))
    return tuple(sentences)


def _freed(free: Structure, data: Data, known: Mapping[str, float]) -> Fitted | None:
    """Return the fit of a structure without known values; None if it fails.

    It starts from least squares and from the known values. From least squares alone, the path of a
    term with memory may end in a wrong minimum.
    """
    divisions = lengths(data, _DURATION)
    ends: list[Fitted] = []
    for begin in (lambda: next(starts(free, data, divisions[0])), lambda: known):
        with suppress(ConvergenceError):
            ends.append(fit_by_length(free, data, begin(), divisions)[-1])
    return min(ends, key=lambda end: (len(end.problem.segments), end.excess), default=None)


def _sentence(known: Known, value: float, std: float) -> str:
    if known.name != "beta1":
        return contradiction_warning(known, value, std)
    inertia = replace(known, name="motor_inertia", value=1.0 / known.value)
    return contradiction_warning(inertia, 1.0 / value, std / value**2)


@dataclass(frozen=True, eq=False)
class Joined:
    """Estimate with prior knowledge joined to it."""

    estimate: Estimate  # from the log and the prior knowledge
    # fixed physical parameters, each with its value and the reason: "given" or "at its bound"
    exact: Mapping[str, tuple[float, str]] = field(default_factory=dict)
    # a sentence for each exact value that the log contradicts, which makes all values unknown
    contradicted: tuple[str, ...] = ()
    # a sentence for each uncertain value that the log contradicts; the intervals span both
    against: tuple[str, ...] = ()


def with_prior_knowledge(
    joint: Joint,
    estimate: Estimate,
    given: Mapping[str, float],
    stated: Stated,
    input_unit: str,
    thresholds: Thresholds,
) -> Joined:
    """Join known values to the estimate, within the bounds of functions of its coefficients."""
    if not stated.known and not stated.within:
        return Joined(estimate)
    parameters = joint.parameters({*estimate.names, *given}, input_unit)
    functions = {p.name: p for p in parameters}

    def joined(active: Mapping[str, float]) -> tuple[Estimate, dict[str, str]]:
        ends = [Known(name, value, 0.0, bound=True) for name, value in active.items()]
        known = (*stated.known, *ends)
        if not known:
            return estimate, {}
        return informed(estimate, known, parameters, given, thresholds.contradiction)

    def violated(name: str, found: Estimate) -> float | None:
        """Return the bound that a function violates; None if it is within or at its bounds."""
        if name not in functions:
            return None
        value = functions[name].value(found.with_values(given))
        lower, upper = stated.within[name]
        slack = _SLACK * abs(value)
        return lower if value < lower - slack else upper if value > upper + slack else None

    active: dict[str, float] = {}
    found, sentences = joined(active)
    for _ in range(_ROUNDS * len(stated.within)):
        left = {n: end for n in stated.within if (end := violated(n, found)) is not None}
        idle = [
            n
            for n in active
            if violated(n, joined({m: v for m, v in active.items() if m != n})[0]) is None
        ]  # functions that stay within their bounds without this constraint
        if not left and not idle:
            break
        active = {n: v for n, v in (active | left).items() if n not in idle}
        found, sentences = joined(active)
    exact = {k.name: (k.value, "given") for k in stated.known if k.std == 0.0}
    exact |= {name: (value, "at its bound") for name, value in active.items()}
    return Joined(
        found,
        exact,
        tuple(sentence for name, sentence in sentences.items() if name in exact),
        tuple(sentence for name, sentence in sentences.items() if name not in exact),
    )
