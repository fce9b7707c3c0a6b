"""Where the fit of a torque balance begins: band-limited least squares on its columns.

The balances of the links hold no input: they are homogeneous, and any scale fits them. Two ways
lead around that. Where the deflection is seen well, the motor's balance gives the spring, with the
deflection as what is explained, and the spring then moves the link. Where it is small, the sum of
both balances, in which the spring cancels, gives the inertias, and the motor's balance the rest.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import butter, sosfiltfilt

from flexid.arrays import FloatArray
from flexid.estimators.balance_motion import balance_columns
from flexid.estimators.samples import Samples
from flexid.models.torque_balance import JointTerm, TorqueBalance

BANDS = (8.0, 16.0, 32.0, 64.0)
"""Cut-off frequencies in Hz that are tried; each at most a tenth of the sampling rate."""

_ORDER = 4  # of the filter, which runs forth and back
_PER_PERIOD = 6.0  # rows that are kept in a period of the cut-off frequency
_EIGHTH = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0.0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
_LEAST = 1e-3  # of a typical size: what a parameter that cannot be negative begins with at least


@dataclass(frozen=True, eq=False)
class Filtered:
    """Columns of the balances in a band, shape (n_rows_kept, n_balances, n_parameters)."""

    columns: FloatArray
    balance: TorqueBalance

    @property
    def springs(self) -> list[int]:
        """Place of each joint's stiffness: the first term of a spring."""
        return self._places("spring")

    @property
    def inputs(self) -> list[int]:
        """Place of each joint's input."""
        return self._places("input")

    def _places(self, place: str) -> list[int]:
        found: dict[int, int] = {}
        for k, (_, joint, term) in enumerate(self.balance.placed()):
            if isinstance(term, JointTerm) and term.place == place:
                found.setdefault(joint, k)
        return [found[joint] for joint in sorted(found)]


def filtered(balance: TorqueBalance, recordings: Sequence[Samples], cutoff: float) -> Filtered:
    """The columns of a balance along recordings, low-passed without phase shift and thinned."""
    parts = []
    for recording in recordings:
        h = recording.sample_time
        sos = butter(_ORDER, min(2.0 * cutoff * h, 0.9), output="sos")
        positions = sosfiltfilt(sos, recording.positions, axis=0)
        speeds = _derivative(positions, h)
        signals = np.stack((positions, speeds, _derivative(speeds, h)), axis=2)
        # A held input is half a sample late.
        held = np.vstack((recording.inputs[:1], recording.inputs))
        inputs = sosfiltfilt(sos, 0.5 * (held[1:] + held[:-1]), axis=0)
        edge = min(len(positions) // 8, int(1.0 / (cutoff * h)) + 8)
        kept = np.arange(edge, len(positions) - edge, max(1, int(1.0 / (_PER_PERIOD * cutoff * h))))
        modes = sosfiltfilt(sos, np.sign(speeds), axis=0)
        parts.append(balance_columns(balance, signals[kept], inputs[kept], modes[kept]))
    return Filtered(np.concatenate(parts), balance)


def _derivative(values: FloatArray, h: float) -> FloatArray:
    """Central differences of order eight; plain ones at the ends."""
    found = np.gradient(values, h, axis=0)
    inner = sum(
        weight * values[k : len(values) - 8 + k] for k, weight in enumerate(_EIGHTH) if weight
    )
    found[4:-4] = inner / h
    return found


def starts(
    balance: TorqueBalance, recordings: Sequence[Samples], fixed: dict[str, float]
) -> Iterator[dict[str, float]]:
    """Values to begin a fit with, the likelier ones first; what is fixed is left as it is."""
    fastest = min(1.0 / recording.sample_time for recording in recordings)
    for cutoff in sorted({min(band, 0.1 * fastest) for band in BANDS}, reverse=True):
        data = filtered(balance, recordings, cutoff)
        for way in (_by_deflection, _by_sums):
            values = way(data, fixed)
            if np.isfinite(values).all():
                yield _possible(data, values, fixed)


def _by_deflection(data: Filtered, fixed: dict[str, float]) -> FloatArray:
    """The spring from the motor's balance, with the deflection on the left; then the links."""
    values = _fixed_values(data, fixed)
    columns, free = data.columns, _free(data, fixed)
    values[data.inputs] = 1.0
    scales: list[list[int]] = []
    for joint, (spring, source) in enumerate(zip(data.springs, data.inputs, strict=True)):
        row = 2 * joint + 1
        used = [k for k in free if k != spring and columns[:, row, k].any()]
        used += [source] if source not in used else []
        share = _least_squares(columns[:, row, used], -columns[:, row, spring])
        stiffness = 1.0 / share[used.index(source)] if share[used.index(source)] else np.inf
        values[spring] = stiffness
        motor = [k for k in used if k != source and not columns[:, row - 1, k].any()]
        values[motor] = [share[used.index(k)] * stiffness for k in motor]
        scales.append([spring, source, *motor])
    open_ = [joint for joint, source in enumerate(data.inputs) if source in free]
    rows = columns[:, ::2]
    sought = [k for k in free if k not in {*data.springs, *data.inputs} and rows[:, :, k].any()]
    stiffness = np.abs(values[data.springs])
    springs = rows[:, :, data.springs] * values[data.springs]
    closed = [joint for joint in range(len(scales)) if joint not in open_]
    left = np.concatenate((rows[:, :, sought], springs[:, :, open_]), axis=2) / stiffness[:, None]
    right = -springs[:, :, closed].sum(axis=2) / stiffness
    found = _least_squares(left.reshape(-1, left.shape[2]), right.ravel())
    values[sought] = found[: len(sought)]
    for joint, scale in zip(open_, found[len(sought) :], strict=True):
        values[scales[joint]] *= scale  # of an input that is not calibrated
    return values


def _by_sums(data: Filtered, fixed: dict[str, float]) -> FloatArray:
    """All at once: motors' balances, and the sums of motor and link, in which springs cancel."""
    values = _fixed_values(data, fixed)
    free = [k for k in _free(data, fixed) if k not in data.inputs]
    values[data.inputs] = 1.0
    columns = data.columns
    rows = np.concatenate((columns[:, 1::2], columns[:, ::2] + columns[:, 1::2]), axis=1)
    right = -(rows[:, :, data.inputs] @ values[data.inputs])
    scale = np.sqrt(np.mean(right**2, axis=0))
    scale = np.where(scale > 0.0, scale, 1.0)
    left = (rows[:, :, free] / scale[:, None]).reshape(-1, len(free))
    values[free] = _least_squares(left, (right / scale).ravel())
    return values


def _fixed_values(data: Filtered, fixed: dict[str, float]) -> FloatArray:
    return np.array([fixed.get(name, 0.0) for name in data.balance.coefficients])


def _free(data: Filtered, fixed: dict[str, float]) -> list[int]:
    return [k for k, name in enumerate(data.balance.coefficients) if name not in fixed]


def _least_squares(left: FloatArray, right: FloatArray) -> FloatArray:
    """Least squares with columns of unit size; what is hardly seen stays small."""
    scale = np.sqrt(np.sum(left**2, axis=0))
    scale = np.where(scale > 0.0, scale, 1.0)
    return np.linalg.lstsq(left / scale, right, rcond=1e-6)[0] / scale


def _possible(data: Filtered, values: FloatArray, fixed: dict[str, float]) -> dict[str, float]:
    """The values by name, none negative that cannot be, with a mass matrix that is positive."""
    size = np.sqrt(np.mean(np.sum(data.columns**2, axis=1), axis=0))
    torque = float(np.sqrt(np.mean((data.columns[:, :, data.inputs]) ** 2)))
    found = {}
    for k, (name, _, term) in enumerate(data.balance.placed()):
        value = float(values[k])
        if name in fixed:
            continue
        if term.sign > 0:
            value = max(value, _LEAST * torque / size[k] if size[k] > 0.0 else 1.0)
        found[name] = value
    return found
