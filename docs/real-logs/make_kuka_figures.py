"""Make the figures of the page on the KUKA KR300, and print the numbers it quotes.

Run `python docs/real-logs/make_kuka_figures.py LOG_A LOG_B` with the two logs (CSV, 10 s at 250 Hz)
that the page describes, made from the data of JonasWeigand/Robot_Identification (MIT).
"""

import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np

from flexid.estimators.samples import samples_of_recording
from flexid.estimators.state_variable_filter import filtered_least_squares
from flexid.identification.alignment import Alignment, Delay, aligned, estimate_alignment
from flexid.models.flexible_joint import flexible_joint
from flexid.recording import Recording, read_log, with_velocities
from flexid.report.style import BLUE, GREY, INK, ORANGE, STYLE, new_figure, save

ROOT = Path(__file__).parents[2]
ASSETS = ROOT / "docs" / "assets"
GEAR = {1: 256.9, 2: 267.4, 3: 252.3}
COLUMNS = """
time = "t_s"
link_position = {{ column = "a{axis}_q_link_deg", unit = "deg" }}
motor_position = {{ column = "a{axis}_q_mot_deg", unit = "deg" }}
motor_torque = {{ column = "a{axis}_tau_mot_Nm", scale = {gear}, unit = "N m" }}
"""
TERMS = (
    "gravity",
    "gravity_cosine",
    "motor_viscous",
    "motor_coulomb",
    "link_offset",
    "motor_offset",
)
RATE = 20.0  # 1/s, of the filter for the stiffness below


def read_axis(log: Path, axis: int) -> Recording:
    """One axis of a log, the torque carried through the gear."""
    with tempfile.TemporaryDirectory() as folder:
        columns = Path(folder) / "columns.toml"
        columns.write_text(COLUMNS.format(axis=axis, gear=GEAR[axis]))
        return read_log(log, columns).pieces[0]


def moved(recording: Recording, alignment: Alignment, delay: float) -> Recording:
    """The recording aligned with another delay of the link's encoder."""
    other = Delay(delay, delay, 0.0, (delay, delay), "given", "")
    return aligned(recording, replace(alignment, link_delay=other))


def stiffness(recording: Recording) -> tuple[float, float]:
    """Stiffness by least squares in N m/rad, alpha1 / beta1, and its relative deviation."""
    samples = [samples_of_recording(with_velocities(recording))]
    fit = filtered_least_squares(samples, flexible_joint(TERMS), RATE)
    a, b = fit.names.index("alpha1"), fit.names.index("beta1")
    gradient = np.zeros(len(fit.names))
    gradient[a], gradient[b] = 1.0 / fit.values[a], -1.0 / fit.values[b]
    return float(fit.values[a] / fit.values[b]), float(
        np.sqrt(gradient @ fit.covariance @ gradient)
    )


def deflection_figure(pieces: dict[int, Recording], found: dict[int, Alignment]) -> None:
    """Deflection as logged and aligned, of the three axes of one log."""
    with mpl.rc_context(STYLE):
        figure = new_figure(7.2, 5.2)
        for place, (axis, piece) in enumerate(pieces.items()):
            axes = figure.add_subplot(3, 1, place + 1)
            after = aligned(piece, found[axis])
            axes.plot(piece.time, np.rad2deg(piece.deflection), color=GREY, label="as logged")
            axes.plot(after.time, np.rad2deg(after.deflection), color=BLUE, label="aligned")
            axes.set_title(f"Axis {axis}")
            axes.set_ylabel("link − motor, deg")
            if place == 0:
                axes.legend(ncols=2, loc="upper right")
        figure.axes[-1].set_xlabel("time, s")
        save(figure, ASSETS, "kuka-deflection")


def delay_figure(delays: dict[str, Delay]) -> None:
    """Delay of the link's encoder with its interval, for each axis of each log."""
    with mpl.rc_context(STYLE):
        figure = new_figure(7.2, 2.6)
        axes = figure.add_subplot()
        for place, delay in enumerate(delays.values()):
            low, high = (1e3 * end for end in delay.interval)
            axes.plot([low, high], [place, place], color=ORANGE, linewidth=3.0)
            axes.plot(1e3 * delay.value, place, "o", color=INK)
        axes.axvline(0.0, color=GREY)
        axes.set_yticks(range(len(delays)), list(delays))
        axes.set_xlim(-0.2, 4.0)
        axes.set_xlabel("delay of the link's encoder behind the motor's, ms")
        save(figure, ASSETS, "kuka-delay")


def main() -> None:
    """Read both logs, print the numbers and write the figures."""
    logs = dict(zip("AB", map(Path, sys.argv[1:3]), strict=True))
    delays: dict[str, Delay] = {}
    for name, log in logs.items():
        pieces = {axis: read_axis(log, axis) for axis in GEAR}
        found = {axis: estimate_alignment([piece]) for axis, piece in pieces.items()}
        for axis, piece in pieces.items():
            delay = found[axis].link_delay
            delays[f"log {name}, axis {axis}"] = delay
            after = aligned(piece, found[axis]).deflection.std()
            print(
                f"{name}{axis}: {1e3 * delay.value:.2f} ms "
                f"({1e3 * delay.interval[0]:.2f} to {1e3 * delay.interval[1]:.2f}), deflection "
                f"{np.rad2deg(piece.deflection.std()):.4f} -> {np.rad2deg(after):.4f} deg, "
                f"in doubt {found[axis].deflection_doubt:.2f}"
            )
            for at in (0.0, delay.interval[0], delay.value, delay.interval[1]):
                value, deviation = stiffness(moved(piece, found[axis], at))
                print(f"    delay {1e3 * at:.2f} ms: {value:.3g} N m/rad +- {deviation:.1%}")
        if name == "A":
            deflection_figure(pieces, found)
    delay_figure(delays)


if __name__ == "__main__":
    main()
