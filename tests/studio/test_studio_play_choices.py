"""What the sliders of Play stand at."""

from __future__ import annotations

from urllib.parse import parse_qsl

import pytest

from flexid.errors import SettingError
from flexid.studies.huang2003.readings import table1_loop
from flexid.studio.play import READINGS, SLIDERS, TABLE1, query_of, read_play


def test_it_begins_at_table_one():
    """Assert that the loop of the first view is the paper's, and the drive ideal."""
    paper = table1_loop((1, 2, 3))
    assert TABLE1.loop.parameters.tolist() == pytest.approx(paper.parameters.tolist())
    assert TABLE1.loop.start_estimates.tolist() == paper.start_estimates.tolist()
    assert TABLE1.sampling is None
    assert read_play({}) == TABLE1
    assert set(READINGS) == {"1,2,3", "1,1,3"}


def test_an_address_says_all():
    """Assert that a run and a pinned one are the same when they come back from their address."""
    chosen = read_play({"reading": "1,1,3", "k": "80", "sampled": "yes", "torque_limit": "500"})
    pinned = read_play({"amplitude": "0.5"})
    found = dict(parse_qsl(query_of(chosen, pinned)))
    assert found["room"] == "play"
    assert read_play(found) == chosen
    assert read_play(found, "pin.") == pinned
    assert chosen.sampling is not None
    assert chosen.sampling.input_limit == 500.0
    assert dict(parse_qsl(query_of(chosen, None)))["pin"] == "none"


@pytest.mark.parametrize("slider", SLIDERS, ids=lambda slider: slider.name)
def test_ends_of_a_slider(slider):
    """Assert that a slider's ends are taken, and nothing beyond them."""
    for value in (slider.lowest, slider.highest):
        assert read_play({slider.name: repr(float(value))}).values[slider.name] == value
    for text in (slider.highest * 1.01, slider.lowest - 0.01 * slider.highest, "nan", "inf", "x"):
        with pytest.raises(SettingError, match=slider.name):
            read_play({slider.name: str(text)})


@pytest.mark.parametrize(
    "values",
    [None, "x", {"reading": "9,9,9"}, {"k": "x" * 1000}, {f"key{i}": "" for i in range(1000)}],
)
def test_what_cannot_be_meant_is_refused(values: object):
    """Assert that an address with other values is answered in a sentence."""
    with pytest.raises(SettingError):
        read_play(values)
