"""What the user knows against what a made log says."""

from dataclasses import replace

import numpy as np
import pytest
from made_joint import COEFFICIENTS, made

from flexid.estimators.channel_timing import Timing
from flexid.identification.estimation.knowledge import contradictions, with_prior_knowledge
from flexid.identification.full_model.fitting import fit_to
from flexid.identification.full_model.model import Data, Structure, data_of
from flexid.identification.preparation.joint import flexible
from flexid.identification.preparation.settings import Settings
from flexid.identification.preparation.stated import stated
from flexid.identification.vocabulary.estimate import Estimate
from flexid.identification.vocabulary.thresholds import THRESHOLDS
from flexid.models.flexible_joint import PAPER_TERMS
from flexid.recording.velocities import with_velocities

JOINT = flexible()
ON = {c for term in PAPER_TERMS for c in JOINT.terms[term]}


@pytest.fixture(scope="module")
def data() -> Data:
    """Five seconds of a motor of 0.3 kg m² and a spring of 100 N m/rad."""
    return data_of(JOINT, [with_velocities(made(31, 5.0))], (0,))


def said(data: Data, given: dict[str, float], **changed: float) -> tuple[str, ...]:
    """What contradicts the log of what is known exactly."""
    full = Structure(JOINT, frozenset(JOINT.optional - ON), Timing("cubic"), given)
    return contradictions(given, {}, full, data, replace(THRESHOLDS, **changed))


def test_inertia_twice_the_truth_is_told(data):
    """Assert that a motor inertia that the log contradicts is called one, beside the log's own."""
    (sentence,) = said(data, {"beta1": 1.0 / 0.6})
    assert sentence.startswith("motor_inertia is known as 0.6")
    assert "it says 0.3 ±" in sentence


def test_inertia_is_told_with_the_deviation_of_its_gain(data):
    """Assert that the log's own inertia is as uncertain, relatively, as the gain it is one over."""
    (sentence,) = said(data, {"beta1": 1.0 / 0.6})
    inertia = float(sentence.partition("±")[2].partition(" by")[0].split(";")[0])
    structure = Structure(JOINT, frozenset(JOINT.optional - ON), Timing("cubic"))
    fit = fit_to(structure, data, COEFFICIENTS, 1.0)[0].fit
    gain = fit.standard_deviations[fit.names.index("beta1")]
    assert inertia / 0.3 == pytest.approx(gain / (10 / 3), rel=0.3)


def test_right_knowledge_is_not_doubted(data):
    """Assert that the truth contradicts nothing, nor does knowing nothing."""
    assert said(data, {"beta1": 10 / 3, "theta2": 100.0}) == ()
    assert said(data, {}) == ()


def test_each_wrong_value_is_told(data):
    """Assert that of three known values the two wrong ones are named."""
    found = said(data, {"beta1": 10 / 3, "theta2": 120.0, "theta1": 4.0})
    assert sorted(sentence.split()[0] for sentence in found) == ["theta1", "theta2"]


@pytest.mark.parametrize(("off", "said_so"), [(0.008, False), (0.012, True)])
def test_less_than_a_hundredth_is_no_contradiction(data, off, said_so):
    """Assert that what is known to a per cent passes however sharp the log is."""
    assert bool(said(data, {"theta2": 100.0 * (1.0 + off)})) == said_so


def test_threshold_is_the_one_given(data):
    """Assert that a greater limit lets a contradiction pass."""
    assert said(data, {"theta2": 120.0}, contradiction=1e6) == ()


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


def test_uncertain_knowledge_counts_by_its_weight():
    """Assert that a gain known as well as the log knows it draws the estimate halfway."""
    found, contradicted = joined({"beta1": 3.03}, {"beta1": 0.03})
    assert found.values == pytest.approx([300.0, 3.015])
    assert found.covariance[1, 1] == pytest.approx(0.00045)
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
