"""Every kind of exported estimator, written once."""

from pathlib import Path

import pytest
from drive import DRIVES

import flexid


@pytest.fixture(scope="session")
def drives(tmp_path_factory) -> dict[str, Path]:
    """Directories by kind."""
    folder = tmp_path_factory.mktemp("drives")
    for number, options in enumerate(DRIVES.values()):
        flexid.export("flexible-joint", to="c99", out=folder / str(number), **options)
    return {name: folder / str(number) for number, name in enumerate(DRIVES)}
