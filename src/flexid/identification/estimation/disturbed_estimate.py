"""The estimate of a fit with disturbances: its covariance, with all that is doubted about it.

What is not random about the disturbances shows as a spread between bands, and between the halves
of the log: it widens the intervals by as much as it exceeds what chance explains. What repeats
itself in every band and half, and what no log shows, is a matter of named doubts
(`flexid.identification.estimation.doubts`).
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import ConvergenceError
from flexid.estimators.channel_timing import INPUT
from flexid.estimators.samples import Samples, side_by_side
from flexid.estimators.state_variable_filter import LeastSquaresFit
from flexid.estimators.steady_gains import Sizes
from flexid.identification.estimation.band import PER_PERIOD, fit_in_band, thinned_samples, thinning
from flexid.identification.estimation.disturbed import Disturbed
from flexid.identification.estimation.doubts import (
    DOUBTS,
    ECCENTRICITY,
    HIDDEN,
    LINK_GRAVITY,
    OF_A_BAND,
    OF_A_HALF,
    Doubted,
    Repeat,
    between_bands,
    between_halves,
    covariance_of,
    widened,
)
from flexid.identification.estimation.excitations import row_sizes
from flexid.identification.estimation.model_error import SEED, lagged, with_more
from flexid.identification.estimation.rig_errors import likely_changes, otherwise_shown
from flexid.identification.full_model.model import Data, Fitted
from flexid.identification.full_model.starting import least_squares_start, suited_rate
from flexid.identification.structure.gap import PLAY, with_free_width
from flexid.identification.vocabulary.evidence import Estimate
from flexid.models.flexible_joint import HARDENING
from flexid.recording.velocities import position_noise

_BANDS = (0.5, 2.0)  # of the usual number of samples per period
_PAIRS = 2  # of noise of the input and its opposite


def disturbed_estimate(
    found: Disturbed, data: Data, input_unit: str, hidden: FloatArray | float = 0.0
) -> tuple[Estimate, dict[str, str]]:
    """The estimate with all doubts in its covariance, and what makes most of each variance.

    The covariance of what may hide behind the terms, shape (k, k), is one of them.
    """
    fitted = found.fitted
    estimate = fitted.fit.at_least(fitted.unit_deviations)
    estimate = with_free_width(estimate, fitted)
    names = fitted.names
    by_play = found.by_lost_play if HARDENING.isdisjoint(names) else found.by_play
    doubted = Doubted(
        fitted,
        row_sizes(_squares(fitted).rows),
        dict(found.shares),
        input_unit,
        _by_gauge(found, data),
        by_eccentricity(fitted),
        pulled(fitted, found.sizes, data.samples, found.factor),
        by_play if PLAY.isdisjoint(names) else 0.0,
        lagged(fitted) if fitted.by_name.get(INPUT, 0.0) < 0.0 else None,
    )
    errors = [(doubt(doubted), words) for doubt, words in DOUBTS.items()]
    if fitted.converged:  # or nothing is known that others could contradict
        own, halves = Repeat(fitted.values, np.diag(estimate.covariance)), _halves(found, data)
        errors.append((between_bands(own, _in_other_bands(found, data)), OF_A_BAND))
        errors += [(between_halves(*halves), OF_A_HALF)] if halves else []
    every = [(covariance_of(directions), words) for directions, words in errors]
    return widened(estimate, [*every, (np.broadcast_to(hidden, estimate.covariance.shape), HIDDEN)])


def _squares(fitted: Fitted) -> LeastSquaresFit:
    return least_squares_start(fitted.structure, fitted.data, suited_rate(fitted))[1]


def pulled(fitted: Fitted, sizes: Sizes, recorded: Sequence[Samples], factor: int) -> FloatArray:
    """Change of each value in the band, shape (k,), by as much noise of the input's sensor again.

    An input that is noisy explains less than it did: least squares takes its gain for too small.
    Noise and its opposite move the values by chance, and that is left out.
    """
    noise = _sensor_noise(fitted, sizes, recorded, factor)
    rng = np.random.default_rng(SEED)
    held = fitted.structure.timing.hold == "zero"
    steps = []
    for _ in range(_PAIRS if noise > 0.0 else 0):
        white = (replace(s, inputs=noise * rng.standard_normal(s.inputs.shape)) for s in recorded)
        inputs = [thinned_samples(samples, factor, held=held).inputs[:, 0] for samples in white]
        draw = np.concatenate(inputs)
        steps += [with_more(fitted, draw)[1], with_more(fitted, -draw)[1]]
    return np.mean(steps, axis=0) if steps else np.zeros(len(fitted.names))


def _sensor_noise(fitted: Fitted, sizes: Sizes, recorded: Sequence[Samples], factor: int) -> float:
    """Standard deviation that the noise of an input's sensor may have, as the log was recorded.

    It is no more than the input's own noise, part of which may have moved the drive. And it is no
    more than what moves the motor beyond its torque at the resonance, as white noise would.
    """
    gain = abs(fitted.by_name.get("beta1", 0.0))
    if gain == 0.0:
        return 0.0
    seen = position_noise(max(recorded, key=len).inputs[:, 0])
    sample_time = fitted.data.samples[0].sample_time
    resonance = 2.0 * np.pi / (PER_PERIOD * sample_time)
    size, rate = sizes.disturbances[-1], sizes.rates[-1]
    unexplained = size * np.sqrt(2.0 * rate / sample_time / (rate**2 + resonance**2)) / gain
    return float(min(seen, unexplained * np.sqrt(factor)))


def _by_gauge(found: Disturbed, data: Data) -> FloatArray | None:
    """Change of each value, shape (k,), where a deflection's sensor shows 1 % more."""
    if not data.relative_to:
        return None
    other = _again(found, _rescaled(data, 1.01), found.factor)
    return (
        np.zeros(len(found.fitted.names)) if other is None else other.values - found.fitted.values
    )


def by_eccentricity(fitted: Fitted) -> FloatArray | None:
    """Errors of gravity, shape (k, 3), by a link's encoder that errs once per turn.

    In the link's balance it looks like gravity through the spring; the motor's torque bears gravity
    and no such error. So the log may say how large it is.
    """
    gravity = np.array([name in LINK_GRAVITY for name in fitted.names])
    if fitted.data.relative_to or not gravity.any():
        return None
    angle = fitted.problem.segments.outputs[:, 0]
    rigs = [otherwise_shown(fitted, 0, ECCENTRICITY * wave(angle)) for wave in (np.sin, np.cos)]
    return gravity[:, None] * likely_changes(fitted, rigs, _scatter(fitted))


def _scatter(fitted: Fitted) -> float:
    """How many times as large the variances are as if innovations were white."""
    with np.errstate(divide="ignore", invalid="ignore"):  # of what the log leaves open
        ratios = np.square(fitted.fit.deviations / fitted.unit_deviations)
    return float(np.max(ratios, where=np.isfinite(ratios), initial=1.0))


def _rescaled(data: Data, scale: float) -> Data:
    """A log whose deflection sensor shows so many times as much."""
    rescaled = []
    for samples in data.samples:
        assert samples.velocities is not None
        positions, velocities = samples.positions.copy(), samples.velocities.copy()
        if positions.shape[1] == 1:  # the motor's motion is the input
            motor, speed = samples.inputs[:, 0], samples.inputs[:, 1]
        else:
            motor, speed = positions[:, 1], velocities[:, 1]
        positions[:, 0] = motor + scale * (positions[:, 0] - motor)
        velocities[:, 0] = speed + scale * (velocities[:, 0] - speed)
        rescaled.append(replace(samples, positions=positions, velocities=velocities))
    return replace(data, samples=tuple(rescaled))


def _in_other_bands(found: Disturbed, data: Data) -> list[Repeat]:
    """The structure fitted in wider and narrower bands, as far as the log has them."""
    factors = {thinning(data, found.fitted.by_name, share * PER_PERIOD) for share in _BANDS} - {
        found.factor
    }
    others = side_by_side(lambda factor: _again(found, data, factor), sorted(factors))
    return [other for other in others if other is not None]


def _halves(found: Disturbed, data: Data) -> tuple[Repeat, Repeat] | None:
    """The structure fitted to either half of every recording; None where one is too short."""
    first, second = side_by_side(lambda half: _again(found, half, found.factor), data.halves())
    return (first, second) if first and second else None


def _again(found: Disturbed, data: Data, factor: int) -> Repeat | None:
    fitted = found.fitted
    try:
        other = fit_in_band(
            fitted.structure,
            data,
            factor,
            fitted.by_name,
            found.sizes,
            of_band=factor == found.factor,
        ).fitted
    except ConvergenceError:
        return None
    # A channel that is moved out of the log leaves nothing to compare.
    if not (other.names == fitted.names and other.converged and other.has_partners):
        return None
    variances = np.maximum(np.diag(other.fit.covariance), other.unit_deviations**2)
    return Repeat(other.values, variances)
