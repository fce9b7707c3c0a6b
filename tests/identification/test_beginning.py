"""Choice of the start from which a fit continues, and what follows if every start fails."""

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from made_joint import made_fit

import flexid.identification.estimation.final_fits as final
import flexid.identification.full_model.fits_by_length as fits_by_length
import flexid.identification.full_model.starting as beginning
from flexid.errors import ConvergenceError
from flexid.estimators.channel_timing import INPUT
from flexid.identification.full_model.fits_by_length import FitsByLength, best_hold
from flexid.identification.vocabulary.thresholds import THRESHOLDS

SAMPLES = 320
SHORTEST = 8  # segments


@dataclass(frozen=True)
class _Segments:
    count: int

    def __len__(self) -> int:
        return self.count

    @property
    def lengths(self) -> np.ndarray:
        return np.full(self.count, 20)

    @property
    def mean_duration(self) -> float:
        return 0.4 / self.count


LADDER = [_Segments(SHORTEST), _Segments(4), _Segments(2)]
MARGIN = 0.01  # s


def fitted(segments: _Segments, excess: float, late: float = 0.0) -> SimpleNamespace:
    """Return a stand-in for a fit with residuals, segments and a delay only."""
    structure = SimpleNamespace(timing=SimpleNamespace(sought=("late",)))
    excessive_delays = {"late"} if late > MARGIN else set()
    given = {
        "structure": structure,
        "has_partners": not excessive_delays,
        "excessive_delays": excessive_delays,
    }
    return made_fit(excess, cost=excess * SAMPLES, segments=segments, **given)


@pytest.fixture
def by_length(monkeypatch):
    """Make fits by length have given excesses, or fail; return fits taken and starts tried."""

    def set_up(ends: dict[tuple[str, int], list[float]], late=0.0, *, insist=True):
        tried: list[tuple[str, int]] = []

        def fit_by_length(structure, data, way, lengths_fitted, *, steps, **_):
            skipped = len(lengths_fitted) - len(LADDER)
            tried.append((way["start"], skipped))
            excesses = ends.get(tried[-1])
            if not steps.insist:
                return [fitted(lengths_fitted[0], 99.0)]
            if structure == {"late"}:
                return [fitted(s, 7.0) for s in lengths_fitted]
            if excesses is None:
                raise ConvergenceError("prediction error", "nowhere")
            return [
                fitted(s, e, late if tried[-1] == ("a", 0) else 0.0)
                for s, e in zip(lengths_fitted, excesses, strict=False)
            ]

        ways = [{"start": name} for name in "abcdef"]
        monkeypatch.setattr(beginning, "fit_by_length", fit_by_length)
        monkeypatch.setattr(beginning, "starts", lambda *_: ways)
        # A start without the unknown delay gives the same structure here.
        full: Any = SimpleNamespace(without=lambda gone: gone)
        rest: Any = None, LADDER
        try:
            found = beginning.first_fits(full, *rest, insist=insist)
        except ConvergenceError:
            return None, tried
        return [f.excess for f in found], tried

    return set_up


LED, SHORT = [1.0, 1.0, 1.0], [1.0, 1.0]
STARTS = [("a", 0), ("b", 0), ("c", 0)]
LONGER = [*STARTS, *((start, skipped) for skipped in (-1, -2) for start in "ab")]
WAYS = {
    "a start that leads through all lengths ends the search": (
        {("a", 0): [3.0, 4.0, 9.0]}, [3.0, 4.0, 9.0], STARTS[:1],
    ),
    "one that does not is compared with the next": (
        {("a", 0): [1.0, 9.0], ("b", 0): LED}, LED, STARTS[:2],
    ),
    "two that the same longer segments stop agree, and end it": (
        {("a", 0): SHORT, ("b", 0): [1.0, 1.005]}, SHORT, STARTS[:2],
    ),
    "of starts that disagree the last may be the best": (
        {("a", 0): [3.0, 4.0], ("b", 0): [3.0, 5.0], ("c", 0): [2.0, 2.0]}, [2.0, 2.0], STARTS,
    ),
    "a fit is not better for having come further": (
        {("a", 0): [1.3, 40.0], ("b", 0): [1.2]}, [1.2], STARTS,
    ),
    "nor if it came all the way": (
        {("a", 0): SHORT, ("b", 0): [1.5, 1.5, 1.8]}, SHORT, STARTS,
    ),
    "nor worse": ({("a", 0): [1.2], ("b", 0): [1.2, 1.3]}, [1.2, 1.3], STARTS),
    "a poor start is better than none": ({("c", 0): [3.0, 4.0]}, [3.0, 4.0], STARTS),
    "longer segments help where the shortest show too little": (
        {("b", -1): SHORT}, SHORT, LONGER[:5],
    ),
    "the longest over which any hold will do, too": ({("a", -2): [1.0]}, [1.0], LONGER[:7]),
    "no start that leads anywhere is an error": ({}, None, LONGER),
}  # fmt: skip


@pytest.mark.parametrize(("ends", "taken", "starts"), WAYS.values(), ids=[*WAYS])
def test_what_is_taken(by_length, ends, taken, starts):
    """Assert which fits are taken, and which starts are tried without how many short segments."""
    assert by_length(ends) == (taken, starts)


@pytest.mark.parametrize(
    ("ends", "late", "taken", "tried"),
    [
        # A fit counts only if its delayed channel stays within the data.
        ({("a", 0): LED, ("b", 0): [2.0, 2.0, 2.0]}, 0.02, [2.0, 2.0, 2.0], STARTS[:2]),
        ({("a", 0): LED, ("b", 0): [2.0, 2.0, 2.0]}, 0.009, LED, STARTS[:1]),
        # If every other start fails, starts are tried without the delay, over the same segments.
        ({("a", 0): LED}, 0.02, [7.0, 7.0, 7.0], [*STARTS, ("a", 0)]),
    ],
)
def test_a_delay_that_leads_out_of_the_data_is_no_start(by_length, ends, late, taken, tried):
    """Assert which fit is taken if the delay of one start exceeds the margin of the data."""
    assert by_length(ends, late=late) == (taken, tried)


def test_without_insisting_the_best_is_taken_however_bad(by_length):
    """Assert that without `insist` the first start's fit is taken if all starts fail."""
    found, tried = by_length({}, insist=False)
    assert (found, tried[-1]) == ([99.0], ("a", 0))


def held(hold: str, cost: float, *, converged: bool = True) -> Any:
    """Return a stand-in for a fit with a hold and no delay."""
    structure = SimpleNamespace(timing=SimpleNamespace(hold=hold))
    rest = {"names": (), "scatter": np.empty(0), "delays": {INPUT: 0.0}}
    return made_fit(cost=cost, structure=structure, converged=converged, **rest)


@pytest.mark.parametrize(
    ("last_ends", "other_ends", "expected", "open_yet"),
    [
        (True, True, "linear", ()),
        (True, False, "zero", ()),
        (False, False, "linear", ("zero",)),
        (False, True, "linear", ("zero",)),
    ],
)
def test_a_hold_whose_steps_do_not_end_is_no_rival(
    monkeypatch, last_ends, other_ends, expected, open_yet
):
    """Assert that the smaller sum of squares decides among converged fits, if there are any."""
    other = held("linear", 900.0, converged=other_ends)
    monkeypatch.setattr(
        fits_by_length, "with_other_hold", lambda _, hold: other if hold == "linear" else None
    )
    last = held("zero", 1000.0, converged=last_ends)
    best, _, tied = best_hold(last, ("zero", "linear"), THRESHOLDS)
    assert (best.structure.timing.hold, tied) == (expected, open_yet)


@pytest.mark.parametrize(
    ("failing", "insist", "ends"),
    [(0, False, True), (1, False, False), (1, True, True), (2, True, False)],
)
def test_a_fit_to_all_data_begins_where_the_choice_ended(monkeypatch, failing, insist, ends):
    """Assert the starts in order, the chosen values and the data's own, and settled shapes."""
    tried = []

    def fit_to(structure, data, start, duration):
        tried.append((start, duration))
        if len(tried) <= failing:
            raise ConvergenceError("prediction error", "nowhere")
        return "fitted", ["shorter", "fitted"]

    monkeypatch.setattr(final, "fit_to", fit_to)
    monkeypatch.setattr(final, "settled", lambda fitted: f"{fitted}, its shapes settled")
    monkeypatch.setattr(final, "lengths", lambda *_: "divisions")
    own_start = SimpleNamespace(by_name={"theta2": 2.0})
    monkeypatch.setattr(final, "first_fits", lambda *_: [None, own_start])
    structure = SimpleNamespace(timing=SimpleNamespace(delays={"link_delay": 0.1}))
    before = SimpleNamespace(by_name={"theta2": 1.0})
    choice: Any = SimpleNamespace(structure=structure, fitted=before, duration=3.0)
    whole: Any = "all data"
    settled = "fitted, its shapes settled"
    if ends:
        assert final._reported(choice, whole, insist=insist) == (settled, ["shorter", settled])
    else:
        with pytest.raises(ConvergenceError, match="nowhere"):
            final._reported(choice, whole, insist=insist)
    starts = [{"link_delay": 0.1, "theta2": 1.0}, {"theta2": 2.0}]
    assert tried == [(start, 3.0) for start in starts[: 1 + (insist and failing > 0)]]


@pytest.mark.parametrize("converged", [True, False])
def test_only_a_fit_that_converged_replaces_shorter_ones(monkeypatch, converged):
    """Assert that a hold which explains the log but did not converge is fitted to all lengths."""
    last, best = held("zero", 1.0), held("linear", 0.9, converged=converged)
    monkeypatch.setattr(fits_by_length, "ending_with", lambda *_: ["all lengths"])
    monkeypatch.setattr(fits_by_length, "with_steps_refined", tuple)
    known: Any = best, "", ()
    found = FitsByLength((), (), True, ("zero", "linear")).with_best_hold([last], known)
    assert found.found == ((best,) if converged else ("all lengths",))


@pytest.mark.parametrize(("apart", "lengths"), [(0.9, [3, 1]), (1.1, [3, 3])])
def test_a_known_minimum_is_not_followed_again(monkeypatch, apart, lengths):
    """Assert that a start which leads to known values, within a deviation, is not followed."""
    followed = []

    def fit(segments: _Segments, value: float) -> Any:
        values = {"values": np.array([value]), "unit_deviations": np.ones(1)}
        return made_fit(cost=1.0, segments=segments, **values)

    def fit_by_length(structure, data, start, divisions, *, steps, should_continue):
        found = [fit(divisions[0], start["value"])]
        for segments in divisions[1:]:
            if not should_continue(found[-1]):
                break
            found.append(fit(segments, start["value"]))
        followed.append(len(found))
        return found

    monkeypatch.setattr(beginning, "fit_by_length", fit_by_length)
    starts: Any = iter([{"value": 5.0}, {"value": 5.0 + apart}])
    divisions: Any = LADDER
    rest: Any = None, None, starts, divisions, 1, lambda _: True
    first, second = beginning._fits_from_starts(*rest)
    assert followed == lengths
    assert (second[-1] is first[-1]) == (lengths[1] == 1)
