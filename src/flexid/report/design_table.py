"""The printed answer of a design, at most 100 columns wide."""

from collections.abc import Callable, Iterator

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from flexid.experiment_design.drive import DOUBT
from flexid.experiment_design.result import Design, Prediction
from flexid.report.terminal import print_parts, titled_table

_UNITS = {"torque": "N m", "velocity": "rad/s", "position": "rad", "deflection": "rad"}


def print_design(result: Design) -> None:
    """Print predictions, limits and the tones on standard output."""
    print_parts(_parts(result))


def _parts(result: Design) -> Iterator[RenderableType]:
    yield _predictions(result)
    yield _limits(result)
    drive, broken = result.drive, [p.name for p in result.references if not p.within_limits]
    if broken:
        yield Text(f"Beyond the limits at this torque: {', '.join(broken)}.")
    tones = ", ".join(f"{rate:.3g}" for rate in result.angular_frequencies)
    what = "torque" if drive.kind == "multisine" else "motor position"
    yield Text(f"Tones of the {what}: {tones} rad/s; {drive.duration:g} s; seed {result.seed}.")
    yield Text(
        f"What the search found was played {result.scale:.3g} times as large, so that every drive "
        f"wrong by {100 * DOUBT:.0f} % keeps to the limits."
    )


def _predictions(result: Design) -> Table:
    inputs = (result.prediction, *result.references)
    table = titled_table(
        f"Predicted standard deviations, {result.drive.criterion}-optimal {result.drive.kind}, "
        f"equal peak torque",
        collapse_padding=True,
    )
    table.add_column("coefficient", no_wrap=True)
    for one in inputs:
        table.add_column(one.name, justify="right", no_wrap=True)
    table.add_column(f"design, worst of ±{100 * DOUBT:.0f} %", no_wrap=True)
    for name in result.prediction.deviations:
        extreme = result.largest_deviations[name]
        table.add_row(
            name,
            *(_percent(one.deviations[name]) for one in inputs),
            f"{_percent(extreme.value)} ({extreme.case})",
        )
    table.add_section()
    for label, value in _summaries().items():
        table.add_row(label, *(value(one) for one in inputs), "")
    table.add_section()
    within = (result.prediction, *result.kept_references)
    table.add_row("worst, within limits", *(_percent(one.worst) for one in within), "")
    return table


def _summaries() -> dict[str, Callable[[Prediction], str]]:
    return {
        "worst": lambda one: _percent(one.worst),
        "criterion E": lambda one: _percent(one.e_deviation),
        "criterion D": lambda one: _percent(one.d_deviation),
        "torque, peak": lambda one: f"{one.peaks['torque']:.3g} N m",
        "torque, rms": lambda one: f"{one.torque_rms:.3g} N m",
    }


def _limits(result: Design) -> Table:
    table = titled_table("Limits", collapse_padding=True)
    table.add_column("channel", no_wrap=True)
    for heading in ("limit", "as believed"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column(f"largest share, ±{100 * DOUBT:.0f} %", no_wrap=True)
    for channel, unit in _UNITS.items():
        extreme = result.largest_use[channel]
        table.add_row(
            channel,
            f"{getattr(result.drive.limits, channel):.3g} {unit}",
            f"{result.prediction.peaks[channel]:.3g} {unit}",
            f"{100 * extreme.value:.0f} % ({extreme.case})",
        )
    return table


def _percent(share: float) -> str:
    return f"{100 * share:.3g} %"
