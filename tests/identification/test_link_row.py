"""The link's row alone beside the fit of both rows, on made logs whose motor has more, or not."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from made_joint import COEFFICIENTS, log, made

from flexid.identification.estimation.link_row import taken
from flexid.identification.identify import identify
from flexid.identification.preparation.settings import Settings
from flexid.identification.result.identification import Identification
from flexid.identification.vocabulary.estimate import Estimate
from flexid.identification.vocabulary.thresholds import THRESHOLDS
from flexid.models.flexible_joint import PAPER_TERMS

LINK = ("theta1", "theta2")

BOTH = Estimate(
    ("theta2", "beta1", "input_delay"),
    np.array([100.0, 3.0, 0.0]),
    np.array([[4.0, 1.0, 0.0], [1.0, 2.0, 0.0], [0.0, 0.0, np.inf]]),
    (9.0, 8.0, 0.0),
)


PLAIN = replace(THRESHOLDS, row_doubt=1.0, contradiction=3.0)


def alone(std: float, value: float = 103.0) -> Estimate:
    """The row's own estimate; its damping is tied in that of both rows."""
    return Estimate(
        ("theta2", "theta_damping"), np.array([value, 0.1]), np.diag([std**2, 1.0]), (50.0, 50.0)
    )


def test_the_rest_is_what_it_is_given_the_link():
    """Assert that values and covariance follow Gauss: the marginal is replaced, no more."""
    found = taken(BOTH, alone(0.5), PLAIN)
    assert found is not None
    assert found.names == BOTH.names
    assert found.values == pytest.approx([103.0, 3.0 + 3.0 / 4.0, 0.0])
    left = 2.0 - 1.0 / 4.0  # of the variance of beta1 once theta2 is known
    expected = [[0.25, 0.25 / 4.0, 0.0], [0.25 / 4.0, left + 0.25 / 16.0, 0.0], [0.0, 0.0, np.inf]]
    assert found.covariance == pytest.approx(np.array(expected))
    assert found.degrees_of_freedom == (50.0, 8.0, 0.0)


@pytest.mark.parametrize(
    ("doubt", "factor"),
    [
        (1.0, 1.0),
        (1.01, 1.01),
        (1.3, np.sqrt(2.0 / (2.0 - 0.25 + 0.25 / 16.0))),  # no more than before
    ],
)
def test_the_rest_is_doubted_more_but_no_more_than_before(doubt, factor):
    """Assert that the others' deviations are scaled, up to what they were, and nothing else is."""
    plain, found = (
        taken(BOTH, alone(0.5), PLAIN),
        taken(BOTH, alone(0.5), replace(PLAIN, row_doubt=doubt)),
    )
    assert plain is not None
    assert found is not None
    assert found.deviations[0] == plain.deviations[0]
    assert found.deviations[1] == pytest.approx(factor * plain.deviations[1])
    assert found.covariance[0, 1] == pytest.approx(factor * plain.covariance[0, 1])
    assert found.values == pytest.approx(plain.values)


@pytest.mark.parametrize(("std", "better"), [(2.25, True), (2.26, False), (np.inf, False)])
def test_only_what_is_known_better_is_taken(std, better):
    """Assert that the row's own values count where their intervals are shorter: both sides.

    2 x 2.262 of nine degrees of freedom is 2.252 x 2.009 of fifty.
    """
    assert (taken(BOTH, alone(std), PLAIN) is not None) == better


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_row_that_contradicts_both_is_not_taken(side):
    """Assert that three deviations of the difference apart is as far as a row may be.

    Both rows have a deviation of 2, the row alone one of 1.5: together 2.5.
    """
    assert taken(BOTH, alone(1.5, 100.0 + side * 7.4), PLAIN) is not None
    assert taken(BOTH, alone(1.5, 100.0 + side * 7.6), PLAIN) is None


def test_all_of_it_has_to_be_known_better():
    """Assert that one value known worse is enough to leave all of them."""
    worse = replace(alone(0.5), names=("theta2", "beta1"))
    assert taken(BOTH, worse, PLAIN) is not None
    assert taken(BOTH, replace(worse, covariance=np.diag([0.25, 2.7])), PLAIN) is None


def test_the_rest_has_no_more_degrees_of_freedom_than_the_row():
    """Assert that what rests on a variance of few degrees of freedom has no more."""
    few = replace(alone(0.5), degrees_of_freedom=(3.0, 50.0))
    found = taken(BOTH, few, PLAIN)
    assert found is not None
    assert found.degrees_of_freedom == (3.0, 3.0, 0.0)


def test_nothing_in_common_is_nothing_to_take():
    """Assert that an estimate stays where every coefficient of the link was given."""
    assert taken(BOTH, replace(alone(0.5), names=("theta1", "theta_damping")), PLAIN) is None


def test_what_is_left_free_by_both_rows_is_not_touched():
    """Assert that an infinite variance of the link's is no reason to take the row alone."""
    free = BOTH.without_knowledge_of({"theta2"})
    assert taken(free, alone(0.5), PLAIN) is None


@cache
def identified(terms: tuple[str, ...] = PAPER_TERMS, **more: Any) -> Identification:
    """Ten seconds of a drive that has more than the terms."""
    return identify([log(made(1, **more))], Settings(terms=terms))


def test_a_fault_of_the_motor_does_not_reach_the_link():
    """Assert that friction that the model lacks leaves the link's coefficients right and sharp."""
    result = identified(motor_coulomb_up=2.0, motor_coulomb_down=2.0)
    row = result.link_row
    assert row is not None
    assert row.taken
    for name in LINK:
        true, found = COEFFICIENTS[name], result.coefficients[name]
        assert found.value == pytest.approx(true, rel=2e-4)
        assert found.interval == pytest.approx(row.alone[name][1:])
        assert found.interval[0] <= true <= found.interval[1]
        lower, upper = row.together[name][1:]
        assert upper - lower > 20.0 * (found.interval[1] - found.interval[0])
        assert lower <= true <= upper
    assert any("knows theta1, theta2 better" in warning for warning in result.warnings)


def test_a_fault_of_the_spring_is_in_its_row_too():
    """Assert that both rows are reported where the row alone is no better."""
    result = identified(half_gap=2e-3)
    row = result.link_row
    assert row is not None
    assert not row.taken
    assert row.excess > 2.0
    for name in LINK:
        assert result.coefficients[name].interval == pytest.approx(row.together[name][1:])
    assert not any("better" in warning for warning in result.warnings)


def test_what_a_stand_in_may_bend_is_doubted_in_the_row_too():
    """Assert that the row alone is no surer than a cubic spring in place of a gap allows."""
    friction = {"motor_coulomb_up": 2.0, "motor_coulomb_down": 2.0}
    row = identified((*PAPER_TERMS, "cubic_stiffness"), half_gap=2e-3, **friction).link_row
    assert row is not None
    assert row.taken
    value, lower, upper = row.alone["theta2"]
    assert value < 99.3  # bent
    assert upper > 99.9  # what its residuals alone allow ends at 99.7
    assert lower < 98.4


def test_what_may_hide_is_doubted_in_the_row_too(monkeypatch):
    """Assert that terms that the link may have widen its row's intervals as those of both rows."""
    hidden = "flexid.identification.estimation.link_row.hidden_covariance"
    monkeypatch.setattr(hidden, lambda *_: np.diag([0.01, 4.0]))
    friction = made(1, motor_coulomb_up=2.0, motor_coulomb_down=2.0)
    row = identify([log(friction)], Settings(terms=PAPER_TERMS)).link_row
    assert row is not None
    for name, std in zip(LINK, (0.1, 2.0), strict=True):
        _, lower, upper = row.alone[name]
        assert 0.5 * (upper - lower) > 1.9 * std


def test_a_right_model_needs_no_row_alone():
    """Assert that nothing is asked of the row where no model error shows."""
    assert identified().link_row is None


def test_a_spring_with_memory_has_no_row_alone():
    """Assert that the row alone, which knows no hysteresis, is left out where there is some."""
    terms = (*PAPER_TERMS, "spring_hysteresis")
    result = identified(
        terms,
        hysteresis_torque=0.5,
        hysteresis_reach=0.03,
        saturation=0.05,
        peak_torque=30.0,
    )
    assert "spring_hysteresis" in result.choices.terms
    assert result.model_error.share > 0.0
    assert result.link_row is None


@pytest.mark.parametrize(("given", "least", "most"), [(100.0, 0.0, 1.1), (101.0, 10.0, np.inf)])
def test_what_is_given_of_the_link_stays_given(given, least, most):
    """Assert that a known coefficient is known in the row alone, too, be it right or wrong."""
    settings = Settings(terms=PAPER_TERMS, known={"theta2": given})
    friction = made(1, motor_coulomb_up=2.0, motor_coulomb_down=2.0)
    row = identify([log(friction)], settings).link_row
    assert row is not None
    assert list(row.alone) == ["theta1"]
    assert least < row.excess < most
