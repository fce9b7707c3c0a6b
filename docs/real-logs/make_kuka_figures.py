"""Make the figures of the page on the KUKA KR300, and print the numbers it quotes.

Run `python docs/real-logs/make_kuka_figures.py LOG_A LOG_B` with the two logs (CSV, 10 s at 250 Hz)
that the page describes, made from the data of JonasWeigand/Robot_Identification (MIT).
"""

import sys
import tempfile
from pathlib import Path

import matplotlib as mpl
import numpy as np

from flexid.identification.alignment import Alignment, Delay, aligned
from flexid.identification.identify import identify
from flexid.identification.result import Identification
from flexid.recording import Log, Recording, read_log
from flexid.report.identification_table import format_fits
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


def read_axis(log: Path, axis: int) -> Log:
    """One axis of a log, the torque carried through the gear."""
    with tempfile.TemporaryDirectory() as folder:
        columns = Path(folder) / "columns.toml"
        columns.write_text(COLUMNS.format(axis=axis, gear=GEAR[axis]))
        return read_log(log, columns)


def link_aligned(piece: Recording, found: Identification) -> Recording:
    """A log with its link's encoder on the motor's clock."""
    none = Delay(0.0, 0.0, (0.0, 0.0), "none")
    alignment = found.choices.alignment
    return aligned(piece, Alignment(alignment.hold, none, alignment.link_delay, ""))


def print_axis(label: str, piece: Recording, found: Identification) -> None:
    """What the page quotes of one axis."""
    delay = found.choices.alignment.link_delay
    low, high = (1e3 * end for end in delay.interval)
    after = link_aligned(piece, found).deflection.std()
    print(
        f"{label}: {1e3 * delay.value:.2f} ms ({low:.2f} to {high:.2f}, {delay.status}), "
        f"deflection {np.rad2deg(piece.deflection.std()):.4f} -> {np.rad2deg(after):.4f} deg"
    )
    stiffness = found.parameters["joint_stiffness"]
    low, high = stiffness.interval
    error = found.model_error
    print(
        f"    stiffness {stiffness.value:.3g} [{low:.3g}, {high:.3g}] {stiffness.status}; exit "
        f"{0 if found.supported else 1}; {found.compliance.reason}; segments of "
        f"{found.choices.segment_duration:.2g} s; residuals "
        + ", ".join(f"{ratio:.3g}" for ratio in found.residual_excess.values())
        + f" times noise, growth {error.growth:.2g}, share {error.share:.2g}"
        + f"; free run {format_fits(found.validation.fit_percent)}"
    )


def deflection_figure(pieces: dict[int, Recording], found: dict[int, Identification]) -> None:
    """Deflection as logged and aligned, of the three axes of one log."""
    with mpl.rc_context(STYLE):
        figure = new_figure(7.2, 5.2)
        for place, (axis, piece) in enumerate(pieces.items()):
            axes = figure.add_subplot(3, 1, place + 1)
            after = link_aligned(piece, found[axis])
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
        axes.set_xlim(left=-0.5)
        axes.set_xlabel("delay of the link's encoder behind the motor's, ms")
        save(figure, ASSETS, "kuka-delay")


def main() -> None:
    """Read both logs, print the numbers and write the figures."""
    logs = dict(zip("AB", map(Path, sys.argv[1:3]), strict=True))
    delays: dict[str, Delay] = {}
    for name, log in logs.items():
        read = {axis: read_axis(log, axis) for axis in GEAR}
        pieces = {axis: one.pieces[0] for axis, one in read.items()}
        found = {axis: identify([one]) for axis, one in read.items()}
        for axis, piece in pieces.items():
            label = f"log {name}, axis {axis}"
            delays[label] = found[axis].choices.alignment.link_delay
            print_axis(label, piece, found[axis])
        if name == "A":
            deflection_figure(pieces, found)
    delay_figure(delays)


if __name__ == "__main__":
    main()
