"""Choices of a window, read from its address."""

import pytest

from flexid.errors import SettingError
from flexid.recording.recording import SI_UNITS
from flexid.studio.choices import Choices, Source, read_choices, read_play


def test_an_address_says_all():
    """Assert that every choice of a form is read, and that terms have one order."""
    values = {
        "column.motor_position": "q & <b>",
        "unit.motor_position": "deg",
        "scale.motor_position": "-0.5",
        "offset.motor_position": "1e-9",
        "column.time": "t",
        "gear_ratio": "101",
        "lead": "1/200",
        "model": "flexible",
        "hold": "zero",
        "terms": "motor_viscous,gravity,motor_viscous",
        "ran": "yes",
    }
    sources = {"motor_position": Source("q & <b>", "deg", -0.5, 1e-9), "time": Source("t")}
    terms = ("gravity", "motor_viscous")
    assert read_choices(values) == Choices(sources, 101.0, "flexible", "zero", terms, True, 0.005)
    assert read_choices({}) == Choices()
    assert read_choices({"terms": ""}).terms == ()  # other than in the log


@pytest.mark.parametrize(
    "values",
    [
        {"model": "../../etc/passwd"},
        {"hold": "<script>"},
        {"terms": "gravity,nonsense"},
        {"column.time": "t", "scale.time": "nan"},
        {"column.time": "t", "gear_ratio": "1/0"},
        {"column.time": "t", "offset.time": "1e999"},
        {"column.time": "t" * 1000},
        {f"key{i}": "" for i in range(1000)},
        "no mapping",
        None,
        {"reading": "9,9,9"},
    ],
)
def test_what_cannot_be_meant_is_refused(values: object):
    """Assert that an address with invalid values is refused in one sentence, in either room."""
    with pytest.raises(SettingError):
        [read(values) for read in (read_choices, read_play)]


def test_choices_as_a_column_map():
    """Assert a map of the differences from the file, without what is unknown or no text."""
    choices = read_choices({"column.time": "t", "column.motor_position": "q", "gear_ratio": "101"})
    assert choices.column_map == {
        **dict.fromkeys(SI_UNITS, False),
        "time": {"column": "t"},
        "motor_position": {"column": "q"},
        "gear_ratio": 101.0,
    }
    assert Choices().column_map is None
    assert read_choices({"column.time": "t", "gear_ratio": "1/101"}).gear_ratio == 1.0 / 101.0
    hostile = {"log": "../../etc/passwd", "column.password": "x", "ran": True, 3: "x", "model": 3}
    assert read_choices(hostile) == Choices()
