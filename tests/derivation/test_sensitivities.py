"""The generated variational equations against finite differences of the model itself."""

import numpy as np
import pytest
from systems import ALL

from flexid.derivation.model_functions import plain_model
from flexid.derivation.sensitivities import sensitivity_functions
from flexid.kernels.store import template
from flexid.models.parametric_system import Memory, ParametricSystem, Row

JUMPS = ParametricSystem(
    "jumps",
    (Row("mass", "q", "v", {"coulomb": "-sign(v)", "drag": "-v*abs(v)", "spring": "-abs(q)*q"}),),
)
TWO_MEMORIES = ParametricSystem(
    "two memories",
    (
        Row("link", "x", "v", {"spring": "y - x", "grease": "-h*v", "wear": "-h"}),
        Row("motor", "y", "w", {"bristles": "-g", "gain": "u"}),
    ),
    memories=(Memory("h", "x - y", "grip"), Memory("g", "y", "hold")),
)
COSTLY = ParametricSystem(
    "costly", (Row("mass", "q", "v", {"stop": "tanh(q)", "gain": "u"}, known="-exp(v)"),)
)
SYSTEMS = {**ALL, "jumps": JUMPS, "two memories": TWO_MEMORIES, "costly": COSTLY}


@pytest.fixture
def plain(monkeypatch):
    """Return a function that runs generated source without compiling it."""
    monkeypatch.setattr("numba.njit", lambda **_: lambda function: function)

    def load(source: str) -> dict:
        names: dict = {}
        exec(compile(template("compiled") + source, "generated", "exec"), names)
        return names

    return load


def drawn(system, seed):
    """Return a state, inputs, modes, coefficients and constants of a system."""
    generator = np.random.default_rng(seed)
    x = generator.uniform(0.2, 1.2, len(system.states))
    u = generator.standard_normal(len(system.inputs))
    modes = np.sign(x[1 : 2 * len(system.rows) : 2])
    p = generator.uniform(0.5, 2.0, len(system.coefficients))
    return x, u, modes, p, np.array(list(system.constants.values()))


def columns_of(system):
    """Return the columns of the coefficients, which follow the initial states, and the next one."""
    first, k = 1 + len(system.states), len(system.coefficients)
    return first + np.arange(k), first + k


def slopes_of(functions, system, x, u, du, modes, p, c, at, delay):
    """Return derivatives of the rates of velocities and memories by states and parameters."""
    n = len(system.rows) + len(system.memories)
    a, r = np.zeros(n * len(x)), np.zeros(n * functions["WIDTH"])
    functions["slopes"](x, u, du, modes, p, c, at, delay, a, r)
    return a.reshape(n, len(x)), r.reshape(n, functions["WIDTH"])


@pytest.mark.parametrize("name", SYSTEMS)
def test_rates_are_the_model_s(plain, name):
    """Assert that x' equals the right-hand side used by all other kernels."""
    system = SYSTEMS[name]
    x, u, modes, p, c = drawn(system, 11)
    rates, expected = np.empty_like(x), np.empty_like(x)
    plain(sensitivity_functions(system, "Test"))["state_rates"](x, u, modes, p, c, rates)
    plain(plain_model(system))["right_hand_side"](x, u, p, c, expected)
    assert rates == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("name", ALL)
def test_linearisation_is_the_slope_of_the_right_hand_side(plain, name):
    """Assert that derivatives match differences, and that smooth models have no jumps."""
    model = plain(plain_model(ALL[name]))
    x, u, _, p, c = drawn(ALL[name], 1)
    found, gains = np.empty((len(x), len(x))), np.empty((len(x), len(u)))
    jumps = np.empty(len(x) // 2)
    model["slopes"](x, u, p, c, found, gains)
    model["jumps"](x, u, p, c, jumps)
    for place, step in enumerate(1e-5 * np.eye(len(x) + len(u))):
        ends = np.empty((2, len(x)))
        for end, side in zip(ends, (step, -step), strict=True):
            model["right_hand_side"](x + side[: len(x)], u + side[len(x) :], p, c, end)
        # The differences have an error of step²/6 times the third derivative.
        slope = (ends[0] - ends[1]) / 2e-5
        np.testing.assert_allclose(np.hstack((found, gains))[:, place], slope, 1e-6, 1e-6)
    assert not jumps.any()


@pytest.mark.parametrize("stop", [0.0, 2.0])
def test_costly_functions_are_called_where_they_are_needed(plain, stop):
    """Assert that terms with a zero coefficient are not computed, unless it is an unknown."""
    functions = plain(sensitivity_functions(COSTLY, "Test"))
    calls = []
    functions["tanh"] = lambda z: calls.append("tanh") or np.tanh(z)
    x, u, modes, p, c = drawn(COSTLY, 12)
    p[0] = stop
    rates = np.empty_like(x)
    functions["state_rates"](x, u, modes, p, c, rates)
    assert calls.count("tanh") == (stop != 0.0)
    assert rates[1] == pytest.approx(stop * np.tanh(x[0]) + p[1] * u[0] - np.exp(x[1]))
    for column, needed in ((0, stop != 0.0), (3, True)):
        calls.clear()
        at = np.array([column, 4])
        a, r = slopes_of(functions, COSTLY, x, u, 0.0 * u, modes, p, c, at, 0)
        assert calls.count("tanh") == needed
        assert a[0, 0] == pytest.approx(stop / np.cosh(x[0]) ** 2)
        if column:
            assert r[0, column] == pytest.approx(np.tanh(x[0]))


def step_of(functions, system, x, u, modes, p, c, h):
    """Return the stages of a Runge-Kutta step of order 4, and its end."""
    stages, end = [x], x.copy()
    for weight, reach in ((1 / 6, 0.5), (1 / 3, 0.5), (1 / 3, 1.0), (1 / 6, 0.0)):
        rates = np.empty_like(x)
        functions["state_rates"](stages[-1], u, modes, p, c, rates)
        end += weight * h * rates
        stages.append(x + reach * h * rates)
        functions["remember"](stages[-1], x, p)
    functions["remember"](end, x, p)
    return [*stages[:4], end]


@pytest.mark.parametrize("name", SYSTEMS)
def test_columns_are_derivatives_of_the_step(plain, name):
    """Assert that each column after a step is the derivative of the step along that column."""
    system = SYSTEMS[name]
    functions = plain(sensitivity_functions(system, "Test"))
    x, u, modes, p, c = drawn(system, 14)
    at, delay = columns_of(system)
    n, du = delay + 1, np.random.default_rng(13).standard_normal(len(u))
    width, memories, h = functions["WIDTH"], len(system.memories), 0.05
    z = np.zeros((len(x), width))
    z[:, 1:n] = np.random.default_rng(15).standard_normal((len(x), n - 1))
    *stages, end = step_of(functions, system, x, u, modes, p, c, h)
    slopes = [
        slopes_of(functions, system, stage, u, du, modes, p, c, at, delay) for stage in stages
    ]
    a, r = (np.array(each) for each in zip(*slopes, strict=True))
    b, q = np.zeros((4, memories * len(x))), np.zeros((4, memories * width))
    for stage, then in enumerate([*stages[1:], end]):
        functions["memory_slopes"](then, x, p, at, b[stage], q[stage])
    after = z.ravel().copy()
    undisturbed = np.zeros(len(system.rows) * width), np.ones(len(system.rows))
    functions["vary"](after, n, h, a.ravel(), r.ravel(), b.ravel(), q.ravel(), *undisturbed)
    after = after.reshape(z.shape)
    for column in range(1, n):
        dp = 1.0 * (at == column)
        moved = du if column == delay else 0.0 * u
        high, low = (
            step_of(functions, system, x + e * z[:, column], u + e * moved, modes, p + e * dp, c, h)
            for e in (1e-6, -1e-6)
        )
        assert after[:, column] == pytest.approx((high[-1] - low[-1]) / 2e-6, rel=1e-6, abs=1e-6)
    assert not after[:, n:].any()


def test_corners_are_those_of_positions(plain):
    """Assert that magnitudes of positions are corners while their terms are on, unlike speeds."""
    system = ParametricSystem(
        "play",
        (Row("mass", "q", "v", {"play": "abs(q - w) - abs(q + w)", "drag": "-v*abs(v)"}),),
        constants={"w": 0.5},
    )
    functions = plain(sensitivity_functions(system, "test"))
    assert functions["N_CORNERS"] == 2
    found = np.zeros(2)
    functions["corners"](np.array([0.2, 3.0]), np.array([1.0, 1.0]), np.array([0.5]), found)
    assert sorted(found) == pytest.approx([-0.3, 0.7])
    functions["corners"](np.array([0.2, 3.0]), np.array([0.0, 1.0]), np.array([0.5]), found)
    assert found == pytest.approx(1.0)
    assert plain(sensitivity_functions(COSTLY, "test"))["N_CORNERS"] == 0
