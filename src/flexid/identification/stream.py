"""Identification of a log of any length, in one pass over its file.

What is chosen for the user is chosen on the head of the log, in memory, as for any log. Then the
whole log streams through least squares with these choices, while short stretches of it, spread
evenly, are kept out of the fit and run freely in the end.
"""

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property
from math import ceil, nan
from pathlib import Path

from flexid.errors import SettingError
from flexid.estimators.block_sandwich import block_size
from flexid.estimators.bounded import bounded_fit
from flexid.estimators.row_signals import needs_velocities
from flexid.estimators.samples import FloatArray
from flexid.estimators.streamed_least_squares import (
    Products,
    StreamedProblem,
    StreamedSums,
)
from flexid.identification.alignment import Alignment, aligned
from flexid.identification.candidate import Candidate
from flexid.identification.estimates import (
    coefficient_estimates,
    parameter_estimates,
    row_evidence,
)
from flexid.identification.findings import rate_shifts, row_excitation
from flexid.identification.identify import identify, with_prior_knowledge, without_estimate
from flexid.identification.joint import flexible, rigid
from flexid.identification.preparation import Pieces, prepare
from flexid.identification.residuals import residual_excess
from flexid.identification.result import Identification, Validation
from flexid.identification.settings import Settings
from flexid.identification.validation import validate
from flexid.identification.warnings import (
    compliance_warnings,
    residual_warnings,
    sign_warnings,
    validation_warnings,
)
from flexid.models.flexible_joint import with_stopping_time
from flexid.recording.recording import CHANNELS, Recording
from flexid.recording.stream import LogStream
from flexid.recording.velocities import best_half_window, with_velocities
from flexid.recording.windows import Window, windows

HEAD_ROWS = 120_000
"""Samples at the beginning that choices are made on: two minutes at 1 kHz."""

_WINDOW = 65_536  # samples that are worked on at once
_LARGEST_MARGIN = 262_144  # samples; beyond it the memory would be that of a long window
_SETTLING = 128  # samples after which no all-pass filter of an alignment remembers its start
_FEWEST_SAMPLES = 75  # of a piece
_FREE_RUNS = 8  # stretches that are kept out of the fit
_FREE_RUN_DURATION = 10.0  # s of each

Progress = Callable[[str], None]
Advance = Callable[[int, int], None]


def _silent(_: str) -> None:
    pass


def _unseen(_: int, __: int) -> None:
    pass


def identify_stream(
    path: Path,
    columns: Path | None = None,
    settings: Settings | None = None,
    progress: Progress = _silent,
    advance: Advance = _unseen,
    workers: int = 2,
) -> Identification:
    """Identify a joint from a Parquet file in one pass, in bounded memory.

    Parameters
    ----------
    path : Path
        The log.
    columns : Path, optional
        A TOML column map.
    settings : Settings, optional
        Choices; the estimator is least squares.
    progress : callable, optional
        Told of each step in words.
    advance : callable, optional
        Told of rows done and rows in all.
    workers : int, optional
        Threads that filter, beside the one that reads. They change no digit of the answer.

    Returns
    -------
    Identification
        Of the whole log but for `compliance`, `observer` and `choices`, which are those of its
        head.

    Raises
    ------
    RecordingError
        If the log, or some row of it, cannot be used.
    SettingError
        If a setting does not suit the log, or prediction error is wanted, which needs the whole
        log in memory.
    """
    settings = settings or Settings()
    if settings.estimator == "prediction-error":
        raise SettingError(
            "estimator",
            "prediction error needs the whole log in memory, so a stream is fitted by least "
            "squares: leave the estimator out, or identify a shorter part without --stream",
        )
    settings = replace(settings, estimator="least-squares")
    progress("reading the head")
    stream = LogStream(path, columns, HEAD_ROWS)
    head = identify([stream.head], settings, progress)
    task = _task(stream, head, settings)
    progress("streaming")
    held_out = _pass(task, stream, advance, workers)
    progress("free runs over the stretches kept out")
    return _result(task, stream, head, settings, held_out)


@dataclass(frozen=True, eq=False)
class _Task:
    """What was chosen on the head, and what the stream adds up.

    Parameters
    ----------
    candidate : Candidate
        The model with its choices.
    alignment : Alignment
        Hold and delays.
    head : Pieces
        The head, aligned.
    sums : StreamedSums
        Of the whole log.
    sample_time : float
        In s.
    """

    candidate: Candidate
    alignment: Alignment
    head: Pieces
    sums: StreamedSums
    sample_time: float

    @property
    def problem(self) -> StreamedProblem:
        """What is sought."""
        return self.sums.problem

    @cached_property
    def half_windows(self) -> tuple[int, int] | None:
        """Half the windows that velocities are derived with; None where none are needed."""
        if not needs_velocities(self.problem.unknowns):
            return None
        longest = max(self.head.recorded, key=len)
        positions = self.candidate.joint.samples(longest).positions.T
        halves = [best_half_window(position) for position in positions]
        return halves[0], halves[-1]

    @property
    def shifted(self) -> bool:
        """Whether a channel is late."""
        return any(delay.value for delay in (self.alignment.input_delay, self.alignment.link_delay))

    @property
    def margin(self) -> int:
        """Samples around a window's own that its equations depend on."""
        delays = (self.alignment.input_delay.value, self.alignment.link_delay.value)
        samples = self.problem.warm_up(self.sample_time) + _SETTLING
        samples += sum(ceil(abs(delay) / self.sample_time) + 8 for delay in delays)
        return samples + max(self.half_windows or (0,))

    @property
    def free_run_blocks(self) -> int:
        """Blocks that a stretch kept out of the fit takes."""
        return ceil(_FREE_RUN_DURATION / (self.problem.block * self.sample_time))


def _task(stream: LogStream, head: Identification, settings: Settings) -> _Task:
    """The choices of the head's identification, and the problem that they make."""
    choices = head.choices
    input_unit = stream.head.pieces[0].input_unit
    joint = rigid() if head.model == "rigid" else flexible()
    if "motor_stiction" in choices.terms:
        joint = flexible("motor_stiction")
    if choices.coulomb_velocity is not None:
        joint = joint.with_coulomb_velocity(choices.coulomb_velocity)
    if choices.stopping_time is not None:
        values = {name: estimate.value for name, estimate in head.coefficients.items()}
        system = with_stopping_time(joint.system, choices.stopping_time, values)
        joint = replace(joint, system=system)
    fixed = settings.fixed_coefficients(input_is_torque=input_unit == "N m")
    candidate = Candidate(
        joint, choices.terms, choices.hold, choices.filter_rate, 0.0, fixed, settings.bounds
    )
    share = settings.validation_share
    pieces, _ = prepare([stream.head], share)
    pieces = pieces.changed(lambda piece: aligned(piece, choices.alignment), share)
    unbounded = replace(candidate, bounds={})
    reference = unbounded.least_squares(pieces.whole, pieces.groups).fit.values
    unknowns = candidate.unknowns((0,))
    most = max(len(unknowns.names_of(row)) for row in unknowns.system.rows)
    duration = stream.rows * stream.sample_time
    block = block_size(duration, stream.sample_time, choices.filter_rate, most)
    problem = StreamedProblem(unknowns, reference, choices.filter_rate, choices.hold, block)
    task = _Task(candidate, choices.alignment, pieces, StreamedSums(problem), stream.sample_time)
    if task.margin > _LARGEST_MARGIN:
        raise SettingError(
            "filter-rate",
            f"{choices.filter_rate:.3g} 1/s is too slow for a stream with a sample time of "
            f"{1e3 * stream.sample_time:.3g} ms: set it to "
            f"{50.0 / (_LARGEST_MARGIN * stream.sample_time):.2g} 1/s or more",
        )
    return task


@dataclass(frozen=True, eq=False)
class _HeldOut:
    """A stretch that is kept out of the fit.

    Parameters
    ----------
    recording : Recording
        The stretch, aligned, and as much before it.
    start : int
        Where it begins.
    products : Products
        Its equations.
    """

    recording: Recording
    start: int
    products: Products


def _pass(task: _Task, stream: LogStream, advance: Advance, workers: int) -> list[_HeldOut]:
    """Stream the whole log through the sums; return what was kept out."""
    block = task.problem.block
    length = max(1, round(max(_WINDOW, task.margin) / block)) * block
    stretches = windows(stream.chunks(), length, task.margin, block, _FEWEST_SAMPLES)
    held_out = []
    pending: deque[Future[tuple[Products, _HeldOut | None]]] = deque()

    def collect() -> None:
        products, held = pending.popleft().result()
        task.sums.add(products)
        if held is not None:
            held_out.append(held)

    with ThreadPoolExecutor(workers) as pool:
        try:
            for window, kept_out in _with_marks(stretches, stream.rows):
                pending.append(pool.submit(_products, task, window, kept_out))
                advance(window.row + window.stop, stream.rows)
                if len(pending) > workers:
                    collect()
            while pending:
                collect()
        finally:
            for future in pending:
                future.cancel()
    return held_out


def _with_marks(stretches: Iterable[Window], rows: int) -> Iterator[tuple[Window, bool]]:
    """Each window, and whether a stretch at its end is kept out: `_FREE_RUNS` of them, evenly."""
    told = 0
    for window in stretches:
        reached = (window.row + window.stop) * _FREE_RUNS // rows
        yield window, reached > told
        told = max(told, reached)


def _products(task: _Task, window: Window, kept_out: bool) -> tuple[Products, _HeldOut | None]:
    """Products of a window's equations, and the stretch at its end that is kept out."""
    recording = window.recording
    if task.shifted:
        recording = aligned(recording, task.alignment)
    if task.half_windows is not None:
        recording = with_velocities(recording, task.half_windows)
    samples = task.candidate.joint.samples(recording)
    skipped = window.start - window.offset
    # Of a piece's last window, all equations there are; alignment may have made it shorter.
    stop = len(samples) - 2 if window.last else window.stop - window.offset
    products = task.problem.products(samples, skipped, stop - skipped, window.offset == 0)
    if not kept_out:
        return products, None
    taken = min(task.free_run_blocks, len(products.lengths) // 3)
    if taken == 0:
        return products, None
    out = Products(tuple(row[-taken:].copy() for row in products.rows), products.lengths[-taken:])
    length = sum(out.lengths)
    stretch = recording.window(stop - 2 * length, stop)
    return products, _HeldOut(_copied(stretch), length, out)


def _copied(recording: Recording) -> Recording:
    """The recording with channels of its own, so that the window they are from can go."""
    channels = {
        name: values.copy() for name in CHANNELS if (values := getattr(recording, name)) is not None
    }
    return replace(recording, **channels)


def _result(
    task: _Task,
    stream: LogStream,
    head: Identification,
    settings: Settings,
    held_out: Sequence[_HeldOut],
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
            "stream": {"rows": stream.rows, "head_rows": min(stream.rows, HEAD_ROWS)},
        },
    )


def _validation(task: _Task, coefficients: FloatArray, held_out: Sequence[_HeldOut]) -> Validation:
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


def _head_shifts(task: _Task, at_bound: Mapping[str, float]) -> dict[str, float]:
    """How far the coefficients move with the filter rate, over the head."""
    same = replace(task.candidate, fixed={**task.candidate.fixed, **at_bound}, bounds={})
    fit = same.least_squares(task.head.whole, task.head.groups).fit
    return rate_shifts(same, task.head, fit)


def _sentence(stream: LogStream, held_out: Sequence[_HeldOut]) -> str:
    """What the stream did, for the summary."""
    head = min(stream.rows, HEAD_ROWS) * stream.sample_time
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
