"""Which grip of a hysteresis is tried, and when: on made-up fits."""

from dataclasses import replace
from typing import Any, cast

import pytest
from made_joint import JOINT, WITHOUT, fitted, made, made_fit, over

import flexid.identification.full_model.fits_by_length as fits_by_length
import flexid.identification.full_model.fitting as fitting
from flexid.identification.full_model.fits_by_length import (
    FitsByLength,
    fit_with_hysteresis,
    sampled,
    turning,
)
from flexid.identification.structure.job import _least_gain
from flexid.identification.vocabulary.thresholds import THRESHOLDS

(GRIP,) = JOINT.grips.values()
JUST, TOO_LITTLE = THRESHOLDS.shape_promise + 0.001, THRESHOLDS.shape_promise - 0.001


@pytest.fixture(autouse=True)
def of_short_logs(monkeypatch):
    """Let made-up fits be searched as a whole: their segments are mere numbers."""
    monkeypatch.setattr(fits_by_length, "sampled", lambda fit: fit)


@pytest.fixture
def tried(monkeypatch):
    """Return a function that says which grips are tried, over that which suits the motion.

    What the first step with each promises is given, and with which of them a few steps hold it.
    """

    def share(way: dict[str, float]) -> float:
        return way[GRIP] / JOINT.first_grip

    def grips(promises: dict[float, float], holding: float | None = None):
        begun = []

        def remembering(before, structure, way, *_):
            assert structure.absent == before.structure.absent - JOINT.remembered
            begun.append(share(way))
            return before if share(way) == holding else None

        monkeypatch.setattr(
            fits_by_length, "promised", lambda *at: promises.get(share(at[-1]), 0.0)
        )
        monkeypatch.setattr(fits_by_length, "explained_by", remembering)
        monkeypatch.setattr(FitsByLength, "longer", lambda *_: [])
        monkeypatch.setattr(FitsByLength, "with_term", lambda by_length, *_: by_length)
        segments = range(4)
        before = made_fit(9.0, segments=segments)
        by_length = FitsByLength((before,), cast(Any, (segments,)), True, ("cubic",), "")
        found = fit_with_hysteresis(by_length, before, lambda _: None)
        assert (found is not None) == (holding in begun)
        return begun

    return grips


def test_the_grip_that_promises_more_is_tried_first(tried):
    """Assert that grips from a quarter of what suits the motion to four times are tried in turn."""
    assert tried({1.0: 0.8, 0.25: 0.5}) == [1.0, 0.25]
    assert tried({1.0: 0.5, 0.25: 0.8}) == [0.25, 1.0]
    assert tried({0.25: 0.3, 0.5: 0.4, 1.0: 0.5, 2.0: 0.6, 4.0: 0.7}) == [4.0, 2.0, 1.0, 0.5, 0.25]


def test_what_holds_its_promise_ends_the_search(tried):
    """Assert that the other one is tried where the first is not followed up, and there alone."""
    assert tried({1.0: 0.8, 0.25: 0.5}, holding=1.0) == [1.0]
    assert tried({1.0: 0.8, 0.25: 0.5}, holding=0.25) == [1.0, 0.25]


def test_what_promises_little_is_not_tried(tried):
    """Assert that below the threshold no step is taken."""
    assert tried({1.0: JUST, 0.25: TOO_LITTLE}) == [1.0]
    assert tried({1.0: TOO_LITTLE, 0.25: TOO_LITTLE}) == []


def test_what_is_promising_goes_on_to_its_end(monkeypatch):
    """Assert that first steps that take away enough are followed by as many as it takes."""
    asked = []

    def led_from(fitted, structure, start=None, *, data=None, insist, iterations=None):
        asked.append((iterations, start or fitted.by_name, fitted.minimum.point.initial_states))
        excess = 1.5 if iterations else 1.0
        return made_fit(excess, by_name={"excess": excess}, states="there")

    monkeypatch.setattr(fits_by_length, "led_from", led_from)
    before = made_fit(9.0, states="here")
    found = fits_by_length.explained_by(before, WITHOUT, {"start": 0.0}, 1.0, THRESHOLDS)
    assert found is not None
    assert found.excess == 1.0
    assert asked == [
        (fits_by_length.FIRST_ITERATIONS, {"start": 0.0}, "here"),
        (None, {"excess": 1.5}, "there"),
    ]


def test_what_diverges_on_its_way_is_given_up(monkeypatch):
    """Assert that first steps that promise much and lead nowhere leave the fit without memory."""

    def led_from(*_, insist, iterations=None, data=None):
        return None if iterations is None else made_fit(1.5)

    monkeypatch.setattr(fits_by_length, "led_from", led_from)
    assert fits_by_length.explained_by(made_fit(9.0), WITHOUT, {}, 1.0, THRESHOLDS) is None


@pytest.mark.parametrize(("floor", "follows"), [(1.0, False), (1.1, True)])
def test_noise_need_not_be_taken_away(monkeypatch, floor, follows):
    """Assert that what short segments leave, too, is none of what memory has to explain."""
    monkeypatch.setattr(fits_by_length, "led_from", lambda *_, **__: made_fit(1.12))
    found = fits_by_length.explained_by(made_fit(1.28), WITHOUT, {}, floor, THRESHOLDS)
    assert (found is not None) == follows


@pytest.mark.parametrize(("short", "floor"), [(1.02, 1.02), (0.97, 1.0), (1.09, 1.09)])
def test_what_is_left_shows_it_beside_all_terms(monkeypatch, short, floor):
    """Assert that memory joins the full model, and what short segments leave counts as noise."""
    asked = []

    def remembering(before, structure, _, noise, *__):
        asked.append((before, structure.absent, noise))
        return before

    monkeypatch.setattr(fits_by_length, "promised", lambda *_: 0.9)
    monkeypatch.setattr(fits_by_length, "explained_by", remembering)
    monkeypatch.setattr(FitsByLength, "longer", lambda *_: [])
    monkeypatch.setattr(FitsByLength, "with_term", lambda by_length, *_: by_length)
    wide = replace(WITHOUT, absent=WITHOUT.absent - {"alpha2"})
    by_length = FitsByLength(
        (over(16, short, wide),), cast(Any, (range(16),)), True, ("cubic",), ""
    )
    leaner = over(4, 5.0)
    assert fit_with_hysteresis(by_length, leaner, lambda _: None) is not None
    assert asked == [(leaner, wide.absent - JOINT.remembered, floor)]


def test_the_shortest_segments_that_last_half_a_second_show_what_is_missing():
    """Assert that shorter ones show it where none lasts as long, and none where all is noise."""
    found = [over(16, 1.05), over(8, 2.0), over(4, 5.0)]
    longer = over(2, 9.0)
    assert turning([*found, longer], THRESHOLDS) is found[2]
    assert turning(found[:2], THRESHOLDS) is found[1]
    assert turning(found[:1], THRESHOLDS) is None


@pytest.mark.parametrize(("away", "shows"), [(-0.001, False), (0.001, True)])
def test_what_may_be_an_error_of_the_noise_shows_nothing(away, shows):
    """Assert that a fit within the threshold counts as noise, and one beyond it does not."""
    fitted = over(4, THRESHOLDS.sensor_excess + away)
    assert (turning([fitted], THRESHOLDS) is fitted) == shows


@pytest.mark.parametrize(("size", "follows"), [(0.1, True), (-0.1, False)])
def test_a_hysteresis_that_drives_is_none(monkeypatch, size, follows):
    """Assert that what comes out negative is not followed up, however much it explains."""
    (name,) = JOINT.grips

    driving = made_fit(1.0, by_name={name: size})
    monkeypatch.setattr(fits_by_length, "led_from", lambda *_, **__: driving)
    found = fits_by_length.explained_by(made_fit(9.0), WITHOUT, {}, 1.0, THRESHOLDS)
    assert (found is not None) == follows


@pytest.mark.parametrize(
    ("rival", "chosen", "gain"), [(1.09, 1.2, 0.0), (1.09, 1.09, 0.05), (1.11, 1.2, 0.05)]
)
def test_what_explains_need_not_save_more(rival, chosen, gain):
    """Assert that a rival which leaves noise alone, as the chosen does not, is better by a hair."""
    assert _least_gain(rival, chosen, THRESHOLDS) == gain


@pytest.mark.parametrize(("enough", "of"), [(10_000, 1), (1_000, 5)])
def test_a_long_log_is_searched_in_part(monkeypatch: pytest.MonkeyPatch, enough: int, of: int):
    """Assert that some of its segments have the fit's values, and nearly the residuals of all."""
    monkeypatch.setattr(fitting, "_ENOUGH", enough)
    whole = fitted(made(1, 10.0))
    some = sampled(whole)
    assert (some is whole) == (of == 1)
    assert len(some.problem.segments) == pytest.approx(len(whole.problem.segments) / of, abs=1)
    assert some.by_name == whole.by_name
    assert some.excess == pytest.approx(whole.excess, rel=0.1)
