"""Excitation of regressors, and the information that positions contain on coefficients."""

import numpy as np
import pytest
from made_motion import CART
from oscillator import oscillator

from flexid.errors import SimulationError
from flexid.estimators.channel_timing import Timing
from flexid.estimators.excitation import decay_rate, excitation, information_at
from flexid.estimators.samples import Samples, divide
from flexid.estimators.segmented_motion import Point, segmented_motion

T = np.linspace(0, 10, 1001)
TWO = np.array([[1.0, 0.6], [0.0, 0.8]])
MEASURED = {  # regressors in columns, and their excitation
    "two of three dependent": (
        np.column_stack([np.sin(T), 3 * np.sin(T), np.cos(T)]),
        {"confounded": ("a", "b"), "correlated": ("a", "b"), "correlation": 1.0},
    ),
    "two with a cosine of ρ have singular values 1 ± ρ": (
        TWO,
        {
            "singular_values": [1.6, 0.4],
            "correlation": 0.6,
            "level": np.linalg.eigvalsh(TWO.T @ TWO / 2)[0],
        },
    ),
    "two without": (np.eye(2), {"correlation": 0.0, "correlated": ("a", "b")}),
    "one of zeros": (
        np.column_stack([np.ones(10), np.zeros(10)]),
        {"condition_number": np.inf, "confounded": ("b",)},
    ),
    "one alone": (np.arange(1.0, 5.0)[:, None], {"condition_number": 1.0, "confounded": ()}),
}


@pytest.mark.parametrize("case", MEASURED)
def test_what_is_measured_of_regressors(case):
    """Assert closed forms, and which coefficients are confounded."""
    columns, expected = MEASURED[case]
    measured = excitation("row", tuple("abc"[: columns.shape[1]]), columns)
    for name, value in expected.items():
        of_names = name in ("confounded", "correlated")
        found = getattr(measured, name)
        assert found == (value if of_names else pytest.approx(value, rel=1e-9, abs=1e-6)), name


H, N, NOISE = 0.01, 400, 1e-3


def information(system, values, force, duration, start):
    """Return the information of a system over segments, with a held force and one initial state."""
    segments = divide([Samples(np.zeros((N, 1)), None, force[:, None], H)], duration)
    point = Point(np.array(values), np.tile(start, (len(segments), 1)))
    problem = segmented_motion(system, segments, Timing("zero"))
    return information_at(problem.at(point, np.array([1.0 / NOISE])), point)


def test_closed_form_of_a_cart():
    """Assert the bound of a linear regression with unknown initial position and speed."""
    force = np.random.default_rng(3).standard_normal(N)
    t = H * np.arange(N)
    velocity = np.concatenate(([0.0], H * np.cumsum(force[:-1])))
    position = np.concatenate(([0.0], np.cumsum(H * velocity[:-1] + 0.5 * H * H * force[:-1])))
    columns = np.column_stack([np.ones(N), t, position, 0.5 * t * t])
    expected = NOISE**2 * np.linalg.inv(columns.T @ columns)[2:, 2:]
    found = information(CART, [2.0, 0.3], force, N * H, np.zeros(2))
    np.testing.assert_allclose(found.covariance, expected, rtol=1e-6)
    np.testing.assert_allclose(found.relative_deviations, np.sqrt(np.diag(expected)) / [2.0, 0.3])


def test_a_motion_that_runs_away():
    """Assert that a diverging model raises an error."""
    with pytest.raises(SimulationError, match="diverges"):
        information(oscillator(), [-1e4, 0.0, 0.0], np.zeros(N), 4.0, np.ones(2))


LONG = np.arange(0.0, 20.0, 0.01)
RIPPLE = 1 + 0.3 * np.sin(2 * np.pi * LONG)


@pytest.mark.parametrize(
    ("errors", "window", "floor", "rate"),
    [
        ((np.exp(-0.4 * LONG) * RIPPLE)[:, None] * [1.0, -3.0], 1.0, 0.0, 0.4),
        (np.maximum(np.exp(-2.0 * LONG), 1e-9)[:, None], 0.5, 1e-8, 2.0),
        (np.column_stack([np.exp(-0.1 * LONG), 10 * np.exp(-3.0 * LONG)]), 0.5, 0.0, 0.1),
        (np.ones((200, 1)), 1.0, 0.0, np.nan),
    ],
    ids=["rippled within the window", "ends in the integrator's noise", "slowest", "two windows"],
)
def test_decay_rate_of_an_exponential(errors, window, floor, rate):
    """Assert the rate of the slowest exponential above the floor."""
    found = decay_rate(LONG[: len(errors)], errors, window, floor)
    assert found == pytest.approx(rate, rel=1e-3, nan_ok=True)
