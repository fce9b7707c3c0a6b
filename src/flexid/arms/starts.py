"""Starting values for the fit of an arm, by least squares on low-passed torque balances.

The link balances contain no input: they are homogeneous, and any scale fits them. Two methods find
the scale. If the deflection is measured well, the motor balance is solved for the spring, which
then drives the link. If the deflection is small, the sum of both balances gives the inertias,
because the spring cancels. The motor balance gives the rest. Dry friction takes any value while a
motor sticks. So each method also runs without the rows in which the motor sticks. For a joint that
rests, only the link balance is used.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from flexid.arrays import FloatArray
from flexid.estimators.samples import Samples
from flexid.estimators.segmented_motion import balance_columns
from flexid.models.planar_arm import PlanarArm
from flexid.models.torque_balance import JointTerm, TorqueBalance
from flexid.recording.velocities import position_noise

BANDS = (8.0, 16.0, 32.0, 64.0)
"""Cut-off frequencies in Hz to try; each at most a tenth of the sampling rate."""

_ORDER = 4  # of the filter, which runs forwards and backwards
_PER_PERIOD = 6.0  # rows kept per period of the cut-off frequency
_EIGHTH = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0.0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
_LEAST = 1e-3  # smallest start of a positive parameter, over its typical size
_SLOW = 3.0  # standard deviations of a velocity's noise, up to which its sign is unknown
_REGULARISATION = 1e-6  # weight of the regularisation towards zero, over a column's norm
_SOFTEST, _REWEIGHTED = 30.0, 3  # assumed stiffness over the largest known one; iterations
_BACKWARDS = 30.0  # standard deviations of white noise; a joint that hardly moves reaches 20
_FREE_FALL = 9.81  # m/s²
_FEWEST_EACH = 5  # rows with a moving motor per parameter of its balance


@dataclass(frozen=True, eq=False)
class Filtered:
    """Low-passed columns of the torque balances."""

    columns: FloatArray  # (n_rows_kept, n_balances, n_parameters)
    balance: TorqueBalance
    moving: NDArray[np.bool_]  # (n_rows_kept, n_balances): whether a velocity keeps its sign
    resting: Sequence[int] = ()  # indices of joints whose motors rest

    def parts(self, resting: Sequence[int]) -> "Iterator[Filtered]":
        """Yield the data without balances of resting motors, then also without sticking motors."""
        columns = self.columns.copy()
        columns[:, [2 * joint + 1 for joint in resting]] = 0.0
        yield replace(self, columns=columns, resting=resting)
        moving = columns.copy()
        for row in range(1, columns.shape[1], 2):
            moves = self.moving[:, row]
            if moves.sum() >= _FEWEST_EACH * np.count_nonzero(columns[:, row].any(axis=0)):
                moving[~moves, row] = 0.0
        if not np.array_equal(moving, columns):
            yield replace(self, columns=moving, resting=resting)

    @property
    def positive(self) -> NDArray[np.bool_]:
        """Whether a parameter (inertia, friction, …) is never negative, shape (n_parameters,)."""
        terms = [term for _, _, term in self.balance.placed()]
        brakes = [isinstance(term, JointTerm) and "v" in term.expression for term in terms]
        return np.array([term.sign > 0 for term in terms]) | brakes

    @property
    def springs(self) -> list[int]:
        """Index of each joint's stiffness, the first term of its spring."""
        return self._places("spring")

    @property
    def inputs(self) -> list[int]:
        """Index of each joint's input."""
        return self._places("input")

    def terms_without_spring(self, joint: int, free: Sequence[int]) -> list[int]:
        """Return indices of a motor balance's terms, with its input and without its stiffness."""
        spring, source, row = self.springs[joint], self.inputs[joint], 2 * joint + 1
        used = [k for k in free if k != spring and self.columns[:, row, k].any()]
        return used if source in used else [*used, source]

    def _places(self, place: str) -> list[int]:
        found: dict[int, int] = {}
        for k, (_, joint, term) in enumerate(self.balance.placed()):
            if isinstance(term, JointTerm) and term.place == place:
                found.setdefault(joint, k)
        return [found[joint] for joint in sorted(found)]


def filtered(balance: TorqueBalance, recordings: Sequence[Samples], cutoff: float) -> Filtered:
    """Return the columns of the balances, low-passed without phase shift and decimated."""
    from scipy.ndimage import maximum_filter1d, minimum_filter1d
    from scipy.signal import butter, sosfiltfilt  # late: it takes a third of a second to import

    parts, moving = [], []
    for recording in recordings:
        h = recording.sample_time
        sos = butter(_ORDER, min(2.0 * cutoff * h, 0.9), output="sos")
        positions = sosfiltfilt(sos, recording.positions, axis=0)
        speeds = _derivative(positions, h)
        signals = np.stack((positions, speeds, _derivative(speeds, h)), axis=2)
        # The mean of two samples corrects the half sample by which a held input is late.
        held = np.vstack((recording.inputs[:1], recording.inputs))
        inputs = sosfiltfilt(sos, 0.5 * (held[1:] + held[:-1]), axis=0)
        edge = min(len(positions) // 8, int(1.0 / (cutoff * h)) + 8)
        kept = np.arange(edge, len(positions) - edge, max(1, int(1.0 / (_PER_PERIOD * cutoff * h))))
        modes = sosfiltfilt(sos, np.sign(speeds), axis=0)
        parts.append(balance_columns(balance, signals[kept], inputs[kept], modes[kept]))
        noise = np.array([position_noise(column) for column in recording.positions.T])
        slow = _SLOW * 2.0 * np.pi * noise * np.sqrt(2.0 / 3.0 * h * cutoff**3)
        turns = np.sign(speeds) * (np.abs(speeds) > slow)
        memory = int(1.0 / (cutoff * h)) | 1
        ends = (each(turns, memory, axis=0)[kept] for each in (minimum_filter1d, maximum_filter1d))
        moving.append(np.prod([*ends], axis=0) > 0.0)
    return Filtered(np.concatenate(parts), balance, np.concatenate(moving))


def _derivative(values: FloatArray, h: float) -> FloatArray:
    """Return central differences of order eight, or of lower order at the ends."""
    found = np.gradient(values, h, axis=0)
    inner = sum(
        weight * values[k : len(values) - 8 + k] for k, weight in enumerate(_EIGHTH) if weight
    )
    found[4:-4] = inner / h
    return found


def starts(
    balance: TorqueBalance,
    recordings: Sequence[Samples],
    fixed: dict[str, float],
    resting: Sequence[int] = (),
) -> Iterator[dict[str, float]]:
    """Yield starting values of the parameters outside `fixed` by name, the widest band first.

    `resting` are indices of joints whose motors rest.
    """
    for cutoff in _bands(recordings):
        data = filtered(balance, recordings, cutoff)
        for part, way in product(data.parts(resting), (_by_deflection, _by_sums)):
            values = way(part, fixed)
            if np.isfinite(values).all():
                yield _bounded(data, values, fixed)


def _bands(recordings: Sequence[Samples]) -> list[float]:
    """Return the cut-off frequencies that suit the sampling, the widest band first."""
    fastest = min(1.0 / recording.sample_time for recording in recordings)
    return sorted({min(band, 0.1 * fastest) for band in BANDS}, reverse=True)


def backward_inputs(
    balance: TorqueBalance,
    recordings: Sequence[Samples],
    fixed: dict[str, float],
    resting: Sequence[int] = (),
) -> list[int]:
    """Return indices of joints whose positive input clearly deflects the spring backwards.

    `resting` are indices of joints whose motors rest.
    """
    data = filtered(balance, recordings, _bands(recordings)[0])
    found = []
    for joint in set(range(balance.joints)) - {*resting}:
        used = data.terms_without_spring(joint, _free(data, fixed))
        left, right = data.columns[:, 2 * joint + 1, used], -data.columns[:, 2 * joint + 1]
        left = left / np.maximum(np.sqrt(np.sum(left**2, axis=0)), np.finfo(float).tiny)
        inverse = np.linalg.pinv(left.T @ left)
        shares = inverse @ left.T @ right[:, data.springs[joint]]
        rest = right[:, data.springs[joint]] - left @ shares
        source = used.index(data.inputs[joint])
        if shares[source] < -_BACKWARDS * np.sqrt(inverse[source, source] * np.mean(rest**2)):
            found.append(joint)
    return found


def readings(
    arm: PlanarArm, recordings: Sequence[Samples]
) -> Iterator[tuple[str, PlanarArm, list[Samples]]]:
    """Yield other readings of a log: what it would mean, the arm, and the recordings."""
    for joint in range(2, arm.joints + 1):
        sides = np.ones(2 * arm.joints)
        sides[2 * joint - 2 : 2 * joint] = -1.0
        turned = [
            replace(r, positions=r.positions * sides, inputs=r.inputs * sides[::2])
            for r in recordings
        ]
        yield (
            f"joint {joint} counts the other way: scale its angles and its input by -1 in a column "
            f"map",
            arm,
            turned,
        )
    if arm.joints > 1 and "prismatic" not in arm.types:
        before = [np.repeat(r.positions[:, :-2:2], 2, axis=1) for r in recordings]
        apart = [
            replace(r, positions=np.hstack((r.positions[:, :2], r.positions[:, 2:] - of_base)))
            for r, of_base in zip(recordings, before, strict=True)
        ]
        yield (
            "angles are measured from one direction: subtract the previous link's from both of "
            "each joint, by a sum in a column map",
            arm,
            apart,
        )
    along, across = arm.gravity if arm.has_gravity else (_FREE_FALL, 0.0)
    turns = (
        (along, across),
        (0.0 - across, along),
        (0.0 - along, 0.0 - across),
        (across, 0.0 - along),
    )
    for x, y in turns:
        if arm.joints > 1 and (x, y) != arm.gravity:
            means = f"gravity is [{x:.3g}, {y:.3g}]: correct it, or the zeros of the angles"
            yield means, replace(arm, gravity=(x, y)), [*recordings]


def unexplained(
    balance: TorqueBalance,
    recordings: Sequence[Samples],
    fixed: dict[str, float],
    resting: Sequence[int] = (),
) -> float:
    """Return the part of the springs' torques, as squares, that the links' balances leave.

    Only slow motion counts. NaN if the motors' balances show no spring.
    """
    data = filtered(balance, recordings, _bands(recordings)[-1])
    values = _by_deflection(next(data.parts(resting)), fixed)
    rows = data.columns[:, ::2]
    torques = rows[:, :, data.springs] @ values[data.springs]
    size, left = (np.sum(part**2, axis=0) for part in (torques, rows @ values))
    return float(np.sum(left / size)) if np.all(size > 0.0) else np.nan


def _by_deflection(data: Filtered, fixed: dict[str, float]) -> FloatArray:
    """Return values with springs from the motor balances, and the rest from the link balances."""
    values = _fixed_values(data, fixed)
    columns, positive, free = data.columns, data.positive, _free(data, fixed)
    values[data.inputs] = 1.0
    scales: list[list[int]] = []
    for joint, (spring, source) in enumerate(zip(data.springs, data.inputs, strict=True)):
        row = 2 * joint + 1
        if joint in data.resting:
            values[spring] = 1.0
            scales.append([spring])
            continue
        used = data.terms_without_spring(joint, free)
        share = _least_squares(columns[:, row, used], -columns[:, row, spring], positive[used])
        if share[used.index(source)] <= 0.0:  # the input deflects this spring backwards
            return np.full_like(values, np.nan)
        stiffness = 1.0 / share[used.index(source)]
        values[spring] = stiffness
        motor = [k for k in used if k != source and not columns[:, row - 1, k].any()]
        values[motor] = [share[used.index(k)] * stiffness for k in motor]
        scales.append([spring, source, *motor])
    scaled = (j for j, source in enumerate(data.inputs) if source in free or j in data.resting)
    open_ = [*scaled]
    rows = columns[:, ::2]
    sought = [k for k in free if k not in {*data.springs, *data.inputs} and rows[:, :, k].any()]
    stiffness = np.abs(values[data.springs])
    # The weights are inverse stiffnesses. A resting joint's is unknown: its weight begins small.
    stiffness[list(data.resting)] = _SOFTEST * stiffness.max()
    springs = rows[:, :, data.springs] * values[data.springs]
    closed = [joint for joint in range(len(scales)) if joint not in open_]
    bounds = np.append(positive[sought], np.ones(len(open_), dtype=np.bool_))
    columns = np.concatenate((rows[:, :, sought], springs[:, :, open_]), axis=2)
    right = -springs[:, :, closed].sum(axis=2)
    own = {joint: len(sought) + open_.index(joint) for joint in data.resting}
    found = _least_squares_of_rows(columns, right, stiffness, bounds)
    for _ in range(_REWEIGHTED if own else 0):
        for joint, place in own.items():
            stiffness[joint] = found[place] if found[place] > 0.0 else stiffness[joint]
        found = _least_squares_of_rows(columns, right, stiffness, bounds)
    values[sought] = found[: len(sought)]
    for joint, scale in zip(open_, found[len(sought) :], strict=True):
        values[scales[joint]] *= scale  # of an uncalibrated input, or of a resting joint
    return values


def _by_sums(data: Filtered, fixed: dict[str, float]) -> FloatArray:
    """Return values from motor balances and from sums of motor and link balances, in one fit."""
    values = _fixed_values(data, fixed)
    free = [k for k in _free(data, fixed) if k not in data.inputs]
    values[data.inputs] = 1.0
    columns = data.columns
    rows = np.concatenate((columns[:, 1::2], columns[:, ::2] + columns[:, 1::2]), axis=1)
    right = -(rows[:, :, data.inputs] @ values[data.inputs])
    scale = np.sqrt(np.mean(right**2, axis=0))
    scale = np.where(scale > 0.0, scale, 1.0)
    values[free] = _least_squares_of_rows(rows[:, :, free], right, scale, data.positive[free])
    return values


def _fixed_values(data: Filtered, fixed: dict[str, float]) -> FloatArray:
    return np.array([fixed.get(name, 0.0) for name in data.balance.coefficients])


def _free(data: Filtered, fixed: dict[str, float]) -> list[int]:
    return [k for k, name in enumerate(data.balance.coefficients) if name not in fixed]


def _least_squares_of_rows(
    left: FloatArray, right: FloatArray, sizes: FloatArray, positive: NDArray[np.bool_]
) -> FloatArray:
    """Return least squares over balances, each divided by its size."""
    weighted = (left / sizes[:, None]).reshape(-1, left.shape[2])
    return _least_squares(weighted, (right / sizes).ravel(), positive)


def _least_squares(left: FloatArray, right: FloatArray, positive: NDArray[np.bool_]) -> FloatArray:
    """Return regularised least squares, with columns scaled to unit norm, some non-negative."""
    from scipy.optimize import lsq_linear

    scale = np.sqrt(np.sum(left**2, axis=0))
    scale = np.where(scale > 0.0, scale, 1.0)
    orthogonal, triangle = np.linalg.qr(left / scale)
    count = len(scale)
    rows = np.vstack((triangle, _REGULARISATION * np.eye(count)))
    sought = np.concatenate((orthogonal.T @ right, np.zeros(count)))
    least = np.where(positive, 0.0, -np.inf)
    return lsq_linear(rows, sought, (least, np.inf), method="bvls").x / scale


def _bounded(data: Filtered, values: FloatArray, fixed: dict[str, float]) -> dict[str, float]:
    """Return the free values by name; terms with sign 1 get at least a small positive value."""
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
