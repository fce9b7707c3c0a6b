"""Search for the grip of a hysteresis, on stand-ins for fits."""

import numpy as np
import pytest
from made_joint import WITHOUT, fitted, made, made_fit, over

import flexid.identification.full_model.fits_by_length as fits_by_length
import flexid.identification.full_model.fitting as fitting
from flexid.identification.full_model.fits_by_length import sampled, turning
from flexid.identification.structure import shapes
from flexid.identification.structure.job import _least_gain
from flexid.identification.structure.sought_terms import HYSTERETIC
from flexid.identification.vocabulary.thresholds import THRESHOLDS

SIZE = "alpha_hysteresis"


@pytest.fixture(autouse=True)
def of_short_logs(monkeypatch):
    """Let stand-ins be searched as a whole, as their segments are mere numbers."""
    monkeypatch.setattr(fits_by_length, "sampled", lambda fit: fit)


def test_neighbouring_grips_are_both_followed():
    """Assert that five grips are candidates, from a quarter of the usual one to four times it."""
    whole = fitted(made(1, 10.0))
    grips = HYSTERETIC.candidates(whole.structure, whole.data)
    usual = whole.structure.joint.first["hysteresis_grip"]
    assert grips == pytest.approx(usual * np.array([0.25, 0.5, 1.0, 2.0, 4.0]))
    for grip, lower in zip(grips[1:], grips, strict=False):
        joint = HYSTERETIC.put(whole.structure, grip).joint
        assert grip - lower > shapes._APART * HYSTERETIC.resolution(joint, whole.data)


@pytest.mark.parametrize("reach", [0.9, 1.1])
def test_hysteresis_along_more_than_the_deflection_is_a_spring(reach: float):
    """Assert that a reach is possible below the range of the deflection, and not above."""
    whole = fitted(made(1, 10.0))
    moved = float(np.ptp(whole.structure.joint.deflections(whole.data.samples)))
    values = {SIZE: 0.1, "hysteresis_grip": 1.0 / (reach * moved)}
    fit = made_fit(structure=whole.structure, data=whole.data, by_name=values)
    assert HYSTERETIC.is_possible(fit) == (reach < 1.0)


@pytest.mark.parametrize(
    ("before", "floor", "first", "last", "follows"),
    [
        (9.0, 1.0, made_fit(1.5), made_fit(1.0), True),
        (9.0, 1.0, made_fit(1.5), None, False),  # the motion diverges
        # Hysteresis need not explain the excess of short segments.
        (1.28, 1.0, made_fit(1.12), made_fit(1.12), False),
        (1.28, 1.1, made_fit(1.12), made_fit(1.12), True),
        # A negative size would drive the motion.
        (9.0, 1.0, made_fit(1.0), made_fit(1.0, by_name={SIZE: 0.1}), True),
        (9.0, 1.0, made_fit(1.0), made_fit(1.0, by_name={SIZE: -0.1}), False),
    ],
)
def test_what_explains_enough_is_followed(monkeypatch, before, floor, first, last, follows):
    """Assert that a fit is continued if its first steps reduce the residuals enough."""
    asked = []

    def fit_from(fitted, structure, start=None, *, steps):
        asked.append((steps, start or fitted.by_name, fitted.minimum.point.initial_states))
        return first if fitted is fit else last

    monkeypatch.setattr(fits_by_length, "fit_from", fit_from)
    first = made_fit(first.excess, by_name={"first": 1.0}, states="there")
    fit = made_fit(before, states="here", data="data")
    rest = floor, THRESHOLDS, HYSTERETIC.is_possible
    found = fits_by_length.explained_by(fit, WITHOUT, {"start": 0.0}, *rest)
    assert found is (last if follows else None)
    assert asked[0] == (fits_by_length.EXPLORING, {"start": 0.0}, "here")
    assert not follows or asked[1:] == [(fits_by_length.EXPLORING, {"first": 1.0}, "there")]


def test_the_shortest_segments_that_last_half_a_second_show_what_is_missing():
    """Assert that the shortest fit of at least 0.5 s is taken, or the longest; none with noise."""
    found = [over(16, 1.05), over(8, 2.0), over(4, 5.0), over(2, 9.0)]
    assert turning(found, THRESHOLDS) is found[2]
    assert turning(found[:2], THRESHOLDS) is found[1]
    for away, shows in ((-0.001, False), (0.001, True)):
        fit = over(4, THRESHOLDS.sensor_excess + away)
        assert (turning([fit], THRESHOLDS) is fit) == shows


@pytest.mark.parametrize(
    ("rival", "chosen", "gain"), [(1.09, 1.2, 0.0), (1.09, 1.09, 0.05), (1.11, 1.2, 0.05)]
)
def test_what_explains_need_not_save_more(rival, chosen, gain):
    """Assert that a rival that leaves only noise needs no gain if the chosen fit leaves more."""
    assert _least_gain(rival, chosen, THRESHOLDS) == gain


@pytest.mark.parametrize(("enough", "of"), [(10_000, 1), (1_000, 5)])
def test_a_long_log_is_searched_in_part(monkeypatch: pytest.MonkeyPatch, enough: int, of: int):
    """Assert that a subset of segments has the fit's values, and about the residuals of all."""
    monkeypatch.setattr(fitting, "_ENOUGH", enough)
    whole = fitted(made(1, 10.0))
    some = sampled(whole)
    assert (some is whole) == (of == 1)
    assert len(some.problem.segments) == pytest.approx(len(whole.problem.segments) / of, abs=1)
    assert some.by_name == whole.by_name
    assert some.excess == pytest.approx(whole.excess, rel=0.1)


def test_a_part_is_searched_as_a_whole(monkeypatch: pytest.MonkeyPatch):
    """Assert that a subset is searched without taking a subset of it again."""
    whole, part = made_fit(9.0, states="whole"), made_fit(9.0, states="part")
    parts = {"whole": part, "part": made_fit(9.0, states="part of the part")}
    asked = []

    def fit_from(fit, *_, **__):
        asked.append(fit.minimum.point.initial_states)
        return made_fit(1.0, by_name={})

    monkeypatch.setattr(fits_by_length, "fit_from", fit_from)
    monkeypatch.setattr(
        fits_by_length, "sampled", lambda fit: parts[fit.minimum.point.initial_states]
    )
    rest = 1.0, THRESHOLDS, lambda _: True
    assert fits_by_length.explained_by(whole, WITHOUT, {}, *rest) is not None
    assert asked == ["part", None, "whole", None]
    asked.clear()
    assert fits_by_length.explained_by(whole, WITHOUT, {}, *rest[:2], lambda _: False) is None
    assert asked == ["part", None]
