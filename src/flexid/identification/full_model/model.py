"""The model of a log: what is fitted, to what, and what a fit of it is.

What is sought are the coefficients of the joint together with what describes the recording: delays
of its channels.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, wraps
from typing import Concatenate, Generic, ParamSpec
from weakref import WeakKeyDictionary

import numpy as np
from typing_extensions import TypeVar

from flexid.arrays import FloatArray
from flexid.estimators.channel_timing import Timing
from flexid.estimators.prediction_error import FLAT, Minimum, described
from flexid.estimators.samples import Samples
from flexid.estimators.segmented_motion import SegmentedMotion
from flexid.estimators.unknowns import Bounds, Unknowns
from flexid.identification.preparation.joint import ElasticArm, Joint
from flexid.identification.vocabulary.evidence import Estimate
from flexid.recording.recording import Hold, Recording
from flexid.recording.slow_motion import scales_apart
from flexid.recording.velocities import position_noise

LINK = "link_delay"
"""Name of the delay of the link's position."""

ROUGH, FINE = 1.0, 1e-2
"""Length of a step, in standard deviations, that ends an iteration: on the way, and at its end."""

_MARGIN = 0.03  # s
_LARGEST_MARGIN = 0.05  # of a recording
_FINEST = 1e-9  # noise over the largest position that still counts as some


M = TypeVar("M", bound=Joint | ElasticArm, default=Joint)
"""A drive with all its terms."""


@dataclass(frozen=True, eq=False)
class Data:
    """What a model is fitted to."""

    samples: tuple[Samples, ...]  # recordings; of a joint, with velocities
    groups: tuple[int, ...]  # the log of each
    noise: FloatArray  # (n_rows,): standard deviation of each position's noise
    # rows whose position was measured relative to another row's, or to an input
    relative_to: Mapping[str, str] = field(default_factory=dict)
    refinement: int = 1  # how many times as many integration steps as usual a fit takes at its end
    # s at both ends of a recording, where late channels lack partners
    largest_delay: float = _MARGIN
    recordings: tuple[Recording, ...] = ()  # of a joint, as they were read

    @cached_property
    def scales_apart(self) -> float:
        """Share by which the scales of two encoders contradict each other."""
        return max((abs(scales_apart(recording)[0]) for recording in self.recordings), default=0.0)

    @cached_property
    def margin(self) -> float:
        """Seconds at both ends of each recording that belong to no segment."""
        return min(self.largest_delay, _LARGEST_MARGIN * self.shortest)

    @cached_property
    def shortest(self) -> float:
        """Length of the shortest recording in s."""
        return min(len(recording) * recording.sample_time for recording in self.samples)

    @cached_property
    def duration(self) -> float:
        """Length of all recordings in s."""
        return sum(len(recording) * recording.sample_time for recording in self.samples)

    def periods(self, resonances: FloatArray) -> FloatArray:
        """Period in s of each angular frequency in rad/s, within what can be predicted."""
        least, most = 5.0 * self.samples[0].sample_time, 0.1 * self.duration
        return np.clip(2.0 * np.pi / np.maximum(resonances, np.finfo(float).tiny), least, most)

    def halves(self) -> Iterator["Data"]:
        """The first and the second half of every recording."""
        cut = [(own, len(own) // 2) for own in self.samples]
        yield replace(self, samples=tuple(own.window(0, middle) for own, middle in cut))
        yield replace(self, samples=tuple(own.window(middle, len(own)) for own, middle in cut))

    def with_noise(self, seed: int) -> "Data":
        """The same with noise like that of the sensors added to the positions once more."""
        draw = np.random.default_rng(seed)
        noisier = []
        for recording in self.samples:
            added = self.noise * draw.standard_normal(recording.positions.shape)
            if "motor" in self.relative_to.values():  # the link's position has the motor's noise
                alone = position_noise(recording.positions[:, 0] - recording.positions[:, 1])
                added[:, 0] *= alone / self.noise[0]
                added[:, 0] += added[:, 1]
            noisier.append(replace(recording, positions=recording.positions + added))
        return replace(self, samples=tuple(noisier))


def data_of(
    joint: Joint, recordings: Sequence[Recording], groups: Sequence[int], given_delay: float = 0.0
) -> Data:
    """Recordings with velocities as a joint's fits take them; `given_delay` in s, of a channel."""
    samples = tuple(joint.samples(recording) for recording in recordings)
    relative = {}
    if joint.kind != "rigid" and recordings[0].link_from_deflection:
        # The link alone has the motor's position as its first input.
        relative = {"link": "motor" if joint.kind == "flexible" else joint.system.inputs[0]}
    noise = encoder_noise(samples)
    return Data(
        samples,
        tuple(groups),
        noise,
        relative,
        largest_delay=max(_MARGIN, given_delay),
        recordings=tuple(recordings),
    )


def encoder_noise(samples: Sequence[Samples]) -> FloatArray:
    """Standard deviation of each position's noise, shape (n_rows,)."""
    longest = max(samples, key=len)
    largest = max(float(np.abs(own.positions).max()) for own in samples)
    noise = np.array([position_noise(position) for position in longest.positions.T])
    noise = np.where(np.ptp(longest.positions, axis=0) > 0.0, noise, noise.max())  # of clamped ones
    return np.maximum(noise, _FINEST * largest)


def sensor_noise(data: Data, deflections: Iterable[int]) -> FloatArray:
    """Noise of each sensor, shape (n_rows,); its own of each link's that shows a deflection.

    The row after such a link is its motor's.
    """
    noise, positions = data.noise.copy(), max(data.samples, key=len).positions
    for link in deflections:
        own = position_noise(positions[:, link] - positions[:, link + 1])
        noise[link] = max(own, 1e-3 * noise[link])
    return noise


@dataclass(frozen=True, eq=False)
class Structure(Generic[M]):
    """A model with the choices made about it."""

    joint: M  # with all its terms
    absent: frozenset[str]  # coefficients that are zero: terms that are off, or found to be
    timing: Timing  # hold of the input, and the delays
    fixed: Mapping[str, float] = field(default_factory=dict)  # coefficients whose value is given
    bounds: Bounds = field(default_factory=dict)  # ends of coefficients

    def unknowns(self, groups: Sequence[int]) -> Unknowns:
        """What is sought of the coefficients."""
        return self.joint.unknowns(self.absent, self.fixed, groups)

    @property
    def terms(self) -> tuple[str, ...]:
        """Terms that are on."""
        follows = {*self.joint.ties}
        return tuple(
            term
            for term, names in self.joint.terms.items()
            if not {*names} - follows <= self.absent
        )

    def with_hold(self, hold: Hold) -> "Structure[M]":
        """The same with an input that behaves otherwise between samples."""
        return replace(self, timing=replace(self.timing, hold=hold))

    def beginning_at(self, values: Mapping[str, float]) -> "Structure[M]":
        """The same whose nonlinear coefficients begin where a fit of it ended."""
        joint = self.joint.with_widths(values)
        return self if joint is self.joint else replace(self, joint=joint)

    def without(self, names: Iterable[str]) -> "Structure[M]":
        """The same with some coefficients and delays zero, and what follows from them."""
        gone = {name.partition("[")[0] for name in names}
        gone |= {c for c, (source, _, _) in self.joint.ties.items() if source in gone}
        gone |= {own for c, own in self.joint.nonlinear.items() if c in gone}
        timing = replace(
            self.timing,
            sought=tuple(name for name in self.timing.sought if name not in gone),
            delays={name: value for name, value in self.timing.delays.items() if name not in gone},
        )
        delays = {*self.timing.sought}
        return replace(self, absent=self.absent | (gone - delays), timing=timing)


@dataclass(frozen=True, eq=False)
class Fitted(Generic[M]):
    """A structure fitted to data over segments of one length."""

    structure: Structure[M]  # what was fitted
    data: Data  # to what
    problem: SegmentedMotion  # the motion that was fitted
    minimum: Minimum  # where it ended
    duration: float  # wanted length of a segment in s
    # what ended at a bound, and was fixed there
    at_bound: Mapping[str, float] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        """What was sought: coefficients, then delays."""
        return self.problem.names

    @property
    def values(self) -> FloatArray:
        """Its values."""
        return self.minimum.point.values

    @property
    def information(self) -> FloatArray:
        """The sum of squares' quadratic form about them."""
        return self.minimum.reduced.information

    @cached_property
    def by_name(self) -> dict[str, float]:
        """Values of all that was sought, those at a bound among them."""
        return {**self.at_bound, **dict(zip(self.names, self.values.tolist(), strict=True))}

    @property
    def ended(self) -> Structure[M]:
        """The structure with what ended at a bound fixed there."""
        return replace(self.structure, fixed={**self.structure.fixed, **self.at_bound})

    @cached_property
    def excess(self) -> float:
        """Mean square of the residuals over that of the sensors' noise: 1 for a right model."""
        return self.minimum.variance(self.problem)

    @cached_property
    def unexplained(self) -> float:
        """Residuals beyond the sensors' noise over the deflection, root mean squares, at most 1.

        The deflection is that of encoders that are on time. With one encoder, the motor's motion
        is in its place.
        """
        if self.excess <= 1.0:
            return 0.0
        segments, joint = self.problem.segments, self.structure.joint
        motion = joint.channels_of(self.problem.on_time(self.values), segments.inputs)[:, -1]
        residuals = self.minimum.equations.residuals
        left = joint.channels_of(residuals, np.zeros_like(segments.inputs))[:, -1]
        beyond = float(np.mean(left**2)) * (1.0 - 1.0 / self.excess)
        moved = float(np.var(motion))
        return float(np.sqrt(beyond / moved)) if beyond < moved else 1.0

    def unexplained_over(self, duration: float) -> float:
        """The same over longer segments, in s: an error of the model grows no slower than these."""
        return self.unexplained * max(1.0, duration / self.duration)

    @cached_property
    def fit(self) -> Estimate:
        """The estimate with its covariance."""
        found = described(self.problem, self.minimum)
        return Estimate(found.names, found.values, found.covariance, found.degrees_of_freedom)

    @cached_property
    def unit_deviations(self) -> FloatArray:
        """Standard deviations if nothing but the sensors' noise were in the residuals."""
        return np.sqrt(np.diag(self.minimum.reduced.inverse))

    @property
    def converged(self) -> bool:
        """Whether the least sum of squares was found, as far as its roughness allows."""
        promised = self.minimum.reduced.decrement
        return promised <= FLAT * self.minimum.equations.cost or self.minimum.last_step <= ROUGH

    @property
    def astray(self) -> frozenset[str]:
        """Delays so long that the channel's samples have no partners in the data."""
        sought = self.structure.timing.sought
        return frozenset(name for name in sought if abs(self.delays[name]) > self.data.margin)

    @property
    def has_partners(self) -> bool:
        """Whether every channel has partners in the data."""
        return not self.astray

    def coefficients(self, recording: int) -> FloatArray:
        """All coefficients of the system in a recording."""
        unknowns = self.problem.unknowns
        return unknowns.coefficients(self.values[: len(unknowns.names)], recording)

    @property
    def delays(self) -> dict[str, float]:
        """Every delay in s."""
        return self.problem.delays(self.values)


Rest = ParamSpec("Rest")
Result = TypeVar("Result")


def once_per_fit(
    function: Callable[Concatenate[Fitted, Rest], Result],
) -> Callable[Concatenate[Fitted, Rest], Result]:
    """Keep what a function makes of a fit, and of hashable arguments beside it, with the fit.

    A fit holds the data of its log: what keeps it alive keeps them in memory.
    """
    kept: WeakKeyDictionary[Fitted, dict[object, Result]] = WeakKeyDictionary()

    @wraps(function)
    def wrapper(fitted: Fitted, *args: Rest.args, **kwargs: Rest.kwargs) -> Result:
        own = kept.setdefault(fitted, {})
        key = (args, *sorted(kwargs.items()))
        if key not in own:
            own[key] = function(fitted, *args, **kwargs)
        return own[key]

    return wrapper
