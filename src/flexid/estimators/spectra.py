"""Innovations of another observer, from their spectra: what sizes cost without another motion.

The innovations e of one observer of a linear model are those of another after a filter. With the
transition F and the gain K of each, both have the same outputs about a motion without an observer,

    y = (I + C (z I - F)⁻¹ F K) e,

so the spectrum of e in some hundred bands of frequency tells what any gain would make of it.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError

from flexid.arrays import FloatArray
from flexid.estimators.segmented_motion import SegmentedMotion
from flexid.estimators.steady_gains import Sizes, sensors_of, steady_gains

WORST = 1e15
"""Cost of what cannot be computed; a difference of two has to be a number."""

_BANDS = 120  # of each recording, of equal width on a logarithmic scale


@dataclass(frozen=True, eq=False)
class _Recording:
    """Innovations of one recording."""

    count: int  # of samples
    sample_time: float
    transition: FloatArray  # of states and disturbances over an interval
    places: NDArray[np.complex128]  # (n_bands,): z of each band
    outputs: NDArray[np.complex128]  # (n_bands, n_outputs, n_outputs): power of y


def cost_by_spectra(
    observed: SegmentedMotion,
    sizes: Sizes,  # of its observer
    residuals: FloatArray,  # (n_samples, n_outputs): its innovations
    transitions: list[FloatArray],  # of each recording
) -> Callable[[Sizes], float]:
    """Twice the negative logarithm of the likelihood of other sizes, but for a constant."""
    segments = observed.segments
    sees = sensors_of(residuals.shape[1], len(transitions[0]))
    recordings = []
    for (part, step), transition in zip(segments.by_recording(), transitions, strict=True):
        inside = residuals[part][segments.within[part]]
        places, power = _bands(inside)
        moved, gain, *_ = _predictor(observed, transition, step, sizes)
        response = np.eye(len(sees)) + _response(places, moved, gain, sees)
        outputs = response @ power @ response.conj().transpose(0, 2, 1)
        recordings.append(_Recording(len(inside), step, transition, places, outputs))

    def cost(sizes: Sizes) -> float:
        total = 0.0
        for own in recordings:
            try:
                moved, gain, whitening, entropy = _predictor(
                    observed, own.transition, own.sample_time, sizes
                )
            except (LinAlgError, ValueError):
                return WORST
            inverse = np.eye(len(sees)) - _response(own.places, moved - gain @ sees, gain, sees)
            white = whitening @ inverse
            squares = np.sum((white @ own.outputs) * white.conj())
            total += own.count * float(entropy.sum()) + float(squares.real)
        return total

    return cost


def _bands(signals: FloatArray) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Places z of bands, and the power in each, shape (n_bands, n, n): in all, the squares' sum."""
    count = len(signals)
    lines = np.fft.rfft(signals, axis=0)
    weights = np.full(len(lines), 2.0 / count)
    weights[0] = 1.0 / count
    if count % 2 == 0:
        weights[-1] = 1.0 / count
    edges = np.unique(np.geomspace(1, len(lines), _BANDS).astype(np.int64))[:-1] - 1
    each = weights[:, None, None] * lines[:, :, None] * lines[:, None, :].conj()
    middles = 0.5 * (edges + np.append(edges[1:], len(lines)) - 1)
    turns = np.maximum(middles, 0.5) / count  # at a constant, what integrates has no response
    return np.exp(2j * np.pi * turns), np.add.reduceat(each, edges, axis=0)


def _predictor(
    observed: SegmentedMotion, transition: FloatArray, sample_time: float, sizes: Sizes
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Transition F and gain F K with the decay of disturbances, the whitening, and log det S."""
    gain, disturbed, decay, whitening, entropy = steady_gains(
        observed, transition, sample_time, sizes
    )
    moved = transition.copy()
    moved[len(gain) :, len(gain) :] = np.diag(decay)
    return moved, moved @ np.vstack((gain, disturbed)), whitening, entropy


def _response(
    places: NDArray[np.complex128], moved: FloatArray, gain: FloatArray, sees: FloatArray
) -> NDArray[np.complex128]:
    """C (z I - F)⁻¹ L at each place, shape (n_places, n_outputs, n_outputs)."""
    resolvent = places[:, None, None] * np.eye(len(moved)) - moved
    return sees @ np.linalg.solve(resolvent, np.broadcast_to(gain, (len(places), *gain.shape)))
