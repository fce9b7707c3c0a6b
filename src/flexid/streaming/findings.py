"""What the estimators say at a moment: values, intervals, and what contradicts them."""

from dataclasses import dataclass

import numpy as np

from flexid.errors import ConvergenceError, SettingError
from flexid.identification.estimation.knowledge import Joined, with_prior_knowledge
from flexid.identification.judgement.estimates import coefficient_estimates, parameter_estimates
from flexid.identification.preparation.stated import Stated
from flexid.identification.vocabulary.evidence import CoefficientEstimate, ParameterEstimate
from flexid.identification.vocabulary.intervals import POSITIVE, quantile
from flexid.identification.vocabulary.thresholds import THRESHOLDS
from flexid.streaming.commissioned import Departure, departures
from flexid.streaming.health import LIMITS, Width
from flexid.streaming.learner import Learner, States


@dataclass(frozen=True, eq=False)
class Findings:
    """What is known at a moment."""

    coefficients: dict[str, CoefficientEstimate]  # Of the model
    parameters: dict[str, ParameterEstimate]  # Physical parameters that these determine
    widths: list[Width]  # Of spring and inertias
    departures: tuple[Departure, ...]  # What differs from an estimate made before
    # A sentence on each value that is known otherwise than the stream says
    contradicted: tuple[str, ...]


def findings(learner: Learner, states: States, stated: Stated) -> Findings:
    """What states say, with what the user states joined to it."""
    options = learner.options
    joint, unknowns, unit = options.joint, options.unknowns, options.input_unit
    with np.errstate(all="ignore"):  # of numbers that no drive has
        joined = _joined(learner, states, stated)
        fixed = {name: (value, "given") for name, value in options.given.items()}
        sizes = _sizes(learner, states)
        coefficients = coefficient_estimates(joined.estimate, joint, unknowns, sizes, fixed, unit)
        parameters = parameter_estimates(
            joint, joined.estimate, unknowns, coefficients, unit, exact=joined.exact
        )
    departed = departures(
        options.reference, parameters, widths=LIMITS.departure, least=LIMITS.least_departure
    )
    disagreement = learner.disagreement(states)
    found = joined.estimate
    widths = [
        Width(
            name,
            float(found.values[place]),
            quantile(found.degrees_of_freedom[place]) * float(found.deviations[place])
            if found.degrees_of_freedom[place] > 0.0
            else np.inf,
            float(disagreement[place]),
        )
        for place, name in enumerate(found.names)
        if name in POSITIVE
    ]
    widths += [Width(n, value, 0.0, 0.0) for n, value in options.given.items() if n in POSITIVE]
    said = (*joined.contradicted, *joined.against)
    return Findings(coefficients, parameters, widths, departed, said)


def _joined(learner: Learner, states: States, stated: Stated) -> Joined:
    """The estimate with what is known joined; as it is, while what that concerns is open."""
    estimate, options = learner.estimate(states), learner.options
    try:
        return with_prior_knowledge(
            options.joint, estimate, options.given, stated, options.input_unit, THRESHOLDS
        )
    except (SettingError, ConvergenceError):
        return Joined(estimate)


def _sizes(learner: Learner, states: States) -> dict[str, float]:
    """Root mean square of each regressor over that of its row's left-hand side."""
    main, state = learner.main, states[0]
    power, _ = main.powers(state)
    return {
        name: float(np.sqrt(np.divide(max(square, 0.0), power[j])))
        for j, (row, gram) in enumerate(
            zip(learner.system.rows, main.information(state), strict=True)
        )
        for name, square in zip(row.coefficients, np.diag(gram), strict=True)
    }
