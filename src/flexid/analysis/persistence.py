r"""Persistent excitation over windows, and the exponential rate that it guarantees.

The bound, for one row p̃' = -c r rᵀp̃ over a window of length T with G = ∫ r rᵀ dt ≥ ε I. Write e
for p̃, e₀ for its value at the window's start, and g = rᵀe. Then

    |e(T)|² = |e₀|² - 2c ∫ g² dt                                      (eq. (9) of the paper)
    rᵀe₀   = g + c ∫₀ᵗ r(t)ᵀr(τ) g(τ) dτ                              (eq. (7), integrated).

The L₂ norm of the left side of the second line is √(e₀ᵀG e₀) ≥ √ε |e₀|. The integral operator on
its right has a Hilbert-Schmidt norm of ‖G‖_F/√2, because ∬ (r(t)ᵀr(τ))² dτ dt = tr G² and the
triangle τ < t is half of the square. Hence √ε |e₀| ≤ (1 + c‖G‖_F/√2) ‖g‖, and

    |e(T)|² ≤ (1 - 2cε / (1 + c‖G‖_F/√2)²) |e₀|².

The argument is that of Sastry and Bodson, Adaptive Control (1989), section 2.5, with a sharper
norm of the operator.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from flexid.arrays import FloatArray
from flexid.errors import SettingError


@dataclass(frozen=True, eq=False)
class Persistence:
    """Excitation of one row over all windows of one length."""

    window: float  # length T in s
    grams: FloatArray  # (k, m, m), ∫ r rᵀ dt over each window
    mean: FloatArray  # (m, m), mean of r rᵀ over the whole record

    @property
    def level(self) -> float:
        """The level of persistent excitation: the smallest eigenvalue of all windows."""
        return float(np.linalg.eigvalsh(self.grams).min())

    def guaranteed_rate(self, gain: float) -> float:
        """Rate λ in 1/s with |p̃(t + T)| ≤ exp(-λT) |p̃(t)| at every start t of a window."""
        return float(-np.log(contraction(self.grams, gain).max()) / self.window)

    def averaged_rate(self, gain: float) -> float:
        """Rate in 1/s that averaging predicts for a small gain: c times the mean Gram's least."""
        return gain * max(float(np.linalg.eigvalsh(self.mean)[0]), 0.0)


def contraction(gram: ArrayLike, gain: float) -> FloatArray:
    """Upper bound of |p̃(t + T)| / |p̃(t)| over a window with Gram matrix G = ∫ r rᵀ dt.

    The derivation stands at the head of this module. Takes one matrix or a stack of them.
    """
    gram = np.asarray(gram, dtype=float)
    least = np.maximum(np.linalg.eigvalsh(gram)[..., 0], 0.0)
    size = 1.0 + gain * np.linalg.norm(gram, axis=(-2, -1)) / np.sqrt(2.0)
    return np.sqrt(1.0 - 2.0 * gain * least / size**2)


def persistence(r: FloatArray, sample_time: float, window: float) -> Persistence:
    """Excitation by a row's regressors, shape (n, m), over all windows of a length in s."""
    length = round(window / sample_time)
    if not 10 <= length < len(r):
        raise SettingError(
            "window",
            f"{window:g} s are {length} samples of {len(r)}: choose at least 10 samples and less "
            f"than the record",
        )
    products = r[:, :, None] * r[:, None, :]
    between = 0.5 * sample_time * (products[1:] + products[:-1])
    total = np.concatenate((np.zeros((1, *products.shape[1:])), np.cumsum(between, axis=0)))
    starts = np.arange(0, len(r) - length, max(1, length // 10))
    grams = total[starts + length] - total[starts]
    return Persistence(length * sample_time, grams, total[-1] / ((len(r) - 1) * sample_time))


def decay_rate(time: FloatArray, errors: FloatArray, window: float, floor: float) -> float:
    """Exponential rate in 1/s at which a row's errors, shape (n, m), have decayed.

    It is minus the slope of the logarithm of the envelope, the largest |p̃| in each window of some
    seconds, over the later half of the windows, where the slowest direction is left. Windows below
    the floor, where the integrator's error takes over, do not count. NaN with fewer than three.
    """
    norm = np.linalg.norm(errors, axis=1)
    place = np.floor((time - time[0]) / window * (1 + 1e-12)).astype(int)
    starts = np.flatnonzero(np.diff(place, prepend=-1))
    envelope = np.maximum.reduceat(norm, starts)
    above = envelope > floor
    count = len(above) if above.all() else int(np.argmin(above))
    later = slice(count // 2, count)
    if count - count // 2 < 3:
        return float("nan")
    slope = np.polyfit(time[starts[later]], np.log(envelope[later]), 1)[0]
    return float(-slope)
