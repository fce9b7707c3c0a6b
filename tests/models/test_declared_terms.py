"""Everything that a term of the flexible joint needs beside its regressors."""

from pathlib import Path

import pytest

from flexid.models.flexible_joint import COEFFICIENT_UNITS, SHAPE_TERMS, TERMS, TIES

NOTATION = Path(__file__).parents[2] / "docs" / "commands.md"
EVERY = TERMS | SHAPE_TERMS


@pytest.mark.parametrize("name", EVERY)
def test_a_term_has_units(name: str) -> None:
    """Assert that every coefficient of a term has a unit, and that it says what it is."""
    term = EVERY[name]
    assert {*term.link, *term.motor} <= COEFFICIENT_UNITS.keys()
    assert term.description


@pytest.mark.parametrize("name", EVERY)
def test_a_term_of_the_spring_is_tied(name: str) -> None:
    """Assert that a term that acts on both sides has one unknown of each pair."""
    term = EVERY[name]
    if term.link and term.motor:
        assert term.link.keys() <= TIES.keys()


@pytest.mark.parametrize("name", EVERY)
def test_a_term_is_in_the_notation(name: str) -> None:
    """Assert that the page on notation declares the term's coefficients."""
    declared = NOTATION.read_text(encoding="utf-8")
    assert [c for c in {*EVERY[name].link, *EVERY[name].motor} if f"`{c}`" not in declared] == []
