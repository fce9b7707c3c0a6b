"""Sentences about a result: no number in them is rounded until it says nothing."""

import pytest

from flexid.identification.alignment import Delay
from flexid.identification.result import ModelError
from flexid.identification.summary import _delay
from flexid.identification.warnings import model_warnings


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
    (warning,) = model_warnings(ModelError(excess, 1.0, 1.0), kind)
    assert f"the residuals {words} sensors' noise" in warning
