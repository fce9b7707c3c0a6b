"""Fixtures that several test packages share."""

from __future__ import annotations

from pathlib import Path

import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the one flag that rewrites the golden files."""
    parser.addoption("--update-golden", action="store_true", help="rewrite the golden files")


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Return the folder of real logs, no part of the project; skip where it is absent."""
    folder = Path(__file__).parents[2] / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"the real logs are not here: no folder {folder.name} beside the repository")
    return folder


@pytest.fixture(scope="session")
def examples() -> Path:
    """Return the folder of the example logs and column maps."""
    return Path(__file__).parents[1] / "examples"
