"""The frequency response of an identified joint for small motions, with its band."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from flexid.arrays import FloatArray
from flexid.errors import SettingError
from flexid.identification.result import Identification
from flexid.identification.vocabulary.estimate import (
    CONFIDENCE,
    Interval,
    checked_level,
    logarithmic_interval,
)
from flexid.models.motion import unit_of
from flexid.stored_estimates.linear_joint import (
    ComplexArray,
    LinearJoint,
    linear_joint,
    response_band,
)

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
    behind: (
        FloatArray  # ends of the phase's interval in rad, on the branch of the angle of `values`
    )
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
    """Frequency responses of an identified joint for small motions, with confidence bands.

    They are those of the joint itself, without hold and delays. A friction that slides is constant,
    and has no part in them.
    """
    joint = linear_joint(result, position)
    characteristic = _characteristic(joint, checked_level(level))
    chosen = _chosen(characteristic) if frequency is None else frequency
    hertz = np.atleast_1d(np.asarray(chosen, dtype=np.float64))
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
