"""Every block of code in README and documentation runs, and prints what the page shows."""

import shutil
from pathlib import Path

import pytest
from page_blocks import PAGES, blocks, indented_code, page_name
from run_page import run_page

# Blocks that are not run, of which each says why: how many a page may have.
NOT_RUN = {
    "README.md": 4,
    "CONTRIBUTING.md": 1,
    "docs/architecture.md": 2,
    "docs/arms.md": 3,
    "docs/decisions/torque-balance.md": 1,
    "docs/decisions/derivatives.md": 1,
    "docs/campaigns.md": 1,
    "docs/compare.md": 1,
    "docs/comparison.md": 2,
    "docs/coverage.md": 1,
    "docs/decisions/full-model.md": 1,
    "docs/decisions/gap.md": 1,
    "docs/decisions/integration-error.md": 1,
    "docs/decisions/presliding.md": 1,
    "docs/decisions/sought-shapes.md": 1,
    "docs/decisions/disturbances.md": 1,
    "docs/decisions/thresholds.md": 1,
    "docs/design.md": 2,
    "docs/drifting.md": 1,
    "docs/drive.md": 2,
    "docs/estimators.md": 2,
    "docs/online.md": 1,
    "docs/performance.md": 1,
    "docs/real-logs/dfki-pendulum.md": 3,
    "docs/real-logs/ist-arm.md": 3,
    "docs/real-logs/kuka.md": 3,
    "docs/real-logs/other-rigs.md": 4,
    "docs/report.md": 1,
    "docs/reproduction.md": 1,
    "docs/studio.md": 1,
    "docs/trials.md": 1,
    "docs/watch.md": 1,
}


NEEDED = {"docs/drive.md": "gcc"}
"""What a page calls that a machine may not have."""


@pytest.mark.parametrize("page", PAGES, ids=page_name)
def test_page_runs(page: Path, tmp_path: Path) -> None:
    """Assert that the blocks of a page run in their order and print what it shows."""
    program = NEEDED.get(page_name(page))
    if program is not None and shutil.which(program) is None:
        pytest.skip(f"{program} is not installed")
    run_page(page_name(page), blocks(page.read_text(encoding="utf-8")), tmp_path)


def test_blocks_that_are_not_run_are_counted() -> None:
    """Assert that no block is left out without being noticed."""
    left_out = {
        page_name(page): sum(
            block.not_run is not None for block in blocks(page.read_text(encoding="utf-8"))
        )
        for page in PAGES
    }
    assert {page: count for page, count in left_out.items() if count} == NOT_RUN


@pytest.mark.parametrize("page", PAGES, ids=page_name)
def test_code_is_fenced(page: Path) -> None:
    """Assert that no code hides from these tests by being indented."""
    assert indented_code(page.read_text(encoding="utf-8")) == []
