"""What a stream is to add up: the choices that its head gives."""

from dataclasses import dataclass, replace
from functools import cached_property
from math import ceil

from flexid.errors import SettingError
from flexid.estimators.block_sandwich import block_size
from flexid.estimators.row_signals import needs_velocities
from flexid.estimators.streamed_least_squares import Products, StreamedProblem, StreamedSums
from flexid.identification.alignment import Alignment, aligned
from flexid.identification.candidate import Candidate
from flexid.identification.joint import flexible, rigid
from flexid.identification.preparation import Pieces, prepare
from flexid.identification.result import Identification
from flexid.identification.settings import Settings
from flexid.models.flexible_joint import with_stopping_time
from flexid.recording.recording import Recording
from flexid.recording.stream import LogStream
from flexid.recording.velocities import best_half_window

_LARGEST_MARGIN = 262_144  # samples; beyond it the memory would be that of a long window
_SETTLING = 128  # samples after which no all-pass filter of an alignment remembers its start
_FREE_RUN_DURATION = 10.0  # s of each


@dataclass(frozen=True, eq=False)
class StreamTask:
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


def stream_task(stream: LogStream, head: Identification, settings: Settings) -> StreamTask:
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
    task = StreamTask(
        candidate, choices.alignment, pieces, StreamedSums(problem), stream.sample_time
    )
    if task.margin > _LARGEST_MARGIN:
        raise SettingError(
            "filter-rate",
            f"{choices.filter_rate:.3g} 1/s is too slow for a stream with a sample time of "
            f"{1e3 * stream.sample_time:.3g} ms: set it to "
            f"{50.0 / (_LARGEST_MARGIN * stream.sample_time):.2g} 1/s or more",
        )
    return task


@dataclass(frozen=True, eq=False)
class HeldOut:
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
