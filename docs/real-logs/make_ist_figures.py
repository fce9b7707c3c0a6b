"""Make the figures of the page on the IST arm, and print the numbers it quotes.

Run `python docs/real-logs/make_ist_figures.py LOG` with the log `ist_square_1p5V.csv` of the arm
(GitHub avdolrahman/Flexible-Robot-Arm-, MIT).
"""

import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes

from flexid.errors import ConvergenceError
from flexid.identification.candidate import AnyFit, Candidate, Fitted
from flexid.identification.identify import identify
from flexid.identification.joint import flexible
from flexid.identification.preparation import prepare
from flexid.identification.result import Identification
from flexid.identification.segment_choice import DURATIONS
from flexid.identification.settings import Settings
from flexid.identification.validation import validate
from flexid.recording import Log, Recording, read_log, with_velocities
from flexid.report.identification_figures import fit_figure
from flexid.report.identification_table import format_fits, print_identification
from flexid.report.style import BLUE, GREY, ORANGE, STYLE, new_figure, save

ROOT = Path(__file__).parents[2]
ASSETS = ROOT / "docs" / "assets"
SHARE = 0.5  # of the log that is kept out
INPUT_DELAY = 0.0167  # s, that least squares likes
RATE_FACTORS = (0.25, 0.5, 1.0, 2.0)  # of the filter rate that was chosen
Values = Mapping[str, float]
SHOWN = {"theta2": "stiffness / link inertia, 1/s²", "alpha1": "stiffness / motor inertia, 1/s²"}


def candidate_of(result: Identification) -> Candidate:
    """What was chosen, to be fitted again."""
    choices, joint = result.choices, flexible()
    if choices.coulomb_velocity is not None:
        joint = joint.with_coulomb_velocity(choices.coulomb_velocity)
    return Candidate(joint, choices.terms, choices.hold, choices.filter_rate, 0.0)


def ways(candidate: Candidate, part: Recording) -> dict[str, Values]:
    """All coefficients from a part of the log, by every way of estimating them."""
    pieces, groups = [with_velocities(part)], [0]
    found = {}
    for factor in RATE_FACTORS:
        tried = replace(candidate, filter_rate=factor * candidate.filter_rate)
        found[f"{tried.filter_rate:.3g} 1/s"] = values_of(tried.least_squares(pieces, groups))
    for duration in DURATIONS:
        tried = replace(candidate, segment_duration=duration)
        try:
            found[f"{duration:g} s"] = values_of(tried.prediction_error(pieces, groups))
        except ConvergenceError as error:
            print(f"{duration:g} s: {error}")
    return found


def values_of(fitted: Fitted[AnyFit]) -> Values:
    """Every coefficient of the model by name, those of terms that are off too."""
    (values,) = fitted.coefficients(1)
    return dict(zip(fitted.unknowns.system.coefficients, map(float, values), strict=True))


def draw_ways(ax: Axes, parts: Mapping[str, Mapping[str, Values]], name: str) -> None:
    """One coefficient by every way, from each part of the log."""
    labels = list(dict.fromkeys(way for found in parts.values() for way in found))
    for (part, found), colour in zip(parts.items(), (BLUE, ORANGE, GREY), strict=True):
        values = [found[way][name] if way in found else float("nan") for way in labels]
        ax.plot(
            range(len(labels)), values, "o-", color=colour, markersize=3, linewidth=0.8, label=part
        )
    ax.axvline(len(RATE_FACTORS) - 0.5, color=GREY, linewidth=0.8, linestyle="--")
    ax.set_xticks(range(len(labels)), labels, rotation=60)
    ax.set_title(SHOWN[name])
    ax.set_ylim(0, 1.1 * ax.get_ylim()[1])


def print_ways(candidate: Candidate, log: Log, parts: Mapping[str, Mapping[str, Values]]) -> None:
    """Coefficients by every way; and what those of the first half make of the second."""
    pieces, _ = prepare([log], SHARE)
    names = candidate.joint.system.coefficients
    for part, found in parts.items():
        for way, values in found.items():
            line = ", ".join(f"{name} {values[name]:.4g}" for name in ("theta2", "alpha1", "beta1"))
            if part == "first half":
                array = np.array([values[name] for name in names])
                run = validate(candidate.joint, pieces, [array], candidate.hold)
                line += f"; free run {format_fits(run.fit_percent)}"
            print(f"{part}, {way}: {line}")


def main() -> None:
    """Read the log, print what the page quotes, write the figures."""
    log = read_log(Path(sys.argv[1]), ROOT / "examples" / "columns_voltage_arm.toml")
    (piece,) = log.pieces
    half = len(piece) // 2
    result = identify([log], Settings(validation_share=SHARE))
    print_identification(result, explain=True)
    delayed = identify([log], Settings(validation_share=SHARE, input_delay=INPUT_DELAY))
    print(f"input {INPUT_DELAY:g} s late: {', '.join(delayed.choices.terms)}")
    print(f"  free run {format_fits(delayed.validation.fit_percent)}")
    windows = {
        "first half": piece.window(0, half),
        "second half": piece.window(half, len(piece)),
        "all": piece,
    }
    candidate = candidate_of(result)
    parts = {name: ways(candidate, window) for name, window in windows.items()}
    print_ways(candidate, log, parts)
    with mpl.rc_context(STYLE):
        save(fit_figure(result), ASSETS, "ist-free-run")
        figure = new_figure(7.2, 3.2)
        axes = figure.subplots(1, len(SHOWN))
        for ax, name in zip(axes, SHOWN, strict=True):
            draw_ways(ax, parts, name)
            ax.set_xlabel("least squares, filter rate | prediction error, segments")
        axes[0].legend(loc="lower left")
        save(figure, ASSETS, "ist-ways")


if __name__ == "__main__":
    main()
