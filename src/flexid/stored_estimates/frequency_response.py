"""The frequency response of an identified joint for small motions: linearised, with its band."""

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
from flexid.identification.structure.gap import PLAY
from flexid.identification.vocabulary.evidence import (
    CONFIDENCE,
    Interval,
    checked_level,
    logarithmic_interval,
    quantile,
    slopes_of,
)
from flexid.models.flexible_joint import coefficients_of
from flexid.models.motion import unit_of
from flexid.models.parametric_system import ParametricSystem
from flexid.simulation.free_run import plain_model
from flexid.stored_estimates.structure import structure_of, values_of

ComplexArray = NDArray[np.complex128]


class Shown(NamedTuple):
    """What is shown of a kind of joint."""

    outputs: tuple[str, ...]  # row by row
    by_force: bool  # whether velocities over a force, else positions over a position
    characteristic: Mapping[str, int]  # rows that move, from the first, at each characteristic


SHOWN: Mapping[Kind, Shown] = {
    "flexible": Shown(
        ("link velocity", "motor velocity"), True, {"antiresonance": 1, "resonance": 2}
    ),
    "link": Shown(("link position",), False, {"antiresonance": 1}),
    "rigid": Shown(("motor velocity",), True, {}),
}


# (-ω² - jω D - K) q = B u,    K = K₀ + Σ cᵢ Kᵢ,    D and B likewise. Dry friction is constant.
@dataclass(frozen=True, eq=False)
class LinearJoint:
    """A joint about a place of rest; `linear_joint` makes one."""

    shown: Shown
    values: FloatArray  # (k,): coefficients in the model's order
    stiffness: FloatArray  # K, (1 + k, n_rows, n_rows): without coefficients, then of each
    damping: FloatArray  # D, likewise
    gain: FloatArray  # B, (1 + k, n_rows, n_inputs), likewise: of the input and its derivatives
    deviations: FloatArray  # (k, m): square root of the covariance, as far as it is finite
    names: tuple[str, ...]  # of the coefficients
    free: NDArray[np.bool_]  # (k,): not determined by the log
    degrees_of_freedom: float  # the fewest of those involved

    @property
    def unknown(self) -> tuple[str, ...]:
        """Coefficients that the log leaves free."""
        return tuple(name for name, free in zip(self.names, self.free, strict=True) if free)

    @property
    def rows(self) -> int:
        """Number of positions."""
        return self.stiffness.shape[1]

    def positions(self, omega: FloatArray, values: FloatArray | None = None) -> ComplexArray:
        """Positions per unit of the input, shape (..., n_rows); of the link, per motor position."""
        c = self.values if values is None else values
        impedance, drive = self._equations(omega, c)
        return np.asarray(np.linalg.solve(impedance, drive[..., None])[..., 0], dtype=np.complex128)

    def logarithmic_slopes(self, omega: FloatArray) -> ComplexArray:
        """Derivatives of ln(positions) by the coefficients, shape (n, n_rows, k)."""
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
        """What an input of size 1, with its derivatives, does to each row."""
        jw = 1j * omega[..., None]
        parts = [gain[..., order] * jw**order for order in range(gain.shape[-1])]
        return np.asarray(np.sum(parts, axis=0), dtype=np.complex128)


def linear_joint(result: Identification, position: float | None = None) -> LinearJoint:
    """Linearise an identified joint."""
    # Friction is dry here even where it was smoothed: sliding, it is constant.
    # So is one that remembers its path, along it, and what play takes off a spring in contact.
    constant = joint_of(result.model).remembered | PLAY
    lasting = {c: value for c, value in values_of(result, 0).items() if c not in constant}
    structure = structure_of(result, lasting, smooth=False)
    system = structure.unknowns(()).system.knowing(structure.joint.first)
    given = {name: lasting.get(name, 0.0) for name in system.coefficients}
    lost = np.array([not np.isfinite(value) for value in given.values()])
    found = {name: value if np.isfinite(value) else 0.0 for name, value in given.items()}
    rest = _hanging(found) if position is None else position
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


def _hanging(coefficients: Mapping[str, float]) -> float:
    """The angle at which gravity has no torque."""
    both = map(coefficients_of, ("gravity", "gravity_cosine"))
    for sine, cosine in zip(*both, strict=True):
        if coefficients.get(cosine):
            return -atan2(coefficients[cosine], coefficients.get(sine, 0.0))
    return 0.0


def _matrices(system: ParametricSystem, rest: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """K, D and B: what no coefficient multiplies, then what each of them does."""
    # They are affine in the coefficients, so unit vectors tell the parts apart.
    slopes_of = plain_model(system).slopes
    rows, count = len(system.rows), len(system.coefficients)
    x, u = np.zeros(2 * rows), np.zeros(len(system.inputs))
    x[::2] = rest
    if len(u) > 1:  # the motor's position, before its velocity
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
_TURN = 2.0  # rad between neighbours, from which on the response vanishes, or peaks, between them


def response_band(joint: LinearJoint, omega: FloatArray, level: float) -> FloatArray:
    """Ends of positions' intervals, (4, n, n_rows): magnitude ratios, then phase differences."""
    # Of a response that is zero: nothing is known of its logarithm.
    nothing = np.repeat([[0.0], [np.inf], [-np.inf], [np.inf]], len(omega), axis=1)
    if joint.unknown:
        return np.stack([nothing] * joint.rows, axis=2)
    response = joint.positions(omega)
    with np.errstate(divide="ignore", invalid="ignore"):  # of what does not move at all
        slopes = joint.logarithmic_slopes(omega)
    bands = [
        _of_row(joint, omega, response, slopes, row, level) if response[:, row].all() else nothing
        for row in range(joint.rows)
    ]
    return np.stack(bands, axis=2)


# Near a resonance the delta method is too narrow below the peak and too wide above. So the response
# is computed at c + r S w, with S Sᵀ the covariance, r the quantile of Student's t, |w| ≤ 1, in the
# plane of the two directions in which magnitude and phase change.
def _of_row(
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
    # The first axis lies along the change of the magnitude, which so is met exactly.
    planes = np.linalg.qr(np.stack((change.real, change.imag), axis=2)).Q
    rays = np.stack((np.cos(_ANGLES), np.sin(_ANGLES)), axis=1)[:, : planes.shape[2]]
    reach = quantile(joint.degrees_of_freedom, level)
    moves = np.einsum("ki,nij,aj->nak", joint.deviations, planes, rays)[:, :, None]
    moves = reach * _RADII[:, None] * moves
    at = np.broadcast_to(omega[:, None, None], moves.shape[:3])
    ratio = joint.positions(at, joint.values + moves)[..., row] / response[:, row, None, None]
    turned = np.angle(ratio[:, :, 1:] / ratio[:, :, :-1])
    angles = np.cumsum(turned, axis=2)  # from the middle outwards
    between = np.angle(np.exp(1j * np.diff(angles[:, [*range(len(rays)), 0], -1], axis=1)))
    any_phase = (np.abs(turned) > _TURN).any(axis=(1, 2)) | (np.abs(between.sum(axis=1)) > np.pi)
    with np.errstate(divide="ignore"):  # of a joint without damping
        largest = 1.0 / _nearest(1.0 / ratio)
    behind = np.where(any_phase, -np.pi, np.minimum(angles.min(axis=(1, 2)), 0.0))
    ahead = np.where(any_phase, np.pi, np.maximum(angles.max(axis=(1, 2)), 0.0))
    return np.array((_nearest(ratio), largest, behind, ahead))


def _nearest(points: ComplexArray) -> FloatArray:
    """How near the lines between points along each ray come to zero, shape (n,)."""
    start, step = points[:, :, :-1], np.diff(points, axis=2)
    length = np.abs(step) ** 2
    along = -(start * step.conj()).real / np.where(length > 0.0, length, 1.0)
    return np.abs(start + np.clip(along, 0.0, 1.0) * step).min(axis=(1, 2))


_POINTS = 400  # of the curves, evenly on the logarithm
_NEAR_PEAK = np.geomspace(1e-5, 0.2, 40)  # and near a peak, however narrow it is
_AROUND = 20.0  # how far the curves go, times what is characteristic


@dataclass(frozen=True)
class Frequency:
    """A frequency that is characteristic of the joint, with its interval."""

    # "antiresonance", of the link while the motor is held, where the motor does not follow its
    # torque; or "resonance", of link and motor against each other
    name: str
    value: float  # Hz, of the joint without its damping
    interval: Interval  # Hz


@dataclass(frozen=True, eq=False)
class Response:
    """What one output does under the input; arrays are (n,)."""

    output: str  # "motor velocity", "link velocity"; "link position" of the link alone
    input: str  # "torque", "current", "voltage" or "motor position"
    unit: str  # of the magnitude
    values: ComplexArray
    lower: FloatArray  # ends of the magnitude's interval; 0 where the log leaves something free,
    upper: FloatArray  # and infinite
    # ends of the phase's interval in rad, on the branch of the angle of `values`
    behind: FloatArray
    ahead: FloatArray


@dataclass(frozen=True, eq=False)
class FrequencyResponse:
    """Frequency responses of an identified joint.

    Parameters
    ----------
    model : {"flexible", "link", "rigid"}
        Which joint.
    frequency : array, shape (n,)
        In Hz.
    responses : tuple of Response
        One for each position of the model.
    characteristic : tuple of Frequency
        Antiresonance and resonance, as far as the joint has them.
    level : float
        Nominal coverage of the intervals.
    unknown : tuple of str
        Coefficients that the log does not determine: because of them there is no band.
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
    """Frequency responses of the joint itself, without hold and delays, with confidence bands."""
    joint = linear_joint(result, position)
    characteristic = _characteristic(joint, checked_level(level))
    chosen = _chosen(characteristic) if frequency is None else frequency
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
    """Name of the input, and the unit of a response to it."""
    if not joint.shown.by_force:
        return "motor position", "{0}/{0}".format(unit_of("rad", result.joint))
    names = {"N m": "torque", "N": "force", "A": "current", "V": "voltage"}
    per_input = result.coefficients["beta1"].unit.partition("/s^2")[2]
    name = names.get(result.input_unit, "input")
    return name, unit_of("rad/s", result.joint) + per_input


def _characteristic(joint: LinearJoint, level: float) -> tuple[Frequency, ...]:
    """Antiresonance and resonance, by the delta method on their logarithms."""
    found = []
    # Gravity's own slow swing is no resonance of the joint.
    for name, rows in joint.shown.characteristic.items():
        stiffness = joint.stiffness[:, :rows, :rows]
        matrix = -(stiffness[0] + np.tensordot(joint.values, stiffness[1:], 1))
        squares, right = (np.asarray(part, np.complex128) for part in np.linalg.eig(matrix))
        place = int(np.argmax(squares.real))
        square = float(squares[place].real)
        if square <= 0.0 or squares[place].imag != 0.0:
            continue  # coefficients that no spring has
        left = np.linalg.inv(right)[place]
        slopes = -np.array([(left @ part @ right[:, place]).real for part in stiffness[1:]])
        std = float(np.linalg.norm(slopes @ joint.deviations)) / (2.0 * square)
        if slopes[joint.free].any():
            std = np.inf
        value = float(np.sqrt(square)) / (2.0 * np.pi)
        ends = logarithmic_interval(value, std * value, joint.degrees_of_freedom, level)
        found.append(Frequency(name, value, ends))
    return tuple(found)


def _chosen(characteristic: Sequence[Frequency]) -> FloatArray:
    """Frequencies in Hz over all that is of interest."""
    own = [f.value for f in characteristic] or [1.0]
    low, high = min(own) / _AROUND, max(own) * _AROUND
    evenly = np.geomspace(low, high, _POINTS)
    near = [f * (1.0 + side * _NEAR_PEAK) for f in own for side in (-1.0, 1.0)]
    every = np.unique(np.concatenate((evenly, *near)))
    return every[(every >= evenly[0]) & (every <= evenly[-1])]
