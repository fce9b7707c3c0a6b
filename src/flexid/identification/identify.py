"""The main job: logs and a model become an estimate with intervals and a verdict."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace

import flexid
from flexid.errors import ConvergenceError
from flexid.estimators.prediction_error import PredictionErrorFit
from flexid.estimators.state_variable_filter import LeastSquaresFit
from flexid.identification import intervals
from flexid.identification.alignment import Alignment, aligned, estimate_alignment
from flexid.identification.candidate import Candidate, Fitted
from flexid.identification.choose import Choice, choose
from flexid.identification.compliance import compare_with_rigid, one_encoder
from flexid.identification.estimates import coefficient_estimates, parameter_estimates
from flexid.identification.findings import findings
from flexid.identification.friction_shape import with_friction_shape
from flexid.identification.joint import SMOOTHED_FRICTION, Joint, flexible, rigid
from flexid.identification.observer_stream import stream
from flexid.identification.preparation import Pieces, prepare
from flexid.identification.prior_knowledge import Known, informed
from flexid.identification.result import Choices, Identification, ObserverTrace
from flexid.identification.settings import Auto, Settings, check_for
from flexid.identification.summary import summary
from flexid.identification.term_choice import with_stopping_time
from flexid.identification.validation import validate
from flexid.identification.warnings import (
    compliance_warnings,
    residual_warnings,
    sign_warnings,
    validation_warnings,
)
from flexid.models.flexible_joint import STOPPING
from flexid.models.terms import SMOOTHING
from flexid.recording.recording import Log, Recording

Progress = Callable[[str], None]

AnyFitted = Fitted[LeastSquaresFit] | Fitted[PredictionErrorFit]


def _silent(_: str) -> None:
    pass


def identify(
    logs: Sequence[Log], settings: Settings | None = None, progress: Progress = _silent
) -> Identification:
    """Identify a joint from one or several logs.

    The channels are aligned in time; terms, segment length and estimator are chosen on the data
    before the held-out end of each piece; the model is fitted to that data and run freely over the
    ends; and it is fitted once more, to all data, for the report.

    Parameters
    ----------
    logs : sequence of Log
        Of the same drive, with the same kind of input and the same encoders. With one encoder the
        joint is taken as rigid.
    settings : Settings, optional
        Choices; see there.
    progress : callable, optional
        Told of each step in words.

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
        If prediction error is insisted upon and does not converge.
    """
    settings = settings or Settings()
    pieces, dropped = prepare(logs, settings.validation_share)
    input_unit = pieces.recorded[0].input_unit
    joint = rigid() if pieces.recorded[0].link_position is None else flexible()
    check_for(joint, settings)
    fixed = settings.fixed_coefficients(input_is_torque=input_unit == "N m")

    pieces, alignment, choice = _best_choice(joint, pieces, fixed, settings, progress)
    candidate = choice.candidate

    progress("free run over the held-out data")
    trained, _ = _fit(candidate, pieces.fitted, pieces.groups, settings)
    coefficients = trained.coefficients(len(pieces.recorded))
    trained_joint = _as_fitted(candidate, trained).joint
    validation = validate(trained_joint, pieces, coefficients, candidate.hold)

    progress("fit to all data")
    reported, retreat = _fit(candidate, pieces.whole, pieces.groups, settings)
    candidate = _as_fitted(candidate, reported)
    widened = with_friction_shape(candidate, reported, pieces.whole, pieces.groups)
    given = {**fixed, **reported.at_bound}
    fit, contradictions, known = with_prior_knowledge(joint, widened, given, settings, input_unit)
    found = findings(
        candidate,
        pieces,
        reported,
        fit,
        known,
        choice.shifts,
        validation.fit_percent,
        alignment.deflection_doubt,
    )
    estimates = coefficient_estimates(
        fit,
        found.evidence,
        candidate.joint.units,
        without_estimate(reported.at_bound, fixed),
        input_unit,
    )
    progress("the rigid joint as a rival")
    compliance = (
        compare_with_rigid(candidate, pieces, validation)
        if joint.kind == "flexible"
        else one_encoder()
    )
    choices = _choices(candidate, choice, pieces, alignment, reported)
    return Identification(
        model=joint.kind,
        coefficients=estimates,
        parameters=parameter_estimates(
            candidate.joint, fit, reported.unknowns, estimates, input_unit
        ),
        least_squares={
            name: value
            for name, value in zip(found.start.names, found.start.values.tolist(), strict=True)
            if name in estimates
        },
        excitation=found.excitation,
        residual_excess=found.residual_excess,
        validation=validation,
        compliance=compliance,
        observer=_stream(candidate, pieces),
        fit=fit,
        choices=choices,
        summary=summary(choices, reported.fit, found.start),
        warnings=(
            *(warning for log in logs for warning in log.warnings),
            *dropped,
            *retreat,
            *contradictions,
            *sign_warnings(estimates),
            *residual_warnings(found.residual_excess),
            *validation_warnings(validation.fit_percent),
            *compliance_warnings(compliance),
        ),
        provenance=_provenance(logs, settings, choices),
    )


def _best_choice(
    joint: Joint,
    recorded: Pieces,
    fixed: Mapping[str, float],
    settings: Settings,
    progress: Progress,
) -> tuple[Pieces, Alignment, Choice]:
    """Align the channels and choose the rest; a delay of the input must pay in the free run.

    What the model lacks can look like a delay. So where one is found, all is chosen once more
    without it, and the better of both repeats the data better.
    """

    def chosen(input_delay: float | Auto) -> tuple[Pieces, Alignment, Choice]:
        progress("time alignment")
        alignment = estimate_alignment(
            recorded.fitted, settings.hold, input_delay, settings.link_delay
        )
        pieces = recorded.changed(
            lambda piece: aligned(piece, alignment), settings.validation_share
        )
        return pieces, alignment, choose(joint, pieces, alignment, fixed, settings, progress)

    first = chosen(settings.input_delay)
    if first[1].input_delay.status != "found":
        return first
    second = chosen(0.0)
    if first[2].error <= second[2].error:
        return first
    doubted = replace(
        first[1].input_delay,
        value=0.0,
        status="none",
        reason="with the delay that fits best, the free run repeats the held-out motion worse",
    )
    return second[0], replace(second[1], input_delay=doubted), second[2]


def _fit(
    candidate: Candidate,
    recordings: Sequence[Recording],
    groups: Sequence[int],
    settings: Settings,
) -> tuple[AnyFitted, tuple[str, ...]]:
    """Fit as chosen; where that fails and was not asked for, least squares with a warning."""
    if candidate.segment_duration == 0:
        return candidate.least_squares(recordings, groups), ()
    try:
        fitted = with_stopping_time(candidate, recordings, groups)
        return fitted.prediction_error(recordings, groups), ()
    except ConvergenceError as error:
        if settings.estimator == "prediction-error":
            raise
        return candidate.least_squares(recordings, groups), (
            f"{error}; the values are those of least squares",
        )


def _as_fitted(candidate: Candidate, fitted: AnyFitted) -> Candidate:
    """The candidate with the constants of a fit: friction's stopping time is fitted each time."""
    return replace(candidate, joint=replace(candidate.joint, system=fitted.unknowns.system))


def _stream(candidate: Candidate, pieces: Pieces) -> ObserverTrace:
    """The paper's observer with the same terms, as far as it needs no derivative of the input."""
    joint, terms = candidate.joint, candidate.terms
    if "motor_stiction" in terms:
        joint = flexible().with_coulomb_velocity(joint.system.constants[SMOOTHING])
        terms = tuple("motor_coulomb" if t == "motor_stiction" else t for t in terms)
    unknowns = joint.unknowns(terms, candidate.fixed)
    return stream(candidate.samples(pieces.whole), unknowns, candidate.hold)


def with_prior_knowledge(
    joint: Joint,
    fit: intervals.Fitted,
    given: Mapping[str, float],
    settings: Settings,
    input_unit: str,
) -> tuple[intervals.Fitted, tuple[str, ...], frozenset[str]]:
    """The fit with what is known uncertainly joined to it.

    Beside it where the two contradict each other, and the coefficients that are known by that.
    """
    uncertain = [
        Known(name, settings.known[name], std)
        for name, std in settings.known_deviations.items()
        if std > 0
    ]
    if not uncertain:
        return fit, (), frozenset()
    parameters = joint.parameters({*fit.names, *given}, input_unit == "N m")
    both = informed(fit, uncertain, parameters, given)
    of = {p.name: [c for c in p.coefficients if c in fit.names] for p in parameters}
    known = [of.get(item.name, [item.name]) for item in uncertain]
    # What is known of several coefficients together leaves each of them to be sought.
    return both, both.warnings, frozenset(c for names in known if len(names) == 1 for c in names)


def without_estimate(
    at_bound: Mapping[str, float], given: Mapping[str, float]
) -> dict[str, tuple[float, str]]:
    """What was not estimated, and why."""
    fixed = {name: (value, "given") for name, value in given.items()}
    return fixed | {name: (value, "at its bound") for name, value in at_bound.items()}


def _choices(
    candidate: Candidate, choice: Choice, pieces: Pieces, alignment: Alignment, reported: AnyFitted
) -> Choices:
    constants = candidate.joint.system.constants
    finished = isinstance(reported.fit, PredictionErrorFit)
    smoothed = bool(SMOOTHED_FRICTION & set(candidate.terms))
    holding = "motor_stiction" in candidate.terms
    longest = max(len(piece) * piece.sample_time for piece in pieces.recorded)
    return Choices(
        terms=candidate.terms,
        alignment=alignment,
        hold=candidate.hold,
        coulomb_velocity=constants[SMOOTHING] if smoothed else None,
        stopping_time=constants[STOPPING] if holding else None,
        filter_rate=candidate.filter_rate,
        estimator="prediction-error" if finished else "least-squares",
        # No segment is longer than its piece.
        segment_duration=min(candidate.segment_duration, longest) if finished else None,
        term_evidence=choice.terms,
        segment_evidence=choice.segments,
    )


def _provenance(logs: Sequence[Log], settings: Settings, choices: Choices) -> dict[str, object]:
    return {
        "flexid_version": flexid.__version__,
        "settings": asdict(settings),
        "chosen": {
            "terms": list(choices.terms),
            "hold": choices.hold,
            "input_delay": choices.alignment.input_delay.value,
            "link_delay": choices.alignment.link_delay.value,
            "coulomb_velocity": choices.coulomb_velocity,
            "stopping_time": choices.stopping_time,
            "filter_rate": round(choices.filter_rate, 6),
            "estimator": choices.estimator,
            "segment_duration": choices.segment_duration,
        },
        "inputs": [{"file": log.source, "sha256": log.sha256} for log in logs],
    }
