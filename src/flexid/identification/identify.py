"""The main job: logs and a model become an estimate with intervals and a verdict.

One path: recordings, full model, structure, estimate, judgement, result.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from flexid.errors import ConvergenceError
from flexid.estimators.segmented_motion import INPUT
from flexid.estimators.state_variable_filter import LeastSquaresFit
from flexid.identification.absence import hidden_covariance
from flexid.identification.alignment import Alignment, Delay, aligned
from flexid.identification.climbing import hold_covariance
from flexid.identification.compliance import compare_with_rigid, of_link_alone, one_encoder
from flexid.identification.estimate import Estimate
from flexid.identification.estimates import coefficient_estimates, parameter_estimates, row_sizes
from flexid.identification.excitations import row_excitation, unexcited
from flexid.identification.fitting import (
    expanded,
    fit_to,
    refit,
)
from flexid.identification.full_model import FINE, LINK, Data, Fitted, Structure, data_of
from flexid.identification.intervals import interval
from flexid.identification.job import Job, job_of, predicting
from flexid.identification.judgement import THRESHOLDS, Thresholds
from flexid.identification.knowledge import contradictions, with_prior_knowledge
from flexid.identification.link_delay import confused_covariance, in_doubt
from flexid.identification.link_row import with_link_row
from flexid.identification.measured_input import error_of, widened_by
from flexid.identification.mirrored import turned_round
from flexid.identification.model_error import stand_in_covariance
from flexid.identification.observer_stream import stream
from flexid.identification.preparation import SplitRecordings, prepare
from flexid.identification.progress import Progress, silent
from flexid.identification.provenance import provenance
from flexid.identification.result import (
    Choices,
    CoefficientEstimate,
    Compliance,
    Identification,
    ModelError,
    ObserverTrace,
    ParameterEstimate,
    TermEvidence,
    Validation,
)
from flexid.identification.settings import Settings
from flexid.identification.starting import least_squares_start, smooth_unknowns
from flexid.identification.structure import Choice
from flexid.identification.summary import summary
from flexid.identification.warnings import (
    compliance_warnings,
    deflection_warnings,
    model_warnings,
    sign_warnings,
    validation_warnings,
)
from flexid.models.terms import SMOOTHING
from flexid.recording.recording import Log
from flexid.recording.velocities import with_velocities

_FILTER_RATE = 20.0  # 1/s, of the least squares that stands beside the estimate


def identify(
    logs: Sequence[Log],
    settings: Settings | None = None,
    progress: Progress = silent,
    thresholds: Thresholds = THRESHOLDS,
) -> Identification:
    """Identify a joint from one or several logs.

    The full model is fitted to the data before each recording's held-out end; what these do not
    show is taken away; what is left predicts the ends, and is fitted once more, to all data, for
    the report.

    Parameters
    ----------
    logs : sequence of Log
        Of the same drive, with the same kind of input and the same encoders. With one encoder the
        joint is taken as rigid; without an input the link is identified alone, as if the settings
        said so.
    settings : Settings, optional
        Choices; see there.
    progress : callable, optional
        Called with each step in words.
    thresholds : Thresholds, optional
        What is decided by.

    Returns
    -------
    Identification

    Raises
    ------
    RecordingError
        If the logs do not go together or are too short.
    SettingError
        If a setting does not suit the logs.
    ConvergenceError
        If the model cannot be fitted from any start.
    """
    settings = settings or Settings()
    recordings, dropped = prepare(logs, settings.validation_share, settings.model)
    job = job_of(recordings, settings)
    training = data_of(job.joint, recordings.fitted, recordings.groups)
    whole = data_of(job.joint, recordings.whole, recordings.groups)
    choice, validation = predicting(job, training, whole, recordings, progress, thresholds)
    whole = replace(whole, refinement=choice.fitted.data.refinement)
    progress("fit to all data")
    reported, rungs, retreat = _reported(choice, whole)
    error = error_of(reported, rungs, thresholds)
    progress("what the model does without")
    full = _full(choice, whole, reported)
    filter_rate = _FILTER_RATE if settings.filter_rate == "auto" else settings.filter_rate
    timely = _timely(reported, recordings)
    scales = _scales(full, _least_squares(full.structure, timely, reported, filter_rate))
    estimate = widened_by(reported, error).widened(hidden_covariance(reported, full, scales))
    estimate = estimate.widened(hold_covariance(reported, choice.climbed.tied))
    estimate = estimate.widened(stand_in_covariance(reported, error))
    estimate, row = with_link_row(
        estimate, reported, rungs, full, recordings, scales, error, thresholds
    )
    if job.delay_in_doubt:
        estimate = estimate.widened(confused_covariance(estimate))
    heavy = replace(choice.structure, absent=choice.structure.absent - _gravity(choice.full))
    rows = _least_squares(heavy, timely, reported, filter_rate).rows
    unknown = (
        unexcited(rows, thresholds.lost_condition) if reported.converged else {*reported.names}
    )
    estimate = estimate.without_knowledge_of(unknown)
    given = {**job.stated.given, **reported.at_bound}
    joined = with_prior_knowledge(
        job.joint, estimate, given, job.stated, job.input_unit, thresholds
    )
    estimate = joined.estimate
    contradicted = (
        *contradictions(job.stated.given, reported.at_bound, choice.full, whole, thresholds),
        *joined.contradicted,
    )
    squares = _least_squares(choice.structure, timely, reported, filter_rate)
    unknowns = reported.problem.unknowns
    coefficients = coefficient_estimates(
        estimate,
        job.joint,
        unknowns,
        row_sizes(squares.rows),
        without_estimate(reported.at_bound, job.stated.given),
        job.input_unit,
        thresholds,
    )
    parameters = parameter_estimates(
        job.joint, estimate, unknowns, coefficients, job.input_unit, thresholds, joined.exact
    )
    if contradicted:  # nothing that rests on it is known
        doubt: dict[str, Any] = {"verdict": "undetermined", "reason": contradicted[0]}
        coefficients = {name: replace(c, **doubt) for name, c in coefficients.items()}
        parameters = {name: replace(p, **doubt) for name, p in parameters.items()}
    turned = turned_round(
        choice.full, recordings.whole, recordings.groups, thresholds.mirrored_share
    )
    compliance = _compliance(choice.structure, coefficients, recordings, validation, progress)
    choices = _choices(choice, full, estimate, settings, filter_rate)
    if job.delay_in_doubt:
        choices = replace(choices, alignment=in_doubt(choices.alignment, estimate))
    return Identification(
        model=job.joint.kind,
        coefficients=coefficients,
        parameters=parameters,
        least_squares={n: v for n, v in _values(squares).items() if n in coefficients},
        excitation={r.name: row_excitation(r, ()) for r in squares.rows if r.coefficients},
        residual_excess=_residual_excess(reported),
        model_error=error,
        validation=validation,
        compliance=compliance,
        observer=_stream(choice.structure, recordings, choices.alignment),
        removed=_removed(job, full, given, error, parameters, thresholds),
        fit=estimate,
        choices=choices,
        summary=summary(choices, job.joint.kind, asked=settings.model != "auto"),
        warnings=(
            *(warning for log in logs for warning in log.warnings),
            *dropped,
            *retreat,
            *contradicted,
            *joined.against,
            *deflection_warnings(turned_round=turned),
            *sign_warnings(coefficients),
            *model_warnings(error, job.joint.kind, row),
            *validation_warnings(validation.fit_percent),
            *compliance_warnings(compliance),
        ),
        provenance=provenance(logs, settings, job.joint.kind, choices),
        recordings=recordings.whole,
        link_row=row,
    )


def _reported(choice: Choice, whole: Data) -> tuple[Fitted, list[Fitted], tuple[str, ...]]:
    """The structure fitted to all data; where that fails, as it was fitted to choose."""
    try:
        start = {**choice.structure.timing.delays, **choice.fitted.by_name}
        return *fit_to(choice.structure, whole, start, choice.duration), ()
    except ConvergenceError:
        return (
            choice.fitted,
            [choice.fitted],
            (
                "the fit to all data does not converge, so the values are those of the data before "
                "the held-out end: check what happened there",
            ),
        )


def _compliance(
    structure: Structure,
    coefficients: Mapping[str, CoefficientEstimate],
    recordings: SplitRecordings,
    validation: Validation,
    progress: Progress,
) -> Compliance:
    """Whether the log shows that the joint is flexible."""
    kind = structure.joint.kind
    if kind == "rigid":
        return one_encoder()
    if kind == "link":
        return of_link_alone(recordings, validation, coefficients["theta2"])
    progress("the rigid joint as a rival")
    return compare_with_rigid(structure, recordings, validation)


def _full(choice: Choice, whole: Data, reported: Fitted) -> Fitted:
    """The model with all usual terms again, fitted to all data, to say how large they may be."""
    shapes = choice.structure.joint.shapes & choice.structure.absent
    usual = replace(
        choice.full,
        absent=choice.full.absent | shapes,
        fixed={**choice.full.fixed, **reported.at_bound},
    )
    try:
        return refit(
            usual,
            whole,
            reported.by_name,
            reported.problem.segments,
            FINE,
            reported.minimum.point.initial_states,
        )
    except ConvergenceError:
        return expanded(usual, reported)


def _removed(
    job: Job,
    full: Fitted,
    given: Mapping[str, float],
    error: ModelError,
    kept: Mapping[str, ParameterEstimate],
    thresholds: Thresholds,
) -> dict[str, ParameterEstimate]:
    """Parameters of the full model that the reported one does without; none if it has no fit."""
    if not np.isfinite(full.minimum.last_step):
        return {}
    estimate = widened_by(full, error)
    if job.delay_in_doubt:
        estimate = estimate.widened(confused_covariance(estimate))
    unknowns = full.problem.unknowns
    every = coefficient_estimates(
        estimate, job.joint, unknowns, {}, without_estimate(full.at_bound, given), job.input_unit
    )
    found = parameter_estimates(job.joint, estimate, unknowns, every, job.input_unit, thresholds)
    return {name: p for name, p in found.items() if name not in kept}


def _gravity(full: Structure) -> frozenset[str]:
    """Gravity, if the log might show it."""
    return frozenset({"theta1", "gamma1"} - full.absent)


def _scales(full: Fitted, squares: LeastSquaresFit) -> dict[str, float]:
    """How large each coefficient may be: as much as moves its row as it does move; and delays."""
    sizes = row_sizes(squares.rows)
    scales = {name: 1.0 / size for name, size in sizes.items() if size > 0.0}
    return scales | dict.fromkeys(full.structure.timing.sought, full.data.margin)


def _timely(reported: Fitted, recordings: SplitRecordings) -> Data:
    """All data with the channels' delays corrected."""
    alignment = _alignment(reported.structure, reported.delays)
    timely = [with_velocities(aligned(recording, alignment)) for recording in recordings.whole]
    return data_of(reported.structure.joint, timely, recordings.groups)


def _least_squares(
    structure: Structure, timely: Data, reported: Fitted, filter_rate: float
) -> LeastSquaresFit:
    """Least squares of the same unknowns on aligned data: what each does to its row."""
    bare = replace(structure, fixed={**structure.fixed, **reported.at_bound})
    return least_squares_start(bare, timely, filter_rate)[1]


def _alignment(structure: Structure, delays: Mapping[str, float]) -> Alignment:
    """Delays as they are to be corrected, no more."""
    input_delay, link_delay = (
        Delay(delays.get(name, 0.0), 0.0, (0.0, 0.0), "given") for name in (INPUT, LINK)
    )
    return Alignment(structure.timing.hold, input_delay, link_delay, "")


def _values(fit: LeastSquaresFit) -> dict[str, float]:
    return dict(zip(fit.names, fit.values.tolist(), strict=True))


def _residual_excess(reported: Fitted) -> dict[str, float]:
    """Residual of each position over its sensor's noise, as root mean squares."""
    ratios = reported.minimum.noise(reported.problem) / reported.data.noise
    rows = [row.name for row in reported.problem.unknowns.system.rows]
    names = ["motor" if name == "rigid" else name for name in rows]
    return {f"{name}_position": float(r) for name, r in zip(names, ratios, strict=True)}


def _stream(
    structure: Structure, recordings: SplitRecordings, alignment: Alignment
) -> ObserverTrace:
    """The paper's observer with the same terms, as far as it needs no derivative of the input."""
    joint = structure.joint
    timely = [with_velocities(aligned(recording, alignment)) for recording in recordings.whole]
    unknowns = smooth_unknowns(structure, recordings.groups)
    hold = "zero" if structure.timing.hold == "zero" else "linear"
    return stream([joint.samples(recording) for recording in timely], unknowns, hold)


def without_estimate(
    at_bound: Mapping[str, float], given: Mapping[str, float]
) -> dict[str, tuple[float, str]]:
    """What was not estimated, and why."""
    fixed = {name: (value, "given") for name, value in given.items()}
    return fixed | {name: (value, "at its bound") for name, value in at_bound.items()}


def _choices(
    choice: Choice,
    full: Fitted,
    estimate: Estimate,
    settings: Settings,
    filter_rate: float,
) -> Choices:
    delays = {name: _delay(name, settings, estimate, full) for name in (INPUT, LINK)}
    joint = choice.structure.joint
    smooth = settings.coulomb_velocity
    return Choices(
        terms=choice.structure.terms,
        alignment=Alignment(
            choice.structure.timing.hold, delays[INPUT], delays[LINK], choice.climbed.hold_reason
        ),
        hold=choice.structure.timing.hold,
        coulomb_velocity=joint.smooth.constants[SMOOTHING] if smooth != "auto" else None,
        filter_rate=filter_rate,
        estimator="prediction-error",
        segment_duration=choice.duration,
        term_evidence=_evidence(choice),
        segment_evidence=choice.lengths,
        shapes={} if joint.shapes <= choice.structure.absent else dict(joint.extended.constants),
    )


def _evidence(choice: Choice) -> tuple[TermEvidence, ...]:
    """What the full model says of each term, and whether it was kept in the end."""
    structure = choice.structure
    kept = structure.joint.optional - structure.absent | {*structure.timing.sought}
    return tuple(replace(e, kept=e.name.partition("[")[0] in kept) for e in choice.terms)


def _delay(name: str, settings: Settings, estimate: Estimate, full: Fitted) -> Delay:
    """A delay as it was found, or, of one that is none, as large as it could be."""
    asked = settings.input_delay if name == INPUT else settings.link_delay
    if not isinstance(asked, str):
        return Delay(asked, 0.0, (asked, asked), "given")
    found = estimate if name in estimate.names else Estimate.of(full.fit)
    if name not in found.names:
        return Delay(0.0, 0.0, (0.0, 0.0), "none")
    place = found.names.index(name)
    value, std = float(found.values[place]), float(found.deviations[place])
    ends = interval(value, std, found.degrees_of_freedom[place])
    if found is estimate:
        return Delay(value, std, ends, "found")
    return Delay(0.0, std, ends, "none")
