import json
from pathlib import Path

import pytest
from benchmarks.accuracy_page import (
    BLOCK,
    PAGE,
    RESULTS,
    lines_of_user_code,
    render,
)
from benchmarks.accuracy_tools import TOOLS
from benchmarks.page_block import block_of, with_block

STAMP = {"date": "2000-01-01", "load": 0.1}


def results(runs: list[dict]) -> dict:
    """Results of one tool."""
    entry = {"version": "1.0", "lines": 3, "runs": [STAMP | run for run in runs]}
    return {"machine": "one", "python": "3", "tools": {"numpy": entry}}


def row(block: str, table: str) -> list[str]:
    """Cells of the first line of a table, its title left out."""
    lines = block.partition(f"### {table}\n")[2].splitlines()
    first = next(place for place, line in enumerate(lines) if line.startswith("|---")) + 1
    return [cell.strip() for cell in lines[first].strip("|").split("|")][1:]


RUNS = [
    {
        "case": "a",
        "seed": seed,
        "seconds": seconds,
        "processor": 3.0 * seconds,
        "errors": [error, 0.001],
        "inside": [True, seed < 2],
        "widest": width,
    }
    for seed, (error, seconds, width) in enumerate([(-0.5, 2.0, 1.0), (0.1, 1.0, 3.0), (0.2, 9, 2)])
]


def test_errors_count_without_their_sign():
    """Assert that median and largest are those of the worst coefficient's absolute error."""
    assert row(render(results(RUNS)), "Accuracy") == ["0.2/0.5"]


def test_intervals_of_all_runs_are_counted_together():
    """Assert that the coverage counts every interval and shows the median of the widths."""
    assert row(render(results(RUNS)), "Intervals") == ["5/6 ±2"]


def test_time_is_the_median():
    """Assert that both times are medians over the runs."""
    assert row(render(results(RUNS)), "Time") == ["2/6"]


def test_a_failure_is_counted_and_said():
    """Assert that a run that failed is in the table and its reason below."""
    failed = {"case": "a", "seed": 3, "failed": "SomeError: gave up"}
    block = render(results([*RUNS, failed]))
    assert row(block, "Accuracy") == ["0.2/0.5, 1 of 4 failed"]
    assert "NumPy least squares, a: SomeError: gave up" in block


def test_no_interval_is_a_dash():
    """Assert that a tool without intervals is not counted as one that misses."""
    bare = [{key: run[key] for key in ("case", "seed", "errors")} for run in RUNS]
    assert row(render(results(bare)), "Intervals") == ["–"]


def test_equal_accuracy_is_compared_on_the_same_logs():
    """Assert that only seeds that both tools finished enter the ratio of their times."""
    case = "encoders, noise × 1"
    own = [{**run, "case": case} for run in RUNS]
    other = [{**RUNS[1], "case": case, "seconds": 50.0, "processor": 240.0}]
    found = results(own)
    entry = found["tools"].pop("numpy")
    found["tools"] = {"flexid_10s": entry, "casadi": results(other)["tools"]["numpy"]}
    block = render(found)
    assert "takes 50 times as long" in " ".join(block.split())
    assert "80 times by the processors" in " ".join(block.split())


def test_lines_of_code_leave_out_blank_lines_and_comments(tmp_path: Path):
    """Assert that only code between the marks counts."""
    source = tmp_path / "tool.py"
    source.write_text(
        "import tool\n# user code begins\nx = 1\n\n  # why\ny = 2  # so\n# user code ends\nz = 3\n"
    )
    assert lines_of_user_code(source) == 2


def test_code_without_marks_is_refused(tmp_path: Path):
    """Assert that a file without the marks is an error, not zero lines."""
    source = tmp_path / "tool.py"
    source.write_text("x = 1\n")
    with pytest.raises(ValueError, match="mark"):
        lines_of_user_code(source)


def test_the_block_is_replaced_and_nothing_else():
    """Assert that text around the marks stays, and the block comes back as it was put in."""
    begin, end = "<!-- accuracy: begin -->", "<!-- accuracy: end -->"
    page = with_block(f"before\n{begin}\nold\n{end}\nafter\n", BLOCK, "new\n")
    assert page.startswith("before\n")
    assert page.endswith("after\n")
    assert "old" not in page
    assert block_of(page, BLOCK) == "new\n"


def test_a_page_without_marks_is_refused():
    """Assert that a page without the marks is an error."""
    with pytest.raises(ValueError, match="once each"):
        with_block("nothing", BLOCK, "new")


def test_the_page_shows_the_results_that_are_kept():
    """Assert that docs/comparison.md was made from benchmarks/accuracy.json as it is."""
    kept = json.loads(RESULTS.read_text(encoding="utf-8"))
    assert block_of(PAGE.read_text(encoding="utf-8"), BLOCK) == render(kept)


def test_the_lines_that_are_kept_are_those_of_today():
    """Assert that no user's code was changed after it was run, as far as its length tells."""
    kept = json.loads(RESULTS.read_text(encoding="utf-8"))["tools"]
    assert {key: entry["lines"] for key, entry in kept.items()} == {
        tool.key: lines_of_user_code(tool.source) for tool in TOOLS if tool.key in kept
    }
