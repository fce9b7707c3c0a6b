"""What a page has inside it."""

import hashlib

import pytest

from flexid.report.page.assets import plotting_script, plotting_style


@pytest.mark.parametrize(
    ("text", "digest"),
    [
        (plotting_script, "2d27e8ad3d228164525ce213f9dc716f39b4e3aee0cc773fb3491c96cf4921a2"),
        (plotting_style, "df630c6a8d6f8eeaff264b50f73ce5b114f646ffd9a0bb74f049b0a00135fa04"),
    ],
    ids=["script", "style"],
)
def test_uplot_is_what_its_authors_published(text, digest):
    """Assert that uPlot has the bytes of uplot@1.6.31, dist/uPlot.iife.min.js and uPlot.min.css."""
    assert hashlib.sha256(text().encode()).hexdigest() == digest
