"""The printed answer of a design."""

from collections.abc import Callable, Iterator

from rich.text import Text

from flexid.experiment_design.drive import DOUBT
from flexid.experiment_design.result import Design, Prediction
from flexid.report.terminal import Cell, Column, Part, Table, number, numbers

_UNITS = {"torque": "N m", "velocity": "rad/s", "position": "rad", "deflection": "rad"}


def design_parts(result: Design) -> Iterator[Part]:
    """Tables and sentences of the answer."""
    yield _predictions(result)
    yield _limits(result)
    wanted = result.drive.experiment
    broken = [p.name for p in result.references if not p.within_limits]
    if broken:
        yield Text(f"Beyond the limits at this torque: {', '.join(broken)}.")
    tones = ", ".join(f"{rate:.3g}" for rate in result.angular_frequencies)
    what = "torque" if wanted.kind == "multisine" else "motor position"
    yield Text(f"Tones of the {what}: {tones} rad/s; {wanted.duration:g} s; seed {result.seed}.")
    yield Text(
        f"What the search found was played {result.scale:.3g} times as large, so that every drive "
        f"wrong by {100 * DOUBT:.0f} % keeps to the limits."
    )


def _predictions(result: Design) -> Table:
    inputs = (result.prediction, *result.references)
    worst = Column(f"design, worst of ±{100 * DOUBT:.0f} %")
    columns = (Column("coefficient"), *numbers(*(one.name for one in inputs)), worst)
    wanted = result.drive.experiment
    how = f"{wanted.criterion}-optimal {wanted.kind}"
    title = f"Predicted standard deviations, {how}, equal peak torque"
    table = Table(title, columns)
    for name in result.prediction.deviations:
        extreme = result.largest_deviations[name]
        table.add(
            name,
            *(_percent(one.deviations[name]) for one in inputs),
            _percent(extreme.value).with_unit(f"({extreme.case})"),
        )
    table.rule()
    for label, value in _summaries().items():
        table.add(label, *(value(one) for one in inputs))
    table.rule()
    within = (result.prediction, *result.kept_references)
    table.add("worst, within limits", *(_percent(one.worst) for one in within))
    return table


def _summaries() -> dict[str, Callable[[Prediction], Cell]]:
    return {
        "worst": lambda one: _percent(one.worst),
        "criterion E": lambda one: _percent(one.e_deviation),
        "criterion D": lambda one: _percent(one.d_deviation),
        "torque, peak": lambda one: number(one.peaks["torque"], 3, "N m"),
        "torque, rms": lambda one: number(one.torque_rms, 3, "N m"),
    }


def _limits(result: Design) -> Table:
    share = Column(f"largest share, ±{100 * DOUBT:.0f} %")
    table = Table("Limits", (Column("channel"), *numbers("limit", "as believed"), share))
    for channel, unit in _UNITS.items():
        extreme = result.largest_use[channel]
        table.add(
            channel,
            number(getattr(result.drive.limits, channel), 3, unit),
            number(result.prediction.peaks[channel], 3, unit),
            f"{100 * extreme.value:.0f} % ({extreme.case})",
        )
    return table


def _percent(share: float) -> Cell:
    return number(100 * share, 3, "%")
