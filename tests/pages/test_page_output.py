"""Comparison of a page's output with the printed one."""

import pytest
from page_output import agrees


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
