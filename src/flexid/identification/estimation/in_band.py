"""A structure fitted with disturbances to a log in its band (`flexid.estimators.innovations`)."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Generic

import numpy as np
from numpy.typing import NDArray

from flexid.arrays import FloatArray
from flexid.errors import ConvergenceError
from flexid.estimators.gauss_newton import NEGLIGIBLE, Minimum, minimise
from flexid.estimators.innovations import STEPS, fit_innovations, predicting
from flexid.estimators.segmented_motion import Point, SegmentedMotion
from flexid.estimators.segments import Segments, divide, first_states
from flexid.estimators.steady_gains import Sizes
from flexid.identification.full_model.fitting import motion_at
from flexid.identification.full_model.model import Data, Fitted, M, Structure
from flexid.identification.structure.validation import Follower

_SAME_TIME = 1e-3  # of a sample


@dataclass(frozen=True, eq=False)
class FitInBand(Generic[M]):
    """A fit with disturbances."""

    fitted: Fitted[M]  # its residuals are innovations
    sizes: Sizes  # of noise and disturbances
    cost: float  # twice the negative logarithm of the likelihood, but for a constant


@dataclass(frozen=True, eq=False)
class InBand(Generic[M]):
    """A structure and a log in its band, to be fitted with disturbances."""

    structure: Structure[M]
    data: Data  # low-passed and thinned out
    directions: FloatArray  # (n_samples, n_rows): of friction; with no samples, it is set-valued
    slowest: float  # in 1/s, of a disturbance
    noise: FloatArray  # (n_rows,): standard deviation of each sensor's, to begin with
    segment: float  # in s: longer than what an observer remembers
    # steps of integration, over those of a fit without disturbances, and their largest number
    coarser: float = 1.0
    most_substeps: float = np.inf  # per sample
    steps: tuple[int, int] = STEPS  # of values, each time before sizes are sought, and at last

    def fit(
        self,
        start: Mapping[str, float],
        sizes: Sizes | None = None,
        near: Fitted[M] | None = None,
    ) -> FitInBand[M]:
        """Values and sizes from a start, in turn; `near` is a fit whose motion is much the same."""
        problem, point = self._problem(start, near)
        found = fit_innovations(problem, point, self.directions, self.slowest, sizes, self.steps)
        if not np.isfinite(found.cost):
            raise ConvergenceError("prediction error", "the disturbed motion diverges")
        fitted = self._fitted(found.problem, found.minimum)
        return FitInBand(fitted, found.sizes, found.cost)

    def with_gains_of(
        self, near: Fitted[M], start: Mapping[str, float], iterations: int
    ) -> Fitted[M]:
        """Values alone, with the observer of another fit."""
        problem, point = self._problem(start, near)
        observer, weights = near.problem.observer, near.problem.weights
        problem = replace(problem, observer=observer, weights=weights)
        found = minimise(problem, point, NEGLIGIBLE, insist=False, iterations=iterations)
        return self._fitted(problem, found)

    def _problem(
        self, start: Mapping[str, float], near: Fitted[M] | None
    ) -> tuple[SegmentedMotion, Point]:
        segments = divide(self.data.samples, self.segment, margin=self.data.margin)
        states = None if near is None else _states_near(segments, near)
        problem, point = motion_at(self.structure, self.data, segments, start, states)
        substeps = int(min(np.ceil(self.coarser * problem.substeps), self.most_substeps))
        return replace(problem, weights=1.0 / self.noise, substeps=substeps), point

    def _fitted(self, problem: SegmentedMotion, minimum: Minimum) -> Fitted[M]:
        return Fitted(self.structure, self.data, problem, minimum, self.segment)


def _states_near(segments: Segments, near: Fitted[M]) -> FloatArray:
    """Initial states, shape (n_segments, n_states): a fit's own, where its segments begin too."""
    found = near.problem.with_memories(first_states(segments))
    times, states = near.problem.segments.start_times, near.minimum.point.initial_states
    for s, time in enumerate(segments.start_times):
        place = int(np.argmin(np.abs(times - time)))
        if abs(time - times[place]) <= _SAME_TIME * segments.sample_times[s]:
            found[s] = states[place]
    return found


def observer_following(directions: FloatArray, sizes: Sizes) -> Follower:
    """Predictions from where an observer has got to that knows the sizes of disturbances."""

    def follow(
        model: SegmentedMotion, values: FloatArray, windows: Segments, warm: NDArray[np.int64]
    ) -> tuple[SegmentedMotion, FloatArray]:
        problem = replace(model, segments=windows)
        point = Point(values, problem.start_states)
        return predicting(problem, point, directions, sizes, warm), point.initial_states

    return follow
