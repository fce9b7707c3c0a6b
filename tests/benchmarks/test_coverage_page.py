"""The page on coverage shows what was measured, and nothing else."""

import json

import pytest
from benchmarks.coverage_page import BLOCK, PAGE, RESULTS, merged, render
from benchmarks.page_block import block_of, with_block

NOMINAL = (92.0, 98.0)


def cells():
    """Everything that was measured."""
    return json.loads(RESULTS.read_text(encoding="utf-8"))


def test_the_page_is_the_results():
    """Assert that the tables of the page are those of the committed results, to the letter."""
    assert block_of(PAGE.read_text(encoding="utf-8"), BLOCK) == render(cells())


def test_a_line_of_the_table():
    """Assert that counts become percent and widths are given in normal half-widths."""
    cell = {
        "noise": "none",
        "estimator": "a guess",
        "seeds": 8,
        "held": {"a": 6, "b": 8},
        "half_width_over_rms_error": {"a": 1.96, "b": 3.92},
    }
    lines = render([cell]).splitlines()
    assert lines[0] == "|none|a|b|seeds|width|"
    assert lines[2] == "|a guess|75.0|100.0|8|1.00–2.00|"


def test_a_trial_of_few_seeds_replaces_nothing():
    """Assert that cells give way to those of as many seeds, and new ones are added."""
    old = [{"noise": "white", "estimator": "a", "seeds": 400}]
    few = {"noise": "white", "estimator": "a", "seeds": 2}
    new = {"noise": "white", "estimator": "b", "seeds": 2}
    assert merged(old, [few, new]) == ([*old, new], [few])
    again = {**old[0], "held": {}}
    assert merged(old, [again]) == ([again], [])


def test_a_page_without_marks_is_refused():
    """Assert that tables are never written to a page that has no place for them."""
    with pytest.raises(ValueError, match="coverage: begin"):
        with_block("# A page", BLOCK, "|table|")


def test_every_interval_means_what_it_says():
    """Assert that 92 to 98 % of at least 400 intervals of each coefficient hold the truth."""
    measured = [cell for cell in cells() if "contrast" not in cell["estimator"]]
    assert len({cell["noise"] for cell in measured}) == 3
    assert any(cell["estimator"].startswith("online") for cell in measured)
    for cell in measured:
        assert cell["seeds"] >= 400
        for name, held in cell["held"].items():
            share = 100.0 * held / cell["seeds"]
            assert NOMINAL[0] <= share <= NOMINAL[1], f"{cell['estimator']}, {name}: {share}"
