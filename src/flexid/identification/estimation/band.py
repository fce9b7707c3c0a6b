"""Fits with disturbances to a log in its joint's band, low-passed and thinned out.

A log that the model does not explain is fitted with disturbances (`flexid.estimators.innovations`)
in the band of the resonance alone.
"""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Generic

import numpy as np
from numpy.typing import NDArray

from flexid.arrays import FloatArray
from flexid.errors import ConvergenceError
from flexid.estimators.innovations import STEPS, first_cost, fit_innovations, predicting
from flexid.estimators.prediction_error import NEGLIGIBLE, USUAL, Minimum, Steps, minimise
from flexid.estimators.samples import Segments, divide, first_states
from flexid.estimators.segmented_motion import Point, SegmentedMotion
from flexid.estimators.steady_gains import Sizes
from flexid.identification.estimation.thinned_log import PER_PERIOD, directions, thinned
from flexid.identification.full_model.fitting import motion_at, within_bounds
from flexid.identification.full_model.model import LINK, Data, Fitted, M, Structure, sensor_noise
from flexid.identification.preparation.joint import Joint
from flexid.identification.structure.link_delay import shifted
from flexid.identification.structure.sought_terms import reflected
from flexid.identification.structure.validation import Follower, from_fitted_states

SPRING_SHARE = 0.25
"""Least rate of a disturbance over the resonance."""

_SAME_TIME = 1e-3  # of a sample, for equal times
# Largest error of the link's delay in the directions of friction, in samples of the band. With one
# of 0.7 the stiffness was 6 % wrong, with an interval of 5 %.
_LATE = 0.1
# Coarser integration steps than usual. The phase error of 3e-5 is below any uncertainty of a
# stiffness. With 16 samples per period, no oscillation needs more than nine substeps.
_INTEGRATION = Steps(coarser=0.4, most_substeps=9)


def slowest_disturbance(data: Data, *, rigid: bool) -> float:
    """Return the least rate of a disturbance in 1/s; a slower one would act like friction."""
    sample_time = max(samples.sample_time for samples in data.samples)
    resonance = 2.0 * np.pi / (PER_PERIOD * sample_time)
    return resonance if rigid else SPRING_SHARE * resonance


@dataclass(frozen=True, eq=False)
class FitInBand(Generic[M]):
    """Fit with disturbances in the band."""

    fitted: Fitted[M]  # with innovations as residuals
    sizes: Sizes  # sizes of noise and disturbances
    cost: float  # -2 log likelihood, up to a constant


@dataclass(frozen=True, eq=False)
class InBand(Generic[M]):
    """Structure and low-passed log to be fitted with disturbances."""

    structure: Structure[M]
    data: Data  # low-passed and thinned out
    directions: FloatArray  # (n_samples, n_rows): of motion; empty for set-valued friction
    slowest: float  # least rate of a disturbance, in 1/s
    noise: FloatArray  # (n_rows,): first value of each sensor's standard deviation
    segment: float  # length of the segments in s, longer than an observer's memory
    integration: Steps = USUAL  # integration steps
    steps: tuple[int, int] = STEPS  # Gauss-Newton steps before each search of sizes, and at the end

    def fit(
        self,
        start: Mapping[str, float],
        sizes: Sizes | None = None,
        near: Fitted[M] | None = None,
    ) -> FitInBand[M]:
        """Fit values and sizes in turn from a start; `near` is a fit with a similar motion."""
        problem, point = self._problem(start, near)
        found = fit_innovations(problem, point, self.directions, self.slowest, sizes, self.steps)
        if not np.isfinite(found.cost):
            raise ConvergenceError("prediction error", "the disturbed motion diverges")
        fitted = self._fitted(found.problem, found.minimum)
        return FitInBand(fitted, found.sizes, found.cost)

    def misfit(self, start: Mapping[str, float]) -> float:
        """Return the cost of a start before any fit; see `first_cost`."""
        return first_cost(*self._problem(start, None), self.directions, self.slowest)

    def with_gains_of(
        self, near: Fitted[M], start: Mapping[str, float], iterations: int
    ) -> Fitted[M]:
        """Fit the values alone, with the observer of another fit."""
        problem, point = self._problem(start, near)
        observer, weights = near.problem.observer, near.problem.weights
        problem = replace(problem, observer=observer, weights=weights)
        found = minimise(problem, point, Steps(NEGLIGIBLE, insist=False, iterations=iterations))
        return self._fitted(problem, found)

    def _problem(
        self, start: Mapping[str, float], near: Fitted[M] | None
    ) -> tuple[SegmentedMotion, Point]:
        segments = divide(self.data.samples, self.segment, margin=self.data.margin)
        states = None if near is None else _states_near(segments, near)
        problem, point = motion_at(self.structure, self.data, segments, start, states)
        return replace(self.integration.taken_by(problem), weights=1.0 / self.noise), point

    def _fitted(self, problem: SegmentedMotion, minimum: Minimum) -> Fitted[M]:
        return Fitted(self.structure, self.data, problem, minimum, self.segment)


@dataclass(frozen=True, eq=False)
class Band:
    """Log as recorded, which is fitted in its joint's band."""

    data: Data  # as recorded
    factor: int  # thinning factor

    def fit(
        self,
        structure: Structure,
        start: Mapping[str, float],
        sizes: Sizes | None = None,
        *,
        of_band: bool = True,  # whether the given sizes belong to this band
    ) -> "JointInBand":
        """Fit a structure within bounds."""
        data, factor = self.data, self.factor
        own = thinned(data, factor, held=structure.timing.hold == "zero")
        noise = noise_in_band(own)
        if sizes is not None and not of_band:  # gains for less noise make the steps diverge
            sizes = replace(sizes, sensors=np.maximum(sizes.sensors, noise))
        late = {**structure.timing.delays, **start}.get(LINK, 0.0)
        in_band = InBand(
            structure,
            own,
            directions_on_time(data, late, factor),
            slowest_disturbance(own, rigid=structure.joint.kind == "rigid"),
            noise,
            own.duration,
            _INTEGRATION,
        )
        last: list[FitInBand] = []

        def fitted_from(begun: Mapping[str, float]) -> Fitted:
            def fit(bounded: Structure) -> Fitted:
                held = bounded if factor == 1 else bounded.with_hold("cubic")
                last.append(replace(in_band, structure=held).fit(begun, sizes))
                return last[-1].fitted

            return within_bounds(structure, data, fit)

        fitted = fitted_from(start)
        if (positive := reflected(fitted.by_name)) != fitted.by_name:
            fitted = fitted_from(positive)
        found = fitted.delays.get(LINK, 0.0)
        if abs(found - late) > _LATE * own.samples[0].sample_time:
            in_band = replace(in_band, directions=directions_on_time(data, found, factor))
            sizes = last[-1].sizes
            fitted = fitted_from(fitted.by_name)
        fitted = replace(fitted, structure=structure.beginning_at(fitted.by_name))
        return JointInBand(fitted, last[-1].sizes, last[-1].cost, self)

    def fits(
        self, begun: Iterable[tuple[Structure, Mapping[str, float]]]
    ) -> Iterator["JointInBand"]:
        """Yield the fits from starts that converge."""
        for structure, start in begun:
            with suppress(ConvergenceError):
                yield self.fit(structure, start)


@dataclass(frozen=True, eq=False)
class JointInBand(FitInBand[Joint]):
    """Fit of a joint with disturbances to a log in its band."""

    band: Band

    @cached_property
    def shares(self) -> dict[str, float]:
        """Unexplained share of each balance: disturbance and sensor errors beyond noise."""
        data, segments = self.fitted.data, self.fitted.problem.segments
        squares, count = np.zeros(len(self.sizes.disturbances)), 0
        for samples in data.samples:
            assert samples.velocities is not None
            rates = np.gradient(samples.velocities, samples.sample_time, axis=0)
            squares, count = squares + np.sum(rates**2, axis=0), count + len(rates)
        shares = self.sizes.disturbances**2 * count / np.maximum(squares, np.finfo(float).tiny)
        joint = self.fitted.structure.joint
        if joint.kind != "rigid":
            moved = np.var(joint.channels_of(segments.outputs, segments.inputs)[:, -1])
            # An error of either position acts on both rows through the spring.
            beyond = np.sum(np.maximum(self.sizes.sensors**2 - noise_in_band(data) ** 2, 0.0))
            shares = shares + beyond / max(float(moved), np.finfo(float).tiny)
        names = [_side(row.name) for row in self.fitted.problem.unknowns.system.rows]
        return dict(zip(names, np.minimum(np.sqrt(shares), 1.0).tolist(), strict=True))


def directions_on_time(
    data: Data, late: float, factor: int, in_band: int | None = None
) -> FloatArray:
    """Return directions of motion (see `directions`) for a link's encoder that is late, in s."""
    return directions(shifted(data, late).samples if late else data.samples, factor, in_band)


def cost_of(fit: FitInBand) -> float:
    """Return the cost of a fit."""
    return fit.cost


def _side(row: str) -> str:
    """Return the side that a row is the balance of."""
    return "motor" if row == "rigid" else row


def noise_in_band(data: Data) -> FloatArray:
    """Return the noise of each sensor; a deflection sensor's own noise where there is one."""
    return sensor_noise(data, [0] if "motor" in data.relative_to.values() else [])


def _states_near(segments: Segments, near: Fitted[M]) -> FloatArray:
    """Return initial states, shape (n_segments, n_states), from a near fit at equal start times."""
    found = near.problem.with_memories(first_states(segments))
    times, states = near.problem.segments.start_times, near.minimum.point.initial_states
    for s, time in enumerate(segments.start_times):
        place = int(np.argmin(np.abs(times - time)))
        if abs(time - times[place]) <= _SAME_TIME * segments.sample_times[s]:
            found[s] = states[place]
    return found


def observer_following(directions: FloatArray, sizes: Sizes, factor: int) -> Follower:
    """Return a follower that starts predictions from an observer's states.

    It applies to a log as recorded; `sizes` are those of the log thinned by `factor`. If the
    observer diverges, predictions begin from fitted states.
    """
    sizes = replace(sizes, sensors=sizes.sensors * np.sqrt(factor))

    def follow(
        model: SegmentedMotion, values: FloatArray, windows: Segments, warm: NDArray[np.int64]
    ) -> tuple[SegmentedMotion, FloatArray]:
        problem = replace(model, segments=windows)
        point = Point(values, problem.start_states)
        try:
            return predicting(problem, point, directions, sizes, warm), point.initial_states
        except ConvergenceError:
            return from_fitted_states(model, values, windows, warm)

    return follow
