"""Tones that begin and end at rest, and the criteria E and D against their definitions."""

import numpy as np
import pytest

from flexid.experiment_design.optimise import deviation, smooth_cost, waveform

TONES = waveform(duration=5.0, sample_time=1e-3, ramp=0.5, highest_frequency=30.0, harmonics=6)
WEIGHTS = np.random.default_rng(1).standard_normal(12)


def test_begins_and_ends_at_rest():
    """Assert that signal and rate vanish at both ends, and do not in between."""
    for values in (TONES.signal(WEIGHTS), TONES.rate(WEIGHTS)):
        assert np.abs(values[[0, -1]]).max() < 1e-12 * np.abs(values).max()


def test_rate_is_the_derivative():
    """Assert that the rate is the derivative of the signal, ramps included."""
    slope = np.gradient(TONES.signal(WEIGHTS), TONES.time, edge_order=2)
    assert np.abs(slope - TONES.rate(WEIGHTS)).max() < 1e-3 * np.abs(slope).max()


def test_tones_are_whole_periods():
    """Assert that all tones differ, fit the experiment and reach the highest frequency asked."""
    periods = TONES.angular_frequencies * 5.0 / (2 * np.pi)
    np.testing.assert_allclose(periods, np.rint(periods), atol=1e-9)
    assert len(np.unique(np.rint(periods))) == 6
    assert TONES.angular_frequencies[-1] == pytest.approx(30.0, abs=2 * np.pi / 5.0)


INFORMATION = np.diag([4.0, 100.0, 1e4])


def test_e_is_the_worst_direction():
    """Assert that E is one over the root of the smallest eigenvalue, in any orientation."""
    turn, _ = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))
    assert deviation(turn @ INFORMATION @ turn.T, "E") == pytest.approx(0.5)


def test_d_is_the_geometric_mean():
    """Assert that D is the geometric mean of the axes of the confidence ellipsoid."""
    assert deviation(INFORMATION, "D") == pytest.approx((0.5 * 0.1 * 0.01) ** (1 / 3))


@pytest.mark.parametrize("criterion", ["E", "D"])
def test_nothing_known_is_infinite_but_searchable(criterion):
    """Assert that a singular matrix determines nothing, and that the search still sees a number."""
    singular = np.diag([1.0, 0.0])
    assert np.isinf(deviation(singular, criterion))
    assert np.isfinite(smooth_cost(singular, criterion))


@pytest.mark.parametrize("criterion", ["E", "D"])
def test_search_sees_the_criterion(criterion):
    """Assert that the smooth cost is the logarithm of the deviation where eigenvalues are apart."""
    exact = np.log(deviation(INFORMATION, criterion))
    assert smooth_cost(INFORMATION, criterion) == pytest.approx(exact, abs=0.01)
