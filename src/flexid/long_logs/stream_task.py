"""What a stream is to add up: the choices that its head gives."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import ceil

import numpy as np

from flexid.errors import SettingError
from flexid.estimators.block_sandwich import block_size
from flexid.estimators.channel_timing import Timing
from flexid.estimators.row_signals import needs_velocities
from flexid.estimators.state_variable_filter import LeastSquaresFit, filtered_least_squares
from flexid.estimators.streamed_least_squares import Products, StreamedProblem, StreamedSums
from flexid.estimators.unknowns import Unknowns
from flexid.identification.full_model.model import Structure
from flexid.identification.full_model.starting import smooth_unknowns
from flexid.identification.preparation.alignment import Alignment, aligned
from flexid.identification.preparation.joint import Joint, joint_of
from flexid.identification.preparation.recordings import prepare
from flexid.identification.preparation.settings import Settings
from flexid.identification.preparation.stated import stated
from flexid.identification.result.identification import Choices, Identification
from flexid.models.terms import SMOOTHING
from flexid.recording.recording import Recording
from flexid.recording.stream import LogStream
from flexid.recording.velocities import best_half_window, with_velocities

_LARGEST_MARGIN = 262_144  # samples; beyond it the memory would be that of a long window
_SETTLING = 128  # samples after which no all-pass filter of an alignment remembers its start
_FREE_RUN_DURATION = 10.0  # s of each


@dataclass(frozen=True, eq=False)
class StreamTask:
    """What was chosen on the head, and what the stream adds up."""

    # The model with its choices; no delays, for channels are aligned beforehand
    structure: Structure
    alignment: Alignment  # Hold and delays
    head: tuple[Recording, ...]  # Recordings of the head, aligned, with velocities
    sums: StreamedSums  # Of the whole log
    sample_time: float  # In s

    @property
    def joint(self) -> Joint:
        """What is identified."""
        return self.structure.joint

    @property
    def problem(self) -> StreamedProblem:
        """What is sought."""
        return self.sums.problem

    @cached_property
    def half_windows(self) -> tuple[int, int] | None:
        """Half the windows that velocities are derived with; None where none are needed."""
        if not needs_velocities(self.problem.unknowns):
            return None
        longest = max(self.head, key=len)
        halves = [
            best_half_window(position) for position in self.joint.samples(longest).positions.T
        ]
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

    def of_head(self, unknowns: Unknowns, rate_factor: float = 1.0) -> LeastSquaresFit:
        """Least squares of the head, in memory, at a multiple of the filter rate."""
        return _least_squares(self.joint, self.head, unknowns, self.problem, rate_factor)

    def choices(self, head: Choices) -> Choices:
        """What holds for the stream of what was chosen on the head."""
        smooth = self.joint.smooth
        smoothed = any(
            SMOOTHING in row.regressors.get(name, "")
            for name in self.problem.unknowns.names
            for row in smooth.rows
        )
        return replace(
            head,
            terms=self.structure.terms,
            coulomb_velocity=smooth.constants[SMOOTHING] if smoothed else None,
            filter_rate=self.problem.filter_rate,
            estimator="least-squares",
            segment_duration=None,
        )


def stream_task(stream: LogStream, head: Identification, settings: Settings) -> StreamTask:
    """The choices of the head's identification, and the problem that they make."""
    choices = head.choices
    recordings, _ = prepare([stream.head], settings.validation_share)
    joint = joint_of(head.model)
    # As wide as in the head, whose shapes are those of the data before its held-out ends.
    joint = joint.scaled([joint.samples(recording) for recording in recordings.fitted])
    if choices.coulomb_velocity is not None:
        joint = joint.with_coulomb_velocity(choices.coulomb_velocity)
    on = {c for term in choices.terms for c in joint.terms[term]}
    # Least squares takes the usual terms alone.
    absent = joint.optional - (on & set(joint.smooth.coefficients))
    input_unit = stream.head.recordings[0].input_unit
    said = stated(settings, joint, input_unit)
    timing = Timing(choices.hold)
    structure = Structure(joint, frozenset(absent), timing, said.given, said.bounds)
    unknowns = smooth_unknowns(structure, (0,))
    timely = tuple(
        with_velocities(aligned(recording, choices.alignment)) for recording in recordings.recorded
    )
    rate = choices.filter_rate if isinstance(settings.filter_rate, str) else settings.filter_rate
    most = max(len(unknowns.names_of(row)) for row in unknowns.system.rows)
    duration = stream.rows * stream.sample_time
    block = block_size(duration, stream.sample_time, rate, most)
    hold = "zero" if choices.hold == "zero" else "linear"
    none = np.zeros(len(unknowns.names))
    problem = StreamedProblem(unknowns, none, rate, hold, block)
    reference = _least_squares(joint, timely, unknowns, problem).values
    sums = StreamedSums(replace(problem, reference=reference))
    task = StreamTask(structure, choices.alignment, timely, sums, stream.sample_time)
    if task.margin > _LARGEST_MARGIN:
        raise SettingError(
            "filter-rate",
            f"{rate:.3g} 1/s is too slow for a stream with a sample time of "
            f"{1e3 * stream.sample_time:.3g} ms: set it to "
            f"{50.0 / (_LARGEST_MARGIN * stream.sample_time):.2g} 1/s or more",
        )
    return task


def _least_squares(
    joint: Joint,
    recordings: Sequence[Recording],
    unknowns: Unknowns,
    problem: StreamedProblem,
    rate_factor: float = 1.0,
) -> LeastSquaresFit:
    """Least squares of recordings in memory, all of one log."""
    samples = [joint.samples(recording) for recording in recordings]
    own = replace(unknowns, groups=(0,) * len(samples))
    rate = rate_factor * problem.filter_rate
    return filtered_least_squares(samples, unknowns.system, rate, problem.hold, own)


@dataclass(frozen=True, eq=False)
class HeldOut:
    """A stretch that is kept out of the fit."""

    recording: Recording  # The stretch, aligned, and as much before it
    start: int  # Where it begins
    products: Products  # Its equations
