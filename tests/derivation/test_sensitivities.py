"""The generated variational equations against finite differences of the model itself."""

import numpy as np
import pytest
from systems import ALL

from flexid.derivation.model_functions import model_functions
from flexid.derivation.sensitivities import sensitivity_functions
from flexid.models.parametric_system import ParametricSystem, Row

JUMPS = ParametricSystem(
    "jumps",
    (Row("mass", "q", "v", {"coulomb": "-sign(v)", "drag": "-v*abs(v)", "spring": "-abs(q)*q"}),),
)
SYSTEMS = {**ALL, "jumps": JUMPS}


@pytest.fixture
def plain(monkeypatch):
    """Return a function that runs generated source without compiling it."""
    monkeypatch.setattr("numba.njit", lambda **_: lambda function: function)

    def load(source: str) -> dict:
        names: dict = {}
        exec(compile(source, "generated", "exec"), names)
        return names

    return load


@pytest.mark.parametrize("name", SYSTEMS)
def test_variations_are_derivatives_of_the_right_hand_side(plain, name):
    """Assert that every column's rate is the directional derivative of x' along that column."""
    system = SYSTEMS[name]
    variations = plain(sensitivity_functions(system, "Test"))
    model = plain(model_functions(system, "Test"))
    n, k = len(system.states), len(system.coefficients)
    generator = np.random.default_rng(11)
    z = generator.uniform(0.2, 1.2, (n, 1 + n + k))
    u, p = generator.standard_normal(len(system.inputs)), generator.uniform(0.5, 2.0, k)
    c = np.array(list(system.constants.values()))
    rates = np.full_like(z, np.nan)
    variations["variation_rates"](
        z, u, 0.0 * u, np.sign(z[1::2, 0]), p, c, 1 + n + np.arange(k), 0, rates
    )

    def right_hand_side(x, p):
        dx = np.empty(n)
        model["right_hand_side"](x, u, p, c, dx)
        return dx

    assert rates[:, 0] == pytest.approx(right_hand_side(z[:, 0], p), rel=1e-12)
    for column in range(1, 1 + n + k):
        dx = 1e-6 * z[:, column]
        dp = np.zeros(k)
        if column > n:
            dp[column - 1 - n] = 1e-6
        high, low = right_hand_side(z[:, 0] + dx, p + dp), right_hand_side(z[:, 0] - dx, p - dp)
        assert rates[:, column] == pytest.approx((high - low) / 2e-6, rel=1e-6, abs=1e-6)


def test_a_coefficient_without_a_column_leaves_the_others_alone(plain):
    """Assert that dropping a column changes no other."""
    system = ALL["paper"]
    rates_of = plain(sensitivity_functions(system, "Test"))["variation_rates"]
    n, k = len(system.states), len(system.coefficients)
    generator = np.random.default_rng(12)
    z = generator.uniform(0.2, 1.2, (n, 1 + n + k))
    u, p = generator.standard_normal(len(system.inputs)), generator.uniform(0.5, 2.0, k)
    c = np.array(list(system.constants.values()))
    full, part = np.empty_like(z), np.empty_like(z[:, :-1])
    at = 1 + n + np.arange(k)
    modes = np.ones(len(system.rows))
    rates_of(z, u, 0.0 * u, modes, p, c, at, 0, full)
    dropped = np.concatenate(([0], at[:-1]))
    rates_of(np.delete(z, 1 + n, axis=1), u, 0.0 * u, modes, p, c, dropped, 0, part)
    assert np.array_equal(part, np.delete(full, 1 + n, axis=1))
