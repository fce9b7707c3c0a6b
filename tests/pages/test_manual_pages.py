"""Blocks of README and documentation run with the output shown; files and values exist."""

import re
import shutil
from collections.abc import Callable
from itertools import zip_longest
from pathlib import Path

import pytest
from page_blocks import PAGES, ROOT, blocks, page_name
from page_output import agrees
from run_page import run_page

from flexid.identification.vocabulary.thresholds import THRESHOLDS, table

NEEDED = {"docs/export.md": "gcc"}  # programs used by a page that may be missing

README, *OTHERS = PAGES
EACH = [README, *(pytest.param(page, marks=pytest.mark.thorough) for page in OTHERS)]


@pytest.mark.parametrize("page", EACH, ids=page_name)
def test_page_runs(page: Path, tmp_path: Path) -> None:
    """Assert that the blocks of a page run in order, with the output shown."""
    program = NEEDED.get(page_name(page))
    if program is not None and shutil.which(program) is None:
        pytest.skip(f"{program} is not installed")
    run_page(page_name(page), blocks(page.read_text(encoding="utf-8")), tmp_path)


def test_blocks_that_are_not_run(golden: Callable[[dict[str, str]], None]) -> None:
    """Assert that blocks which are not run are listed."""
    left_out = {
        page_name(page): [one.not_run for one in blocks(page.read_text(encoding="utf-8"))]
        for page in PAGES
    }
    golden({page: "; ".join(filter(None, reasons)) for page, reasons in left_out.items()})


PLACES = (ROOT, ROOT / "src" / "flexid", ROOT / "src" / "flexid" / "derivation")


@pytest.mark.parametrize("page", PAGES, ids=page_name)
def test_files_exist(page):
    """Assert that every file of the repository named on a page exists."""
    text = page.read_text(encoding="utf-8")
    named = set(re.findall(r"`([\w./-]+/[\w.-]*\w\.(?:py|toml|csv|md|json))`", text))
    named = {one for one in named if one.partition("/")[0] in FOLDERS}
    assert [one for one in named if not any((place / one).exists() for place in PLACES)] == []


FOLDERS = {path.name for place in PLACES for path in place.iterdir() if path.is_dir()}


def test_tables_of_pages():
    """Assert a test of each fault, and every threshold with its value."""
    page = (ROOT / "docs" / "reliability.md").read_text(encoding="utf-8")
    rows = [
        line for line in page.partition("## Mutation testing")[0].splitlines() if line[:1] == "|"
    ]
    assert len(rows) > 30
    assert all("`tests/" in row for row in rows if not row.startswith(("|Fault", "|---")))
    page = (ROOT / "docs" / "intervals.md").read_text(encoding="utf-8")
    shown = {}
    for row in re.findall(r"^\|((?:`\w+`(?:, )?)+)\|([\d., ]+)\|", page, re.MULTILINE):
        names, values = re.findall(r"`(\w+)`", row[0]), row[1].split(", ")
        shown |= {name: float(value) for name, value in zip_longest(names, values, fillvalue="nan")}
    assert shown == {name: value for name, value, *_ in table(THRESHOLDS)}


@pytest.mark.parametrize(
    ("shown", "printed", "alike"),
    [
        # Layout, elisions and the digit after the last shown do not matter.
        ("a  b\nc", "a b c", True),
        ("value 5.0000", "value 4.9999969", True),
        ("value 452 [196, 709]", "value 453 [196, 708]", True),
        ("below 2.1e-06 rad", "below 2.0e-06 rad", True),
        ("a\n...\nd", "a b c d", True),
        ("...\nc d\n...", "a b c d e", True),
        ("... b ... b ... b", "b b b", True),
        (" name\n ────\n x", "name\n──────\nx", True),
        ("5 samples", "5 samples", True),
        # Another word, number or sign matters, and a missing one.
        ("value 5.0000", "value 5.0002", False),
        ("a b", "a b c", False),
        ("a\n...\nd", "a b c", False),
        ("a\n...\na", "a", False),
        ("...\nc b\n...", "a b c d", False),
        ("... b ... b ... b", "b a b", False),
        ("5 samples", "6 samples", False),
        ("5.0 m", "5.0 s", False),
        ("value 1.0", "value -1.0", False),
    ],
)
def test_agrees(shown: str, printed: str, alike: bool) -> None:
    """Assert which output agrees with a page."""
    assert agrees(shown, printed) is alike
