"""Equations that tell the delays of the input and of the link's encoder, from filtered signals.

A joint's equations hold between channels of one instant. The state-variable filter commutes with a
shift in time, so every channel is filtered once and its filtered signal, which is smooth, is taken
at other times by a spline. Two sets of equations are linear in what is unknown beside a delay:

*Deflection.* The spring's law, with the torque that twists it taken once from the link's side and
once from the motor's (c > 0: compliances, inertias and frictions over the stiffness):

    q1 - q3 = -c1 q1'' - c2 sin q1 - c3 cos q1 - c4 q1' - c5 (q1' - q3') - c6 sign q1' + c7
    q1 - q3 = c8 q3'' + c9 q3' - c10 (q1' - q3') + c11 sign q3' + c12 - c13 u

*Torque.* The balance of the whole joint, in which the spring does not occur:

    u = c1 q3'' + c2 q1'' + c3 sin q1 + c4 cos q1 + c5 q3' + c6 q1' + c7 sign q3' + c8
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from flexid.estimators.samples import FloatArray, Samples
from flexid.estimators.state_variable_filter import filtered_signals
from flexid.identification.even_spline import EvenSpline
from flexid.models.parametric_system import ParametricSystem, Row
from flexid.models.terms import COULOMB_VELOCITY
from flexid.recording.recording import Hold, Recording
from flexid.recording.velocities import velocity

_MEMORY = 40.0  # time constants of the filter after which its past has vanished
_DENSITY = 10.0  # equations per time constant of the filter: more tell nothing new


def _row(number: str, position: str, speed: str) -> dict[str, str]:
    """Signals of one encoder, each a coefficient's regressor."""
    return {
        f"sine{number}": f"sin({position})",
        f"cosine{number}": f"cos({position})",
        f"position{number}": position,
        f"velocity{number}": speed,
        f"direction{number}": f"tanh({speed}/{COULOMB_VELOCITY!r})",
    }


_MOTOR = Row("motor", "x3", "x4", {**_row("3", "x3", "x4"), "constant": "1", "input": "u"})
_LINK = Row("link", "x1", "x2", _row("1", "x1", "x2"))
_ONE_ENCODER = ParametricSystem("signals of one encoder", (_MOTOR,))
_TWO_ENCODERS = ParametricSystem("signals of two encoders", (_LINK, _MOTOR))


@dataclass(frozen=True, eq=False)
class Equation:
    """One equation ``response = regressors' p`` at one delay d, and how it changes with d.

    Parameters
    ----------
    regressors : array, shape (k, n)
        At n instants.
    response, response_slope : array, shape (n,)
        Left-hand side, and its derivative by the delay.
    changing : int
        Place of the one regressor that changes with the delay.
    regressor_slope : array, shape (n,)
        Its derivative.
    """

    regressors: FloatArray
    response: FloatArray
    response_slope: FloatArray
    changing: int
    regressor_slope: FloatArray


@dataclass(frozen=True)
class Unknown:
    """A coefficient of the equations: whether it has a bound, and whether it is zero at best.

    Parameters
    ----------
    bounded : bool
        Whether physics forbids negative values.
    spare : bool
        A friction that looks like a delay: assumed only where the data demand it.
    """

    bounded: bool = True
    spare: bool = False


_FREELY = Unknown(bounded=False)
_SPARE = Unknown(spare=True)
DEFLECTION_UNKNOWNS = (
    (Unknown(), _FREELY, _FREELY, _SPARE, _SPARE, Unknown(), _FREELY),
    (Unknown(), Unknown(), _SPARE, Unknown(), _FREELY, Unknown()),
)
"""c1 to c7 and c8 to c13 of the deflection's equations."""

TORQUE_UNKNOWNS = (
    (Unknown(), Unknown(), _FREELY, _FREELY, Unknown(), Unknown(), Unknown(), _FREELY),
)
"""c1 to c8 of the torque's equation."""


@dataclass(frozen=True, eq=False)
class _Piece:
    """Filtered signals of one contiguous piece."""

    signals: Mapping[str, FloatArray]
    sample_time: float
    filter_rate: float
    instants: NDArray[np.int_]

    @cached_property
    def _splines(self) -> dict[str, EvenSpline]:
        return {}

    def at(self, name: str, delay: float = 0.0, derivative: int = 0) -> FloatArray:
        """Signal at the instants less a delay, or its derivative by time there."""
        if delay == 0.0 and derivative == 0:
            return self.signals[name][self.instants]
        if name not in self._splines:
            self._splines[name] = EvenSpline(self.signals[name])
        values = self._splines[name].at(self.instants, -delay / self.sample_time, derivative)
        return values / self.sample_time**derivative

    def without_past(self, equations: Sequence[FloatArray]) -> FloatArray:
        """Equations less what the filter may remember from before the record."""
        stacked = np.array(equations)
        elapsed = self.filter_rate * self.sample_time * (self.instants - self.instants[0])
        count = int(np.searchsorted(elapsed, _MEMORY))
        decay = np.exp(-elapsed[:count])
        past, _ = np.linalg.qr(np.column_stack((decay, elapsed[:count] * decay)))
        stacked[:, :count] -= (stacked[:, :count] @ past) @ past.T
        return stacked


@dataclass(frozen=True, eq=False)
class DelayEquations:
    """The equations of some pieces at any delays of the input and of the link's encoder.

    Parameters
    ----------
    pieces : tuple of _Piece
        Filtered signals.
    limit : float
        Largest delay of either kind in s; the pieces are cut by it at both ends.
    """

    pieces: tuple[_Piece, ...]
    limit: float

    @property
    def filter_rate(self) -> float:
        """Rate of the filter in 1/s."""
        return self.pieces[0].filter_rate

    @property
    def lengths(self) -> list[int]:
        """Instants of each piece."""
        return [len(piece.instants) for piece in self.pieces]

    @property
    def spacings(self) -> list[float]:
        """Time between the instants of each piece, in s."""
        return [p.sample_time * float(p.instants[1] - p.instants[0]) for p in self.pieces]

    def deflection(self, input_delay: float) -> Callable[[float], list[Equation]]:
        """Equations of the deflection as a function of the link encoder's delay."""

        def at(delay: float) -> list[Equation]:
            signals = [_deflection_signals(piece, delay, input_delay) for piece in self.pieces]
            joined = np.concatenate(signals, axis=1)
            return [_equation(joined[:10], 4), _equation(joined[10:], 2)]

        return at

    def torque(self, link_delay: float) -> Callable[[float], list[Equation]]:
        """Equation of the torque as a function of the input's delay."""

        def at(delay: float) -> list[Equation]:
            signals = [_torque_signals(piece, delay, link_delay) for piece in self.pieces]
            return [_equation(np.concatenate(signals, axis=1), 0)]

        return at


def _equation(signals: FloatArray, changing: int) -> Equation:
    """Equation from response, its slope, regressors, and the slope of one of them."""
    return Equation(signals[2:-1], signals[0], signals[1], changing, signals[-1])


def channels(piece: Recording) -> Samples:
    """Encoders and input of a piece, with velocities derived from the positions.

    Velocities that a drive has measured are not used: it has smoothed them, and they come late.
    """
    positions = [q for q in (piece.link_position, piece.motor_position) if q is not None]
    return Samples(
        np.column_stack(positions),
        np.column_stack([velocity(q, piece.sample_time) for q in positions]),
        piece.input[:, None].astype(np.float64),
        piece.sample_time,
    )


def delay_equations(
    pieces: Sequence[Samples], filter_rate: float, hold: Hold, limit: float
) -> DelayEquations:
    """Filter the channels of some pieces.

    Parameters
    ----------
    pieces : sequence of Samples
        As of `channels`, with two encoders, or all with one.
    filter_rate : float
        Rate of the state-variable filter in 1/s.
    hold : {"zero", "linear"}
        Hold of the input.
    limit : float
        Largest delay in s that will be asked for; every piece is longer than twice that.

    Returns
    -------
    DelayEquations
    """
    return DelayEquations(
        tuple(_filtered(piece, filter_rate, hold, limit) for piece in pieces), limit
    )


def _filtered(piece: Samples, filter_rate: float, hold: Hold, limit: float) -> _Piece:
    h = piece.sample_time
    system = _ONE_ENCODER if piece.positions.shape[1] == 1 else _TWO_ENCODERS
    filtered = filtered_signals([piece], system, filter_rate, hold)
    names = [*system.coefficients, *(f"acceleration{row.coordinate[1]}" for row in system.rows)]
    margin = int(np.ceil(limit / h)) + 2
    stride = max(1, int(1.0 / (_DENSITY * filter_rate * h)))
    instants = np.arange(margin, filtered.shape[1] - margin, stride)
    return _Piece(dict(zip(names, filtered, strict=True)), h, filter_rate, instants)


def _deflection_signals(piece: _Piece, link_delay: float, input_delay: float) -> FloatArray:
    """Response, its slope, regressors, and the slope of one of them; both equations in turn.

    The first stands on the link encoder's clock, the second on the motor encoder's.
    """
    at, d = piece.at, link_delay
    from_link = (
        at("position1") - at("position3", d),
        at("position3", d, 1),
        -at("acceleration1"),
        -at("sine1"),
        -at("cosine1"),
        -at("velocity1"),
        at("velocity3", d) - at("velocity1"),
        -at("direction1"),
        at("constant"),
        -at("velocity3", d, 1),
    )
    from_motor = (
        at("position1", -d) - at("position3"),
        at("position1", -d, 1),
        at("acceleration3"),
        at("velocity3"),
        at("velocity3") - at("velocity1", -d),
        at("direction3"),
        at("constant"),
        -at("input", input_delay),
        -at("velocity1", -d, 1),
    )
    return piece.without_past((*from_link, *from_motor))


def _torque_signals(piece: _Piece, input_delay: float, link_delay: float) -> FloatArray:
    """Response, its slope, regressors, and that none of them changes with the delay.

    Without a link encoder the motor's stands for it.
    """
    at, d = piece.at, link_delay
    two = "acceleration1" in piece.signals
    nothing = np.zeros(len(piece.instants))
    return piece.without_past(
        (
            at("input", input_delay),
            -at("input", input_delay, 1),
            at("acceleration3"),
            at("acceleration1", -d) if two else nothing,
            at("sine1", -d) if two else at("sine3"),
            at("cosine1", -d) if two else at("cosine3"),
            at("velocity3"),
            at("velocity1", -d) if two else nothing,
            at("direction3"),
            at("constant"),
            nothing,
        )
    )
