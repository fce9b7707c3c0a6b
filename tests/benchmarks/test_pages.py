"""Benchmarks: smoke runs, stored results on pages, and every reader of files on any file."""

import json
from dataclasses import fields
from math import inf
from pathlib import Path
from random import Random

import pytest
from benchmarks.accuracy_tools import TOOLS
from benchmarks.fuzz import mutated, tried
from benchmarks.fuzz_targets import Targets, made_estimate
from benchmarks.mutations import changes
from benchmarks.page_block import block_of
from benchmarks.rivals import page as rivals
from benchmarks.smoke import JOBS
from benchmarks.thresholds import UNTOUCHED, moved
from benchmarks.trials import page as trials
from benchmarks.trials.realistic import page as realistic

from benchmarks import accuracy_page, coverage_page, mutants_page
from flexid.identification.vocabulary.thresholds import THRESHOLDS

KEPT = json.loads(coverage_page.RESULTS.read_text(encoding="utf-8"))


@pytest.mark.parametrize("made", [accuracy_page, coverage_page, rivals, trials])
def test_the_page_is_the_results(made):
    """Assert that each page shows the stored results exactly, with the current families."""
    kept, page = (path.read_text(encoding="utf-8") for path in (made.RESULTS, made.PAGE))
    assert block_of(page, made.BLOCK) == made.render(json.loads(kept))
    if made is trials:
        assert trials.families() in page
        assert realistic.families() in page


def test_every_interval_means_what_it_says():
    """Assert that 92 to 98 % of at least 400 intervals of each coefficient contain the truth."""
    measured = [cell for cell in KEPT if "contrast" not in cell["estimator"]]
    assert len({cell["noise"] for cell in measured}) == 3
    assert any(cell["estimator"].startswith("online") for cell in measured)
    for cell in measured:
        assert cell["seeds"] >= 400
        for name, held in cell["held"].items():
            share = 100.0 * held / cell["seeds"]
            assert 92.0 <= share <= 98.0, f"{cell['estimator']}, {name}: {share}"


def test_lines_of_code(tmp_path: Path):
    """Assert that only code between the marks counts, and that stored counts are current."""
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


def test_a_log_that_a_rival_fails_on_is_not_left_out():
    """Assert that a rival's failures and missing values are shown with its medians."""
    answered = {"errors": {"link_inertia": -0.25}, "inside": {"link_inertia": False}}
    answered |= {"widest": 0.5, "seconds": 3.0}
    nothing = {"errors": {"link_inertia": inf}, "seconds": 5.0}
    records = [
        {"tool": "mujoco", "family": "basic", "seed": seed, **one}
        for seed, one in enumerate((answered, {"failed": "ValueError: no"}, nothing))
    ]
    run = dict.fromkeys(("command", "date", "commit", "machine", "python"), "2026-01-01")
    block = rivals.render({"runs": [run], "versions": {"mujoco": "1.0"}, "records": records})
    for line in ("0.25, failed, no number", "0/1 ±0.5", "4"):
        assert f"|MuJoCo sysid|{line}|" in block


FOLDER = Path(__file__).parents[2] / "benchmarks"
PARTS = {"batch", "long_log", "fuzz_guided", "smoke"}
"""Programs that a benchmark starts, and the smoke run itself."""
PICTURES = {"studio_pictures"}
"""Programs without a measurement."""


def test_no_benchmark_is_left_out():
    """Assert that each benchmark program has a smoke run."""
    marks = ('if __name__ == "__main__":', "def run(quick: bool)")
    texts = {path.stem: path.read_text("utf-8") for path in FOLDER.glob("[a-z]*.py")}
    single = {name for name, text in texts.items() if any(mark in text for mark in marks)}
    packages = {path.parent.name for path in FOLDER.glob("*/__main__.py")}
    assert {job.module for job in JOBS} == (single | packages) - PARTS - PICTURES


def test_each_threshold_is_halved_and_doubled():
    """Assert that one threshold changes at a time, and that all are changed but the listed ones."""
    names = {field.name for field in fields(THRESHOLDS)} - {*UNTOUCHED}
    found = dict(moved())
    assert set(found) == {f"{name} x {factor}" for name in names for factor in ("0.5", "2")}
    for name, thresholds in found.items():
        own, factor = name.split(" x ")
        other = {f.name: getattr(thresholds, f.name) for f in fields(thresholds)}
        assert other.pop(own) == float(factor) * getattr(THRESHOLDS, own)
        assert all(value == getattr(THRESHOLDS, rest) for rest, value in other.items())


def test_mutants():
    """Assert one change at a time and none of annotations; pages as the results, all judged."""
    source = 'def f(δ: "int" = 2) -> "a | b":\n    return not δ <= 3.0 and f"{1}"\n'
    found = {whole.decode().removesuffix("\n") for *_, whole in changes(source.encode())}
    for before, after in (
        ("= 2", "= (3)"),
        ('not δ <= 3.0 and f"{1}"', "(not δ <= 3.0 or f'{1}')"),
        ("not δ <= 3.0", "(δ <= 3.0)"),
        ("δ <= 3.0", "(δ < 3.0)"),
        ("δ <= 3.0", "(δ >= 3.0)"),
        ("3.0", "(6.0)"),
    ):
        found.remove(source.replace(before, after).removesuffix("\n"))
    assert not found
    results = mutants_page.kept()
    page = mutants_page.PAGE.read_text(encoding="utf-8")
    assert block_of(page, mutants_page.BLOCK) == "\n".join([*mutants_page.table(results), ""])
    assert mutants_page.LIST.read_text(encoding="utf-8") == mutants_page.survivors(results)
    assert "not judged" not in mutants_page.survivors(results)


TEXTS = ("log, text", "column map", "drive file", "experiment file", "model file")
TEXTS += ("estimate", "watch, text")
# Each file takes a process and some time, so the command alone tries more of them.
APART = ("log, Parquet", "log, MATLAB", "log, MATLAB 7.3", "log, HDF5", "log, MDF", "log, MCAP")
APART += ("log, ROS 1 bag", "log, ROS 2 bag", "log, stream", "watch, MCAP", "watch, HDF5")
STRANGE = ("log, Parquet", "log, stream")  # not all of their seeds are valid files


@pytest.fixture(scope="module")
def readers() -> Targets:
    """Return every reader with its seeds."""
    return Targets(made_estimate())


@pytest.mark.parametrize(
    "name", [*TEXTS, *(pytest.param(name, marks=pytest.mark.thorough) for name in APART)]
)
def test_any_mutation(name: str, readers: Targets, tmp_path: Path) -> None:
    """Assert that a valid file is read, and that a mutated one is read or refused in one line."""
    target = readers[name]
    for good in () if name in STRANGE else target.seeds:
        assert tried(target, tmp_path / f"seed{target.suffix}", good) == ""
    for seed in range(60 if name in TEXTS else 4):
        content = mutated(Random(seed), target)
        assert tried(target, tmp_path / f"input{target.suffix}", content) in ("", None), seed
