"""Sentences about a result: no number in them is rounded until it says nothing."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from flexid.identification.judgement.estimates import widest
from flexid.identification.preparation.alignment import Delay
from flexid.identification.result.summary import _delay
from flexid.identification.result.warnings import model_warnings
from flexid.identification.vocabulary.evidence import CoefficientEstimate, ModelError


@pytest.mark.parametrize(
    ("value", "ends", "text"),
    [
        (2.0001e-3, (1.9998e-3, 2.0004e-3), "link 2.0001 [1.9998, 2.0004] ms late"),
        (-3.766e-3, (-32.2e-3, 24.7e-3), "link -3.77 [-32.2, 24.7] ms late"),
        (1e-3, (1e-3, 1e-3), "link 1 [1, 1] ms late"),
    ],
)
def test_the_ends_of_a_delay_differ_as_printed(value, ends, text):
    """Assert that as many digits are shown as it takes."""
    assert _delay("link", Delay(value, 0.0, ends, "found")) == text


@pytest.mark.parametrize(
    ("excess", "words"), [(0.004, "are slightly above the"), (2.0, "are 1.73 times the")]
)
@pytest.mark.parametrize("kind", ["flexible", "link"])
def test_residuals_are_never_one_times_the_noise(excess, words, kind):
    """Assert that a small excess is said in words."""
    (warning,) = model_warnings(ModelError(excess, 1.0, 1.0), kind, 0.1)
    assert f"the residuals {words} sensors' noise" in warning


@pytest.mark.parametrize("kind", ["flexible", "link", "rigid"])
@pytest.mark.parametrize(
    ("excess", "widest", "said"),
    [(0.09, 0.009, False), (0.11, 0.009, True), (0.09, 0.011, True), (0.09, np.inf, True)],
)
def test_a_model_error_that_changes_no_number_is_no_alarm(excess, widest, said, kind):
    """Assert that one is said that is larger than the noise is known, or widens an interval."""
    assert bool(list(model_warnings(ModelError(excess, 1.0, 1.0), kind, widest))) == said


@pytest.mark.parametrize("taken", [False, True])
def test_where_a_number_comes_from_is_always_said(taken):
    """Assert that an error too small for an alarm does not hide that the link's row was taken."""
    row = cast(Any, SimpleNamespace(taken=taken, alone=("theta2",)))
    said = list(model_warnings(ModelError(0.09, 1.0, 1.0), "flexible", 0.009, row))
    assert [("taken from it" in sentence) for sentence in said] == [True] * taken


def test_the_widest_interval_counts_by_what_it_means():
    """Assert that what was given has none, and one about zero counts by what it does to its row."""
    found = {
        "theta2": estimate("theta2", 100.0, 1.0),
        "beta1": estimate("beta1", 3.0, 0.0),
        "alpha_offset": estimate("alpha_offset", 0.0, 2.0),
    }
    assert widest(found, {"theta2": 0.5, "alpha_offset": 0.003}) == pytest.approx(0.01)
    assert widest(found, {"alpha_offset": 0.02}) == pytest.approx(0.04)
    assert widest(found, {}) == np.inf
    assert widest({}, {}) == 0.0


def estimate(name: str, value: float, half: float) -> CoefficientEstimate:
    """A coefficient with its interval."""
    ends = (value - half, value + half)
    return CoefficientEstimate(name, "", value, 0.5 * half, ends, "determined", "")
