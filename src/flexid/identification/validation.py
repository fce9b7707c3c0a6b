"""Free runs: how well the model alone repeats a stretch that was kept out of the fit."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from flexid.errors import SimulationError
from flexid.identification.joint import Joint
from flexid.identification.preparation import Pieces
from flexid.identification.result import FreeRun, Validation
from flexid.recording.recording import Hold, Recording
from flexid.simulation.free_run import free_run

_WARM_UP = 0.5  # s of data before the held-out stretch from which its first state is taken
_FEWEST_SAMPLES = 20
_STEP = 1e-4  # rad and rad/s, for the Jacobian
_REST = 0.05  # root mean square of held-out motion over that of fitted motion, below which it rests
_CHOICE_STARTS = (0.0, 0.2, 0.4, 0.6)  # of a stretch, from which runs start where a choice is made

FloatArray = NDArray[np.float64]


def validate(
    joint: Joint, pieces: Pieces, coefficients: Sequence[FloatArray], hold: Hold
) -> Validation:
    """Run the model freely over the held-out end of each piece.

    The state at the start of a held-out stretch is taken from the half second of data before it:
    the model is fitted to it with its initial state as the only unknown and runs on from there.
    Nothing of the held-out stretch but the input is used.

    Parameters
    ----------
    joint : Joint
        The model.
    pieces : Pieces
        The recorded motion and where its held-out ends begin.
    coefficients : sequence of array, shape (n_coefficients,)
        Of each piece, fitted on the data before the held-out stretches.
    hold : {"zero", "linear"}
        Behaviour of the input between samples.

    Returns
    -------
    Validation
        With fit −inf per cent in every channel if the free run diverges, and NaN in a channel that
        hardly moves in the held-out stretches, where a fit would test nothing.
    """
    runs = _runs(joint, pieces, coefficients, hold, (0.0,))
    fits = 100 * (1 - _relative_errors(joint, pieces, runs))
    return Validation(dict(zip(joint.channels, map(float, fits), strict=True)), tuple(runs))


def free_run_error(
    joint: Joint, pieces: Pieces, coefficients: Sequence[FloatArray], hold: Hold
) -> float:
    """Mean over the channels of the error that free runs make, relative to the motion.

    A single run says as much about its first state as about the model, so each stretch is run from
    several instants on. Parameters are those of `validate`.

    Returns
    -------
    float
        Infinite if a run diverges or nothing moves.
    """
    runs = _runs(joint, pieces, coefficients, hold, _CHOICE_STARTS)
    errors = _relative_errors(joint, pieces, runs)
    tested = errors[~np.isnan(errors)]
    return float(tested.mean()) if len(tested) else np.inf


def _runs(
    joint: Joint,
    pieces: Pieces,
    coefficients: Sequence[FloatArray],
    hold: Hold,
    places: Sequence[float],
) -> list[FreeRun]:
    runs = []
    for piece, start, values in zip(pieces.recorded, pieces.starts, coefficients, strict=True):
        measured = joint.outputs(piece)
        for place in places:
            first = start + round(place * (len(piece) - start))
            try:
                simulated = _run(joint, piece, first, values, hold)
            except SimulationError:
                simulated = np.full_like(measured[first:], np.inf)
            runs.append(FreeRun(piece.time[first:], measured[first:], simulated))
    return runs


def _run(joint: Joint, piece: Recording, start: int, values: FloatArray, hold: Hold) -> FloatArray:
    """Channels of a free run from a sample on; its first state is that of the data before."""
    coefficients = dict(zip(joint.system.coefficients, map(float, values), strict=True))
    length = max(_FEWEST_SAMPLES, round(_WARM_UP / piece.sample_time))
    first = max(0, start - length)
    positions = joint.samples(piece).positions[first:start]

    def run(state: FloatArray, begin: int, end: int) -> FloatArray:
        inputs = piece.input[begin:end]
        return free_run(joint.system, coefficients, state, inputs, piece.sample_time, hold)

    def misfit(state: FloatArray) -> FloatArray:
        return (run(state, first, start)[:, ::2] - positions).ravel()

    guess = _initial_guess(positions, piece.sample_time)
    # Over the warm-up the motion is all but linear in its first state: one Jacobian is enough.
    base = misfit(guess)
    slopes = [(misfit(guess + step) - base) / _STEP for step in _STEP * np.eye(len(guess))]
    jacobian = np.column_stack(slopes)
    found = least_squares(misfit, guess, jac=_always(jacobian), method="lm")
    state = run(found.x, first, start + 1)[-1]
    return joint.channels_of(run(state, start, len(piece))[:, ::2])


def _always(jacobian: FloatArray) -> Any:
    """A function of the state that SciPy takes for the Jacobian; its stubs know of none."""
    return lambda _: jacobian


def _initial_guess(positions: FloatArray, sample_time: float) -> FloatArray:
    n = min(len(positions), _FEWEST_SAMPLES)
    parabola = np.polynomial.polynomial.polyfit(np.arange(n) * sample_time, positions[:n], 2)
    return np.asarray(parabola[:2].T.ravel(), dtype=np.float64)


def _relative_errors(joint: Joint, pieces: Pieces, runs: Sequence[FreeRun]) -> FloatArray:
    """Root mean square error over that of the motion, channel by channel; NaN at rest."""
    measured = [run.measured for run in runs]
    error = np.sum([np.sum((r.measured - r.simulated) ** 2, axis=0) for r in runs], axis=0)
    spread = _spread(measured)
    fitted = [
        joint.outputs(piece)[:start]
        for piece, start in zip(pieces.recorded, pieces.starts, strict=True)
    ]
    moved = spread / sum(map(len, measured))
    resting = moved < _REST**2 * _spread(fitted) / sum(map(len, fitted))
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(resting, np.nan, np.sqrt(error / spread))


def _spread(stretches: Sequence[FloatArray]) -> FloatArray:
    """Sum of squares about each stretch's mean, per channel."""
    return np.asarray(sum(np.sum((y - y.mean(axis=0)) ** 2, axis=0) for y in stretches))
