"""Make the figures of the page on DFKI's pendulum, and print the numbers it quotes.

Run `python docs/real-logs/make_dfki_figures.py LOG` with the log `ddp.csv` of the pendulum's
repository (dfki-ric-underactuated-lab/torque_limited_simple_pendulum, BSD 3-clause).
"""

import sys
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid
from scipy.optimize import least_squares
from scipy.signal import savgol_filter

from flexid.estimators.samples import samples_of_recording
from flexid.estimators.state_variable_filter import LeastSquaresFit, filtered_least_squares
from flexid.models.flexible_joint import rigid_joint
from flexid.models.physical import physical_parameters
from flexid.recording import Recording, read_log, with_velocities
from flexid.recording.velocities import velocity
from flexid.report.figure import BLUE, GREY, INK, ORANGE, RED, STYLE, new_figure, save

ROOT = Path(__file__).parents[2]
ASSETS = ROOT / "docs" / "assets"
TERMS = ("gravity", "coulomb", "offset")
CHOICES = {
    "gravity, viscous": ("gravity", "viscous"),
    "gravity, Coulomb": ("gravity", "coulomb"),
    "gravity, Coulomb, offset": TERMS,
    "the same and viscous": (*TERMS, "viscous"),
}
WARM_UP = 1.0  # s before the held-out stretch from which its first state is taken

FloatArray = NDArray[np.float64]


def fit(recording: Recording, terms: tuple[str, ...] = TERMS) -> LeastSquaresFit:
    """Least squares on the filtered position."""
    samples = samples_of_recording(with_velocities(recording), "rigid")
    return filtered_least_squares([samples], rigid_joint(terms))


def values_of(found: LeastSquaresFit) -> dict[str, float]:
    """Coefficients by name."""
    return dict(zip(found.names, map(float, found.values), strict=True))


def regressions(recording: Recording, width: int) -> tuple[FloatArray, FloatArray]:
    """Inertia and gravity torque by regressing the torque on the acceleration, and the reverse.

    Both take derivatives from one window of `width` samples.
    """
    q, dt = recording.motor_position, recording.sample_time
    v, a = (np.asarray(savgol_filter(q, width, 3, deriv=d, delta=dt)) for d in (1, 2))
    u = np.asarray(savgol_filter(recording.input, width, 3))
    others = [np.sin(q), v, np.sign(v), np.ones_like(q)]
    torque, *_ = np.linalg.lstsq(np.column_stack([a, *others]), u, rcond=None)
    motion, *_ = np.linalg.lstsq(np.column_stack([u, *others]), a, rcond=None)
    return torque[:2], np.array([1.0, -motion[1]]) / motion[0]


def energy_balance(recording: Recording) -> FloatArray:
    """Inertia, gravity torque, Coulomb friction and offset from work and energy alone."""
    q, dt = recording.motor_position, recording.sample_time
    v = velocity(q, dt)
    work, path = (
        cumulative_trapezoid(y, dx=dt, initial=0.0) for y in (recording.needed_input * v, abs(v))
    )
    columns = np.column_stack([v**2 / 2, 1 - np.cos(q), path, q[0] - q, np.ones_like(q)])
    found, *_ = np.linalg.lstsq(columns, work, rcond=None)
    return found[:4]


def held_out(recording: Recording, terms: tuple[str, ...]) -> tuple[float, FloatArray, FloatArray]:
    """Fit of the free run over the last third in percent, with its time and positions."""
    from flexid.simulation.free_run import free_run

    start = round(len(recording) * 2 / 3)
    system, values = rigid_joint(terms), values_of(fit(recording.window(0, start), terms))
    dt, u = recording.sample_time, recording.needed_input
    first = start - round(WARM_UP / dt)
    before, after = recording.motor_position[first:start], recording.motor_position[start:]

    def run(state: FloatArray) -> FloatArray:
        return free_run(system, values, state, u[first : start + 1], dt)

    line = np.polynomial.polynomial.polyfit(dt * np.arange(40), before[:40], 2)[:2]
    state = least_squares(lambda x: run(x)[:-1, 0] - before, line, method="lm").x
    x = free_run(system, values, run(state)[-1], u[start:], dt)[:, 0]
    spread = np.linalg.norm(after - after.mean())
    return float(100 * (1 - np.linalg.norm(after - x) / spread)), recording.time[start:], x


def trap_figure(recording: Recording, inertia: float, gravity: float) -> None:
    """Plot inertia and gravity torque over the window of the differentiation."""
    widths = np.arange(7, 302, 6)
    found = np.array([regressions(recording, int(width)) for width in widths])
    figure = new_figure(7.2, 3.0)
    axes = figure.subplots(1, 2, sharex=True)
    seconds = widths * recording.sample_time
    for place, (ax, value, label) in enumerate(
        zip(axes, (inertia, gravity), ("inertia in kg m²", "gravity torque in N m"), strict=True)
    ):
        ax.plot(seconds, found[:, 0, place], color=BLUE, label="torque on acceleration")
        ax.plot(seconds, found[:, 1, place], color=ORANGE, label="acceleration on torque")
        ax.axhline(value, color=INK, linewidth=1.0, linestyle="--", label="flexid")
        ax.set(xlabel="window of the differentiation in s", ylabel=label, ylim=(0, 2 * value))
    axes[0].legend()
    save(figure, ASSETS, "dfki-windows")


def free_run_figure(recording: Recording) -> None:
    """The held-out swing up, measured and from the model."""
    figure = new_figure(7.2, 3.0)
    ax = figure.subplots()
    ax.plot(recording.time, recording.motor_position, color=GREY, label="measured")
    for (label, terms), colour in zip(CHOICES.items(), (RED, ORANGE, BLUE, None), strict=True):
        percent, time, x = held_out(recording, terms)
        print(f"free run, {label}: {percent:.1f} %")
        if colour:
            ax.plot(time, x, color=colour, label=f"{label}: {percent:.1f} %")
    ax.axvline(recording.time[round(len(recording) * 2 / 3)], color=INK, linewidth=0.8)
    ax.set(xlabel="time in s", ylabel="position in rad")
    ax.legend()
    save(figure, ASSETS, "dfki-free-run")


def main() -> None:
    """Read the log, print what the page quotes, write the figures."""
    log = read_log(Path(sys.argv[1]), ROOT / "examples" / "columns_pendulum.toml")
    (recording,) = log.recordings
    recording = replace(recording, motor_velocity=None)
    found = fit(recording)
    values = values_of(found)
    for parameter in physical_parameters(values, input_is_torque=True, kind="rigid"):
        gradient = parameter.gradient(values, found.names)
        std = float(np.sqrt(gradient @ found.covariance @ gradient))
        print(f"{parameter.name} {parameter.value(values):.4f} ± {std:.4f} {parameter.unit}")
    print("energy balance", energy_balance(recording).round(4))
    for width in (25, 33, 51, 101, 201):
        print(width, *(pair.round(3) for pair in regressions(recording, width)))
    with mpl.rc_context(STYLE):
        trap_figure(recording, 1 / values["beta1"], values["gamma1"] / values["beta1"])
        free_run_figure(recording)


if __name__ == "__main__":
    main()
