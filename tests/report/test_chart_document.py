"""The document of a chart equals the chart."""

import json
from dataclasses import fields

import numpy as np
import pytest

from flexid.report.charts.decimate import kept_samples
from flexid.report.charts.description import Axis, Band, Chart, Level, Line, Panel, Points
from flexid.report.charts.document import chart_document

TIME = np.linspace(0.0, 1.0, 11)
ANGLE = np.sin(TIME)


def chart(*marks, x=None, y=None) -> Chart:
    """Return a chart of one panel."""
    panel = Panel("link", x or Axis("time", "s"), y or Axis("angle", "rad"), marks)
    return Chart("fit", "The fit", "The line is smooth.", (panel,), linked=False)


MARKS = {
    "line": Line("model", TIME, ANGLE, "red", 2.0, "dashed", filled=True),
    "band": Band("band", TIME, ANGLE - 1.0, ANGLE + 1.0, "grey"),
    "points": Points("seen", TIME, ANGLE, "orange", 3.0, faint=True, stems=True),
    "level": Level("limit", 0.5, "x", "green", "dotted"),
}


@pytest.mark.parametrize("kind", MARKS)
def test_every_field_of_a_mark_is_in_the_document(kind):
    """Assert that a mark's document has its fields, and the places of its arrays."""
    mark = MARKS[kind]
    made = chart_document(chart(mark))
    (found,) = made["panels"][0]["marks"]
    assert found.pop("kind") == kind
    assert set(found) == {field.name for field in fields(mark)}
    for name, value in found.items():
        wanted = getattr(mark, name)
        if isinstance(wanted, np.ndarray):
            assert made["arrays"][value] == pytest.approx(wanted, abs=1e-5)
        else:
            assert value == wanted


def test_every_field_of_chart_and_panel_is_in_the_document():
    """Assert that titles, sentence, axes and layout come through, as JSON."""
    axes = Axis("time", "s", limits=(0.0, 2.0)), Axis("angle", "rad", categories=("a", "b"))
    made = json.loads(json.dumps(chart_document(chart(*MARKS.values(), x=axes[0], y=axes[1]))))
    (panel,) = made.pop("panels")
    assert len(panel.pop("marks")) == len(MARKS)
    del made["arrays"]
    assert made == {
        "name": "fit",
        "title": "The fit",
        "says": "The line is smooth.",
        "columns": 1,
        "linked": False,
    }
    assert panel == {
        "title": "link",
        "height": 1.0,
        "span": 1,
        "colour": "ink",
        "x": {
            "label": "time",
            "unit": "s",
            "logarithmic": False,
            "limits": [0.0, 2.0],
            "categories": [],
            "step": None,
        },
        "y": {
            "label": "angle",
            "unit": "rad",
            "logarithmic": False,
            "limits": None,
            "categories": ["a", "b"],
            "step": None,
        },
    }


def test_an_array_stands_once():
    """Assert that two marks over the same times share them."""
    made = chart_document(chart(Line("a", TIME, ANGLE), Line("b", TIME.copy(), 2.0 * ANGLE)))
    first, second = made["panels"][0]["marks"]
    assert first["x"] == second["x"]
    assert len(made["arrays"]) == 3


def test_what_is_not_finite_is_a_gap():
    """Assert that NaN and infinity become null, which JSON has."""
    values = np.array([1.0, np.nan, np.inf, 2.0])
    made = chart_document(chart(Line("a", np.linspace(0.0, 3.0, 4), values)))
    assert made["arrays"][1] == [1.0, None, None, 2.0]
    assert "NaN" not in json.dumps(made)


@pytest.mark.parametrize("offset", [0.0, 1.7e9])
def test_times_keep_their_distance(offset):
    """Assert that rounding follows an array's range, not its size."""
    time = offset + np.linspace(0.0, 0.999, 1000)
    made = chart_document(chart(Line("a", time, np.zeros_like(time))))
    assert np.diff(made["arrays"][0]) == pytest.approx(0.001, abs=1e-5)


def test_a_logarithmic_axis_keeps_small_values():
    """Assert that a millionth beside a million keeps its digits."""
    values = np.array([1.234567e-6, 1.0, 7.654321e6])
    axes = Axis("frequency", "Hz", logarithmic=True), Axis("size", logarithmic=True)
    made = chart_document(chart(Line("a", values, values), x=axes[0], y=axes[1]))
    assert made["arrays"][0] == pytest.approx(values, rel=1e-5)


def test_a_long_log_keeps_its_extremes():
    """Assert that of a million samples some thousands stay, with a spike of one of two curves."""
    time = np.linspace(0.0, 999.999, 1_000_000)
    wave, spike = np.sin(time), np.zeros_like(time)
    spike[654_321] = 5.0
    made = chart_document(chart(Line("a", time, wave), Line("b", time, spike)))
    x, y, other = made["arrays"]
    assert len(x) == len(y) == len(other) < 2000
    assert max(other) == 5.0
    assert x[other.index(5.0)] == pytest.approx(654.321)
    assert max(y) == pytest.approx(1.0, abs=1e-4)


def test_a_gap_stays_a_gap():
    """Assert that a gap in a long curve is there after decimation."""
    values = np.ones(100_000)
    values[50_000:50_010] = np.nan
    assert np.isnan(values[kept_samples([values], 400)]).any()


def test_a_short_curve_keeps_all():
    """Assert that nothing is left out where there is room."""
    assert kept_samples([ANGLE], 11).tolist() == list(range(11))


def test_what_leaves_the_frame_does_not_coarsen_what_is_in_it():
    """Assert that a peak of 1e9 beyond the limits leaves the digits of the values within."""
    values = np.where(np.arange(11) == 0, 1e9, 12.34567)
    made = chart_document(
        chart(Line("torque", TIME, values), y=Axis("torque", "N m", limits=(-50.0, 50.0)))
    )
    found = made["arrays"][made["panels"][0]["marks"][0]["y"]]
    assert found[1:] == pytest.approx([12.34567] * 10, abs=0.05)
