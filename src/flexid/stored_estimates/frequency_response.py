"""Frequency response of an identified joint, linearised at rest, with a confidence band."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import atan2
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexid.arrays import FloatArray
from flexid.errors import SettingError
from flexid.estimators.normal_equations import eigen
from flexid.identification.preparation.joint import Kind, joint_of
from flexid.identification.result import Identification
from flexid.identification.vocabulary.evidence import (
    CONFIDENCE,
    Interval,
    checked_level,
    logarithmic_interval,
    quantile,
    slopes_of,
)
from flexid.kernels.store import model_kernel
from flexid.models.flexible_joint import PLAY, coefficients_of
from flexid.models.motion import unit_of
from flexid.models.parametric_system import ParametricSystem
from flexid.stored_estimates.structure import structure_of, values_of

ComplexArray = NDArray[np.complex128]


class Shown(NamedTuple):
    """Outputs, input and characteristic frequencies of a kind of joint."""

    outputs: tuple[str, ...]  # one per row
    by_force: bool  # velocity over torque or force if True, else position over position
    characteristic: Mapping[str, int]  # number of leading rows that move at each frequency


SHOWN: Mapping[Kind, Shown] = {
    "flexible": Shown(
        ("link velocity", "motor velocity"), True, {"antiresonance": 1, "resonance": 2}
    ),
    "link": Shown(("link position",), False, {"antiresonance": 1}),
    "rigid": Shown(("motor velocity",), True, {}),
}


# (-ω² - jω D - K) q = B u,  K = K₀ + Σ cᵢ Kᵢ, likewise D and B. Dry friction, constant, drops out.
@dataclass(frozen=True, eq=False)
class LinearJoint:
    """Joint linearised about a position at rest; made by `linear_joint`."""

    shown: Shown
    values: FloatArray  # (k,): coefficients in the model's order
    stiffness: FloatArray  # K₀, K₁, …, shape (1 + k, n_rows, n_rows)
    damping: FloatArray  # D₀, D₁, …, shape (1 + k, n_rows, n_rows)
    gain: FloatArray  # B₀, B₁, …, (1 + k, n_rows, n_inputs): for the input and its derivatives
    deviations: FloatArray  # (k, m): square root of the finite part of the covariance
    names: tuple[str, ...]  # of the coefficients
    free: NDArray[np.bool_]  # (k,): whether the log does not determine the coefficient
    degrees_of_freedom: float  # smallest number among the estimates used

    @property
    def unknown(self) -> tuple[str, ...]:
        """Coefficients that the log does not determine."""
        return tuple(name for name, free in zip(self.names, self.free, strict=True) if free)

    @property
    def rows(self) -> int:
        """Number of positions."""
        return self.stiffness.shape[1]

    def positions(self, omega: FloatArray, values: FloatArray | None = None) -> ComplexArray:
        """Return the complex positions per unit of the input, shape (..., n_rows)."""
        c = self.values if values is None else values
        impedance, drive = self._equations(omega, c)
        return np.asarray(np.linalg.solve(impedance, drive[..., None])[..., 0], dtype=np.complex128)

    def logarithmic_slopes(self, omega: FloatArray) -> ComplexArray:
        """Return the derivatives of ln(positions) by the coefficients, shape (n, n_rows, k)."""
        impedance, drive = self._equations(omega, self.values)
        q = np.linalg.solve(impedance, drive[..., None])
        jw = 1j * omega[:, None, None, None]
        moved = (self.stiffness[1:] + jw * self.damping[1:]) @ q[:, None]
        pushed = moved[..., 0] + self._drive(omega[:, None], self.gain[1:])
        slopes = np.linalg.solve(impedance, pushed.swapaxes(1, 2)) / q
        return np.asarray(slopes, dtype=np.complex128)

    def _equations(self, omega: FloatArray, c: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        stiffness, damping, gain = (
            affine[0] + np.tensordot(c, affine[1:], 1)
            for affine in (self.stiffness, self.damping, self.gain)
        )
        w = omega[..., None, None]
        impedance = -(w**2) * np.eye(self.rows) - 1j * w * damping - stiffness
        return impedance, self._drive(omega, gain)

    def _drive(self, omega: FloatArray, gain: FloatArray) -> ComplexArray:
        """Return B u of each row for the unit input exp(jωt) and its derivatives."""
        jw = 1j * omega[..., None]
        parts = [gain[..., order] * jw**order for order in range(gain.shape[-1])]
        return np.asarray(np.sum(parts, axis=0), dtype=np.complex128)


def linear_joint(result: Identification, position: float | None = None) -> LinearJoint:
    """Linearise an identified joint at a position, by default at its equilibrium."""
    # Terms that are constant in sliding motion have no slope: dry friction, also where the fit
    # smoothed it; friction with memory, along its path; the offset of a spring with backlash.
    constant = joint_of(result.model).remembered | PLAY
    varying = {c: value for c, value in values_of(result, 0).items() if c not in constant}
    structure = structure_of(result, varying, smooth=False)
    system = structure.unknowns(()).system.knowing(structure.joint.first)
    given = {name: varying.get(name, 0.0) for name in system.coefficients}
    lost = np.array([not np.isfinite(value) for value in given.values()])
    found = {name: value if np.isfinite(value) else 0.0 for name, value in given.items()}
    rest = _equilibrium(found) if position is None else position
    if not np.isfinite(rest):
        raise SettingError("position", f"must be a finite position in rad or m, got {rest}")
    slopes = slopes_of([result.coefficients.get(name) for name in found], result.fit.names)
    finite = np.isfinite(np.diag(result.fit.covariance))
    free = (slopes[:, ~finite] != 0.0).any(axis=1) | lost
    used = (slopes != 0.0).any(axis=0) & finite
    variances, vectors = eigen(result.fit.covariance[np.ix_(used, used)])
    freedom = [n for n, is_used in zip(result.fit.degrees_of_freedom, used, strict=True) if is_used]
    return LinearJoint(
        SHOWN[result.model],
        np.array(list(found.values())),
        *_matrices(system, rest),
        slopes[:, used] @ (vectors * np.sqrt(np.maximum(variances, 0.0))),
        tuple(found),
        free,
        float(min(freedom, default=np.inf)),
    )


def _equilibrium(coefficients: Mapping[str, float]) -> float:
    """Return the link angle at which gravity exerts no torque, in rad."""
    both = map(coefficients_of, ("gravity", "gravity_cosine"))
    for sine, cosine in zip(*both, strict=True):
        if coefficients.get(cosine):
            return -atan2(coefficients[cosine], coefficients.get(sine, 0.0))
    return 0.0


def _matrices(system: ParametricSystem, rest: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return K, D and B, each as its constant part followed by its slope in each coefficient."""
    # The matrices are affine in the coefficients, so unit vectors separate the parts.
    slopes_of = model_kernel("plain_model", system).slopes
    rows, count = len(system.rows), len(system.coefficients)
    x, u = np.zeros(2 * rows), np.zeros(len(system.inputs))
    x[::2] = rest
    if len(u) > 1:  # inputs of the link alone: the motor's position and its velocity
        u[0] = rest
    constants = list(system.constants.values())
    slopes = np.empty((1 + count, 2 * rows, 2 * rows))
    gains = np.empty((1 + count, 2 * rows, len(u)))
    for place, coefficients in enumerate(np.vstack((np.zeros(count), np.eye(count)))):
        point = (x.tolist(), u.tolist(), coefficients.tolist(), constants)
        slopes_of(*point, slopes[place], gains[place])
    for parts in (slopes, gains):
        parts[1:] -= parts[0]
    return slopes[:, 1::2, ::2], slopes[:, 1::2, 1::2], gains[:, 1::2]


_RADII = np.array([0.0, 0.25, 0.5, 0.75, 1.0])
_ANGLES = 2.0 * np.pi * np.arange(32) / 32  # the largest response is missed by 0.5 % of the width
_LARGEST_STEP = 2.0  # rad between neighbours; beyond it the response may be 0 or ∞ between them


def response_band(joint: LinearJoint, omega: FloatArray, level: float) -> FloatArray:
    """Return the interval ends, (4, n, n_rows): magnitude ratios, then phase differences in rad."""
    # A response of zero has no logarithm, so its interval is unbounded.
    unbounded = np.repeat([[0.0], [np.inf], [-np.inf], [np.inf]], len(omega), axis=1)
    if joint.unknown:
        return np.stack([unbounded] * joint.rows, axis=2)
    response = joint.positions(omega)
    with np.errstate(divide="ignore", invalid="ignore"):  # for a response of zero
        slopes = joint.logarithmic_slopes(omega)
    bands = [
        _row_band(joint, omega, response, slopes, i, level) if response[:, i].all() else unbounded
        for i in range(joint.rows)
    ]
    return np.stack(bands, axis=2)


# Near a resonance the delta method gives bands too narrow below the peak and too wide above it. So
# the response is computed at c + r S w, where S Sᵀ is the covariance, r the quantile of Student's t
# and |w| ≤ 1 lies in the plane of the two directions in which magnitude and phase change.
def _row_band(
    joint: LinearJoint,
    omega: FloatArray,
    response: ComplexArray,
    slopes: ComplexArray,
    row: int,
    level: float,
) -> FloatArray:
    change = slopes[:, row] @ joint.deviations
    if change.shape[1] == 0:  # nothing was estimated
        none = np.zeros(len(omega))
        return np.array((none + 1.0, none + 1.0, none, none))
    # The first axis lies along the change of the magnitude, so a ray meets that direction exactly.
    planes = np.linalg.qr(np.stack((change.real, change.imag), axis=2)).Q
    rays = np.stack((np.cos(_ANGLES), np.sin(_ANGLES)), axis=1)[:, : planes.shape[2]]
    reach = quantile(joint.degrees_of_freedom, level)
    moves = np.einsum("ki,nij,aj->nak", joint.deviations, planes, rays)[:, :, None]
    moves = reach * _RADII[:, None] * moves
    at = np.broadcast_to(omega[:, None, None], moves.shape[:3])
    ratio = joint.positions(at, joint.values + moves)[..., row] / response[:, row, None, None]
    turned = np.angle(ratio[:, :, 1:] / ratio[:, :, :-1])
    angles = np.cumsum(turned, axis=2)  # along each ray, from its centre outwards
    between = np.angle(np.exp(1j * np.diff(angles[:, [*range(len(rays)), 0], -1], axis=1)))
    jumps = (np.abs(turned) > _LARGEST_STEP).any(axis=(1, 2))
    any_phase = jumps | (np.abs(between.sum(axis=1)) > np.pi)
    with np.errstate(divide="ignore"):  # for a joint without damping
        largest = 1.0 / _nearest(1.0 / ratio)
    behind = np.where(any_phase, -np.pi, np.minimum(angles.min(axis=(1, 2)), 0.0))
    ahead = np.where(any_phase, np.pi, np.maximum(angles.max(axis=(1, 2)), 0.0))
    return np.array((_nearest(ratio), largest, behind, ahead))


def _nearest(points: ComplexArray) -> FloatArray:
    """Return the smallest distance from zero to the lines between points on a ray, shape (n,)."""
    start, step = points[:, :, :-1], np.diff(points, axis=2)
    length = np.abs(step) ** 2
    along = -(start * step.conj()).real / np.where(length > 0.0, length, 1.0)
    return np.abs(start + np.clip(along, 0.0, 1.0) * step).min(axis=(1, 2))


_POINTS = 400  # number of frequencies, spaced evenly on a logarithmic axis
_NEAR_PEAK = np.geomspace(1e-5, 0.2, 40)  # relative distances of further points from each peak
_SPAN = 20.0  # ratio of the outermost frequencies to the characteristic ones


@dataclass(frozen=True)
class Frequency:
    """Antiresonance or resonance of the undamped joint, with its interval."""

    # "antiresonance": the link oscillates and torque does not move the motor; "resonance": link
    # and motor oscillate against each other
    name: str
    value: float  # Hz, without damping
    interval: Interval  # Hz


@dataclass(frozen=True, eq=False)
class Response:
    """Frequency response of one output to the input; arrays have shape (n,)."""

    output: str  # "motor velocity" or "link velocity"; "link position" for the link alone
    input: str  # "torque", "current", "voltage" or "motor position"
    unit: str  # of the magnitude
    values: ComplexArray
    lower: FloatArray  # interval of the magnitude; 0 if a coefficient is undetermined
    upper: FloatArray  # infinite in that case
    # interval of the phase in rad, on the same branch as the angle of `values`
    behind: FloatArray
    ahead: FloatArray


@dataclass(frozen=True, eq=False)
class FrequencyResponse:
    """Frequency responses of an identified joint.

    Parameters
    ----------
    model : {"flexible", "link", "rigid"}
        Kind of joint.
    frequency : array, shape (n,)
        Frequencies in Hz.
    responses : tuple of Response
        One response for each position of the model.
    characteristic : tuple of Frequency
        Antiresonance and resonance that the joint has.
    level : float
        Nominal coverage of the intervals.
    unknown : tuple of str
        Coefficients that the log does not determine. If there are any, there is no band.
    """

    model: str
    frequency: FloatArray
    responses: tuple[Response, ...]
    characteristic: tuple[Frequency, ...]
    level: float
    unknown: tuple[str, ...]

    def __repr__(self) -> str:
        outputs = ", ".join(response.output for response in self.responses)
        low, high = self.frequency[0], self.frequency[-1]
        count = len(self.frequency)
        return f"<FrequencyResponse: {outputs}; {count} frequencies, {low:.3g} to {high:.3g} Hz>"


def frequency_response(
    result: Identification,
    *,
    frequency: ArrayLike | None = None,
    position: float | None = None,
    level: float = CONFIDENCE,
) -> FrequencyResponse:
    """Compute frequency responses of the joint, without hold and delays, with confidence bands."""
    joint = linear_joint(result, position)
    characteristic = _characteristic(joint, checked_level(level))
    chosen = _default_frequencies(characteristic) if frequency is None else frequency
    try:
        hertz = np.atleast_1d(np.asarray(chosen, dtype=np.float64))
    except (TypeError, ValueError):
        hertz = np.empty(0)
    if hertz.ndim != 1 or not hertz.size or not (np.isfinite(hertz) & (hertz > 0.0)).all():
        raise SettingError("frequency", "must be numbers of Hz above 0, one or more")
    omega = 2.0 * np.pi * hertz
    bands = response_band(joint, omega, level)
    positions = joint.positions(omega)
    input_name, unit = _input(joint, result)
    responses = []
    for row, name in enumerate(joint.shown.outputs):
        values = positions[:, row] * (1j * omega if joint.shown.by_force else 1.0)
        size, angle = np.abs(values), np.angle(values)
        lower, upper, behind, ahead = bands[:, :, row]
        moves = bool(size.all())
        responses.append(
            Response(
                name,
                input_name,
                unit,
                values,
                size * lower,
                size * upper if moves else np.full(len(size), np.inf),
                angle + behind,
                angle + ahead,
            )
        )
    return FrequencyResponse(
        result.model, hertz, tuple(responses), characteristic, level, joint.unknown
    )


def _input(joint: LinearJoint, result: Identification) -> tuple[str, str]:
    """Return the name of the input and the unit of a response to it."""
    if not joint.shown.by_force:
        return "motor position", "{0}/{0}".format(unit_of("rad", result.joint))
    names = {"N m": "torque", "N": "force", "A": "current", "V": "voltage"}
    per_input = result.coefficients["beta1"].unit.partition("/s^2")[2]
    name = names.get(result.input_unit, "input")
    return name, unit_of("rad/s", result.joint) + per_input


def _characteristic(joint: LinearJoint, level: float) -> tuple[Frequency, ...]:
    """Return antiresonance and resonance, with intervals by the delta method on the logarithm."""
    found = []
    # Only the largest eigenvalue counts: the slow pendulum motion is no resonance of the joint.
    for name, rows in joint.shown.characteristic.items():
        stiffness = joint.stiffness[:, :rows, :rows]
        matrix = -(stiffness[0] + np.tensordot(joint.values, stiffness[1:], 1))
        squares, right = (np.asarray(part, np.complex128) for part in np.linalg.eig(matrix))
        place = int(np.argmax(squares.real))
        square = float(squares[place].real)
        if square <= 0.0 or squares[place].imag != 0.0:
            continue  # no oscillation: the coefficients have the signs of no real spring
        left = np.linalg.inv(right)[place]
        slopes = -np.array([(left @ part @ right[:, place]).real for part in stiffness[1:]])
        std = float(np.linalg.norm(slopes @ joint.deviations)) / (2.0 * square)
        if slopes[joint.free].any():
            std = np.inf
        value = float(np.sqrt(square)) / (2.0 * np.pi)
        ends = logarithmic_interval(value, std * value, joint.degrees_of_freedom, level)
        found.append(Frequency(name, value, ends))
    return tuple(found)


def _default_frequencies(characteristic: Sequence[Frequency]) -> FloatArray:
    """Return frequencies in Hz around the characteristic ones, denser near them."""
    own = [f.value for f in characteristic] or [1.0]
    low, high = min(own) / _SPAN, max(own) * _SPAN
    evenly = np.geomspace(low, high, _POINTS)
    near = [f * (1.0 + side * _NEAR_PEAK) for f in own for side in (-1.0, 1.0)]
    every = np.unique(np.concatenate((evenly, *near)))
    return every[(every >= evenly[0]) & (every <= evenly[-1])]
