"""What the user knows against what a made log says."""

from dataclasses import replace

import numpy as np
import pytest
from made_joint import COEFFICIENTS, JOINT, PAPER, data, made

from flexid.identification.estimation.knowledge import contradictions, with_prior_knowledge
from flexid.identification.full_model.fitting import fit_to
from flexid.identification.full_model.model import Data
from flexid.identification.preparation.settings import Settings
from flexid.identification.preparation.stated import stated
from flexid.identification.vocabulary.estimate import Estimate
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


def test_right_knowledge_is_not_doubted(log):
    """Assert that the truth contradicts nothing, nor does knowing nothing."""
    assert said(log, {"beta1": 10 / 3, "theta2": 100.0}) == ()
    assert said(log, {}) == ()


def test_each_wrong_value_is_told(log):
    """Assert that of three known values the two wrong ones are named."""
    found = said(log, {"beta1": 10 / 3, "theta2": 120.0, "theta1": 4.0})
    assert sorted(sentence.split()[0] for sentence in found) == ["theta1", "theta2"]


@pytest.mark.parametrize(("off", "said_so"), [(0.008, False), (0.012, True)])
def test_less_than_a_hundredth_is_no_contradiction(log, off, said_so):
    """Assert that what is known to a per cent passes however sharp the log is."""
    assert bool(said(log, {"theta2": 100.0 * (1.0 + off)})) == said_so


def test_threshold_is_the_one_given(log):
    """Assert that a greater limit lets a contradiction pass."""
    assert said(log, {"theta2": 120.0}, contradiction=1e6) == ()


ESTIMATE = Estimate(
    ("alpha1", "beta1"), np.array([300.0, 3.0]), np.diag([9.0, 0.0009]), (np.inf, np.inf)
)


def joined(known: dict[str, float], deviations: dict[str, float], limit: float = 3.0):
    """Join what is known uncertainly to a stiffness of 100 N m/rad and an inertia of 1/3 kg m²."""
    settings = Settings(known=known, known_deviations=deviations)
    thresholds = replace(THRESHOLDS, contradiction=limit)
    found = with_prior_knowledge(
        JOINT, ESTIMATE, {}, stated(settings, JOINT, "N m"), "N m", thresholds
    )
    return found.estimate, found.against


def test_exact_knowledge_is_no_measurement():
    """Assert that what is known exactly, and fixed, changes no estimate of the rest."""
    found, contradicted = joined({"theta2": 5.0}, {"theta2": 0.0})
    assert found is ESTIMATE
    assert contradicted == ()


def test_inertia_is_known_as_a_parameter():
    """Assert that a motor inertia known well fixes the gain."""
    found, _ = joined({"motor_inertia": 0.335}, {"motor_inertia": 1e-6})
    assert found.values[1] == pytest.approx(1.0 / 0.335, rel=1e-5)


@pytest.mark.parametrize(("limit", "said_so"), [(3.0, True), (12.0, False)])
def test_contradicting_knowledge_spans_both(limit, said_so):
    """Assert that beyond the limit the estimate reaches from the joined value back to the log's.

    3.3 known and 3 from the log, each ± 0.03, are seven of their common deviations apart, and
    0.15 from what joins them.
    """
    found, contradicted = joined({"beta1": 3.3}, {"beta1": 0.03}, limit)
    assert bool(contradicted) == said_so
    variance = 0.00045 + (0.15**2 if said_so else 0.0)
    assert found.covariance[1, 1] == pytest.approx(variance, rel=1e-6)
