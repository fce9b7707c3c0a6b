"""Make the figures of the page on the IST arm, and print the numbers it quotes.

Run `python docs/real-logs/make_ist_figures.py LOG` with the log `ist_square_1p5V.csv` of the arm
(GitHub avdolrahman/Flexible-Robot-Arm-, MIT).
"""

import sys
from collections.abc import Mapping
from pathlib import Path

import matplotlib as mpl
from matplotlib.axes import Axes

from flexid.errors import ConvergenceError
from flexid.estimators.channel_timing import Timing
from flexid.identification.full_model.fitting import fit_by_length, lengths
from flexid.identification.full_model.model import Data, Structure, data_of
from flexid.identification.full_model.starting import least_squares_start, starts
from flexid.identification.identify import identify
from flexid.identification.preparation.joint import flexible
from flexid.identification.preparation.recordings import prepare
from flexid.identification.preparation.settings import Settings
from flexid.identification.result import Identification
from flexid.identification.structure.validation import validate
from flexid.recording import Log, Recording, read_log, with_velocities
from flexid.report.figure import BLUE, GREY, ORANGE, STYLE, draw, new_figure, save
from flexid.report.identification import evidence, format_fits, parts
from flexid.report.response_charts import fit_chart
from flexid.report.terminal import print_parts

ROOT = Path(__file__).parents[2]
ASSETS = ROOT / "docs" / "assets"
SHARE = 1 / 3  # of the log that is kept out
RATES = (7.1, 14.1, 28.3, 56.6)  # 1/s, of the filter of least squares
TERMS = ("motor_viscous", "link_offset", "motor_offset")  # without dry friction
Values = Mapping[str, float]
SHOWN = {"theta2": "stiffness / link inertia, 1/s²", "alpha1": "stiffness / motor inertia, 1/s²"}


def structure_of(result: Identification, data: Data) -> Structure:
    """The structure that was found, to be fitted again."""
    joint = flexible().scaled(data.samples)
    on = {c for term in result.choices.terms for c in joint.terms[term]}
    delays = {"input_delay": result.choices.alignment.input_delay}
    found = {name: delay.value for name, delay in delays.items() if delay.status == "found"}
    return Structure(
        joint, frozenset(joint.optional - on), Timing(result.choices.hold, found, tuple(found))
    )


def ways(result: Identification, log: Log, part: Recording) -> dict[str, Values]:
    """The coefficients from a part of the log, by every way of estimating them."""
    data = data_of(flexible(), [with_velocities(part)], [0])
    structure = structure_of(result, data)
    found = {}
    for rate in RATES:
        values, _ = least_squares_start(structure, data, rate)
        found[f"{rate:.3g} 1/s"] = values
    divisions = lengths(data)
    for start in starts(structure, data, divisions[0]):
        try:
            fits = fit_by_length(structure, data, start, divisions)
            break
        except ConvergenceError as error:
            print(f"from one of the starts: {error}")
    else:
        return found
    recordings, _ = prepare([log], SHARE)
    whole = data_of(flexible(), recordings.whole, recordings.groups)
    for fitted in fits:
        way = f"{float(f'{fitted.duration:.1g}'):g} s"
        found[way] = fitted.by_name
        fit = format_fits(validate(fitted, whole, recordings.starts).fit_percent)
        print(f"    {way}: residuals² {fitted.excess:.3g} of noise; over held-out data {fit}")
    return found


def draw_ways(ax: Axes, parts: Mapping[str, Mapping[str, Values]], name: str) -> None:
    """One coefficient by every way, from each part of the log."""
    labels = list(dict.fromkeys(way for found in parts.values() for way in found))
    for (part, found), colour in zip(parts.items(), (BLUE, ORANGE, GREY), strict=True):
        values = [found[way][name] if way in found else float("nan") for way in labels]
        ax.plot(
            range(len(labels)), values, "o-", color=colour, markersize=3, linewidth=0.8, label=part
        )
    ax.axvline(len(RATES) - 0.5, color=GREY, linewidth=0.8, linestyle="--")
    ax.set_xticks(range(len(labels)), labels, rotation=60)
    ax.set_title(SHOWN[name])
    ax.set_ylim(0, 1.1 * ax.get_ylim()[1])


def print_ways(parts: Mapping[str, Mapping[str, Values]]) -> None:
    """Coefficients by every way."""
    for part, found in parts.items():
        for way, values in found.items():
            shown = (name for name in ("theta2", "alpha1", "beta1", "input_delay"))
            line = ", ".join(f"{name} {values[name]:.4g}" for name in shown if name in values)
            print(f"{part}, {way}: {line}")


def main() -> None:
    """Read the log, print what the page quotes, write the figures."""
    log = read_log(Path(sys.argv[1]), ROOT / "examples" / "columns_voltage_arm.toml")
    (recording,) = log.recordings
    half = len(recording) // 2
    result = identify([log], Settings(validation_share=SHARE))
    print_parts([*parts(result), *evidence(result)])
    for name, settings in {
        "three terms": Settings(terms=TERMS, validation_share=SHARE),
        "three terms, input in time": Settings(
            terms=TERMS, validation_share=SHARE, input_delay=0.0
        ),
    }.items():
        print(name)
        print_parts(parts(identify([log], settings)))
    windows = {
        "first half": recording.window(0, half),
        "second half": recording.window(half, len(recording)),
        "all": recording,
    }
    found = {}
    for name, window in windows.items():
        print(name)
        found[name] = ways(result, log, window)
    print_ways(found)
    with mpl.rc_context(STYLE):
        save(draw(fit_chart(result)), ASSETS, "ist-free-run")
        figure = new_figure(7.2, 3.2)
        axes = figure.subplots(1, len(SHOWN))
        for ax, name in zip(axes, SHOWN, strict=True):
            draw_ways(ax, found, name)
            ax.set_xlabel("least squares, filter rate | prediction error, segments")
        axes[0].legend(loc="lower left")
        save(figure, ASSETS, "ist-ways")


if __name__ == "__main__":
    main()
