"""What is done where a fit leads nowhere: another hold, or all data again; on made-up fits."""

from types import SimpleNamespace
from typing import Any

import pytest
from made_joint import made_fit

import flexid.identification.estimation.final_fits as final
import flexid.identification.full_model.fits_by_length as fits_by_length
from flexid.errors import ConvergenceError
from flexid.estimators.channel_timing import INPUT
from flexid.identification.full_model.fits_by_length import best_hold
from flexid.identification.vocabulary.thresholds import THRESHOLDS


def held(hold: str, cost: float, *, converged: bool = True) -> Any:
    """As much of a fit as a choice of the hold needs, without a delay."""
    structure = SimpleNamespace(timing=SimpleNamespace(hold=hold))
    return made_fit(
        cost=cost, structure=structure, names=(), converged=converged, delays={INPUT: 0.0}
    )


@pytest.mark.parametrize(
    ("last_ends", "other_ends", "expected"),
    [(True, True, "linear"), (True, False, "zero"), (False, False, "linear")],
)
def test_a_hold_whose_steps_do_not_end_is_no_rival(monkeypatch, last_ends, other_ends, expected):
    """Assert that the lesser sum of squares counts only where its steps ended, or none's did."""
    other = held("linear", 900.0, converged=other_ends)
    monkeypatch.setattr(
        fits_by_length, "held_otherwise", lambda _, hold: other if hold == "linear" else None
    )
    last = held("zero", 1000.0, converged=last_ends)
    best, _, _ = best_hold(last, ("zero", "linear"), THRESHOLDS)
    assert best.structure.timing.hold == expected


@pytest.fixture
def reported(monkeypatch):
    """Return a function that fits to all data, where the first so many fits fail."""

    def result(failing: int, *, anyhow: bool = True):
        tried = []

        def fit_to(structure, data, start, duration):
            tried.append((start, duration))
            if len(tried) <= failing:
                raise ConvergenceError("prediction error", "nowhere")
            return "fitted", ["shorter", "fitted"]

        def first_fits(asked, data, divisions):
            assert (asked, divisions) == (structure, "divisions")
            return [None, SimpleNamespace(by_name={"theta2": 2.0})]

        monkeypatch.setattr(final, "fit_to", fit_to)
        monkeypatch.setattr(final, "settled", lambda fitted: f"{fitted}, its shapes settled")
        monkeypatch.setattr(final, "lengths", lambda *_: "divisions")
        monkeypatch.setattr(final, "first_fits", first_fits)
        structure = SimpleNamespace(timing=SimpleNamespace(delays={"link_delay": 0.1}))
        before = SimpleNamespace(by_name={"theta2": 1.0})
        choice: Any = SimpleNamespace(structure=structure, fitted=before, duration=3.0)
        whole: Any = "all data"
        return *final._reported(choice, whole, anyhow=anyhow), tried, before

    return result


@pytest.mark.parametrize("failing", [0, 1, 2])
def test_a_fit_to_all_data_begins_where_the_choice_ended(reported, failing):
    """Assert that where it fails the data are fitted from their own starts, as they may show more.

    Where that fails too the choice's values stand, and a sentence says so.
    """
    fitted, lengths_fitted, retreat, tried, before = reported(failing)
    ways = [{"link_delay": 0.1, "theta2": 1.0}, {"theta2": 2.0}]
    assert tried == [(way, 3.0) for way in ways[: failing + 1]]
    if failing == 2:
        assert (fitted, lengths_fitted) == (before, [before])
        assert "before the held-out end" in retreat[0]
    else:
        settled = "fitted, its shapes settled"
        assert (fitted, lengths_fitted, retreat) == (settled, ["shorter", settled], ())


def test_a_fit_that_need_not_stand_is_not_begun_anew(reported):
    """Assert that where a fit with disturbances may stand in its place, one failure is enough."""
    with pytest.raises(ConvergenceError, match="nowhere"):
        reported(1, anyhow=False)
    assert reported(0, anyhow=False)[0] == "fitted, its shapes settled"
