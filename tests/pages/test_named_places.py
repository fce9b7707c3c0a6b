"""Files, tests and thresholds named on pages exist, with the values given."""

import re
from itertools import zip_longest

import pytest
from page_blocks import PAGES, ROOT, page_name

from flexid.identification.vocabulary.thresholds import THRESHOLDS, table

PLACES = (ROOT, ROOT / "src" / "flexid", ROOT / "src" / "flexid" / "derivation")


@pytest.mark.parametrize("page", PAGES, ids=page_name)
def test_files_exist(page):
    """Assert that every file of the repository named on a page exists."""
    text = page.read_text(encoding="utf-8")
    named = set(re.findall(r"`([\w./-]+/[\w.-]*\w\.(?:py|toml|csv|md|json))`", text))
    named = {one for one in named if one.partition("/")[0] in FOLDERS}
    assert [one for one in named if not any((place / one).exists() for place in PLACES)] == []


FOLDERS = {path.name for place in PLACES for path in place.iterdir() if path.is_dir()}


def test_every_fault_has_a_test():
    """Assert that each row of the tables of faults has a test."""
    page = (ROOT / "docs" / "reliability.md").read_text(encoding="utf-8")
    rows = [
        line for line in page.partition("## Mutation testing")[0].splitlines() if line[:1] == "|"
    ]
    assert len(rows) > 30
    assert all("`tests/" in row for row in rows if not row.startswith(("|Fault", "|---")))


def test_thresholds_are_those_of_the_table():
    """Assert that the page has every threshold with its value."""
    page = (ROOT / "docs" / "intervals.md").read_text(encoding="utf-8")
    shown = {}
    for row in re.findall(r"^\|((?:`\w+`(?:, )?)+)\|([\d., ]+)\|", page, re.MULTILINE):
        names, values = re.findall(r"`(\w+)`", row[0]), row[1].split(", ")
        shown |= {name: float(value) for name, value in zip_longest(names, values, fillvalue="nan")}
    assert shown == {name: value for name, value, *_ in table(THRESHOLDS)}
