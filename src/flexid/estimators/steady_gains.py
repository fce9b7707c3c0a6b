"""Steady-state Kalman gains of a disturbed motion, for given noise and disturbances."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, expm

from flexid.arrays import FloatArray
from flexid.estimators.segmented_motion import SegmentedMotion

_DOUBLINGS = 40  # largest number of doublings of the time until the covariance is steady
_STEADY = 1e-10  # relative change of a covariance by the last doubling


@dataclass(frozen=True, eq=False)
class Sizes:
    """Sizes of sensor noise and of the rows' disturbances; arrays may have leading axes.

    An error of a spring's torque acts on link and motor in opposite directions, so the white noise
    that drives the disturbances of such a pair of rows is correlated.
    """

    sensors: FloatArray  # (n_rows,): standard deviation of each output's noise, in rad
    disturbances: FloatArray  # (n_rows,): root mean square of each row's disturbance, in rad/s²
    rates: FloatArray  # (n_rows,): decay rate of each disturbance, in 1/s
    correlations: FloatArray  # (n_rows // 2,): of the white noise of link and motor

    @classmethod
    def of(cls, numbers: FloatArray, rows: int) -> "Sizes":
        """Return the sizes with some `numbers`, (..., n_numbers)."""
        parts = np.split(numbers, [rows, 2 * rows, 3 * rows], axis=-1)
        sensors, disturbances, rates, correlations = parts
        return cls(np.exp(sensors), np.exp(disturbances), np.exp(rates), np.tanh(correlations))

    @property
    def numbers(self) -> FloatArray:
        """All sizes as unbounded numbers: logarithms, and inverse hyperbolic tangents."""
        sizes = np.log(np.concatenate((self.sensors, self.disturbances, self.rates)))
        return np.append(sizes, np.arctanh(self.correlations))

    def covariance(self, shares: FloatArray) -> FloatArray:
        """Return the covariance, (..., n_rows, n_rows), of shares, (n_rows,), of disturbances."""
        size = self.disturbances * shares
        found = size[..., :, None] * size[..., None, :]
        links = np.arange(0, 2 * self.correlations.shape[-1], 2)
        correlation = _diagonal(np.ones_like(size))
        correlation[..., links, links + 1] = self.correlations
        correlation[..., links + 1, links] = self.correlations
        return correlation * found


def transition_of(jacobian: FloatArray, sample_time: float) -> FloatArray:
    """Return the transition matrix of n_states states and constant disturbances of n_rows rows.

    It is not finite if the motion is very unstable.
    """
    n, rows = len(jacobian), len(jacobian) // 2
    forced = np.zeros((n + rows, n + rows))
    forced[:n, :n] = jacobian
    forced[1:n:2, n:] = np.eye(rows)
    with np.errstate(over="ignore", invalid="ignore"):  # of a start that diverges
        return np.asarray(expm(forced * sample_time), dtype=np.float64)


def sensors_of(rows: int, states: int) -> FloatArray:
    """Return the output matrix, shape (rows, states): each output is the position of its row."""
    return np.eye(2 * rows, states)[::2]


# A disturbance d is constant over an interval: d <- decay d + G e, with the innovations e.
def steady_gains(
    problem: SegmentedMotion, transition: FloatArray, sample_time: float, sizes: Sizes
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return gains of states and disturbances, decay, whitening, and log det S by outputs."""
    rows = sizes.rates.shape[-1]
    n = len(transition) - rows
    decay = np.exp(-sizes.rates * sample_time)
    step = _with_decay(transition, decay)
    noise = np.zeros_like(step)
    noise[..., n:, n:] = sizes.covariance(np.sqrt(1.0 - decay**2))
    sees = sensors_of(rows, n + rows)
    mixing = np.eye(rows)
    for a, other in enumerate(problem.references):  # a relative output has its reference's noise
        if other is not None:
            mixing[a, other] = 1.0
    sensors = mixing @ _diagonal(sizes.sensors**2) @ mixing.T
    predicted = steady_covariance(step, noise, sees, sensors)
    covariance = sees @ predicted @ sees.T + sensors
    gain = _turned(np.linalg.solve(covariance, sees @ predicted))
    triangle = np.linalg.cholesky(covariance)
    whitening = np.asarray(np.tril(np.linalg.inv(triangle)), dtype=np.float64)
    entropy = 2.0 * np.log(np.diagonal(triangle, axis1=-2, axis2=-1))
    return gain[..., :n, :], gain[..., n:, :], decay, whitening, entropy


def _turned(matrices: NDArray[np.floating]) -> FloatArray:
    return np.asarray(np.swapaxes(matrices, -1, -2), dtype=np.float64)


def _diagonal(values: FloatArray) -> FloatArray:
    """Return diagonal matrices, (..., n, n)."""
    return values[..., None] * np.eye(values.shape[-1])


def _with_decay(transition: FloatArray, decay: FloatArray) -> FloatArray:
    """Return transition matrices with decaying disturbances."""
    n = len(transition) - decay.shape[-1]
    step = np.tile(transition, (*decay.shape[:-1], 1, 1))
    step[..., n:, n:] = _diagonal(decay)
    return step


def steady_covariance(
    step: FloatArray, noise: FloatArray, sees: FloatArray, sensors: FloatArray
) -> FloatArray:
    """Solve Riccati equations by doubling (Anderson and Moore, Optimal Filtering, sec. 6.7)."""
    forward = _turned(step)
    information = sees.T @ np.linalg.solve(sensors, sees)
    covariance, found = noise, np.zeros_like(noise)
    steady = np.zeros(noise.shape[:-2], dtype=np.bool_)
    unit = np.eye(step.shape[-1])
    with np.errstate(over="ignore", invalid="ignore"):  # of a motion that diverges
        for _ in range(_DOUBLINGS):
            inverse = np.linalg.inv(unit + information @ covariance)
            more = _turned(forward) @ covariance @ inverse @ forward
            information = information + forward @ inverse @ information @ _turned(forward)
            forward = forward @ inverse @ forward
            covariance = covariance + more
            if not np.isfinite(covariance).all():
                break
            change = np.abs(more).max(axis=(-2, -1))
            settled = change <= _STEADY * np.abs(covariance).max(axis=(-2, -1))
            found = np.where((settled & ~steady)[..., None, None], covariance, found)
            steady |= settled
            if steady.all():
                return 0.5 * (found + _turned(found))
    raise LinAlgError("the filter does not settle")


_BANDS = 120  # frequency bands of each recording, of equal width on a logarithmic scale


def cost_by_spectra(
    observed: SegmentedMotion,
    sizes: Sizes,  # of the observer that made the innovations
    residuals: FloatArray,  # (n_samples, n_outputs): the innovations
    transitions: list[FloatArray],  # transition matrix of each recording
) -> Callable[[Sizes], FloatArray]:
    """Return -2 log likelihood, (...), as a function of sizes, up to a constant."""
    segments = observed.segments
    sees = sensors_of(residuals.shape[1], len(transitions[0]))
    recordings = []
    for (part, step), transition in zip(segments.by_recording(), transitions, strict=True):
        inside = residuals[part][segments.within[part]]
        places, power = _bands(inside)
        moved, gain, *_ = _predictor(observed, transition, step, sizes)
        response = np.eye(len(sees)) + _response(places, moved, gain, sees)
        outputs = response @ power @ response.conj().transpose(0, 2, 1)  # power of y in each band
        recordings.append((len(inside), step, transition, places, outputs))

    def cost(sizes: Sizes) -> FloatArray:
        total = np.zeros(sizes.rates.shape[:-1])
        for count, step, transition, places, outputs in recordings:
            moved, gain, whitening, entropy = _predictor(observed, transition, step, sizes)
            inverse = np.eye(len(sees)) - _response(places, moved - gain @ sees, gain, sees)
            white = whitening[..., None, :, :] @ inverse
            squares = ((white @ outputs) * white.conj()).reshape(*total.shape, -1)
            total = total + (count * entropy.sum(axis=-1) + squares.sum(axis=-1).real)
        return total

    return cost


def _bands(signals: FloatArray) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Points z = exp(iωh) of bands, and the power in each, (n_bands, n, n), of all samples."""
    count = len(signals)
    lines = np.fft.rfft(signals, axis=0)
    weights = np.full(len(lines), 2.0 / count)
    weights[0] = 1.0 / count
    if count % 2 == 0:
        weights[-1] = 1.0 / count
    edges = np.unique(np.geomspace(1, len(lines), _BANDS).astype(np.int64))[:-1] - 1
    each = weights[:, None, None] * lines[:, :, None] * lines[:, None, :].conj()
    middles = 0.5 * (edges + np.append(edges[1:], len(lines)) - 1)
    turns = np.maximum(middles, 0.5) / count  # above 0, where an integrator's response is infinite
    return np.exp(2j * np.pi * turns), np.add.reduceat(each, edges, axis=0)


def _predictor(
    observed: SegmentedMotion, transition: FloatArray, sample_time: float, sizes: Sizes
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Transition matrix F with decaying disturbances, gain F K, whitening, and log det S."""
    gain, disturbed, decay, whitening, entropy = steady_gains(
        observed, transition, sample_time, sizes
    )
    moved = _with_decay(transition, decay)
    return moved, moved @ np.concatenate((gain, disturbed), axis=-2), whitening, entropy


def _response(
    places: NDArray[np.complex128], moved: FloatArray, gain: FloatArray, sees: FloatArray
) -> NDArray[np.complex128]:
    """C (z I - F)⁻¹ L at each point z, shape (..., n_places, n_outputs, n_outputs)."""
    resolvent = places[:, None, None] * np.eye(moved.shape[-1]) - moved[..., None, :, :]
    return sees @ np.linalg.solve(resolvent, gain[..., None, :, :])
