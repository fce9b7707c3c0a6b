"""Validation: how well the model alone repeats a stretch that was kept out of the fit."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from flexid.errors import SimulationError
from flexid.identification.result import FreeRun, Validation
from flexid.models.parametric_system import ParametricSystem
from flexid.recording.recording import Hold, Recording
from flexid.simulation.free_run import free_run

CHANNELS = ("link_position", "motor_position", "deflection")

_WARM_UP = 1.0  # s of data before the held-out stretch from which its first state is taken
_FEWEST_SAMPLES = 20
_REST = 0.05  # root mean square of held-out motion over that of fitted motion, below which it rests

FloatArray = NDArray[np.float64]


def validate(
    pieces: Sequence[tuple[Recording, int]],
    system: ParametricSystem,
    coefficients: Mapping[str, float],
    hold: Hold,
) -> Validation:
    """Run the model freely over the held-out end of each piece.

    The state at the start of a held-out stretch is taken from the second of data before it: the
    model is fitted to that second with its initial state as the only unknown and runs on from
    there. Nothing of the held-out stretch but the input is used.

    Parameters
    ----------
    pieces : sequence of (Recording, int)
        Each piece with the index at which its held-out stretch begins.
    system : ParametricSystem
        Two rows, link and motor.
    coefficients : mapping of str to float
        Fitted on the data before the held-out stretches.
    hold : {"zero", "linear"}
        Behaviour of the input between samples.

    Returns
    -------
    Validation
        With fit −inf per cent in every channel if the free run diverges, and NaN in a channel that
        hardly moves in the held-out stretches, where a fit would test nothing.
    """
    runs, fitted = [], []
    for piece, start in pieces:
        fitted.append(_outputs(piece.link_position, piece.motor_position)[:start])
        measured = _outputs(piece.link_position, piece.motor_position)[start:]
        try:
            simulated = _run(piece, start, system, coefficients, hold)
        except SimulationError:
            simulated = np.full_like(measured, np.inf)
        runs.append(FreeRun(piece.time[start:], measured, simulated))
    fits = np.where(_at_rest(runs, fitted), np.nan, _fit_percent(runs))
    return Validation(dict(zip(CHANNELS, map(float, fits), strict=True)), tuple(runs))


def _run(
    piece: Recording,
    start: int,
    system: ParametricSystem,
    coefficients: Mapping[str, float],
    hold: Hold,
) -> FloatArray:
    state = _state_at(piece, start, system, coefficients, hold)
    x = free_run(system, coefficients, state, piece.input[start:], piece.sample_time, hold)
    return _outputs(x[:, 0], x[:, 2])


def _state_at(
    piece: Recording,
    start: int,
    system: ParametricSystem,
    coefficients: Mapping[str, float],
    hold: Hold,
) -> FloatArray:
    length = max(_FEWEST_SAMPLES, round(_WARM_UP / piece.sample_time))
    first = max(0, start - length)
    positions = np.column_stack([piece.link_position, piece.motor_position])[first:start]

    def run(state: FloatArray) -> FloatArray:
        inputs = piece.input[first : start + 1]
        return free_run(system, coefficients, state, inputs, piece.sample_time, hold)

    guess = _initial_guess(positions, piece.sample_time)
    found = least_squares(
        lambda state: (run(state)[:-1, [0, 2]] - positions).ravel(), guess, method="lm"
    )
    return run(found.x)[-1]


def _initial_guess(positions: FloatArray, sample_time: float) -> FloatArray:
    n = min(len(positions), _FEWEST_SAMPLES)
    parabola = np.polynomial.polynomial.polyfit(np.arange(n) * sample_time, positions[:n], 2)
    return np.asarray(parabola[:2].T.ravel(), dtype=np.float64)


def _outputs(link: FloatArray, motor: FloatArray) -> FloatArray:
    return np.column_stack([link, motor, link - motor])


def _fit_percent(runs: Sequence[FreeRun]) -> FloatArray:
    error = sum(np.sum((run.measured - run.simulated) ** 2, axis=0) for run in runs)
    spread = _spread([run.measured for run in runs])
    with np.errstate(divide="ignore"):
        return 100 * (1 - np.sqrt(np.asarray(error) / spread))


def _at_rest(runs: Sequence[FreeRun], fitted: Sequence[FloatArray]) -> NDArray[np.bool_]:
    """Channels whose held-out motion is next to nothing beside the motion that was fitted."""
    measured = [run.measured for run in runs]
    held_out = _spread(measured) / sum(map(len, measured))
    return held_out < _REST**2 * _spread(fitted) / sum(map(len, fitted))


def _spread(stretches: Sequence[FloatArray]) -> FloatArray:
    """Sum of squares about each stretch's mean, per channel."""
    return np.asarray(sum(np.sum((y - y.mean(axis=0)) ** 2, axis=0) for y in stretches))
