"""Identification of a joint: from logs and a model to an estimate with intervals and verdicts.

The steps are recordings, full model, structure, estimate, judgement and result.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from flexid.errors import ConvergenceError
from flexid.estimators.channel_timing import INPUT
from flexid.identification.estimation.answers import Answer
from flexid.identification.estimation.doubts import OF_A_LOG
from flexid.identification.estimation.excitations import row_excitation, row_sizes
from flexid.identification.estimation.final_fits import FinalFits
from flexid.identification.estimation.inputs import answer_with_amplifier
from flexid.identification.estimation.knowledge import contradictions, with_prior_knowledge
from flexid.identification.estimation.neglected_deflection import (
    gravity_of,
    like_a_spring,
    with_bending,
    with_hidden_spring,
)
from flexid.identification.full_model.model import LINK, Fitted
from flexid.identification.judgement import (
    Judge,
    constant_estimates,
    of_joint,
    of_link_alone,
    widest,
    without_unused_link,
)
from flexid.identification.preparation.joint import Kind
from flexid.identification.preparation.recordings import Alignment, Delay, prepare
from flexid.identification.preparation.settings import Auto, Settings
from flexid.identification.result import (
    Choices,
    Identification,
    amplifier_warnings,
    compliance_warnings,
    division_warnings,
    model_warnings,
    one_way_warnings,
    provenance,
    sign_warnings,
    summary,
    validation_warnings,
)
from flexid.identification.structure.job import Job, job_of
from flexid.identification.structure.link_delay import confused_covariance, in_doubt, skew
from flexid.identification.structure.sought_terms import sought_constants
from flexid.identification.vocabulary import Progress, silent
from flexid.identification.vocabulary.evidence import (
    Compliance,
    Estimate,
    Validation,
    ValueEstimate,
    Verdict,
    interval,
)
from flexid.identification.vocabulary.thresholds import THRESHOLDS, Thresholds
from flexid.models.flexible_joint import POSITIVE, SMOOTHING
from flexid.models.motion import unit_of
from flexid.models.physical import Directional, Sum
from flexid.recording.recording import Caution, Log, Rank, cautions, rank_of, ranked
from flexid.recording.slow_motion import is_of_the_spring, late_input

# Half-width over the value from which a difference between logs is named. Friction of one drive
# differs by some per cent from log to log; another payload changes the link's inertia by more.
_UNLIKE = 0.05
_SPRING_SENSOR = Caution(
    "the input is the spring's torque, as from a sensor at the joint, so it shows neither inertia "
    "nor friction of the motor: log the motor's torque, current or voltage; without this column, "
    "the link's ratios are known better",
    Rank.MODEL,
)
_TAKEN_AS_RIGID = Caution(
    "the log determines neither an inertia nor the stiffness of a flexible joint, so the drive was "
    "taken as rigid: inertia and friction are those of motor and link together; excite the "
    "resonance, use finer encoders, or see what little is known with `--model flexible`",
    Rank.MOTION,
)
_HIDDEN_SPRING = Caution(
    "the inertia grows with the frequency of the motion, as if the joint bends: the intervals "
    "allow for that; log link_position to identify the spring",
    Rank.MODEL,
)
_NOT_CONVERGED = (
    "the fit does not converge, so the value is unknown: identify a part of the log, "
    "or fewer terms with `--terms`"
)


def identify(
    logs: Sequence[Log],
    settings: Settings | None = None,
    progress: Progress = silent,
    thresholds: Thresholds = THRESHOLDS,
) -> Identification:
    """Identify a joint from one or several logs.

    The full model is fitted to the data before each recording's held-out end. Terms that these
    data do not show are removed. The remaining structure predicts the held-out ends. It is then
    fitted to all data for the report.
    """
    settings = settings or Settings()

    def job_with(model: Kind | Auto) -> tuple[Job, tuple[str, ...]]:
        recordings, dropped = prepare(logs, settings.validation_share, model)
        return job_of(recordings, settings, progress, thresholds), dropped

    job, dropped = job_with(settings.model)
    if not _may_be_rigid(job):
        return _identified(job, logs, dropped)
    found, problems = None, []
    with suppress(ConvergenceError):
        found = _identified(job, logs, dropped)
        if "determined" in _verdicts(found):
            return found
        problems = [text for text in found.warnings if rank_of(text) == Rank.SCALE]
    progress("a rigid drive")
    job, dropped = job_with("rigid")
    try:
        rigid = _identified(job, logs, (*dropped, _TAKEN_AS_RIGID, *problems))
    except ConvergenceError:
        if found is None:
            raise
        return found
    nothing: set[Verdict] = {"undetermined"}
    if found is None or (
        # Weak values of a flexible joint are safer than those of a rigid one with disturbances.
        _verdicts(rigid) != nothing and (not rigid.disturbances or _verdicts(found) == nothing)
    ):
        return rigid
    return found


def _may_be_rigid(job: Job) -> bool:
    """Whether a flexible joint may be taken as rigid, since the user asked nothing else."""
    settings = job.settings
    is_free = settings.model == settings.terms == "auto" and not (settings.known or settings.bounds)
    return job.joint.kind == "flexible" and is_free and not job.clamped


def _verdicts(found: Identification) -> set[Verdict]:
    """Return the verdicts on inertias and stiffness, their ratios and the sum of the inertias."""
    every = {**found.coefficients, **found.parameters}
    return {every[name].verdict for name in every.keys() & {*POSITIVE, "total_inertia"}}


def _identified(job: Job, logs: Sequence[Log], dropped: Sequence[str]) -> Identification:
    """Return the identification of a job; `dropped` are warnings about its recordings."""
    settings, thresholds = job.settings, job.thresholds
    job, found, amplifier = answer_with_amplifier(job)
    found, bending = _with_neglected_deflection(job, found, logs)
    exact = found.disturbances is None
    fits, validation, choice = found.fits, found.validation, found.fits.choice
    numbers = _numbers(job, fits, found)
    # Of a coefficient that a doubt makes unknown, the sign has no meaning.
    known_sign = {n: c for n, c in numbers.coefficients.items() if n not in found.doubted}
    compliance = _compliance(job, numbers.coefficients, validation)
    if (found.doubts or not exact) and np.isfinite(compliance.deflection):
        moved = f"{compliance.deflection:.2g} {unit_of('rad', job.joint.type)}"
        reason = f"the deflection moves by {moved}, {found.prediction}"
        compliance = replace(compliance, visible="theta2" not in found.doubted, reason=reason)
    choices = replace(_choices(fits, numbers.estimate, settings), amplifier=amplifier)
    if job.delay_in_doubt:
        choices = replace(choices, alignment=in_doubt(choices.alignment, numbers.estimate))
    if settings.link_delay == "auto" and LINK in choice.structure.timing.delays:
        skewed = skew(job.joint, job.whole)
        choices = replace(choices, alignment=skewed.delays_the_link(choices.alignment))
    return Identification(
        model=job.joint.kind,
        joint=job.joint.type,
        coefficients=numbers.coefficients,
        parameters=numbers.parameters,
        least_squares={n: v for n, v in fits.squares.by_name.items() if n in numbers.coefficients},
        excitation={r.name: row_excitation(r) for r in fits.squares.rows if r.coefficients},
        residual_excess=fits.residual_excess,
        model_error=fits.error,
        validation=validation,
        compliance=compliance,
        removed=_removed(job, fits, numbers.parameters),
        fit=numbers.estimate,
        choices=choices,
        summary=summary(choices, job.joint.kind, asked=settings.model != "auto"),
        warnings=ranked(
            (
                *(warning for log in logs for warning in log.warnings),
                *dropped,
                *_clock_warnings(job, logs),
                *found.doubts,
                *bending,
                *cautions(Rank.MODEL, found.retreat),
                *cautions(Rank.MODEL, _unlike_logs(numbers.parameters, found)),
                *cautions(Rank.SCALE, (*numbers.contradicted, *numbers.against)),
                *amplifier_warnings(amplifier, job.input_unit),
                *sign_warnings(known_sign, fits.driving),
                *(one_way_warnings(fits.one_way) if exact else ()),
                *(numbers.without_motor or division_warnings(numbers.parameters)),
                *model_warnings(
                    fits.error, job.joint.kind, numbers.widest, found.disturbances, thresholds
                ),
                *(validation_warnings(_moving_channels(job, validation)) if exact else ()),
                *(compliance_warnings(compliance) if exact else ()),
            )
        ),
        provenance=provenance(logs, settings, job.joint.kind, choices),
        recordings=job.recordings.whole,
        disturbances=found.disturbances,
    )


def _with_neglected_deflection(
    job: Job, found: Answer, logs: Sequence[Log]
) -> tuple[Answer, tuple[Caution, ...]]:
    """Return the answer with the doubt that a rigid joint bends, and a warning if it seems to."""
    if job.joint.kind != "rigid":
        return found, ()
    recordings = [recording for log in logs for recording in log.recordings]
    if any(recording.link_position is not None for recording in recordings):
        return replace(found, estimate=with_bending(found.estimate, recordings)), ()
    if (spring := like_a_spring(found.estimate, recordings)) is not None:
        found = replace(
            found, doubts=(*found.doubts, spring), doubted=frozenset(gravity_of(found.estimate))
        )
    # The positions of an exact fit show the inertia at the lowest frequencies.
    if found.disturbances is None or "beta1" not in found.estimate.names:
        return found, ()
    reported = found.fits.reported
    known = {**reported.structure.fixed, **reported.structure.timing.delays, **reported.at_bound}
    estimate, share = with_hidden_spring(found.estimate, recordings, known)
    noted = 2.0 * share > job.thresholds.noted_width  # two deviations are half an interval
    return replace(found, estimate=estimate), (_HIDDEN_SPRING,) if noted else ()


def _moving_channels(job: Job, validation: Validation) -> dict[str, float]:
    """Return the fits in per cent of the channels that are not clamped."""
    return {name: fit for name, fit in validation.fit_percent.items() if name not in job.clamped}


class _Numbers(NamedTuple):
    """Reported values, and the contradictions between the log and the known values."""

    estimate: Estimate
    coefficients: dict[str, ValueEstimate]
    parameters: dict[str, ValueEstimate]
    contradicted: tuple[str, ...]
    against: tuple[str, ...]
    widest: float
    without_motor: tuple[Caution, ...]


def _numbers(job: Job, fits: FinalFits, found: Answer) -> _Numbers:
    """Join the prior knowledge to the estimate, and judge each value."""
    reported, full, thresholds = fits.reported, fits.choice.full, job.thresholds
    estimate = found.estimate.without_knowledge_of(fits.unexcited(thresholds.lost_share))
    given = {**job.stated.given, **reported.at_bound}
    joined = with_prior_knowledge(
        job.joint, estimate, given, job.stated, job.input_unit, thresholds
    )
    contradicted = (
        *contradictions(job.stated.given, reported, full, thresholds),
        *joined.contradicted,
    )
    sizes = row_sizes(fits.squares.rows)
    judge = _judge(job, reported)
    fixed = without_estimate(reported.at_bound, job.stated.given)
    coefficients, parameters = judge.judged(joined.estimate, fixed, sizes, joined.exact)
    coefficients = {name: c.because(*_main_causes(c, found)) for name, c in coefficients.items()}
    parameters = {name: p.because(*_main_causes(p, found)) for name, p in parameters.items()}
    constants = sought_constants(joined.estimate, reported.structure)
    parameters |= constant_estimates(job.joint, constants, parameters, thresholds)
    if job.link_is_clamped:
        remaining = (*parameters.values(), *coefficients.values())
        joined = replace(joined, estimate=without_unused_link(joined.estimate, remaining))
    against = contradicted[0] if contradicted else "" if reported.converged else _NOT_CONVERGED
    half = widest(coefficients, sizes)
    has_motor = job.joint.kind != "flexible" or not all(
        map(is_of_the_spring, job.recordings.recorded)
    )
    without_motor = () if has_motor else (_SPRING_SENSOR,)

    def with_unknown(values: Mapping[str, ValueEstimate]) -> dict[str, ValueEstimate]:
        """Mark values as unknown after a contradiction, or if the log shows no spring."""
        lost = {name: against for name in values if against}
        if found.doubts:
            spring = (name for name, e in values.items() if found.doubted & e.slopes.keys())
            lost |= dict.fromkeys(spring, str(found.doubts[0]))
        if without_motor:
            motor = (name for name in values if "motor" in name or name == "total_inertia")
            lost |= dict.fromkeys(motor, "the input is the spring's torque")
        return {n: e.unknown(lost[n]) if n in lost else e for n, e in values.items()}

    return _Numbers(
        joined.estimate,
        with_unknown(coefficients),
        with_unknown(parameters),
        contradicted,
        joined.against,
        half,
        without_motor,
    )


def _judge(job: Job, fitted: Fitted) -> Judge:
    """Return the judge of a fit's values."""
    unknowns, clamped = fitted.problem.unknowns, job.link_is_clamped
    return Judge(job.joint, unknowns, job.input_unit, job.thresholds, clamped)


def _main_causes(estimate: ValueEstimate, found: Answer) -> dict[str, None]:
    """Return the main causes of the interval widths of a value's coefficients."""
    return dict.fromkeys(found.widest.get(name, "") for name in estimate.slopes)


def _unlike_logs(parameters: Mapping[str, ValueEstimate], found: Answer) -> Iterator[str]:
    """Warn of parameters whose intervals are wide mainly because they differ between the logs."""
    names = [
        name
        for name, each in parameters.items()
        if OF_A_LOG in _main_causes(each, found) and each.half_width > _UNLIKE * abs(each.value)
    ]
    if names:
        yield (
            f"the logs differ in {', '.join(names)}, by more than their noise: identify each log "
            f"alone, or only logs with the same load and at the same temperature"
        )


def _clock_warnings(job: Job, logs: Sequence[Log]) -> Iterator[str]:
    """Warn of inputs whose clock differs from the encoders', which no fitted delay can correct."""
    if job.joint.kind == "flexible" and job.settings.input_delay == "auto":
        for log in logs:
            yield from late_input(max(log.recordings, key=len))


def _compliance(
    job: Job, coefficients: Mapping[str, ValueEstimate], validation: Validation
) -> Compliance:
    """Whether the log shows that the joint is flexible."""
    if job.joint.kind == "rigid":
        reason = "the joint was taken as rigid, so there is no compliance to see"
        return Compliance(False, reason, np.nan, np.nan)
    if job.joint.kind == "link":
        return of_link_alone(job.recordings, validation, coefficients["theta2"])
    return of_joint(job.recordings, validation)


def _removed(
    job: Job, fits: FinalFits, kept: Mapping[str, ValueEstimate]
) -> dict[str, ValueEstimate]:
    """Return parameters of the full model's removed terms; none if that model has no fit."""
    full = fits.full
    if not np.isfinite(full.minimum.last_step):
        return {}
    estimate = fits.in_full
    if job.delay_in_doubt:
        estimate = estimate.widened(confused_covariance(estimate))
    given = {**job.stated.given, **fits.reported.at_bound}
    _, found = _judge(job, full).judged(estimate, without_estimate(full.at_bound, given))
    # Without asymmetry, friction by direction equals the reported mean. The parts of a sum are
    # reported themselves.
    known = {*kept} | {
        p.name
        for p in job.joint.parameters(full.structure.joint.units, job.input_unit)
        if isinstance(p, Directional | Sum)
    }
    return {name: p for name, p in found.items() if name not in known}


def without_estimate(
    at_bound: Mapping[str, float], given: Mapping[str, float]
) -> dict[str, tuple[float, str]]:
    """Return values that were not estimated, each with the reason."""
    fixed = {name: (value, "given") for name, value in given.items()}
    return fixed | {name: (value, "at its bound") for name, value in at_bound.items()}


def _choices(fits: FinalFits, estimate: Estimate, settings: Settings) -> Choices:
    choice = fits.choice
    delays = {name: _delay(name, settings, estimate, fits.in_full) for name in (INPUT, LINK)}
    joint, smooth = choice.structure.joint, settings.coulomb_velocity
    kept = joint.optional - choice.structure.absent | {*choice.structure.timing.sought}
    return Choices(
        terms=choice.structure.terms,
        alignment=Alignment(
            choice.structure.timing.hold, delays[INPUT], delays[LINK], choice.by_length.hold_reason
        ),
        hold=choice.structure.timing.hold,
        coulomb_velocity=joint.smooth.constants[SMOOTHING] if smooth != "auto" else None,
        filter_rate=fits.filter_rate,
        estimator="innovations" if fits.reported.problem.observer else "prediction-error",
        segment_duration=choice.duration,
        term_evidence=tuple(
            replace(e, kept=e.name.partition("[")[0] in kept) for e in choice.terms
        ),
        segment_evidence=choice.lengths,
        shapes=joint.constants_of(joint.optional - choice.structure.absent),
    )


def _delay(name: str, settings: Settings, estimate: Estimate, in_full: Estimate) -> Delay:
    """Return the delay as found; for a removed delay, zero with its interval in the full model."""
    asked = settings.input_delay if name == INPUT else settings.link_delay
    if not isinstance(asked, str):
        return Delay(asked, 0.0, (asked, asked), "given")
    found = estimate if name in estimate.names else in_full
    if name not in found.names:
        return Delay(0.0, 0.0, (0.0, 0.0), "none")
    value, std, freedom = found.of(name)
    ends = interval(value, std, freedom)
    if found is estimate:
        return Delay(value, std, ends, "found")
    return Delay(0.0, std, ends, "none")
