"""The printed observer at work: its integrals, their rates, and the Lyapunov function it lowers."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import quad, solve_ivp
from systems import ALL, HARDENING, NO_CLOSED_FORM

from flexid.derivation.observer import derive_observer
from flexid.derivation.printing_code import python_observer
from flexid.derivation.source import ScalarPrinter
from flexid.derivation.symbolic import symbolic_system
from flexid.models.parametric_system import ParametricSystem, Row

Array = np.ndarray


@dataclass(frozen=True)
class Printed:
    """The observer of a model as `flexid derive` prints it in Python, with all gains alike."""

    system: ParametricSystem
    gain: float = 1.0

    @cached_property
    def module(self) -> dict[str, Any]:
        """What is printed, run."""
        namespace: dict[str, Any] = {}
        exec(compile(python_observer(derive_observer(self.system)), "printed", "exec"), namespace)
        return namespace

    @cached_property
    def needs_rates(self) -> bool:
        """Whether the inputs' rates are among its arguments."""
        return bool(derive_observer(self.system).input_rates)

    def arguments(self, x: Array, u: Array, du: Array, own: Array) -> list[list[float]]:
        """All arguments that it has."""
        constants = list(self.system.constants.values())
        gains = [self.gain] * len(self.system.rows)
        groups = [x, u, du if self.needs_rates else [], own, gains, constants]
        return [list(map(float, group)) for group in groups if len(group)]

    @cached_property
    def _model(self) -> Any:
        """Regressors, then known parts, from the symbols themselves."""
        symbolic = symbolic_system(self.system)
        names = [*symbolic.states, *symbolic.inputs, *symbolic.constants]
        wanted = [r for row in symbolic.rows for r in row.regressor]
        wanted += [row.known for row in symbolic.rows]
        return sp.lambdify(names, wanted, "math", printer=ScalarPrinter)

    def regressors(self, x: Array, u: Array) -> tuple[Array, Array]:
        """Regressors and known parts."""
        values = [*x, *u, *self.system.constants.values()]
        found = np.array(self._model(*map(float, values)))
        return found[: len(self.system.coefficients)], found[len(self.system.coefficients) :]

    def immersion(self, x: Array, u: Array) -> Array:
        """b, which is what the estimates are of observer states 0 and gains of 1."""
        own = np.zeros(len(self.system.coefficients))
        return np.array(self.module["estimates"](*self.arguments(x, u, np.zeros_like(u), own)))

    def cancelling(self, x: Array, u: Array, du: Array) -> Array:
        """C, which is what the observer's rates have beside regressor times prediction."""
        estimates = self.immersion(x, u)
        rates = self.module["rates"](*self.arguments(x, u, du, np.zeros(len(estimates))))
        r, k = self.regressors(x, u)
        found = -np.array(rates)
        for row, (_, part) in enumerate(self.system.row_slices()):
            found[part] -= r[part] * (r[part] @ estimates[part] + k[row])
        return found


def randoms(system: ParametricSystem, seed: int) -> tuple[np.random.Generator, Array, Array]:
    """Return a generator, and a state and inputs from it."""
    generator = np.random.default_rng(seed)
    x = generator.normal(size=len(system.states))
    return generator, x, generator.normal(size=len(system.inputs))


@pytest.mark.parametrize("name", ALL)
def test_immersion_is_the_integral_of_the_regressor(name: str):
    """Assert that the printed b is the adaptive integral of r over the row's velocity."""
    printed = Printed(ALL[name])
    generator, _, _ = randoms(printed.system, 1)
    for scale in (0.01, 1.0, 30.0):
        x = scale * generator.normal(size=len(printed.system.states))
        u = generator.normal(size=len(printed.system.inputs))
        b = printed.immersion(x, u)
        for row, (_, part) in enumerate(printed.system.row_slices()):
            end = x[2 * row + 1]
            breaks = sorted(np.sign(end) * p for p in (0.1, 0.5, 2.0, 10.0) if p < abs(end))
            for place in range(part.start, part.stop):

                def regressor(v: float, place=place, row=row, x=x, u=u) -> float:
                    at = x.copy()
                    at[2 * row + 1] = v
                    return printed.regressors(at, u)[0][place]

                wanted, _ = quad(regressor, 0, end, points=breaks or None, limit=200)
                assert b[place] == pytest.approx(wanted, rel=1e-7, abs=1e-10)


@pytest.mark.parametrize("name", ALL)
def test_cancelling_term_is_the_rate_of_the_immersion(name: str):
    """Assert that C is db/dt along a motion whose row velocities stand still."""
    printed = Printed(ALL[name])
    generator, x, u = randoms(printed.system, 2)
    du = generator.normal(size=len(u))
    dx = np.zeros_like(x)
    dx[0::2] = x[1::2]
    h = 1e-5
    ahead, behind = (printed.immersion(x + s * h * dx, u + s * h * du) for s in (1.0, -1.0))
    found = printed.cancelling(x, u, du)
    np.testing.assert_allclose(found, (ahead - behind) / (2 * h), rtol=1e-7, atol=1e-8)


@pytest.mark.parametrize("width", [0.02, 0.1, 1.0, 10.0])
@pytest.mark.parametrize("velocity", [-10.0, 0.3, 10.0])
def test_quadrature_error_of_friction_curves(width: float, velocity: float):
    """Assert an error below 1e-7 for Stribeck curves down to 1/500 of the velocity."""
    system = ParametricSystem(
        "stribeck",
        (Row("arm", "q", "v", {"a": "exp(-(v/width)**2)*tanh(3*v/width)"}),),
        constants={"width": width},
    )
    b = Printed(system).immersion(np.array([0.0, velocity]), np.zeros(1))

    def curve(v: float) -> float:
        return np.exp(-((v / width) ** 2)) * np.tanh(3 * v / width)

    end = min(abs(velocity), 7 * width)
    wanted, _ = quad(curve, 0.0, end, epsabs=1e-14, epsrel=1e-12, limit=200)
    assert b[0] == pytest.approx(wanted, rel=1e-7)  # even in v


@pytest.mark.parametrize("system", [NO_CLOSED_FORM, HARDENING], ids=["quadrature", "closed form"])
def test_lyapunov_function_decreases(system: ParametricSystem):
    """Assert that the printed observer, integrated with the plant, obeys (8) and (9)."""
    printed = Printed(system, gain=1.5)
    n, m = len(system.states), len(system.coefficients)
    generator = np.random.default_rng(3)
    p = generator.uniform(0.5, 2.0, m)
    still = np.zeros(1)

    def estimates(state: Array) -> Array:
        given = printed.arguments(state[:n], still, still, state[n:])
        return np.array(printed.module["estimates"](*given))

    def rates(t: float, state: Array) -> Array:
        x, u = state[:n], np.array([3 * np.sin(2 * t)])
        r, k = printed.regressors(x, u)
        dx = np.empty(n)
        dx[0::2] = x[1::2]
        dx[1::2] = [r[part] @ p[part] + k[row] for row, (_, part) in enumerate(system.row_slices())]
        return np.concatenate(
            [dx, printed.module["rates"](*printed.arguments(x, u, still, state[n:]))]
        )

    times = np.linspace(0.0, 4.0, 81)
    start = np.concatenate([0.3 * generator.normal(size=n), np.zeros(m)])
    solution = solve_ivp(rates, (0, 4.0), start, t_eval=times, rtol=1e-9, atol=1e-10)
    V = np.array([0.5 * np.sum((estimates(s) - p) ** 2) for s in solution.y.T])
    assert np.all(np.diff(V) < 1e-7 * V[0])
    assert V[-1] < 0.9 * V[0]
