"""Motions of small systems over segments, and derivatives by differences."""

from dataclasses import replace

import numpy as np

from flexid.estimators.channel_timing import Timing
from flexid.estimators.samples import Samples, divide
from flexid.estimators.segmented_motion import Point, SegmentedMotion, segmented_motion
from flexid.estimators.unknowns import Unknowns
from flexid.models.parametric_system import ParametricSystem, Row

FloatArray = np.ndarray


def problem_of(
    sought: Unknowns | ParametricSystem,
    force: FloatArray,
    h: float,
    timing: Timing | None = None,
    substeps: int = 1,
) -> SegmentedMotion:
    """Return one segment under an input, with positions of zero."""
    sought = sought if isinstance(sought, Unknowns) else Unknowns(sought)
    outputs = np.zeros((len(force), len(sought.system.rows)))
    samples = Samples(outputs, None, np.asarray(force, dtype=np.float64)[:, None], h)
    segments = divide([samples], 2.0 * h * len(force))
    problem = segmented_motion(sought.system, segments, timing or Timing("linear"), sought)
    return replace(problem, substeps=substeps)


def point_of(values: list[float], *state: float) -> Point:
    """Return values of the unknowns and one initial state."""
    return Point(np.array(values, dtype=np.float64), np.array([state], dtype=np.float64))


def motion(problem: SegmentedMotion, point: Point) -> FloatArray:
    """Return positions of the motion, shape (n, n_rows)."""
    found = problem.equations(point)
    assert np.isfinite(found.cost)
    return problem.segments.outputs - found.residuals


def measured(problem: SegmentedMotion, outputs: FloatArray) -> SegmentedMotion:
    """Return the problem with other measured outputs."""
    return replace(problem, segments=replace(problem.segments, outputs=outputs))


def fall(problem: SegmentedMotion, point: Point, place: int, step: float) -> float:
    """Return minus half the slope of the sum of squares, by differences; states come first."""
    at, n = np.concatenate((point.initial_states.ravel(), point.values)), point.initial_states.size
    costs = []
    for side in (step, -step):
        moved = at.copy()
        moved[place] += side
        states = moved[:n].reshape(point.initial_states.shape)
        costs.append(problem.equations(Point(moved[n:], states), "nothing").cost)
    return (costs[1] - costs[0]) / (4.0 * step)


CART = ParametricSystem("cart", (Row("cart", "q", "v", {"gain": "u", "push": "1"}),))


def held_cart(n: int = 400, h: float = 0.01, seed: int = 1) -> Samples:
    """Return a cart under a random force, constant over each interval, integrated exactly."""
    force = np.random.default_rng(seed).standard_normal(n)
    acceleration = 2.0 * force + 0.3
    velocity = np.concatenate(([0.7], 0.7 + h * np.cumsum(acceleration[:-1])))
    position = np.cumsum(np.concatenate(([0.1], (h * velocity + 0.5 * h * h * acceleration)[:-1])))
    return Samples(position[:, None], None, force[:, None], h)
