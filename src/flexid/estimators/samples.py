"""Measured samples of a parametric system as arrays, and their segments."""

import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import pairwise
from typing import Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from flexid.arrays import FloatArray
from flexid.errors import SettingError
from flexid.estimators.budget import shared
from flexid.recording.recording import Recording
from flexid.recording.velocities import position_noise, velocity


@dataclass(frozen=True, eq=False)
class Samples:
    """Uniformly sampled recording, without gaps, of a system with any number of rows.

    Parameters
    ----------
    positions : array, shape (n, n_rows)
        Position of each row, in the order of the system's rows.
    velocities : array, shape (n, n_rows), or None
        Velocity of each row; None if velocities are unknown.
    inputs : array, shape (n, n_inputs)
        Inputs.
    sample_time : float
        Time between samples in s.
    start_time : float, optional
        Time of the first sample in s.
    """

    positions: FloatArray
    velocities: FloatArray | None
    inputs: FloatArray
    sample_time: float
    start_time: float = 0.0

    def __len__(self) -> int:
        return int(self.positions.shape[0])

    @property
    def time(self) -> FloatArray:
        """Time of every sample, shape (n,), in s."""
        return self.start_time + self.sample_time * np.arange(len(self), dtype=np.float64)

    def window(self, first: int, last: int) -> "Samples":
        """Return the samples from index `first` up to, but without, index `last`.

        Parameters
        ----------
        first, last : int
            Indices of samples.
        """
        part = slice(first, last)
        return Samples(
            self.positions[part],
            None if self.velocities is None else self.velocities[part],
            self.inputs[part],
            self.sample_time,
            self.start_time + first * self.sample_time,
        )


def samples_of_recording(
    recording: Recording, kind: Literal["flexible", "rigid", "link"] = "flexible"
) -> Samples:
    """Return a recording as arrays for a joint; for "link", the motor's motion is the input."""
    link, motor = recording.link_velocity, recording.motor_velocity
    positions, velocities = [recording.motor_position], [motor]
    if kind == "flexible":
        positions, velocities = [recording.needed_link_position, *positions], [link, motor]
    if kind == "link":
        if motor is None:
            motor = velocity(recording.motor_position, recording.sample_time)
        inputs = [recording.motor_position, motor]
        positions, velocities = [recording.needed_link_position], [link]
    else:
        inputs = [recording.needed_input]
    known = [v for v in velocities if v is not None]
    return Samples(
        np.column_stack(positions),
        np.column_stack(known) if len(known) == len(velocities) else None,
        np.column_stack(inputs).astype(np.float64),
        recording.sample_time,
        recording.start_time,
    )


A = TypeVar("A")
B = TypeVar("B")

FEWEST_SAMPLES = 20
"""Smallest number of samples of a segment: more than its initial state needs."""

_START_DURATION = 0.03  # s at the start of a segment, in which a cubic follows a drive's motion
_START_SAMPLES = 8  # but at least this many samples: a cubic has four coefficients
_FEWEST_START_SAMPLES = 6  # lower limit if the motion vibrates
_START_RATIO = 1.4  # between successive numbers of samples
_START_EXCESS = 2.0  # largest RMS residual of a cubic over white noise: 1 in 300 by chance


@dataclass(frozen=True, eq=False)
class Segments:
    """Samples of all recordings, concatenated, and their division into segments."""

    # (n_segments,): first sample of every segment; each segment lies within one recording
    starts: NDArray[np.int64]
    lengths: NDArray[np.int64]  # (n_segments,): number of samples of every segment
    # (n_recordings + 1,): first sample of every divided recording, then the number of samples
    recording_starts: NDArray[np.int64]
    sample_times: FloatArray  # (n_segments,): time between samples in s
    start_times: FloatArray  # (n_segments,): time of the first sample in s
    # (n_segments,): index of each segment's recording among those given to `divide`
    recordings: NDArray[np.int64]
    outputs: FloatArray  # (n_samples, n_outputs): measured positions, one per row
    inputs: FloatArray  # (n_samples, n_inputs): inputs

    def __len__(self) -> int:
        return len(self.starts)

    @property
    def mean_duration(self) -> float:
        """Mean length of a segment in s."""
        return float(np.mean(self.lengths * self.sample_times))

    @property
    def can_be_halved(self) -> bool:
        """Whether every segment is long enough to be cut in two."""
        return bool(self.lengths.min() >= 2 * FEWEST_SAMPLES)

    def halved(self) -> "Segments":
        """Cut every segment in two; segment i becomes segments 2 i and 2 i + 1."""
        twice = self.at(np.repeat(np.arange(len(self)), 2))
        skipped = twice.lengths // 2 * (np.arange(len(twice)) % 2)  # 0 in each first half
        return replace(
            twice,
            starts=twice.starts + skipped,
            lengths=np.where(skipped > 0, twice.lengths - skipped, twice.lengths // 2),
            start_times=twice.start_times + skipped * twice.sample_times,
        )

    @cached_property
    def firsts(self) -> NDArray[np.int64]:
        """Index of the first segment of each recording, shape (n_recordings,)."""
        return np.flatnonzero(np.diff(self.recordings, prepend=-1))

    @cached_property
    def places(self) -> NDArray[np.int64]:
        """Index of each segment's recording among those with segments, shape (n_segments,)."""
        return np.searchsorted(self.firsts, np.arange(len(self)), side="right") - 1

    def merged(self) -> "Segments | None":
        """Join segments in pairs; return None if a recording has an odd number of segments."""
        if np.any(np.diff(np.append(self.firsts, len(self))) % 2):
            return None
        lengths = self.lengths[::2] + self.lengths[1::2]
        return replace(self.at(np.arange(0, len(self), 2)), lengths=lengths)

    def some(self, count: int) -> "Segments":
        """Return about `count` evenly spaced segments, with the first of each recording."""
        step = -(-len(self) // count)
        parts = np.split(np.arange(len(self)), self.firsts[1:])
        return self.at(np.concatenate([part[::step] for part in parts]))

    def at(self, places: NDArray[np.int64] | NDArray[np.bool_]) -> "Segments":
        """Return the segments at some indices or under a mask."""
        names = ("starts", "lengths", "sample_times", "start_times", "recordings")
        return replace(self, **{name: getattr(self, name)[places] for name in names})

    def first_blocks(self, duration: float) -> NDArray[np.int64]:
        """Return the index of each segment's first block, then the number of blocks."""
        counts = np.round(self.lengths * self.sample_times / duration).astype(np.int64)
        return np.concatenate(([0], np.cumsum(np.clip(counts, 1, self.lengths))))

    def of(self, samples: FloatArray) -> list[FloatArray]:
        """Split an array over all samples into one array per segment."""
        return [samples[a : a + n] for a, n in zip(self.starts, self.lengths, strict=True)]

    @cached_property
    def within(self) -> NDArray[np.bool_]:
        """Mask of the samples that belong to a segment, shape (n_samples,)."""
        inside = np.zeros(len(self.outputs), dtype=np.bool_)
        for first, length in zip(self.starts, self.lengths, strict=True):
            inside[first : first + length] = True
        return inside

    def by_recording(self) -> list[tuple[slice, float]]:
        """Return slice of the samples, and sample time, of every recording that has segments."""
        own = np.searchsorted(self.recording_starts, self.starts[self.firsts], side="right")
        edges = self.recording_starts.tolist()
        times = self.sample_times[self.firsts].tolist()
        return [
            (slice(edges[i - 1], edges[i]), h) for i, h in zip(own.tolist(), times, strict=True)
        ]


def divide(
    recordings: Sequence[Samples],
    duration: float,  # in s
    margin: float = 0.0,
) -> Segments:
    """Cut recordings into segments of about equal length."""
    if not (np.isfinite(duration) and duration > 0.0):
        raise SettingError("segment duration", f"must be finite and above 0 s, got {duration}")
    margins = [round(margin / recording.sample_time) for recording in recordings]
    kept = [len(recording) - 2 * m for recording, m in zip(recordings, margins, strict=True)]
    places = [i for i, count in enumerate(kept) if count >= FEWEST_SAMPLES]
    if not places:
        raise SettingError(
            "samples", f"no recording has {FEWEST_SAMPLES} samples in a row: give a longer log"
        )
    recording_starts, parts = [0], []
    for place in places:
        recording, h = recordings[place], recordings[place].sample_time
        wanted = round(kept[place] * h / duration)
        count = max(1, min(wanted, kept[place] // FEWEST_SAMPLES))
        ends = margins[place], margins[place] + kept[place]
        edges = np.linspace(*ends, count + 1).round().astype(np.int64)
        starts, times = recording_starts[-1] + edges[:-1], recording.start_time + h * edges[:-1]
        parts.append((starts, np.diff(edges), np.full(count, h), times, np.full(count, place)))
        recording_starts.append(recording_starts[-1] + len(recording))
    starts, lengths, sample_times, start_times, own = map(np.concatenate, zip(*parts, strict=True))
    used = [recordings[place] for place in places]
    signals = [recording.positions for recording in used], [recording.inputs for recording in used]
    return Segments(
        starts,
        lengths,
        np.array(recording_starts),
        sample_times,
        start_times,
        own,
        *(np.ascontiguousarray(np.concatenate(each), dtype=np.float64) for each in signals),
    )


def first_states(segments: Segments) -> FloatArray:
    """Estimate initial states, (n_segments, n_states), by cubics through the first positions."""
    positions = segments.outputs
    own = [positions[part] for part, _ in segments.by_recording()]
    noises = [[position_noise(column) for column in columns.T] for columns in own]
    states = np.empty((len(segments), 2 * positions.shape[1]))
    for s, part in enumerate(segments.of(positions)):
        # Recordings may come from different encoders.
        sample_time, noise = segments.sample_times[s], noises[segments.places[s]]
        longest = min(len(part), max(_START_SAMPLES, round(_START_DURATION / sample_time)))
        for a, allowed in enumerate(noise):
            value, slope = _cubic_start(part[:longest, a], _START_EXCESS * allowed)
            states[s, 2 * a], states[s, 2 * a + 1] = value, slope / sample_time
    return states


def _cubic_start(positions: FloatArray, allowed: float) -> tuple[float, float]:
    """First value and slope per sample of the longest cubic with an RMS residual below allowed."""
    n = len(positions)
    while True:
        powers, inverse = _cubic(n)
        coefficients = inverse @ positions[:n]
        left = positions[:n] - powers @ coefficients
        shorter = max(_FEWEST_START_SAMPLES, int(n / _START_RATIO))
        if shorter >= n or left @ left <= allowed**2 * (n - 4):
            return float(coefficients[0]), float(coefficients[1])
        n = shorter


@cache
def _cubic(n: int) -> tuple[FloatArray, FloatArray]:
    """Powers 0 to 3 of the indices of n samples, shape (n, 4), and their pseudo-inverse, (4, n)."""
    powers = np.vander(np.arange(n, dtype=np.float64), 4, increasing=True)
    return powers, np.asarray(np.linalg.pinv(powers), dtype=np.float64)


_FEWEST_SAMPLES = 1_000  # per thread: with fewer, handing them over costs as much as it saves
_SHARES = 4  # per thread, so that all threads end at about the same time


def in_threads(
    run: Callable[[int, int], None],
    lengths: NDArray[np.int64],  # (n_segments,)
) -> None:
    """Call a function for ranges of segments, on all cores if there are enough samples."""
    reached = np.cumsum(lengths)
    total = int(reached[-1])
    threads = min(cores(), total // _FEWEST_SAMPLES, len(lengths))
    if threads < 2:
        run(0, len(lengths))
        return
    shares = total * np.arange(1, _SHARES * threads) / (_SHARES * threads)
    edges = sorted({0, *np.searchsorted(reached, shares).tolist(), len(lengths)})
    side_by_side(lambda share: run(*share), pairwise(edges), threads)


def side_by_side(of: Callable[[A], B], each: Iterable[A], threads: int | None = None) -> list[B]:
    """Return a function's results in order, computed in `threads` threads or on all cores."""
    every = [*each]
    places = iter(range(len(every)))
    results: dict[int, B] = {}
    failures: dict[int, BaseException] = {}
    with shared(len(every)) as own_budget:

        def work() -> None:
            for place in places:
                if failures:
                    return
                try:
                    with own_budget(place):
                        results[place] = of(every[place])
                except BaseException as error:  # an interruption, too, ends the work of all threads
                    failures[place] = error

        helpers = [_helpers().submit(work) for _ in range(min(threads or cores(), len(every)) - 1)]
        work()  # this thread never waits for a free one, so calls may be nested
        wait([helper for helper in helpers if not helper.cancel()])
        if failures:
            raise failures[min(failures)]  # as in one thread
    return [results[place] for place in range(len(every))]


@cache
def _helpers() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(max(cores() - 1, 1))


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
