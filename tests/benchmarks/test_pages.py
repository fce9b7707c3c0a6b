"""The pages show the results that are kept, and results can be put together."""

import json
from math import inf
from pathlib import Path

import pytest
from benchmarks.accuracy_tools import TOOLS
from benchmarks.page_block import block_of, with_block
from benchmarks.rivals import page as rivals
from benchmarks.rivals.__main__ import merged as merged_rivals
from benchmarks.trials import page as trials
from benchmarks.trials import run
from benchmarks.trials.families import FAMILIES
from benchmarks.trials.realistic import page as realistic

from benchmarks import accuracy, accuracy_page, coverage_page

KEPT = json.loads(coverage_page.RESULTS.read_text(encoding="utf-8"))


@pytest.mark.parametrize("made", [accuracy_page, coverage_page, rivals, trials])
def test_the_page_is_the_results(made):
    """Assert that each page was made from the results that are kept, to the letter."""
    kept = json.loads(made.RESULTS.read_text(encoding="utf-8"))
    assert block_of(made.PAGE.read_text(encoding="utf-8"), made.BLOCK) == made.render(kept)


def test_the_block_is_replaced_and_nothing_else():
    """Assert that text around the marks stays, and that a page without them is refused."""
    begin, end = "<!-- accuracy: begin -->", "<!-- accuracy: end -->"
    page = with_block(f"before\n{begin}\nold\n{end}\nafter\n", "accuracy", "new\n")
    assert (page[:7], page[-6:]) == ("before\n", "after\n")
    assert "old" not in page
    assert block_of(page, "accuracy") == "new\n"
    with pytest.raises(ValueError, match="once each"):
        with_block("nothing", "accuracy", "new")


def test_every_interval_means_what_it_says():
    """Assert that 92 to 98 % of at least 400 intervals of each coefficient hold the truth."""
    measured = [cell for cell in KEPT if "contrast" not in cell["estimator"]]
    assert len({cell["noise"] for cell in measured}) == 3
    assert any(cell["estimator"].startswith("online") for cell in measured)
    for cell in measured:
        assert cell["seeds"] >= 400
        for name, held in cell["held"].items():
            share = 100.0 * held / cell["seeds"]
            assert 92.0 <= share <= 98.0, f"{cell['estimator']}, {name}: {share}"


def test_a_trial_of_few_seeds_replaces_nothing():
    """Assert that cells give way to those of as many seeds, and new ones are added."""
    old = [{"noise": "white", "estimator": "a", "seeds": 400}]
    few = {"noise": "white", "estimator": "a", "seeds": 2}
    new = {"noise": "white", "estimator": "b", "seeds": 2}
    assert coverage_page.merged(old, [few, new]) == ([*old, new], [few])
    again = {**old[0], "held": {}}
    assert coverage_page.merged(old, [again]) == ([again], [])


def timed(**runs: list[tuple[str, float]]) -> dict:
    """Results of accuracy by tool; a run is the kind of log and its time."""
    return {
        "tools": {
            tool: {"runs": [{"case": case, "seed": 0, "seconds": time} for case, time in found]}
            for tool, found in runs.items()
        }
    }


def test_new_runs_replace_those_of_the_same_tool_and_log_only():
    """Assert that other logs' runs and other tools are kept, in the order of the page."""
    kept = timed(casadi=[("noise × 1", 3.0)], numpy=[("noise × 1", 1.0), ("example log", 2.0)])
    together = accuracy.merged(kept, timed(numpy=[("noise × 1", 4.0)]))
    runs = {"numpy": [("noise × 1", 4.0), ("example log", 2.0)], "casadi": [("noise × 1", 3.0)]}
    assert together["tools"] == timed(**runs)["tools"]
    assert list(together["tools"]) == ["numpy", "casadi"]


def test_lines_of_code(tmp_path: Path):
    """Assert that only code between the marks counts, and that the page has today's."""
    source = tmp_path / "tool.py"
    source.write_text("a\n# user code begins\nx = 1\n\n  # why\ny = 2  # so\n# user code ends\nz\n")
    assert accuracy_page.lines_of_user_code(source) == 2
    source.write_text("x = 1\n")
    with pytest.raises(ValueError, match="mark"):
        accuracy_page.lines_of_user_code(source)
    kept = json.loads(accuracy_page.RESULTS.read_text(encoding="utf-8"))["tools"]
    assert {key: entry["lines"] for key, entry in kept.items()} == {
        tool.key: accuracy_page.lines_of_user_code(tool.source)
        for tool in TOOLS
        if tool.key in kept
    }


ABOUT = {"command": "this", "date": "2026-01-01", "commit": "abc", "machine": "m", "python": "3.11"}


def trial(family="basic", seed=1000, **changes):
    """The record of a blind trial with one parameter."""
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


TRIALS = {
    "runs": [ABOUT],
    "records": [
        trial(given={"link_inertia": [2.02, 1.9, 2.1, "determined"]}),
        trial("lugre", error="RecordingError: log.csv: a|b", refused=True),
    ],
}


def test_trials_are_put_together():
    """Assert that runs are kept, the later record of a log counts, and the file has it back."""
    later = {"runs": [ABOUT], "records": [trial(seconds=5.0), trial("coulomb", 1001)]}
    together = run.merged([TRIALS, later])
    found = [(r["family"], r["seed"], r["seconds"]) for r in together["records"]]
    assert found == [("basic", 1000, 5.0), ("coulomb", 1001, 2.0), ("lugre", 1000, 2.0)]
    assert json.loads(run.text(together)) == together


def rival(*records: dict) -> dict:
    """Results of one tool on one family."""
    about = {"tool": "mujoco", "family": "basic"}
    found = [about | {"seed": seed} | record for seed, record in enumerate(records)]
    return {"runs": [ABOUT], "versions": {"mujoco": "1.0"}, "records": found}


def test_the_pages_list_all_families():
    """Assert that the families of today stand on the page of trials."""
    page = trials.PAGE.read_text(encoding="utf-8")
    assert trials.families() in page
    assert realistic.families() in page


def test_a_log_that_a_rival_fails_on_is_not_left_out():
    """Assert that medians of a rival stand beside what it has no answer or no number for."""
    answered = {"errors": {"link_inertia": -0.25}, "inside": {"link_inertia": False}}
    answered |= {"widest": 0.5, "seconds": 3.0}
    nothing = {"errors": {"link_inertia": inf}, "seconds": 5.0}
    block = rivals.render(rival(answered, {"failed": "ValueError: no"}, nothing))
    for line in ("0.25, failed, no number", "0/1 ±0.5", "4"):
        assert f"|MuJoCo sysid|{line}|" in block


def test_a_later_record_of_a_rival_counts():
    """Assert that a tool which ran again on a log has its later answer, beside all others."""
    old = rival({"failed": "once"}, {"errors": {"link_inertia": 1.0}, "seconds": 3.0})
    together = merged_rivals(old, rival({"errors": {"link_inertia": 2.0}, "seconds": 3.0}))
    assert [r["errors"]["link_inertia"] for r in together["records"]] == [2.0, 1.0]
    assert len(together["runs"]) == 2
