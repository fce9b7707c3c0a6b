"""What the sums of a stream tell, beside what its head does."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import nan

from flexid.estimators.bounded import bounded_fit
from flexid.estimators.samples import FloatArray
from flexid.identification.estimates import (
    coefficient_estimates,
    parameter_estimates,
    row_evidence,
)
from flexid.identification.findings import rate_shifts, row_excitation
from flexid.identification.identify import with_prior_knowledge, without_estimate
from flexid.identification.preparation import Pieces
from flexid.identification.residuals import residual_excess
from flexid.identification.result import Identification, Validation
from flexid.identification.settings import Settings
from flexid.identification.stream_task import HeldOut, StreamTask
from flexid.identification.validation import validate
from flexid.identification.warnings import (
    compliance_warnings,
    residual_warnings,
    sign_warnings,
    validation_warnings,
)
from flexid.recording.stream import LogStream


def stream_result(
    task: StreamTask,
    stream: LogStream,
    head: Identification,
    settings: Settings,
    held_out: Sequence[HeldOut],
) -> Identification:
    """Everything that the sums tell, beside what the head does."""
    candidate, joint = task.candidate, task.candidate.joint
    input_unit = stream.head.pieces[0].input_unit
    start, at_bound = bounded_fit(task.sums.fit, task.problem.unknowns, candidate.active_bounds())
    unknowns = task.problem.unknowns.fixing(at_bound)
    given = {**candidate.fixed, **at_bound}
    fit, contradictions, known = with_prior_knowledge(joint, start, given, settings, input_unit)
    trained = task.sums.fit(unknowns, [held.products for held in held_out])
    validation = _validation(task, unknowns.coefficients(trained.values, 0), held_out)
    excess = residual_excess(start, unknowns, candidate.samples(task.head.whole))
    rows = [row for row in start.rows if row.coefficients]
    evidence = row_evidence(
        fit,
        start,
        _head_shifts(task, at_bound),
        excess,
        {row.name: row_excitation(row, known) for row in rows},
        validation.fit_percent,
        task.alignment.deflection_doubt,
    )
    fixed = without_estimate(at_bound, candidate.fixed)
    estimates = coefficient_estimates(fit, evidence, joint.units, fixed, input_unit)
    values = dict(zip(start.names, start.values.tolist(), strict=True))
    return replace(
        head,
        coefficients=estimates,
        parameters=parameter_estimates(joint, fit, unknowns, estimates, input_unit),
        least_squares={name: value for name, value in values.items() if name in estimates},
        excitation={row.name: row_excitation(row, ()) for row in rows},
        residual_excess=excess,
        validation=validation,
        fit=fit,
        summary=(*head.summary, _sentence(stream, held_out)),
        warnings=(
            *stream.head.warnings,
            *stream.warnings,
            *contradictions,
            *sign_warnings(estimates),
            *residual_warnings(excess),
            *validation_warnings(validation.fit_percent),
            *compliance_warnings(head.compliance),
        ),
        provenance={
            **head.provenance,
            "inputs": [{"file": stream.file, "sha256": stream.sha256}],
            "stream": {"rows": stream.rows, "head_rows": stream.head_rows},
        },
    )


def _validation(
    task: StreamTask, coefficients: FloatArray, held_out: Sequence[HeldOut]
) -> Validation:
    """Free runs over the stretches that were kept out of the fit."""
    if not held_out:
        return Validation(dict.fromkeys(task.candidate.joint.channels, nan), ())
    pieces = Pieces(
        tuple(held.recording for held in held_out),
        tuple(held.start for held in held_out),
        (0,) * len(held_out),
    )
    every = [coefficients] * len(held_out)
    return validate(task.candidate.joint, pieces, every, task.candidate.hold)


def _head_shifts(task: StreamTask, at_bound: Mapping[str, float]) -> dict[str, float]:
    """How far the coefficients move with the filter rate, over the head."""
    same = replace(task.candidate, fixed={**task.candidate.fixed, **at_bound}, bounds={})
    fit = same.least_squares(task.head.whole, task.head.groups).fit
    return rate_shifts(same, task.head, fit)


def _sentence(stream: LogStream, held_out: Sequence[HeldOut]) -> str:
    """What the stream did, for the summary."""
    head = stream.head_rows * stream.sample_time
    whole = stream.rows * stream.sample_time
    runs = f"; free runs over {len(held_out)} stretches of it" if held_out else ""
    return (
        f"Stream: all of this was chosen on the first {head:.4g} s; then {stream.rows} samples "
        f"({_duration(whole)}) were fitted in one pass{runs}."
    )


def _duration(seconds: float) -> str:
    for unit, size in (("h", 3600.0), ("min", 60.0)):
        if seconds >= size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds:.3g} s"
