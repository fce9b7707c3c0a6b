"""The page on blind trials shows what was measured, and results can be put together."""

import json

import pytest
from benchmarks.page_block import block_of, with_block
from benchmarks.trials.families import FAMILIES
from benchmarks.trials.page import (
    BLOCK,
    PAGE,
    RESULTS,
    families,
    render,
    terminal,
)
from benchmarks.trials.realistic import page as realistic
from benchmarks.trials.run import merged, read, text

ABOUT = {
    "command": "python -m benchmarks.trials",
    "date": "2026-01-01",
    "commit": "abc",
    "machine": "a machine",
    "python": "3.11",
    "seconds": 120,
}


def record(family="basic", seed=1000, **changes):
    """The record of a log with one parameter."""
    return {
        "family": family,
        "seed": seed,
        "in_class": FAMILIES[family].in_class,
        "hold": "zero",
        "terms": ["gravity"],
        "truth": {"link_inertia": 2.0},
        "seconds": 2.0,
        "estimates": {"link_inertia": [2.1, 2.05, 2.15, "determined"]},
        "chosen": {"terms": ["gravity"], "hold": "zero"},
    } | changes


RESULT = {
    "runs": [ABOUT],
    "records": [
        record(given={"link_inertia": [2.02, 1.9, 2.1, "determined"]}),
        record("lugre", error="RecordingError: log.csv: a|b", refused=True),
    ],
}


def test_the_page_is_the_results():
    """Assert that the page shows the committed results to the letter."""
    if not RESULTS.exists():
        pytest.skip("nothing was measured yet")
    assert block_of(PAGE.read_text(encoding="utf-8"), BLOCK) == render(read(RESULTS))


def test_the_page_lists_the_families():
    """Assert that the page says of each family what it has, realistic ones too."""
    page = PAGE.read_text(encoding="utf-8")
    assert families() in page
    assert realistic.families() in page


def test_a_wrong_log_is_listed_with_its_numbers():
    """Assert that truth, value, interval and errors of a confidently wrong log are shown."""
    lines = render(RESULT).splitlines()
    assert "|basic|1000|link_inertia|2|2.1|2.05 to 2.15|+5 %|+1 %|" in lines
    assert "|lugre|1000|RecordingError: log.csv: a\\|b|" in lines
    assert any(line.startswith("|basic|1|1|1|0|100.0|") for line in lines)
    assert any(line.startswith("|lugre|1|0|0|1 (1)|0.0|") for line in lines)
    assert any("`python -m benchmarks.trials`, 2026-01-01, commit abc" in line for line in lines)


def test_the_terminal_shows_the_same_scores():
    """Assert that all families stand in the table for the terminal."""
    shown = terminal(RESULT)
    assert "basic" in shown
    assert "lugre" in shown
    assert "\n\n" in shown


def test_a_page_without_marks_is_refused():
    """Assert that tables are never written to a page that has no place for them."""
    with pytest.raises(ValueError, match="trials: begin"):
        with_block("# A page", BLOCK, "|table|")


def test_results_are_put_together():
    """Assert that runs are kept, logs are joined, and the later record of a log counts."""
    again = ABOUT | {"date": "2026-01-02"}
    later = {"runs": [ABOUT, again], "records": [record(seconds=5.0), record("coulomb", 1001)]}
    together = merged([RESULT, later])
    assert together["runs"] == [ABOUT, again]
    assert [(r["family"], r["seed"]) for r in together["records"]] == [
        ("basic", 1000),
        ("coulomb", 1001),
        ("lugre", 1000),
    ]
    assert together["records"][0]["seconds"] == 5.0


def test_the_file_has_a_line_for_each_log():
    """Assert that results survive the file, one line for each log."""
    assert json.loads(text(RESULT)) == RESULT
    assert len(text(RESULT).splitlines()) == 6 + 1
