"""A page made by hand, with every kind of part and mark."""

import numpy as np
from rich.text import Text

from flexid.report.chart import Axis, Band, Chart, Level, Line, Panel, Points
from flexid.report.page import Answer, Command, Page, Section
from flexid.report.terminal import Column, Table, numbers

TIME = np.linspace(0.0, 10.0, 501)
WAVE = np.sin(TIME)


def made_chart(name: str = "fit", label: str = "measured") -> Chart:
    """Return a chart of two panels over time, with every kind of mark."""
    time = Axis("time", "s")
    first = Panel(
        "link",
        time,
        Axis("angle", "rad"),
        (
            Band("95 % band", TIME, WAVE - 0.1, WAVE + 0.1, "grey"),
            Line(label, TIME, WAVE),
            Level("limit", 0.5, "y", "red", "dashed"),
        ),
    )
    second = Panel(
        "residual",
        time,
        Axis("residual", "rad"),
        (Points("residual", TIME[::10], 1e-4 * np.cos(40 * TIME[::10])),),
        0.5,
    )
    return Chart(name, f"Chart {name}", f"What to see in {name}.", (first, second))


def made_other_charts() -> list[Chart]:
    """Return charts with logarithmic axes, names at an axis, and a closed line."""
    turn = np.linspace(0.0, 2.0 * np.pi, 50)
    frequency = np.geomspace(0.1, 100.0, 80)
    bode = Panel(
        "response",
        Axis("frequency", "Hz", logarithmic=True),
        Axis("magnitude", "rad/s/(N m)", logarithmic=True),
        (Line("model", frequency, 1e-6 / frequency),),
    )
    region = Panel(
        "region",
        Axis("stiffness", "N m/rad"),
        Axis("inertia", "kg m^2"),
        (Line("region", np.cos(turn), np.sin(turn)),),
    )
    named = Panel(
        "",
        Axis("within", "%"),
        Axis("", categories=("stiffness", "inertia")),
        (Points("interval", np.array([1.0, 2.0]), np.array([0.0, 1.0])),),
    )
    return [
        Chart(name, f"Chart {name}", f"What to see in {name}.", (panel,), linked=False)
        for name, panel in (("bode", bode), ("regions", region), ("widths", named))
    ]


def made_page(word: str = "stiffness") -> Page:
    """Return a page on which a word from outside stands wherever one may stand."""
    table = Table("Parameters", (Column("name"), *numbers("value"), Column("unit"), Column("why")))
    for verdict, colour in (("determined", "green"), ("weak", "yellow"), ("lost", "red")):
        table.add(word, "1.00", "kg m^2", Text(verdict, colour))
    answer = Answer(f"Is {word} right?", word, "fair", [word, Command(f"flexid {word}")])
    charts = [made_chart("fit", word), made_chart("again"), *made_other_charts()]
    sections = [
        Section("fit", word, charts),
        Section("more", "More", [Text(word, "yellow"), word, table]),
    ]
    return Page(word, word, table, [answer], sections)
