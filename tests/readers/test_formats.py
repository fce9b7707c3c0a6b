"""The registry of formats, from which all lists of formats derive."""

from importlib import import_module
from pathlib import Path

import pytest

from flexid.readers.formats import FORMATS, Format, format_of, kinds, looks_like, suffixes

PAGE = Path(__file__).parents[2] / "docs" / "logs.md"


@pytest.mark.parametrize("one", FORMATS, ids=lambda one: one.name)
def test_a_format(one: Format):
    """Assert that a format has a function, its own suffixes, and a row in the docs."""
    assert callable(import_module(one.module).read)
    for suffix in one.suffixes:
        assert format_of(Path(f"log{suffix.upper()}")) == one
        assert sum(suffix in other.suffixes for other in FORMATS) == 1
        assert f"`{suffix}`" in PAGE.read_text(encoding="utf-8").partition("\n## Other formats")[2]
    assert one.name in kinds()
    assert {*one.suffixes} <= {*suffixes()}
    assert all(looks_like(magic + b"more") == one for magic in one.magic)


def test_what_is_no_format(tmp_path: Path):
    """Assert that other files are text, and that a folder has the format of the bags in it."""
    assert format_of(Path("log.csv")) is None
    assert looks_like(b"time,motor_position\n") is None
    assert format_of(tmp_path) is None
    (tmp_path / "a.db3").write_bytes(b"")
    found = format_of(tmp_path)
    assert found is not None
    assert found.name == "ROS 2 bag"
