"""Identification of a long log in bounded memory: choices on its head, then one streaming pass."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import RecordingError, SettingError
from flexid.files import sha256, shown
from flexid.identification.identify import identify
from flexid.identification.judgement import widest
from flexid.identification.preparation.joint import joint_of
from flexid.identification.preparation.recordings import MEMORY
from flexid.identification.preparation.settings import Settings
from flexid.identification.preparation.stated import stated
from flexid.identification.result import (
    Choices,
    Identification,
    amplifier_warnings,
    compliance_warnings,
    model_warnings,
    sign_warnings,
    summary,
    validation_warnings,
)
from flexid.identification.vocabulary import Progress, silent
from flexid.identification.vocabulary.evidence import Estimate, ValueEstimate, quantile
from flexid.models.flexible_joint import SHAPE_TERMS, SMOOTHING
from flexid.readers.formats import PARQUET
from flexid.readers.guard import Reading
from flexid.recording.read import log_of_table
from flexid.recording.recipes import MapSource
from flexid.recording.recording import Log, Rank, cautions, ranked
from flexid.recording.sampling import EVEN, GAP
from flexid.recording.series import Signals, names_of
from flexid.recording.velocities import with_velocities
from flexid.streaming.incoming import Replay
from flexid.streaming.learner import findings, regressor_sizes
from flexid.streaming.options import WatchOptions, options_of_stream
from flexid.streaming.session import Session

HEAD_ROWS = 120_000  # samples of the head, which decides all choices: two minutes at 1 kHz
_LEAST_CHANGE = 0.01  # of a coefficient, relative to its value, for a warning


def identify_stream(
    path: Path,
    columns: MapSource | None = None,
    settings: Settings | None = None,
    progress: Progress = silent,
) -> Identification:
    """Identify a joint from a Parquet file in one pass, in bounded memory."""
    settings = settings or Settings()
    if settings.model != "auto":
        raise SettingError("model", "follows from the channels in a stream: omit it")
    progress("reading the head")
    log, head_rows, all_rows = _head(path, columns)
    for channel in log.turned:
        reason = "counts against the motor's direction: write scale = -1 for it in a column map"
        raise RecordingError(shown(path), channel, reason)
    found = identify([log], settings, progress)
    if found.choices.amplifier.filters_positions:
        reason = "seem to have been low-passed, which a stream cannot correct: omit --stream"
        raise RecordingError(shown(path), "positions", reason)
    progress("streaming")
    with closing(Replay(path, columns, found.model)) as replay:
        session = Session(_options(replay, log, found, settings))
        clock = _Clock(replay.name, session.options.sample_time)
        earlier = np.empty(0)
        for samples in replay:
            clock.check(samples[:, 0])
            if session.options.n_inputs:
                logged = samples[:, -1].copy()
                samples[:, -1] = found.choices.amplifier.reached(
                    logged, session.options.sample_time, earlier
                )
                earlier = np.concatenate((earlier, logged))[-MEMORY:]
            session.feed(samples)
            share = f"{100 * session.fed / all_rows:.0f} %"
            progress(f"{share} of {all_rows / 1e6:.3g} million samples")
    result = _result(session, found, settings, log.warnings)
    h = session.options.sample_time
    summary = (
        *result.summary,
        f"Stream: these choices rest on the first {head_rows * h:.4g} s; then {session.fed} "
        f"samples ({session.fed * h:.6g} s) were fitted in one pass.",
    )
    inputs = [{**log.provenance, "sha256": sha256(path)}]
    stream = {"rows": session.fed, "head_rows": head_rows}
    provenance = {**found.provenance, "inputs": inputs, "stream": stream}
    return replace(result, summary=summary, provenance=provenance)


def _head(path: Path, columns: MapSource | None) -> tuple[Log, int, int]:
    """Return the first rows of a Parquet file as a log, their number, and the file's number."""
    if path.suffix.lower() not in PARQUET.suffixes:
        reason = "only a Parquet file can be streamed: write the log as .parquet"
        raise RecordingError(shown(path), "", reason)
    with Reading(path) as reading:
        names_of(reading)  # raises if there are no samples
        rows = reading.series[0].length
        table = next(Signals(reading, columns).tables(min(rows, HEAD_ROWS)))
    return log_of_table(table, columns, is_stream=True), table.frame.height, rows


def _options(replay: Replay, log: Log, head: Identification, settings: Settings) -> WatchOptions:
    """Return the stream's options from the head's identification and the user's settings."""
    channels = replay.channels
    joint = joint_of(channels.kind, channels.joint_type)
    terms = _usual_terms(head)
    given = stated(replace(settings, terms=terms), joint, channels.input_unit).given
    chosen: dict[str, Any] = {
        "terms": terms,
        "known": settings.known,
        "known_deviations": settings.known_deviations,
        "filter_rate": settings.filter_rate,
        "coulomb_velocity": settings.coulomb_velocity,
    }
    if settings.coulomb_velocity == "auto":  # the velocity suited to the head's motion
        moving = [joint.samples(with_velocities(recording)) for recording in log.recordings]
        chosen["coulomb_velocity"] = joint.scaled(moving).smooth.constants[SMOOTHING]
    sample_time = log.recordings[0].sample_time
    options = options_of_stream(chosen, head, channels, sample_time, given)
    return replace(options, reference={})  # the head is no independent reference


def _usual_terms(head: Identification) -> tuple[str, ...]:
    """Return the head's terms that recursive least squares supports."""
    return tuple(term for term in head.choices.terms if term not in SHAPE_TERMS)


@dataclass
class _Clock:
    """Check that a log's time steps are even, as a session assumes."""

    file: str
    sample_time: float  # s
    rows: int = 0
    last: float = np.nan  # s

    def check(self, time: FloatArray) -> None:
        """Check the time stamps of the next samples, in s; raise if a step is uneven."""
        h = self.sample_time
        steps = np.diff(time, prepend=self.last)
        near = np.abs(steps - h) <= 2.0 * EVEN * h
        uneven = ~near & (steps > 0.0) & (steps < GAP * h)
        if uneven.any():
            index = int(np.argmax(uneven))
            raise RecordingError(
                self.file,
                f"row {self.rows + index + 1}",
                f"the time step is {1e3 * steps[index]:.6g} ms where the sample time is "
                f"{1e3 * h:.6g} ms, and a stream is not interpolated: resample the log to even "
                f"times, or identify a shorter part of it without --stream",
            )
        self.rows, self.last = self.rows + len(time), float(time[-1])


def _result(
    session: Session,
    found: Identification,
    settings: Settings,
    warnings: Sequence[str],
) -> Identification:
    """Return the head's identification with the values that the session determined."""
    learner, states, options = session.learner, session.now.states, session.options
    estimate = learner.estimate(states)
    # If the drive has changed, the head's values are no reference.
    before = {} if session.n_changes else found.coefficients
    noisy = learner.noise_estimate(states)
    apart = _excess_difference(noisy, before)
    own = replace(
        settings,
        terms=_usual_terms(found),
        known=options.known,
        known_deviations=options.known_deviations,
    )
    prior = stated(own, options.joint, options.input_unit)
    now = findings(learner, states, estimate.widened(np.diag(apart**2)), prior)
    given = [c for name in options.stated.given if (c := found.coefficients.get(name))]
    reasons = dict.fromkeys(c.reason for c in given if c.verdict != "determined")
    contradicted = (*reasons, *now.contradicted)
    if contradicted:  # then no value can be trusted
        coefficients, parameters = (
            {name: e.unknown(contradicted[0]) for name, e in each.items()}
            for each in (now.coefficients, now.parameters)
        )
        now = replace(now, coefficients=coefficients, parameters=parameters)
    choices, sizes = _choices(found, options), regressor_sizes(learner, states)
    values = estimate.by_name
    return replace(
        found,
        coefficients=now.coefficients,
        parameters=now.parameters,
        least_squares={name: value for name, value in values.items() if name in now.coefficients},
        excitation=session.excitation,
        removed={name: p for name, p in found.removed.items() if name not in now.parameters},
        fit=now.estimate,
        choices=choices,
        summary=summary(choices, found.model),
        warnings=ranked(
            (
                *warnings,
                *cautions(Rank.DATA, _data_warnings(session)),
                *cautions(Rank.MODEL, _stream_warnings(found, noisy, apart)),
                *cautions(Rank.SCALE, (*contradicted, *now.against)),
                *sign_warnings(now.coefficients, ()),
                *amplifier_warnings(found.choices.amplifier, found.recordings[0].input_unit),
                *model_warnings(found.model_error, found.model, widest(now.coefficients, sizes)),
                *validation_warnings(found.validation.fit_percent),
                *compliance_warnings(found.compliance),
            )
        ),
        recordings=(),
        # The pass fits the input as logged.
        disturbances=found.disturbances and replace(found.disturbances, input_noise=0.0),
    )


def _excess_difference(estimate: Estimate, head: Mapping[str, ValueEstimate]) -> FloatArray:
    """Return how far values are from the head's, shape (k,); 0 where noise explains it."""
    found = np.zeros(len(estimate.names))
    for place, name in enumerate(estimate.names):
        (value, std, freedom), of_head = estimate.of(name), head.get(name)
        if of_head is None or not freedom > 0.0:
            continue
        half, other = quantile(freedom) * std, of_head.half_width
        apart = abs(value - of_head.value)
        # Both share the head's noise, so noise alone makes no larger difference than this.
        if np.isfinite(apart) and apart > np.hypot(half, other):
            found[place] = apart
    return found


def _choices(head: Identification, options: WatchOptions) -> Choices:
    """Return the head's choices, changed where recursive least squares differs."""
    smoothed = any(
        SMOOTHING in row.regressors.get(name, "")
        for row in options.system.rows
        for name in row.coefficients
    )
    return replace(
        head.choices,
        terms=_usual_terms(head),
        coulomb_velocity=options.coulomb_velocity if smoothed else None,
        filter_rate=options.filter_rate,
        estimator="least-squares",
        segment_duration=None,
    )


def _data_warnings(session: Session) -> Iterator[str]:
    """Yield warnings of unusable samples and of changes of the drive."""
    counts = session.counts
    if counts.taken < counts.fed or counts.gaps or counts.wraps:
        yield counts.sentence
    for change in session.changes[-3:]:
        yield f"{change.sentence}; the values are those since then"


def _stream_warnings(head: Identification, estimate: Estimate, apart: FloatArray) -> Iterator[str]:
    """Yield warnings of unsupported terms and of values that differ from the head's."""
    advice = "a shorter part of the log without --stream determines more"
    gone = sorted({*head.choices.terms} - {*_usual_terms(head)})
    if gone:
        yield (
            f"the head of the log shows {', '.join(gone)}, which recursive least squares does not "
            f"support: {advice}"
        )
    least = np.fmax(_LEAST_CHANGE * np.abs(estimate.values), 2.0 * estimate.deviations)
    moved = [name for name, differs in zip(estimate.names, apart > least, strict=True) if differs]
    if moved:
        verb = "differ" if len(moved) > 1 else "differs"
        yield (
            f"{', '.join(moved)} by least squares over the whole log {verb} from the fit to its "
            f"head: friction is sharper than the smoothed model, a channel is late, or the drive "
            f"changed; the intervals are widened by the difference, and {advice}"
        )
