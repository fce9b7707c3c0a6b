"""The comparison of what a page shows with what was printed."""

import pytest
from page_output import agrees


@pytest.mark.parametrize(
    ("shown", "printed"),
    [
        ("a  b\nc", "a b c"),
        ("value 5.0000", "value 4.9999969"),
        ("value 452 [196, 709]", "value 453 [196, 708]"),
        ("below 2.1e-06 rad", "below 2.0e-06 rad"),
        ("a\n...\nd", "a b c d"),
        ("...\nc d\n...", "a b c d e"),
        (" name\n ────\n x", "name\n──────\nx"),
        ("5 samples", "5 samples"),
    ],
)
def test_agrees(shown: str, printed: str) -> None:
    """Assert that layout, elisions and the digit after the last shown make no difference."""
    assert agrees(shown, printed)


@pytest.mark.parametrize(
    ("shown", "printed"),
    [
        ("value 5.0000", "value 5.0002"),
        ("a b", "a b c"),
        ("a\n...\nd", "a b c"),
        ("a\n...\na", "a"),
        ("...\nc b\n...", "a b c d"),
        ("5 samples", "6 samples"),
        ("5.0 m", "5.0 s"),
        ("value 1.0", "value -1.0"),
    ],
)
def test_differs(shown: str, printed: str) -> None:
    """Assert that another word, number or sign is noticed, and so is something that is missing."""
    assert not agrees(shown, printed)
