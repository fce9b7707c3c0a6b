"""What the sums of a stream determine, beside what its head does.

Least squares takes no account of what the prediction error does: friction that is dry, noise in the
regressors, terms beyond the usual ones. How far that matters the head shows: there least squares at
other filter rates, and the prediction error, should say the same, and the whole log should say what
its head says. Where they do not, and noise does not explain it, the difference counts as a standard
deviation.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import nan
from typing import Any

import numpy as np

from flexid.arrays import FloatArray
from flexid.estimators.bounded import bounded_fit
from flexid.estimators.segmented_motion import SegmentedMotion, segmented_motion
from flexid.estimators.segments import divide
from flexid.estimators.state_variable_filter import LeastSquaresFit
from flexid.estimators.streamed_least_squares import StreamedFit
from flexid.estimators.unknowns import Unknowns
from flexid.identification.estimation.excitations import row_excitation, row_sizes
from flexid.identification.estimation.knowledge import with_prior_knowledge
from flexid.identification.full_model.model import Data, data_of
from flexid.identification.identify import without_estimate
from flexid.identification.judgement.estimates import (
    coefficient_estimates,
    parameter_estimates,
    widest,
)
from flexid.identification.preparation.settings import Settings
from flexid.identification.preparation.stated import stated
from flexid.identification.result.identification import Identification
from flexid.identification.result.summary import summary
from flexid.identification.result.warnings import (
    compliance_warnings,
    model_warnings,
    sign_warnings,
    validation_warnings,
)
from flexid.identification.structure.validation import residuals_over_noise, validate_with
from flexid.identification.vocabulary.estimate import Estimate
from flexid.identification.vocabulary.evidence import Validation
from flexid.identification.vocabulary.intervals import quantile
from flexid.identification.vocabulary.thresholds import THRESHOLDS
from flexid.long_logs.stream_task import HeldOut, StreamTask
from flexid.recording.caution import Rank, cautions, ranked
from flexid.recording.stream import LogStream

# Multiples of the filter rate at which a right model gives the same answer. Slower filters see
# another part of the motion and hardly any noise; beyond twice the rate noise in the regressors
# biases the answer.
_RATES = (0.125, 0.25, 0.5, 2.0)

_MATTERS = 0.01  # of a coefficient's value, from which on a warning says that it moves
_SEGMENT_DURATION = 1.0  # s over which the model has to follow what was kept out, if none is chosen


def stream_result(
    task: StreamTask,
    stream: LogStream,
    head: Identification,
    settings: Settings,
    held_out: Sequence[HeldOut],
) -> Identification:
    """Everything that the sums determine, beside what the head does."""
    joint, structure = task.joint, task.structure
    input_unit = stream.head.recordings[0].input_unit
    sought = set(task.problem.unknowns.names)
    bounds = {c: ends for c, ends in structure.bounds.items() if c in sought}
    start, at_bound = bounded_fit(task.sums.fit, task.problem.unknowns, bounds)
    unknowns = task.problem.unknowns.fixing(at_bound)
    given = {**structure.fixed, **at_bound}
    here = task.of_head(unknowns)
    shifts = estimator_shifts(task, unknowns, here, head)
    changes = _apart(here, start.values, _half_widths(start))
    found = Estimate.of(start).widened(np.diag(shifts**2 + changes**2))
    said = stated(settings, joint, input_unit)
    joined = with_prior_knowledge(joint, found, given, said, input_unit, THRESHOLDS)
    estimate = joined.estimate
    trained = task.sums.fit(unknowns, [held.products for held in held_out])
    predicted = _predicted(task, unknowns, trained.values, held_out, head)
    contradicted = (*_contradicted(head, structure.fixed), *joined.contradicted)
    fixed = without_estimate(at_bound, structure.fixed)
    sizes = row_sizes(start.rows)
    estimates = coefficient_estimates(estimate, joint, unknowns, sizes, fixed, input_unit)
    parameters = parameter_estimates(
        joint, estimate, unknowns, estimates, input_unit, exact=joined.exact
    )
    if contradicted:
        doubt: dict[str, Any] = {"verdict": "undetermined", "reason": contradicted[0]}
        estimates = {name: replace(c, **doubt) for name, c in estimates.items()}
        parameters = {name: replace(p, **doubt) for name, p in parameters.items()}
    choices = task.choices(head.choices)
    left_out = sorted(set(head.choices.terms) - set(choices.terms))
    values = dict(zip(start.names, start.values.tolist(), strict=True))
    return replace(
        head,
        coefficients=estimates,
        parameters=parameters,
        least_squares={name: value for name, value in values.items() if name in estimates},
        excitation={row.name: row_excitation(row, ()) for row in start.rows if row.coefficients},
        residual_excess=predicted.residual_excess,
        validation=predicted.validation,
        removed={name: p for name, p in head.removed.items() if name not in parameters},
        fit=estimate,
        choices=choices,
        summary=(*summary(choices, head.model), _sentence(stream, held_out)),
        warnings=ranked(
            (
                *stream.head.warnings,
                *stream.warnings,
                *cautions(Rank.MODEL, _stream_warnings(left_out, start, shifts, changes)),
                *cautions(Rank.SCALE, (*contradicted, *joined.against)),
                *sign_warnings(estimates, ()),
                *model_warnings(head.model_error, head.model, widest(estimates, sizes)),
                *validation_warnings(predicted.validation.fit_percent),
                *compliance_warnings(head.compliance),
            )
        ),
        provenance={
            **head.provenance,
            "inputs": [{**stream.head.provenance, "sha256": stream.sha256}],
            "stream": {"rows": stream.rows, "head_rows": stream.head_rows},
        },
    )


def estimator_shifts(
    task: StreamTask, unknowns: Unknowns, here: LeastSquaresFit, head: Identification
) -> FloatArray:
    """How far each coefficient moves over the head with the way it is estimated."""
    others = [task.of_head(unknowns, factor) for factor in _RATES]
    shifts = [_apart(here, other.values, _half_widths(other)) for other in others]
    predicted = [head.coefficients.get(name) for name in here.names]
    values = np.array([nan if c is None else c.value for c in predicted])
    half_widths = np.array([nan if c is None else 0.5 * np.ptp(c.interval) for c in predicted])
    return np.max([*shifts, _apart(here, values, half_widths)], axis=0)


def _apart(here: LeastSquaresFit, values: FloatArray, half_widths: FloatArray) -> FloatArray:
    """How far values are from a fit's; 0 where noise explains it.

    Two estimates from the same log share part of their noise, so the root of the sum of the squares
    of their intervals' half-widths bounds what noise alone does to their difference. What is beyond
    counts whole: the same error that moves one fit may have widened the other's interval.
    """
    with np.errstate(invalid="ignore"):
        apart = np.abs(values - here.values)
        explained = apart <= np.hypot(_half_widths(here), half_widths)
    return np.where(explained | ~np.isfinite(apart), 0.0, apart)


def _half_widths(fit: LeastSquaresFit | StreamedFit) -> FloatArray:
    """Half the width of each coefficient's interval; infinite where there is none."""
    quantiles = [quantile(freedom) for freedom in fit.degrees_of_freedom]
    with np.errstate(invalid="ignore"):
        return np.asarray(quantiles) * fit.standard_deviations


@dataclass(frozen=True)
class _Predicted:
    """What the stretches that were kept out say of values fitted without them."""

    validation: Validation
    residual_excess: dict[str, float]


def _predicted(
    task: StreamTask,
    unknowns: Unknowns,
    values: FloatArray,
    held_out: Sequence[HeldOut],
    head: Identification,
) -> _Predicted:
    """Predict the stretches that were kept out, with dry friction where the head has it."""
    joint = task.joint
    if not held_out:
        return _Predicted(Validation(dict.fromkeys(joint.channels, nan), ()), {})
    groups = (0,) * len(held_out)
    data = data_of(joint, [held.recording for held in held_out], groups)
    model = replace(unknowns, system=joint.system, groups=groups)
    problem = _motion(task, model, data)
    starts = [held.start for held in held_out]
    duration = head.choices.segment_duration or _SEGMENT_DURATION
    return _Predicted(
        validate_with(joint, problem, values, data, starts),
        residuals_over_noise(problem, values, data, duration),
    )


def _motion(task: StreamTask, unknowns: Unknowns, data: Data) -> SegmentedMotion:
    segments = divide(data.samples, data.duration)
    motion = segmented_motion(unknowns.system, segments, task.structure.timing, unknowns)
    return replace(motion, weights=1.0 / data.noise)


def _contradicted(head: Identification, given: Mapping[str, float]) -> tuple[str, ...]:
    """What the head says against coefficients that are known exactly."""
    known = [head.coefficients[name] for name in given if name in head.coefficients]
    return tuple(dict.fromkeys(c.reason for c in known if c.verdict != "determined"))


def _stream_warnings(
    left_out: Sequence[str], fit: StreamedFit, shifts: FloatArray, changes: FloatArray
) -> Iterator[str]:
    """Warn of what least squares does not have, and of what moves."""
    advice = "a shorter part of the log without --stream determines more"
    if left_out:
        yield (
            f"the head of the log shows {', '.join(left_out)}, which least squares of a stream "
            f"does not have: {advice}"
        )
    moved = _named(fit, shifts)
    if moved:
        yield (
            f"over the head of the log {moved} by least squares differently from the prediction "
            f"error; the intervals make allowance for that, and {advice}"
        )
    changed = _named(fit, changes)
    if changed:
        yield (
            f"over the whole log {changed} differently from its head: the drive changed on the "
            f"way; the intervals make allowance for that"
        )


def _named(fit: StreamedFit, moves: FloatArray) -> str:
    """Coefficients that move by enough to matter, as the subject of a sentence."""
    matters = moves > np.fmax(_MATTERS * np.abs(fit.values), 2.0 * fit.standard_deviations)
    names = [name for name, it_does in zip(fit.names, matters, strict=True) if it_does]
    if not names:
        return ""
    verb = "come" if len(names) > 1 else "comes"
    return f"{', '.join(names)} {verb} out"


def _sentence(stream: LogStream, held_out: Sequence[HeldOut]) -> str:
    """What the stream did, for the summary."""
    head = stream.head_rows * stream.sample_time
    whole = stream.rows * stream.sample_time
    kept_out = (
        "1 stretch of it was" if len(held_out) == 1 else f"{len(held_out)} stretches of it were"
    )
    runs = f"; {kept_out} kept out and predicted" if held_out else ""
    return (
        f"Stream: all of this was chosen on the first {head:.4g} s; then {stream.rows} samples "
        f"({_duration(whole)}) were fitted in one pass{runs}."
    )


def _duration(seconds: float) -> str:
    for unit, size in (("h", 3600.0), ("min", 60.0)):
        if seconds >= size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds:.3g} s"
