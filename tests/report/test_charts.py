"""Charts: drawn as described, with the values found, in a file and in a page."""

import re
from pathlib import Path
from typing import TypeVar
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.colors import to_hex
from shown import chart_lines, check

from flexid.experiments.experiment import read_experiment
from flexid.identification.vocabulary.evidence import FreeRun, Validation
from flexid.library.simulate import SimulatedRun
from flexid.report.chart import Axis, Band, Chart, Level, Line, Panel, kept_samples, whole_decades
from flexid.report.figure import COLOURS, chart_html, draw, drawn_once
from flexid.report.page import page_html
from flexid.report.reproduction import charts as reproduction_charts
from flexid.report.reproduction import parts
from flexid.report.response_charts import autocorrelation, free_run_chart, residual_chart
from flexid.report.simulated_run import motion_chart, observer_chart
from flexid.report.terminal import print_parts

X = np.array([1.0, 10.0, 100.0])
Y = np.array([2.0, np.nan, 4.0])


def chart(*panels: Panel, columns: int = 1, title: str = "A title") -> Chart:
    """Return a chart of panels."""
    return Chart("name", title, "What to see.", panels, columns)


def panel(*marks, x=None, y=None, **layout) -> Panel:
    """Return a panel over time."""
    return Panel("a title", x or Axis("time", "s"), y or Axis("angle", "rad"), marks, **layout)


def test_marks_and_axes_are_as_described():
    """Assert values, colours, strokes and labels of marks; units, scale and steps of axes."""
    line = Line("line", X, Y, "red", 2.5, "dotted")
    band, level = Band("band", X, -X, X, "green"), Level("level", 3.0, "x", "orange", "dashed")
    (ax,) = draw(chart(panel(band, line, level))).axes
    drawn, across = ax.lines
    assert np.array_equal(drawn.get_xydata(), np.column_stack([X, Y]), equal_nan=True)
    assert (to_hex(drawn.get_color()), drawn.get_linewidth()) == (COLOURS["red"], 2.5)
    assert drawn.get_linestyle() == ":"
    assert np.asarray(across.get_xdata()).tolist() == [3.0, 3.0]
    (shade,) = ax.collections
    assert np.array_equal(shade.get_datalim(ax.transData).intervaly, [-100.0, 100.0])
    assert to_hex(np.asarray(shade.get_facecolor())[0]) == COLOURS["green"]
    x = Axis("frequency", "Hz", logarithmic=True, limits=(0.1, 1000.0))
    y = Axis("phase", "°", limits=(-180.0, 90.0), step=90.0)
    (ax,) = draw(chart(panel(Line("", X, Y), x=x, y=y))).axes
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("frequency (Hz)", "phase (°)")
    assert (ax.get_xscale(), ax.get_yscale()) == ("log", "linear")
    assert ax.get_xlim() == (0.1, 1000.0)
    assert np.diff(ax.get_yticks()).tolist() == [90.0] * (len(ax.get_yticks()) - 1)


def test_the_legend_names_each_label_once():
    """Assert that labels of several panels appear once, and empty labels do not."""
    one = panel(Line("model", X, Y), Line("", X, Y))
    figure = draw(chart(one, panel(Line("model", X, Y), Level("limit", 1.0))))
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["model", "limit"]
    assert draw(chart(panel(Line("alone", X, Y)))).legends == []


@pytest.mark.parametrize("length", [5, 20, 60])
def test_the_legend_is_no_wider_than_the_figure(length):
    """Assert that seven labels fit, short or long, in as many lines as needed."""
    lines = [Line(f"{k} " + length * "n", X, k * X) for k in range(7)]
    figure = draw(chart(panel(*lines)))
    figure.draw_without_rendering()
    (legend,) = figure.legends
    box, paper = legend.get_window_extent(), figure.bbox
    assert paper.x0 <= box.x0 < box.x1 <= paper.x1
    assert box.y1 < figure.axes[0].get_window_extent().y0


def test_layout_of_panels():
    """Assert that a column shares x with one label, and that spans and heights are kept."""
    y = Axis("angle", "rad", limits=(0.0, 500.0))
    panels = [panel(Line("", X, k * X), y=y) for k in range(1, 5)]
    axes = draw(chart(*panels, columns=2)).axes
    assert [ax.get_xlabel() for ax in axes] == ["", "", "time (s)", "time (s)"]
    assert axes[0].get_shared_x_axes().joined(axes[0], axes[2])
    other = panel(Line("", X, X), x=Axis("frequency", "Hz"))
    above = draw(chart(panel(Line("", X, X), span=2), other, other, columns=2)).axes
    assert [ax.get_xlabel() for ax in above] == ["time (s)", "frequency (Hz)", "frequency (Hz)"]
    free = draw(chart(panel(Line("", X, X)), panel(Line("", X, 9.0 * X)), columns=2)).axes
    assert [ax.get_ylabel() for ax in free] == ["angle (rad)"] * 2
    assert free[1].get_ylim()[1] > 5.0 * free[0].get_ylim()[1]
    line = Line("", X, Y)
    wide = panel(line, span=2, height=2.0)
    figure = draw(chart(wide, panel(line), panel(line), columns=2))
    figure.draw_without_rendering()
    top, left, right = (ax.get_position() for ax in figure.axes)
    assert top.x0 == pytest.approx(left.x0)
    assert top.x1 == pytest.approx(right.x1)
    assert left.y1 < top.y0
    assert 1.5 < top.height / left.height < 2.5


def test_a_long_line_keeps_its_spikes_and_gaps():
    """Assert that a million samples are thinned, with extreme values kept."""
    time, still = np.arange(1e6), np.zeros(1_000_000)
    still[123_456], still[600_000:600_010] = 1.0, np.nan
    (ax,) = draw(chart(panel(Line("", time, still), Band("", time, still - 1.0, still)))).axes
    drawn = np.asarray(ax.lines[0].get_xydata())
    assert len(drawn) < 3_000
    assert drawn[drawn[:, 1] == 1.0].tolist() == [[123_456.0, 1.0]]
    assert np.isnan(drawn[:, 1]).any()
    assert kept_samples([still[:11]], 11).tolist() == list(range(11))


def test_text_is_no_formula():
    """Assert that dollars and backslashes of a name are drawn unchanged."""
    name = r"gain $\frac of $x, " + 12 * "and longer "
    x, y = Axis(r"$\frac$", "s"), Axis(r"$\x")
    formula = Panel(r"$\frac$", x, y, (Line(r"$\y$", X, Y), Line("other", X, Y)))
    figure = draw(chart(formula, title=name))
    figure.draw_without_rendering()
    lines = figure.get_suptitle().splitlines()
    assert lines[0].startswith(r"gain $\frac of $x, and")
    assert max(map(len, lines)) <= 84
    ElementTree.fromstring(chart_html(chart(formula, title=name)))


def test_figures_of_a_page():
    """Assert Matplotlib's points to a tenth, text as text, the page's colours, and no style."""
    made = chart(panel(Line("", X, X**0.5), y=Axis("size", logarithmic=True)))
    figure = drawn_once(made)
    (ax,) = figure.axes
    pixels = ax.transData.transform(np.column_stack([X, X**0.5])) * 72.0 / figure.dpi
    pixels[:, 1] = 72.0 * figure.get_figheight() - pixels[:, 1]
    svg = ElementTree.fromstring(chart_html(made))
    paths = [path.get("d", "") for path in svg.iter("{http://www.w3.org/2000/svg}path")]
    found = [np.array(re.findall(r"[-.\d]+", path), dtype=float) for path in paths]
    assert any(len(f) == 6 and np.abs(f - pixels.ravel()).max() < 0.06 for f in found)
    marks = Band("band", X, -X, X, "grey"), Line("line", X, X)
    html = chart_html(chart(panel(*marks), title='<b> & "c"'))
    assert html.count('aria-label="&lt;b&gt; &amp; &quot;c&quot;"') == html.count("<svg") == 1
    assert ">time (s)<" in html
    assert html.count('fill="var(--chart-grey)" fill-opacity="0.25"') >= 2  # legend and panel
    assert "style" not in html
    assert not re.search("#[0-9a-f]{6}\\b", html)
    assert chart_html(chart(panel(*marks), title='<b> & "c"')) == html


def test_numbers_of_charts():
    """Assert powers of ten as limits, and an autocorrelation that alternates with the lag."""
    assert whole_decades(np.array([3.0, 4.0])) == (1.0, 10.0)
    assert whole_decades(np.array([10.0, 10.0])) == (10.0, 100.0)
    assert whole_decades(np.array([0.02, 1e3, 0.0, np.nan])) == (0.01, 1e3)
    np.testing.assert_allclose(
        autocorrelation(np.array([1.0, -1.0, 1.0, -1.0])), [1, -0.75, 0.5, -0.25]
    )
    assert autocorrelation(np.zeros(3)).tolist() == [1.0, 0.0, 0.0]


M = TypeVar("M")


def marks_of(panel: Panel, kind: type[M]) -> list[M]:
    """Return marks of one kind."""
    return [mark for mark in panel.marks if isinstance(mark, kind)]


def test_channels_of_several_joints_have_units_of_their_own():
    """Assert the labels and units of axes, for joints that turn and slide."""
    seen = np.random.default_rng(3).standard_normal((20, 2))
    runs = (FreeRun(np.arange(20.0), seen, np.zeros_like(seen)),)
    fits = {"link_position_1": 90.0, "deflection_2": 80.0}
    chart = free_run_chart("fit", "", Validation(fits, runs), {}, ("revolute", "prismatic"))
    axes = [(panel.y.label, panel.y.unit) for panel in chart.panels]
    assert axes[::2] == [("position", "rad"), ("deflection", "m")]
    assert axes[1::2] == [("residual", "rad"), ("residual", "m")]


def test_residuals_that_repeat_leave_the_band():
    """Assert that noise is outside its band in a twentieth of the lags, and a sine in most."""
    generator = np.random.default_rng(3)
    time = np.linspace(0.0, 20.0, 20_001)
    noise = generator.standard_normal(len(time))
    measured = np.column_stack([noise, noise + np.sin(2.0 * time)])
    runs = (FreeRun(time, measured, np.zeros_like(measured)),)
    chart = residual_chart(
        Validation({"link_position": 1.0, "motor_position": 1.0}, runs), ("revolute",)
    )
    assert [panel.x.label for panel in chart.panels] == ["time", "lag"] * 2
    shares = []
    for panel in chart.panels[1::2]:
        (band,), (line,) = marks_of(panel, Band), marks_of(panel, Line)
        assert line.x[0] == 0.0
        assert line.y[0] == pytest.approx(1.0)
        shares.append(np.mean(np.abs(line.y[1:]) > band.high[0]))
    assert 0.03 < shares[0] < 0.07
    assert shares[1] > 0.8
    diverged = (FreeRun(time, measured, np.full_like(measured, np.inf)),)
    lost = residual_chart(
        Validation({"link_position": -np.inf, "motor_position": 0.0}, diverged), ("revolute",)
    )
    assert not marks_of(lost.panels[1], Line)


EXPERIMENT = read_experiment(Path(__file__).parents[2] / "experiments" / "huang2003.toml")


def test_a_run_is_shown(request: pytest.FixtureRequest):
    """Assert table, figures and command on the page, and marks with the first torque cut off."""
    run = EXPERIMENT.with_values({"run.duration": 25.0}).run()
    made = page_html(SimulatedRun(EXPERIMENT, run)._page("flexid simulate x"))
    assert made.count('class="chart"') == 2
    for text in ("theta1", "Tracking error:", "flexid simulate x", EXPERIMENT.digest):
        assert text in made
    charts = motion_chart("Table I", run), observer_chart("Table I", run)
    lines = (line for chart in charts for line in chart_lines(chart))
    check("run_charts", lines, request, computed=True)


def test_the_reproduction_is_shown(reproduction, request: pytest.FixtureRequest, capsys):
    """Assert marks of the figures, each claim's verdict and values, and tables of 80 columns."""
    charts = reproduction_charts(reproduction)
    lines = (line for chart in charts for line in chart_lines(chart))
    check("reproduction_charts", lines, request, computed=True)
    lines = (
        f"{claim.key}, {claim.verdict}: {one.subject}, {one.quantity} "
        f"{one.value * (abs(one.value) > 1e-6):.3e} {one.unit}"
        for claim in reproduction.claims
        for one in claim.findings
    )
    check("claims", lines, request, computed=True)
    print_parts(parts(reproduction))
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    assert sum("holds" in line or "does not hold" in line for line in lines) >= 15
