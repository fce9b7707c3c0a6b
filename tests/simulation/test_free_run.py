"""Free run of a model with a recorded input."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from flexid.errors import SimulationError
from flexid.models.flexible_joint import flexible_joint
from flexid.models.parametric_system import ParametricSystem, Row
from flexid.simulation.free_run import free_run


@pytest.mark.parametrize(("hold", "other"), [("linear", "zero"), ("zero", "linear")])
def test_both_holds_agree_with_scipy(hold, other):
    """Assert that an interpolated or held input gives SciPy's motion."""
    p = {"theta1": 5.0, "theta2": 100.0, "alpha1": 333.0, "alpha2": 0.3, "beta1": 3.3}
    times = np.arange(201) * 0.01
    samples = 20 * np.sin(3 * times)

    def rates(t, x):
        d, held = x[0] - x[2], samples[min(int(t / 0.01 + 1e-9), 200)]
        u = np.interp(t, times, samples) if hold == "linear" else held
        link = -p["theta1"] * np.sin(x[0]) - p["theta2"] * d
        return [x[1], link, x[3], p["alpha1"] * d - p["alpha2"] * x[3] + p["beta1"] * u]

    exact = {"method": "DOP853", "t_eval": times, "rtol": 1e-11, "atol": 1e-12, "max_step": 0.01}
    expected = solve_ivp(rates, (0.0, times[-1]), np.zeros(4), **exact).y.T
    actual, wrong = (
        free_run(flexible_joint(), p, np.zeros(4), samples, 0.01, own) for own in (hold, other)
    )
    np.testing.assert_allclose(actual, expected, atol=1e-4 if hold == "linear" else 2e-4)
    assert np.max(np.abs(wrong - expected)) > 1e-2


FORCES = {"stiffness": "-q", "drag": "-v", "lossy": "-v*sign(v)"}
FORCES["coulomb"] = "-sign(v)*(1 + exp(-v**2))"
CART = ParametricSystem("cart", (Row("cart", "q", "v", FORCES, known="u"),))


def moved(start: list[float], force: np.ndarray, sample_time: float, **acting: float) -> np.ndarray:
    """Return the motion of a cart on which these forces act; one kernel serves all of them."""
    return free_run(CART, dict.fromkeys(FORCES, 0.0) | acting, start, force, sample_time)


def test_convergence_is_of_fourth_order():
    """Assert that halving the sample time divides the error by sixteen."""
    errors = []
    for n in (20, 40, 80):  # short steps without substeps
        x = moved([1.0, 0.0], np.zeros(n + 1), 1 / n, stiffness=1.0)
        errors.append(abs(x[-1, 0] - np.cos(1.0)))
    slopes = np.diff(np.log2(errors))
    np.testing.assert_allclose(slopes, -4, atol=0.25)


def test_what_no_free_run_has():
    """Assert refusals of dry friction, absurd poles and divergence; a fast pole is integrated."""
    for start in (0.0, 1.0):
        with pytest.raises(SimulationError, match=r"row 1 jumps .* tanh\(v/0\.01\)"):
            moved([0.0, start], np.ones(20), 1e-2, drag=1.0, coulomb=0.5, lossy=0.5)
    x = moved([0.0, 1.0], np.ones(2000), 1e-2, drag=1.0, lossy=0.5)
    assert x[-1, 1] == pytest.approx(2.0 / 3.0, rel=1e-6)  # v + v/2 = 1
    x = moved([0.0, 1.0], np.ones(200), 1e-2, drag=5000.0)
    assert x[-1, 1] == pytest.approx(1 / 5000.0, rel=1e-6)
    with pytest.raises(SimulationError, match="too fast"):
        moved([0.0, 1.0], np.ones(200), 1e-2, drag=1e12)
    with pytest.raises(SimulationError, match="diverges") as caught:
        moved([1.0, 0.0], np.zeros(10_001), 1e-2, stiffness=-100.0)
    assert 0 < caught.value.time < 10
