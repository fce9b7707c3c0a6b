"""Free runs: how well the model alone repeats a stretch that was kept out of the fit."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from flexid.errors import SimulationError
from flexid.estimators.samples import Samples
from flexid.identification.joint import Joint
from flexid.identification.preparation import Pieces
from flexid.identification.result import FreeRun, Validation
from flexid.recording.recording import Hold
from flexid.simulation.free_run import FreeRunner

_WARM_UP = 0.5  # s of data before the held-out stretch from which its first state is taken
_FEWEST_SAMPLES = 20
_STEP = 1e-4  # rad and rad/s, for the Jacobian
_MOST_STEPS = 20
_CONVERGED = 1e-9  # relative fall of the sum of squares by a step that ends the search
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
        samples = joint.samples(piece)
        measured = joint.channels_of(samples.positions)
        for place in places:
            first = start + round(place * (len(piece) - start))
            try:
                simulated = _run(joint, samples, first, values, hold)
            except SimulationError:
                simulated = np.full_like(measured[first:], np.inf)
            runs.append(FreeRun(piece.time[first:], measured[first:], simulated))
    return runs


def _run(joint: Joint, samples: Samples, start: int, values: FloatArray, hold: Hold) -> FloatArray:
    """Channels of a free run from a sample on; its first state is that of the data before."""
    coefficients = dict(zip(joint.system.coefficients, map(float, values), strict=True))
    length = max(_FEWEST_SAMPLES, round(_WARM_UP / samples.sample_time))
    first = max(0, start - length)
    positions, inputs = samples.positions[first:start], samples.inputs
    guess = _initial_guess(positions, samples.sample_time)
    runner = FreeRunner.near(
        joint.system, coefficients, guess, inputs[first], samples.sample_time, hold
    )

    def misfit(state: FloatArray) -> FloatArray:
        return (runner.run(state, inputs[first:start])[:, ::2] - positions).ravel()

    state = runner.run(_least(misfit, guess), inputs[first : start + 1])[-1]
    return joint.channels_of(runner.run(state, inputs[start:])[:, ::2])


def _least(misfit: Callable[[FloatArray], FloatArray], guess: FloatArray) -> FloatArray:
    """State of the least sum of squares of a misfit that is nearly linear in it.

    Over the warm-up the motion is, so one Jacobian is enough.
    """
    state, left = guess, misfit(guess)
    slopes = [(misfit(guess + step) - left) / _STEP for step in _STEP * np.eye(len(guess))]
    inverse = np.linalg.pinv(np.column_stack(slopes))
    for _ in range(_MOST_STEPS):
        trial = state - inverse @ left
        rest = misfit(trial)
        if not rest @ rest < left @ left:
            break
        done = rest @ rest > (1.0 - _CONVERGED) * (left @ left)
        state, left = trial, rest
        if done:
            break
    return state


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
