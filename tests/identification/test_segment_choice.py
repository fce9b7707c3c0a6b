"""How long the segments are, from what their free runs do."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from flexid.identification.segment_choice import best_segments, segment_evidence, segment_shifts

NAMES = ("stiffness", "friction")


def trial(duration, error, values=(100.0, 2.0), std=0.1) -> Any:
    """Return what is needed of a trial; no length or no standard deviation: least squares alone."""
    fit = SimpleNamespace(
        names=NAMES,
        values=np.array(values),
        gauss_newton_covariance=np.eye(2) * std**2,
        covariance=np.eye(2) * std**2,
    )
    finish = SimpleNamespace(fit=fit) if duration and std else None
    candidate = SimpleNamespace(segment_duration=duration)
    return SimpleNamespace(candidate=candidate, error=error, finish=finish)


def test_best_free_run_decides():
    """Assert that a length whose free run is clearly better is taken."""
    trials = [trial(0, 0.2), trial(1.0, 0.2), trial(2.0, 0.1), trial(5.0, 0.15, std=0.01)]
    assert best_segments(trials).candidate.segment_duration == 2.0


def test_longer_segments_decide_among_equals():
    """Assert that of lengths about equally good the longest is taken, which tells most."""
    trials = [trial(0, 0.2), trial(1.0, 0.1), trial(2.0, 0.1005, std=0.2), trial(5.0, 0.102)]
    assert best_segments(trials).candidate.segment_duration == 2.0


def test_least_squares_gives_way_to_an_equal():
    """Assert that prediction error is taken where it is about as good as least squares."""
    assert best_segments([trial(0, 0.1), trial(1.0, 0.1005)]).candidate.segment_duration == 1.0


@pytest.mark.parametrize("other", [trial(1.0, 0.2), trial(1.0, 0.1, std=0)])
def test_least_squares_stays_where_nothing_is_as_good(other):
    """Assert that least squares stays if prediction error is worse or does not converge."""
    assert best_segments([trial(0, 0.1), other]).candidate.segment_duration == 0


def test_coefficients_that_move_beyond_noise_are_told():
    """Assert that the shift is what two standard deviations of the difference do not explain."""
    chosen, other = trial(1.0, 0.1), trial(2.0, 0.1, values=(101.0, 2.1))
    shifts = segment_shifts(chosen, [trial(0, 0.1), chosen, other])
    assert shifts["stiffness"] == pytest.approx(1.0 - 2 * 0.1 * 2**0.5)
    assert shifts["friction"] == 0.0


def test_least_squares_moves_with_no_length():
    """Assert that there are no shifts where least squares was chosen."""
    assert segment_shifts(trial(0, 0.1), [trial(1.0, 0.1)]) == {}


def test_failure_is_on_record():
    """Assert that a length that did not converge says so, and that least squares always does."""
    evidence = segment_evidence([trial(0, 0.3), trial(1.0, 0.2, std=0), trial(2.0, 0.1)])
    assert [e.duration for e in evidence] == [0, 1.0, 2.0]
    assert [e.error for e in evidence] == [0.3, 0.2, 0.1]
    assert [e.converged for e in evidence] == [True, False, True]
