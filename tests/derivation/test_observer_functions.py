"""Generated immersion and cancelling term: values, quadrature error, Lyapunov decrease."""

from types import ModuleType

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from systems import ALL, HARDENING, NO_CLOSED_FORM

from flexid.derivation.model_functions import model_functions
from flexid.derivation.observer_functions import observer_functions
from flexid.kernels.store import load_kernel
from flexid.models.parametric_system import ParametricSystem, Row


@pytest.fixture(autouse=True)
def _uncompiled(monkeypatch: pytest.MonkeyPatch):
    # Compilation is the kernels' business; here the same source runs as plain Python.
    monkeypatch.setattr("numba.njit", lambda **_: lambda function: function)


def generated(system: ParametricSystem) -> ModuleType:
    """Run the generated functions of a model as plain Python."""
    source = model_functions(system, "Test") + "\n\n" + observer_functions(system)
    module = ModuleType("generated")
    exec(compile(source, "generated", "exec"), module.__dict__)
    return module


def constants(system: ParametricSystem) -> np.ndarray:
    """Return the constants' values in order."""
    return np.array(list(system.constants.values()))


def immersed(module: ModuleType, x: np.ndarray, u: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Return b."""
    b = np.empty(module.N_COEFFICIENTS)
    module.immersion(x, u, c, b)
    return b


@pytest.mark.parametrize("name", ALL)
def test_immersion_is_the_integral_of_the_regressor(name: str):
    """Assert that the generated b is the adaptive integral of the generated r."""
    system = ALL[name]
    module, c = generated(system), constants(system)
    rng = np.random.default_rng(1)
    for scale in (0.01, 1.0, 30.0):
        x = scale * rng.normal(size=module.N_STATES)
        u = rng.normal(size=module.N_INPUTS)
        b = immersed(module, x, u, c)
        for place in range(module.N_COEFFICIENTS):
            starts = [part.start for _, part in system.row_slices()]
            velocity = 2 * int(np.searchsorted(starts, place, side="right")) - 1

            def regressor(v: float, place=place, velocity=velocity, x=x, u=u) -> float:
                r, k = np.empty(module.N_COEFFICIENTS), np.empty(module.N_ROWS)
                at = x.copy()
                at[velocity] = v
                module.regressors(at, u, c, r, k)
                return r[place]

            end = x[velocity]
            breaks = sorted(np.sign(end) * p for p in (0.1, 0.5, 2.0, 10.0) if p < abs(end))
            wanted, _ = quad(regressor, 0, end, points=breaks or None, limit=200)
            assert b[place] == pytest.approx(wanted, rel=1e-7, abs=1e-10)


@pytest.mark.parametrize("name", ALL)
def test_cancelling_term_is_the_rate_of_the_immersion(name: str):
    """Assert that C is db/dt along a motion whose row velocities stand still."""
    system = ALL[name]
    module, c = generated(system), constants(system)
    rng = np.random.default_rng(2)
    x, u, du = (rng.normal(size=n) for n in (module.N_STATES, module.N_INPUTS, module.N_INPUTS))
    C = np.empty(module.N_COEFFICIENTS)
    module.cancelling_term(x, u, du, c, C)
    dx = np.zeros_like(x)
    dx[0::2] = x[1::2]
    h = 1e-5
    ahead, behind = (immersed(module, x + s * h * dx, u + s * h * du, c) for s in (1.0, -1.0))
    np.testing.assert_allclose(C, (ahead - behind) / (2 * h), rtol=1e-7, atol=1e-8)


@pytest.mark.parametrize("width", [0.02, 0.1, 1.0, 10.0])
@pytest.mark.parametrize("velocity", [-10.0, 0.3, 10.0])
def test_quadrature_error_of_friction_curves(width: float, velocity: float):
    """Assert an error below 1e-7 for Stribeck curves down to 1/500 of the velocity."""
    system = ParametricSystem(
        "stribeck",
        (Row("arm", "q", "v", {"a": "exp(-(v/width)**2)*tanh(3*v/width)"}),),
        constants={"width": width},
    )
    b = immersed(generated(system), np.array([0.0, velocity]), np.zeros(1), constants(system))

    def curve(v: float) -> float:
        return np.exp(-((v / width) ** 2)) * np.tanh(3 * v / width)

    end = min(abs(velocity), 7 * width)
    wanted, _ = quad(curve, 0.0, end, epsabs=1e-14, epsrel=1e-12, limit=200)
    assert b[0] == pytest.approx(wanted, rel=1e-7)  # even in v


@pytest.mark.parametrize("system", [NO_CLOSED_FORM, HARDENING], ids=["quadrature", "closed form"])
def test_lyapunov_function_decreases(system: ParametricSystem):
    """Assert that the generated observer, integrated with the plant, obeys (8) and (9)."""
    module, c = generated(system), constants(system)
    n, m = module.N_STATES, module.N_COEFFICIENTS
    rng = np.random.default_rng(3)
    p = rng.uniform(0.5, 2.0, m)
    gain = 1.5
    work = [np.empty(size) for size in (n, m, module.N_ROWS, m)]

    def estimates(state: np.ndarray) -> np.ndarray:
        return state[n:] + gain * immersed(module, state[:n], np.zeros(1), c)

    def rates(t: float, state: np.ndarray) -> np.ndarray:
        dx, r, k, C = work
        x, u = state[:n], np.array([3 * np.sin(2 * t)])
        module.right_hand_side(x, u, p, c, dx)
        module.regressors(x, u, c, r, k)
        module.cancelling_term(x, u, np.zeros(1), c, C)
        hat, dy = estimates(np.concatenate([x, state[n:]])), np.empty(m)
        for row, (_, part) in enumerate(system.row_slices()):
            dy[part] = -gain * (r[part] * (r[part] @ hat[part] + k[row]) + C[part])
        return np.concatenate([dx, dy])

    times = np.linspace(0.0, 4.0, 81)
    start = np.concatenate([0.3 * rng.normal(size=n), np.zeros(m)])
    solution = solve_ivp(rates, (0, 4.0), start, t_eval=times, rtol=1e-9, atol=1e-10)
    V = np.array([0.5 * np.sum((estimates(s) - p) ** 2) for s in solution.y.T])
    assert np.all(np.diff(V) < 1e-7 * V[0])
    assert V[-1] < 0.9 * V[0]


def test_kernel_compiles(monkeypatch: pytest.MonkeyPatch, tmp_path):
    """Assert that numba compiles the generated source, loops over nodes included."""
    monkeypatch.undo()
    monkeypatch.setattr("flexid.kernels.store.cache_directory", lambda: tmp_path)
    module = load_kernel(
        "test_observer",
        (NO_CLOSED_FORM.digest,),
        lambda: model_functions(NO_CLOSED_FORM, "Test") + observer_functions(NO_CLOSED_FORM),
    )
    plain = np.empty(3)
    module.immersion.py_func(np.array([0.4, -3.0]), np.zeros(1), np.ones(1), plain)
    compiled = np.empty(3)
    module.immersion(np.array([0.4, -3.0]), np.zeros(1), np.ones(1), compiled)
    np.testing.assert_allclose(compiled, plain, rtol=1e-13)
