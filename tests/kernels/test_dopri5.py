"""The explicit integrator, against theory and SciPy's own Dormand-Prince."""

import numpy as np
import pytest
from problems import SMOOTH, WALL, integrate, integrator, smooth_solution
from scipy.integrate import RK45

STEPS = 2.0 ** -np.arange(3, 8)
FIXED = 1e9  # a relative tolerance that accepts every step, so that the longest step is the step


def slope(steps: np.ndarray, errors: list[float]) -> float:
    """Return the fitted order of convergence."""
    return float(np.polyfit(np.log(steps), np.log(errors), 1)[0])


def test_order_is_five() -> None:
    """Assert that the error at the end falls with the fifth power of the step."""
    kernel = integrator(SMOOTH, 2, "dopri5")
    errors = []
    small = STEPS[2:]  # above, the next order still counts
    for step in small:
        _, _, z, _, counts = integrate(kernel, 1.0, [1.0, 1.0], 0.0, FIXED, longest_step=step)
        assert counts[0] == round(1.0 / step)
        errors.append(float(np.max(np.abs(z - smooth_solution(1.0)))))
    assert 4.7 < slope(small, errors) < 5.3


def test_a_step_is_that_of_scipy() -> None:
    """Assert that step and dense output are SciPy's, to rounding and to its order."""
    kernel = integrator(SMOOTH, 2, "dopri5")

    def rates(t: float, z: np.ndarray) -> np.ndarray:
        dz = np.empty(2)
        kernel.rates(t, z, np.zeros(1), dz)
        return dz

    peer = RK45(rates, 0.0, np.ones(2), 1.0, 0.1, FIXED, FIXED, first_step=0.1)
    peer.step()
    z, samples = integrate(
        kernel, 0.1, [1.0, 1.0], 0.0, FIXED, longest_step=0.1, sample_time=0.01, samples=11
    )[2:4]
    assert z == pytest.approx(peer.y, rel=1e-14)
    expected = peer.dense_output()(np.arange(11) * 0.01)
    np.testing.assert_allclose(samples.T, expected, atol=1e-7)


def test_order_of_dense_output_is_four() -> None:
    """Assert that between the steps the error falls with the fourth power of the step, at least."""
    kernel = integrator(SMOOTH, 2, "dopri5")
    errors = []
    times = np.arange(1001) / 1000.0
    for step in STEPS:
        samples = integrate(
            kernel, 1.0, [1.0, 1.0], 0.0, FIXED, 1e-9, step, 1000, 1e-3, len(times)
        )[3]
        errors.append(float(np.max(np.abs(samples - smooth_solution(times).T))))
    assert 3.9 < slope(STEPS, errors) < 5.1


def test_tolerance_is_met() -> None:
    """Assert that the error stays near the tolerance and falls with it."""
    kernel = integrator(SMOOTH, 2, "dopri5")
    for tolerance in (1e-4, 1e-6, 1e-8, 1e-10):
        z = integrate(kernel, 1.0, [1.0, 1.0], 0.0, tolerance, tolerance)[2]
        assert np.max(np.abs(z - smooth_solution(1.0))) < 10.0 * tolerance


def test_no_way_on_is_said() -> None:
    """Assert that equations that end somewhere are given up there."""
    status, reached, *_ = integrate(integrator(WALL, 1, "dopri5"), 2.0, [0.0])
    assert status != 0
    assert 0.0 < reached < 2.0
