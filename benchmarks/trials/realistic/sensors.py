"""Log of a realistic run: encoders, converters, a strain gauge and lost samples."""

import numpy as np

from benchmarks.trials.arrays import FloatArray, IntArray
from benchmarks.trials.realistic.drafts import Draft
from benchmarks.trials.realistic.play import Play, coloured

_VOLT_BITS = 12
_WANDER_TIME = 10.0  # s, in which a gauge drifts at random


def logged(
    rng: np.random.Generator,
    draft: Draft,
    play: Play,
    run: FloatArray,
    steps: tuple[float, float],
    gain: float,
) -> dict[str, FloatArray]:
    """Return the columns of the log by their headers.

    Parameters
    ----------
    rng : Generator
    draft : Draft
    play : Play
    run : (n, 6) ndarray
        Result of `simulate`.
    steps : tuple of float
        Steps of the link's (or the gauge's) and the motor's sensor in rad.
    gain : float
        Torque in N m per unit of the logged input.
    """
    picks = np.arange(play.first, len(play.times), play.every)
    late = draft.jitter * rng.uniform(-1.0, 1.0, len(picks)) / draft.pace
    noise = play.noise[picks] * steps
    motor = angle_between(play, run, 2, picks, late)
    columns = {"time [s]": np.arange(len(picks)) / draft.pace}
    if draft.has_gauge:
        gauge = draft.gauge_scale * run[picks, 4]
        gauge += draft.gauge_drift * np.ptp(gauge) * _wander(rng, play.times[picks])
        columns["deflection [rad]"] = rounded(gauge + noise[:, 0], steps[0])
    else:
        link = angle_between(play, run, 0, picks, late)
        size, phase = draft.eccentricity * (link - motor).std(), rng.uniform(0.0, 2.0 * np.pi)
        link += size * np.sin(link + phase)
        columns["link_position [rad]"] = rounded(link + noise[:, 0], steps[0])
    columns["motor_position [rad]"] = rounded(motor + noise[:, 1], steps[1])
    command = run[picks, 5] / gain
    if draft.volts:
        step = 2.5 * draft.volts / 2.0**_VOLT_BITS
        columns["motor_voltage [V]"] = rounded(command, step)
    else:
        columns["motor_torque [N m]"] = command
    return _with_losses(rng, draft, columns) if draft.dropped else columns


def angle_between(
    play: Play, run: FloatArray, column: int, picks: IntArray, late: FloatArray
) -> FloatArray:
    """Return an angle slightly before or after the controller's instants, by cubic Hermite."""
    place = picks + late / play.period
    low = np.clip(np.floor(place).astype(int), 0, len(play.times) - 2)
    x = place - low
    y, dy = run[:, column], play.period * run[:, column + 1]
    return (
        (1.0 + 2.0 * x) * (1.0 - x) ** 2 * y[low]
        + x * (1.0 - x) ** 2 * dy[low]
        + x**2 * (3.0 - 2.0 * x) * y[low + 1]
        + x**2 * (x - 1.0) * dy[low + 1]
    )


def _wander(rng: np.random.Generator, times: FloatArray) -> FloatArray:
    """Return the drift of a gauge: a ramp and a slow random part."""
    return rng.uniform(-1.0, 1.0) * times / times[-1] + 0.5 * coloured(rng, times, _WANDER_TIME)


def _with_losses(
    rng: np.random.Generator, draft: Draft, columns: dict[str, FloatArray]
) -> dict[str, FloatArray]:
    """Remove single samples; the time is the number of the row."""
    count = len(columns["time [s]"])
    lost = rng.choice(np.arange(5, count), max(int(draft.dropped * count), 1), replace=False)
    kept = {name: np.delete(values, lost) for name, values in columns.items()}
    kept["time [s]"] = columns["time [s]"][: count - len(lost)]
    return kept


def rounded(values: FloatArray, step: float) -> FloatArray:
    """Return values rounded to a grid."""
    return np.rint(values / step) * step
