"""The generated variational equations against finite differences of the model itself."""

from itertools import pairwise

import numpy as np
import pytest
from systems import ALL

from flexid.derivation.model_functions import model_functions
from flexid.derivation.sensitivities import sensitivity_functions
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
SYSTEMS = {**ALL, "jumps": JUMPS, "two memories": TWO_MEMORIES}


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
        z,
        u,
        0.0 * u,
        np.sign(z[1 : 2 * len(system.rows) : 2, 0]),
        p,
        c,
        1 + n + np.arange(k),
        0,
        rates,
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


@pytest.fixture
def moved(plain):
    """Return a function: what a path from some positions to others leaves of the memories."""
    remember = plain(sensitivity_functions(TWO_MEMORIES, "Test"))["remember"]

    def memories(grips, start, end, at=(0,) * 7):
        z = np.array(end, dtype=np.float64)
        remember(z, np.array(start, dtype=np.float64), np.array([0.0] * 5 + grips), np.array(at))
        return z[4:]

    return memories


def test_memories_follow_their_law(moved):
    """Assert that a path's closed form is what the equation h' = s (w - |w| h) comes to."""
    start = np.array([0.1, 0.0, -0.2, 0.0, 0.4, -0.9])
    end = np.array([0.5, 0.0, -0.5, 0.0, np.nan, np.nan])
    found = moved([3.0, 2.0], start[:, None], end[:, None])[:, 0]
    h, g = 0.4, -0.9
    steps = 20000  # of Euler, whose error is then below 1e-4
    for _ in range(steps):
        forward, backward = 0.7 / steps, -0.3 / steps
        h += 3.0 * (forward - abs(forward) * h)
        g += 2.0 * (backward - abs(backward) * g)
    assert found == pytest.approx([h, g], abs=2e-4)


def test_a_path_may_be_cut(moved):
    """Assert that a path in two parts leaves what it leaves in one."""
    start = np.array([[0.1], [0.0], [-0.2], [0.0], [0.4], [-0.9]])
    end = np.array([[0.5], [0.0], [-0.5], [0.0], [0.0], [0.0]])
    middle = 0.7 * start + 0.3 * end
    middle[4:] = moved([3.0, 2.0], start, middle)
    whole, parts = (moved([3.0, 2.0], a, end) for a in (start, middle))
    assert parts == pytest.approx(whole, rel=1e-14)


def test_a_path_s_derivatives_are_those_of_its_memory(moved):
    """Assert that columns hold the derivatives by start, end and grip that differences show."""
    generator = np.random.default_rng(3)
    start, end = generator.standard_normal((2, 6, 3))
    grips = np.array([3.0, 2.0])
    at = np.array([0, 0, 0, 0, 0, 1, 2])

    def at_point(column, step):
        by_grip = grips + step * (np.arange(2) == column - 1)
        a, b = (z[:, :1] + step * z[:, column : column + 1] for z in (start, end))
        return moved(by_grip.tolist(), a, b)[:, 0]

    found = moved(grips.tolist(), start, end, at)
    for column in (1, 2):
        slope = (at_point(column, 1e-6) - at_point(column, -1e-6)) / 2e-6
        assert found[:, column] == pytest.approx(slope, rel=1e-7, abs=1e-8)


def test_memory_is_passive(moved):
    """Assert that a friction h gives back no more work than h²/(2 s) holds, to and fro."""
    generator = np.random.default_rng(4)
    x, h, work, grip = 0.0, 0.0, 0.0, 3.0
    for stop in generator.uniform(-1.0, 1.0, 30):
        steps = np.linspace(x, stop, 400)
        for a, b in pairwise(steps.tolist()):
            start = [[a], [0.0], [0.0], [0.0], [h], [0.0]]
            after = float(moved([grip, 1.0], start, [[b], *start[1:]])[0, 0])
            work += 0.5 * (h + after) * (b - a)
            h = after
            assert abs(h) <= 1.0
        x = stop
        assert work >= h * h / (2.0 * grip) - 1e-6
    assert work > 10.0  # and that it loses
