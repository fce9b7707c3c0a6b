"""Fixture that collects the fits which an identification makes, for tests to inspect."""

import pytest

import flexid.identification.estimation.answers as answers
from flexid.identification.estimation.final_fits import FinalFits, final_fits


@pytest.fixture
def fits_seen(monkeypatch: pytest.MonkeyPatch) -> list[FinalFits]:
    """Return a list that collects the final fits of each later identification, in their order."""
    found: list[FinalFits] = []

    def watched(*given, **how):
        found.append(final_fits(*given, **how))
        return found[-1]

    monkeypatch.setattr(answers, "final_fits", watched)
    return found
