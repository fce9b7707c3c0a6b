"""Make the figures of the page on the KUKA KR300, and print the numbers it quotes.

Run `python docs/real-logs/make_kuka_figures.py LOG_A LOG_B` with the two logs (CSV, 10 s at 250 Hz)
that the page describes, made from the data of JonasWeigand/Robot_Identification (MIT).
"""

import sys
import tempfile
from pathlib import Path

import matplotlib as mpl
import numpy as np

from flexid.errors import ConvergenceError
from flexid.identification.identify import identify
from flexid.identification.preparation.recordings import Alignment, Delay, aligned
from flexid.identification.preparation.settings import Settings
from flexid.identification.result import Identification
from flexid.recording import Log, Recording, read_log, with_velocities
from flexid.report.figure import BLUE, GREY, INK, ORANGE, STYLE, new_figure, save
from flexid.report.identification import format_fits

ROOT = Path(__file__).parents[2]
ASSETS = ROOT / "docs" / "assets"
GEAR = {1: 256.9, 2: 267.4, 3: 252.3}
DELAY = 0.003  # s, of the link's encoder
SLOW = 0.02  # rad/s, over which friction changes sign in a regression
COLUMNS = """
time = "t_s"
link_position = {{ column = "a{axis}_q_link_deg", unit = "deg" }}
motor_position = {{ column = "a{axis}_q_mot_deg", unit = "deg" }}
motor_torque = {{ column = "a{axis}_tau_mot_Nm", scale = {gear}, unit = "N m" }}
"""


def read_axis(log: Path, axis: int) -> Log:
    """One axis of a log, the torque carried through the gear."""
    with tempfile.TemporaryDirectory() as folder:
        columns = Path(folder) / "columns.toml"
        columns.write_text(COLUMNS.format(axis=axis, gear=GEAR[axis]))
        return read_log(log, columns)


def link_aligned(recording: Recording) -> Recording:
    """A log with its link's encoder on the motor's clock."""
    none, late = (Delay(value, 0.0, (value, value), "given") for value in (0.0, DELAY))
    return aligned(recording, Alignment("linear", none, late, ""))


def regressed_delays(recording: Recording) -> tuple[float, float]:
    """Return the delays in s that explain the deflection best, without and with a spring."""
    recording = with_velocities(recording)
    speed, position = recording.motor_velocity, recording.motor_position
    assert speed is not None
    late = [np.ones_like(speed), speed]
    wound = [recording.input, np.tanh(speed / SLOW), np.sin(position), np.cos(position)]
    found = [
        np.linalg.lstsq(np.column_stack(columns), recording.deflection, rcond=None)[0]
        for columns in (late, late + wound)
    ]
    return -float(found[0][1]), -float(found[1][1])


def print_axis(label: str, recording: Recording, delays: tuple[float, float]) -> None:
    """Print the delay of one axis that the page quotes."""
    before, after = (np.rad2deg(p.deflection.std()) for p in (recording, link_aligned(recording)))
    alone, beside = (1e3 * delay for delay in delays)
    print(
        f"{label}: {alone:.2f} ms, beside a spring {beside:.2f} ms; "
        f"deflection {before:.4f} -> {after:.4f} deg"
    )


def print_identified(found: Identification) -> None:
    """Print flexid's result for one axis."""
    late = found.choices.alignment.link_delay
    residuals = ", ".join(f"{ratio:.3g}" for ratio in found.residual_excess.values())
    print(
        f"    {found.model}, link {1e3 * late.value:.2f} ms late ({late.status}); exit "
        f"{0 if found.supports() else 1}; residuals {residuals} times noise; "
        f"free run {format_fits(found.validation.fit_percent)}"
    )
    if found.disturbances is not None:
        for name, share in found.disturbances.shares.items():
            print(f"    unexplained, {name}: {100.0 * share:.0f} %")
    for name in {"joint_stiffness", "total_inertia", "inertia"} & found.parameters.keys():
        value, (low, high) = found.parameters[name].value, found.parameters[name].interval
        print(f"    {name} {value:.3g} [{low:.3g}, {high:.3g}] {found.parameters[name].verdict}")
    print("   ", found.warnings[0])


def deflection_figure(recordings: dict[int, Recording]) -> None:
    """Deflection as logged and aligned, of the three axes of one log."""
    with mpl.rc_context(STYLE):
        figure = new_figure(7.2, 5.2)
        for place, (axis, recording) in enumerate(recordings.items()):
            axes = figure.add_subplot(3, 1, place + 1)
            after = link_aligned(recording)
            axes.plot(
                recording.time, np.rad2deg(recording.deflection), color=GREY, label="as logged"
            )
            axes.plot(after.time, np.rad2deg(after.deflection), color=BLUE, label="3 ms later")
            axes.set_title(f"Axis {axis}")
            axes.set_ylabel("link − motor, deg")
            if place == 0:
                axes.legend(ncols=2, loc="upper right")
        figure.axes[-1].set_xlabel("time, s")
        save(figure, ASSETS, "kuka-deflection")


def delay_figure(delays: dict[str, tuple[float, float]]) -> None:
    """Delay of the link's encoder for each axis of each log, by two regressions."""
    with mpl.rc_context(STYLE):
        figure = new_figure(7.2, 2.6)
        axes = figure.add_subplot()
        places = range(len(delays))
        alone, beside = (1e3 * np.array(list(delays.values()))).T
        axes.plot(alone, places, "o", color=ORANGE, label="late encoder alone")
        axes.plot(beside, places, "o", color=INK, label="beside a spring")
        axes.axvline(0.0, color=GREY)
        axes.set_yticks(places, list(delays))
        axes.set_xlim(-0.2, 4.0)
        axes.set_xlabel("delay of the link's encoder behind the motor's, ms")
        axes.legend(loc="center left", bbox_to_anchor=(0.1, 0.5))
        save(figure, ASSETS, "kuka-delay")


def main() -> None:
    """Read both logs, print the numbers and write the figures."""
    logs = dict(zip("AB", map(Path, sys.argv[1:3]), strict=True))
    delays: dict[str, tuple[float, float]] = {}
    for name, log in logs.items():
        read = {axis: read_axis(log, axis) for axis in GEAR}
        recordings = {axis: one.recordings[0] for axis, one in read.items()}
        for axis, recording in recordings.items():
            label = f"log {name}, axis {axis}"
            delays[label] = regressed_delays(recording)
            print_axis(label, recording, delays[label])
            for settings in (Settings(), Settings(link_delay=DELAY)):
                try:
                    print_identified(identify([read[axis]], settings))
                except ConvergenceError as error:
                    print(f"    {error}")
        if name == "A":
            deflection_figure(recordings)
    delay_figure(delays)


if __name__ == "__main__":
    main()
