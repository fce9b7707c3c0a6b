"""All blocks of code in README and documentation run, with the output shown."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from page_blocks import PAGES, blocks, page_name
from run_page import run_page

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
