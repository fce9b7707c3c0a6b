"""Types of a fit: the data, the structure that is fitted, and the fitted result.

The unknowns are the coefficients of the joint and the delays of the recording's channels.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Generic

import numpy as np
from typing_extensions import TypeVar

from flexid.arrays import FloatArray
from flexid.estimators.channel_timing import Timing
from flexid.estimators.prediction_error import FLAT, ROUGH, Minimum, described
from flexid.estimators.samples import Samples
from flexid.estimators.segmented_motion import SegmentedMotion
from flexid.estimators.unknowns import Bounds, Unknowns
from flexid.identification.preparation.joint import ElasticArm, Joint
from flexid.identification.vocabulary.evidence import Estimate
from flexid.models.flexible_joint import CONTACT_DEFLECTION, PLAY
from flexid.recording.recording import Hold, Recording
from flexid.recording.slow_motion import scales_apart
from flexid.recording.velocities import position_noise

LINK = "link_delay"
"""Name of the delay of the link's position."""

_MARGIN = 0.03  # s
_LARGEST_MARGIN = 0.05  # of a recording
# Share of the squared speed that a half lacks if it is mostly rest. A rest with a controller that
# hunts determines any value precisely, and a friction had an interval of 6400 %.
_UNEVEN = 0.45
_FINEST = 1e-9  # least noise over the largest position


M = TypeVar("M", bound=Joint | ElasticArm, default=Joint)
"""Model with all its terms: a joint or an arm."""


@dataclass(frozen=True, eq=False)
class Data:
    """Data that a model is fitted to."""

    samples: tuple[Samples, ...]  # recordings; for a joint with velocities
    groups: tuple[int, ...]  # index of each recording's log
    noise: FloatArray  # (n_rows,): standard deviation of each position's noise
    # rows with a position that was measured relative to another row or an input, and the latter
    relative_to: Mapping[str, str] = field(default_factory=dict)
    refinement: int = 1  # factor of the number of integration steps in a final fit
    # largest delay in s; delayed channels lack data that long at both ends of a recording
    largest_delay: float = _MARGIN
    recordings: tuple[Recording, ...] = ()  # for a joint: recordings as read

    @cached_property
    def scales_apart(self) -> float:
        """Relative difference between the scales of two encoders."""
        return max((abs(scales_apart(recording)[0]) for recording in self.recordings), default=0.0)

    @cached_property
    def margin(self) -> float:
        """Time in s at both ends of each recording that is in no segment."""
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
        """Return periods in s of frequencies in rad/s, from 5 samples to a tenth of the data."""
        least, most = 5.0 * self.samples[0].sample_time, 0.1 * self.duration
        return np.clip(2.0 * np.pi / np.maximum(resonances, np.finfo(float).tiny), least, most)

    def halves(self) -> Iterator["Data"]:
        """Yield the data with the first halves of all recordings, and with the second halves."""
        cut = [(own, _middle(own)) for own in self.samples]
        yield replace(self, samples=tuple(own.window(0, middle) for own, middle in cut))
        yield replace(self, samples=tuple(own.window(middle, len(own)) for own, middle in cut))

    def logs(self) -> Iterator[tuple[int, "Data"]]:
        """Yield the index of each log, and the data with its recordings alone."""
        for log in sorted({*self.groups}):
            own = [s for s, group in zip(self.samples, self.groups, strict=True) if group == log]
            yield log, replace(self, samples=tuple(own), groups=(log,) * len(own))

    def in_part(self, share: float) -> "Data":
        """Return two pieces of each recording, together a share of it."""
        samples = []
        for own in self.samples:
            starts, length = (0, len(own) // 2), max(1, int(0.5 * share * len(own)))
            samples += [own.window(start, start + length) for start in starts]
        groups = np.repeat(self.groups, 2).tolist()
        return replace(self, samples=tuple(samples), groups=tuple(groups))

    def with_noise(self, seed: int) -> "Data":
        """Return the data with as much noise as the sensors' added to the positions."""
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


def _middle(samples: Samples) -> int:
    """Return the middle sample of a recording, or of its motion if a half is mostly rest."""
    middle = len(samples) // 2
    if samples.velocities is None:
        return middle
    motion = np.cumsum(np.sum(samples.velocities**2, axis=1))
    if abs(motion[middle] - 0.5 * motion[-1]) <= _UNEVEN * motion[-1]:
        return middle
    shortest = len(samples) // 4
    return int(np.clip(np.searchsorted(motion, 0.5 * motion[-1]), shortest, 3 * shortest))


def data_of(
    joint: Joint, recordings: Sequence[Recording], groups: Sequence[int], given_delay: float = 0.0
) -> Data:
    """Return recordings with velocities as `Data`; `given_delay` is the largest given one in s."""
    samples = tuple(joint.samples(recording) for recording in recordings)
    relative = {}
    if joint.kind != "rigid" and recordings[0].link_from_deflection:
        # The link alone has the motor's position as its first input.
        relative = {"link": "motor" if joint.kind == "flexible" else joint.systems[0].inputs[0]}
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
    """Return the standard deviation of each position's noise, shape (n_rows,)."""
    longest = max(samples, key=len)
    largest = max(float(np.abs(own.positions).max()) for own in samples)
    noise = np.array([position_noise(position) for position in longest.positions.T])
    noise = np.where(np.ptp(longest.positions, axis=0) > 0.0, noise, noise.max())  # for clamped
    return np.maximum(noise, _FINEST * largest)


def sensor_noise(data: Data, deflections: Iterable[int]) -> FloatArray:
    """Return the noise of each sensor, shape (n_rows,).

    `deflections` are rows of links with a deflection sensor; the next row is their motor's.
    """
    noise, positions = data.noise.copy(), max(data.samples, key=len).positions
    for link in deflections:
        own = position_noise(positions[:, link] - positions[:, link + 1])
        noise[link] = max(own, 1e-3 * noise[link])
    return noise


@dataclass(frozen=True, eq=False)
class Structure(Generic[M]):
    """Model with its terms, delays, given values and bounds."""

    joint: M  # with all its terms
    absent: frozenset[str]  # coefficients that are zero, of terms that are off
    timing: Timing  # hold of the input, and the delays
    fixed: Mapping[str, float] = field(default_factory=dict)  # given coefficients
    bounds: Bounds = field(default_factory=dict)  # bounds of coefficients

    def unknowns(self, groups: Sequence[int]) -> Unknowns:
        """Return the unknown coefficients."""
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
        """Return the structure with another hold of the input."""
        return replace(self, timing=replace(self.timing, hold=hold))

    def beginning_at(self, values: Mapping[str, float]) -> "Structure[M]":
        """Return the structure with start values for its nonlinear coefficients."""
        joint = self.joint.with_widths(values)
        return self if joint is self.joint else replace(self, joint=joint)

    def without(self, names: Iterable[str]) -> "Structure[M]":
        """Return the structure without some coefficients and delays, and those tied to them."""
        gone = {name.partition("[")[0] for name in names}
        gone |= {c for c, (source, _, _) in self.joint.ties.items() if source in gone}
        gone |= {own for c, own in self.joint.nonlinear.items() if c in gone}
        # Without play, a cubic spring hardens from its centre on.
        joint = self.joint.with_widths({CONTACT_DEFLECTION: 0.0}) if gone & PLAY else self.joint
        timing = replace(
            self.timing,
            sought=tuple(name for name in self.timing.sought if name not in gone),
            delays={name: value for name, value in self.timing.delays.items() if name not in gone},
        )
        delays = {*self.timing.sought}
        return replace(self, joint=joint, absent=self.absent | (gone - delays), timing=timing)


@dataclass(frozen=True, eq=False)
class Fitted(Generic[M]):
    """Structure fitted to data over segments of one length."""

    structure: Structure[M]  # fitted structure
    data: Data  # fitted data
    problem: SegmentedMotion  # fitted motion
    minimum: Minimum  # minimum found
    duration: float  # length of a segment in s
    # coefficients that ended at a bound and were fixed there, by name
    at_bound: Mapping[str, float] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the fitted coefficients, then of the fitted delays."""
        return self.problem.names

    @property
    def values(self) -> FloatArray:
        """Fitted values, shape (k,)."""
        return self.minimum.point.values

    @property
    def information(self) -> FloatArray:
        """Information matrix: the quadratic form of the sum of squares, shape (k, k)."""
        return self.minimum.reduced.information

    @cached_property
    def by_name(self) -> dict[str, float]:
        """Values by name, including coefficients at a bound."""
        return {**self.at_bound, **dict(zip(self.names, self.values.tolist(), strict=True))}

    @property
    def all_values(self) -> dict[str, float]:
        """Values by name, including those that the structure fixes."""
        return {**self.structure.fixed, **self.by_name}

    @property
    def ended(self) -> Structure[M]:
        """Structure with the coefficients at a bound fixed there."""
        return replace(self.structure, fixed={**self.structure.fixed, **self.at_bound})

    @cached_property
    def excess(self) -> float:
        """Mean square of the residuals over that of the sensors' noise: 1 for a right model."""
        return self.minimum.variance(self.problem)

    @cached_property
    def unexplained(self) -> float:
        """Root mean square of residuals beyond noise over the deflection's, at most 1.

        The deflection is corrected for delays of the encoders. With one encoder, the motor's motion
        is used instead.
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
        """Return `unexplained` over longer segments, in s, in proportion to their length."""
        return self.unexplained * max(1.0, duration / self.duration)

    @cached_property
    def fit(self) -> Estimate:
        """Estimate with its covariance."""
        found = described(self.problem, self.minimum)
        return Estimate(found.names, found.values, found.covariance, found.degrees_of_freedom)

    @cached_property
    def unit_deviations(self) -> FloatArray:
        """Standard deviations for sensor noise alone, shape (k,)."""
        return np.sqrt(np.diag(self.minimum.reduced.inverse))

    @cached_property
    def scatter(self) -> FloatArray:
        """Ratio of each deviation to its value for white residuals, shape (k,); nan if unknown."""
        with np.errstate(invalid="ignore", divide="ignore"):
            ratios = self.fit.deviations / self.unit_deviations
        return np.where(np.isfinite(ratios) & (ratios > 0.0), ratios, np.nan)

    @property
    def converged(self) -> bool:
        """Whether the steps reached the minimum, within the roughness of the sum of squares."""
        promised = self.minimum.reduced.decrement
        return promised <= FLAT * self.minimum.equations.cost or self.minimum.last_step <= ROUGH

    @property
    def excessive_delays(self) -> frozenset[str]:
        """Delays beyond the margin of the data."""
        sought = self.structure.timing.sought
        return frozenset(name for name in sought if abs(self.delays[name]) > self.data.margin)

    @property
    def has_partners(self) -> bool:
        """Whether all delays are within the margin of the data."""
        return not self.excessive_delays

    @property
    def delays(self) -> dict[str, float]:
        """All delays in s, by name."""
        return self.problem.delays(self.values)
