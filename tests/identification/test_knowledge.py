"""What the user knows against what a made log says."""

from dataclasses import replace

import pytest
from made_joint import COEFFICIENTS, PAPER, data, made

from flexid.identification.estimation.knowledge import contradictions
from flexid.identification.full_model.fitting import fit_to
from flexid.identification.full_model.model import Data
from flexid.identification.vocabulary.thresholds import THRESHOLDS


@pytest.fixture(scope="module")
def log() -> Data:
    """Five seconds of a motor of 0.3 kg m² and a spring of 100 N m/rad."""
    return data(made(31, 5.0))


def said(log: Data, given: dict[str, float], **changed: float) -> tuple[str, ...]:
    """What contradicts the log of what is known exactly."""
    return contradictions(
        given, {}, replace(PAPER, fixed=given), log, replace(THRESHOLDS, **changed)
    )


def test_inertia_twice_the_truth_is_told(log):
    """Assert that a motor inertia that the log contradicts is called one, beside the log's own.

    That one is as uncertain, relatively, as the gain whose inverse it is.
    """
    (sentence,) = said(log, {"beta1": 1.0 / 0.6})
    assert sentence.startswith("motor_inertia is known as 0.6")
    assert "it says 0.3 ±" in sentence
    inertia = float(sentence.partition("±")[2].partition(" by")[0].split(";")[0])
    fit = fit_to(PAPER, log, COEFFICIENTS, 1.0)[0].fit
    gain = fit.deviations[fit.names.index("beta1")]
    assert inertia / 0.3 == pytest.approx(gain / (10 / 3), rel=0.3)


@pytest.mark.parametrize(
    ("given", "named"),
    [
        ({}, []),
        ({"beta1": 10 / 3, "theta2": 100.0}, []),
        ({"beta1": 10 / 3, "theta2": 120.0, "theta1": 4.0}, ["theta1", "theta2"]),
        ({"theta2": 100.8}, []),
        ({"theta2": 101.2}, ["theta2"]),
    ],
)
def test_each_wrong_value_is_told(log, given, named):
    """Assert that what is off by a hundredth is named, however sharp the log, if the limit says."""
    assert sorted(sentence.split()[0] for sentence in said(log, given)) == named
    assert said(log, given, contradiction=1e6) == ()
