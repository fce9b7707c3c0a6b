"""Closed loops composed symbolically, and variational equations, against finite differences."""

from typing import cast

import numpy as np
import pytest
import sympy as sp
from systems import ALL, THREE_ROWS

from flexid.derivation.model_functions import plain_model
from flexid.derivation.sensitivities import sensitivity_functions
from flexid.derivation.symbolic import symbol
from flexid.errors import AccelerationError, ModelError
from flexid.kernels.store import template
from flexid.models.expression import evaluate
from flexid.models.flexible_joint import flexible_joint
from flexid.models.parametric_system import Memory, ParametricSystem, Row
from flexid.paper.closed_loop import compose_loop
from flexid.paper.laws import REFERENCE_NAMES, Controller, pd_gravity, robust_law
from flexid.paper.loop import LoopDeclaration, Multisine, sinusoid
from flexid.paper.observer import derive_observer
from flexid.simulation.closed_loop import loop_kernel

JOINT = flexible_joint(known={"beta1": 10 / 3})
PAPER = LoopDeclaration(JOINT, robust_law(), sinusoid(3.0, 5.0))

CURVED = Controller(
    "law in curved coordinates",
    "q2",
    {"u1": "-stiffness*(q1 - aim) - slip", "u2": "-v3 + qd_2"},
    {"stiffness": 4.0},
    {"aim": "qd + qd_1**2/5", "slip": "v1 - qd_1 + sin(q1)"},
    {
        "s1": "q1 - aim",
        "s2": "slip",
        "s3": "q2 + q1**2/3",
        "s4": "v2 - stiffness*q1*v1",
        "s5": "q3 - qd_1",
        "s6": "v3 + sin(q2 + q3)",
    },
)
CURVED_LOOP = LoopDeclaration(THREE_ROWS, CURVED, Multisine([0.5, 0.3], [2.0, 3.1], [0.2, 0.4]))

UNKNOWN_GAIN = LoopDeclaration(flexible_joint(), pd_gravity(), Multisine([1.2, 0.6], [2.0, 5.3]))

loops = pytest.mark.parametrize(
    "declaration", [PAPER, CURVED_LOOP, UNKNOWN_GAIN], ids=["paper", "curved", "unknown gain"]
)


def parameters(declaration: LoopDeclaration) -> np.ndarray:
    """Return values for all parameters: declared ones, and arbitrary ones for the rest."""
    system, law, reference = declaration.system, declaration.controller, declaration.reference
    given = {**system.constants, **law.values, **reference.parameters}
    names = declaration.parameter_names
    return np.array([given.get(name, 1.0 + place / 7) for place, name in enumerate(names)])


@loops
def test_derivatives(declaration: LoopDeclaration) -> None:
    """Assert that Jacobian and time derivative match central differences of the rates."""
    kernel, p = loop_kernel(declaration), parameters(declaration)
    z = np.random.default_rng(2).normal(size=kernel.SIZE)
    dz, slope = np.empty(kernel.SIZE), np.empty(kernel.SIZE)
    jacobian = np.zeros((kernel.SIZE, kernel.SIZE))
    kernel.rates_and_jacobian(0.3, z, p, dz, jacobian, slope)

    def rates(t: float, z: np.ndarray) -> np.ndarray:
        result = np.empty(kernel.SIZE)
        kernel.rates(t, z, p, result)
        return result

    h = 1e-5
    columns = [(rates(0.3, z + h * e) - rates(0.3, z - h * e)) / (2 * h) for e in np.eye(len(z))]
    scale = np.max(np.abs(jacobian), axis=1, keepdims=True)
    assert np.max(np.abs(np.array(columns).T - jacobian) / scale) < 1e-6
    difference = (rates(0.3 + h, z) - rates(0.3 - h, z)) / (2 * h)
    assert difference == pytest.approx(slope, rel=1e-5, abs=1e-6 * np.max(np.abs(slope)))
    assert rates(0.3, z) == pytest.approx(dz, rel=1e-12)


@loops
def test_both_routes_agree(declaration: LoopDeclaration) -> None:
    """Assert that eq. (7) in coordinates gives the motion of eqs. (1) to (3) in plain states."""
    kernel, p = loop_kernel(declaration), parameters(declaration)
    x = 0.5 * np.random.default_rng(3).normal(size=kernel.N_STATES)
    estimates = np.random.default_rng(4).normal(size=kernel.N_COEFFICIENTS)
    z, dz = np.empty(kernel.SIZE), np.empty(kernel.SIZE)
    kernel.start(0.3, x, estimates, p, z)
    kernel.rates(0.3, z, p, dz)

    def states_and_estimates(h: float) -> np.ndarray:
        y = np.empty(kernel.N_OUTPUTS)
        kernel.outputs(0.3 + h, z + h * dz, p, y)
        first = kernel.N_STATES + kernel.N_INPUTS
        return np.concatenate((y[: kernel.N_STATES], y[first : first + kernel.N_COEFFICIENTS]))

    moved = (states_and_estimates(1e-6) - states_and_estimates(-1e-6)) / 2e-6
    expected = plain_rates(declaration, 0.3, x, estimates)
    assert moved == pytest.approx(expected, rel=1e-5, abs=1e-7 * max(abs(expected)))


def plain_rates(
    declaration: LoopDeclaration, t: float, x: np.ndarray, estimates: np.ndarray
) -> np.ndarray:
    """Return x' and the rates of the estimates, from eqs. (1) to (3) as printed."""
    system, law = declaration.system, declaration.controller
    values = dict(zip(declaration.parameter_names, parameters(declaration), strict=True))
    values |= dict(zip(system.states, x, strict=True))
    values |= {
        name: float(declaration.reference.evaluate(t, order))
        for order, name in enumerate(REFERENCE_NAMES)
    }
    for name, text in {**law.definitions, **law.inputs}.items():
        values[name] = evaluate(text, values, name)
    observer = derive_observer(system)
    numbers = {symbol(name): value for name, value in values.items()}
    numbers |= {row.gain: values[f"_gain{place}"] for place, row in enumerate(observer.rows)}
    numbers |= zip((p for row in observer.rows for p in row.estimates), estimates, strict=True)
    numbers |= dict.fromkeys(observer.rates, 0.7)  # u' cancels, so any value will do
    rates = observer.symbolic.right_hand_side
    moving = [*observer.symbolic.states, *observer.symbolic.inputs]
    speeds = [*rates, *observer.rates]
    moved = [
        update + sum(sp.diff(p, x) * rate for x, rate in zip(moving, speeds, strict=True))
        for row in observer.rows
        for p, update in zip(row.outputs, row.updates, strict=True)
    ]
    return np.array([float(cast(sp.Expr, one.xreplace(numbers))) for one in (*rates, *moved)])


@pytest.mark.parametrize("second", ["x2 + x4", "2*x2", "x2 + x2**2"])
def test_map_must_be_triangular(second: str) -> None:
    """Assert that a coordinate must be its state plus a function of earlier states."""
    law = Controller("law", "x1", {"u": "-x4"}, coordinates={
        "s1": "x1", "s2": second, "s3": "x3", "s4": "x4"
    })  # fmt: skip
    with pytest.raises(ModelError, match="s2 must be x2 plus"):
        compose_loop(LoopDeclaration(JOINT, law, sinusoid(1.0, 1.0)))


def test_what_a_loop_leaves_out() -> None:
    """Assert e1' = e2 - k e1, no nominal term in e3', and no observer that needs accelerations."""
    loop = compose_loop(PAPER)
    e1, e2, e3, e4 = loop.variables[:4]
    k, gain1, gain2 = symbol("k"), symbol("gain1"), symbol("gain2")
    assert sp.expand(loop.rates[0] - (e2 - k * e1)) == 0
    assert sp.expand(loop.rates[2] - (e4 - gain2 * e3 + gain1 * loop.rates[1])) == 0
    assert loop.tracking_error == e1
    damped = flexible_joint(("gravity", "joint_damping"), known={"beta1": 10 / 3})
    with pytest.raises(AccelerationError, match="theta_damping"):
        compose_loop(LoopDeclaration(damped, robust_law(), sinusoid(3.0, 5.0)))


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
RIPPLES = ParametricSystem(
    "ripples",
    (
        Row("link", "x", "v", {"spring": "y - x", "gravity": "-sin(x)", "fine": "cos(n*y)"}),
        Row("motor", "y", "w", {"sine": "sin(n*y)", "cosine": "cos(n*y)", "coarse": "tanh(y)"}),
    ),
    nonlinear=("n",),
)
SYSTEMS = {**ALL, "jumps": JUMPS, "two memories": TWO_MEMORIES}
SYSTEMS |= {"costly": COSTLY, "ripples": RIPPLES}


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


def acting(functions, p, at):
    """Return the marks of the blocks of terms: 2 if they act, 1 if they are sought."""
    on = np.zeros(functions["N_BLOCKS"])
    functions["acting"](p, at, on)
    return on


def rates_of(functions, x, u, modes, p, c):
    """Return x' with the terms whose coefficients are not zero."""
    rates = np.empty_like(x)
    on = acting(functions, p, np.zeros(len(p), dtype=np.int64))
    functions["state_rates"](x, u, modes, p, c, on, rates)
    return rates


def slopes_of(functions, system, x, u, du, modes, p, c, at, delay):
    """Return derivatives of the rates of velocities and memories by states and parameters."""
    n = len(system.rows) + len(system.memories)
    a, r = np.zeros(n * len(x)), np.zeros(n * functions["WIDTH"])
    on = acting(functions, p, at)
    functions["slopes"](x, u, du, modes, p, c, on, at, delay, a, r)
    return a.reshape(n, len(x)), r.reshape(n, functions["WIDTH"])


@pytest.mark.parametrize("name", SYSTEMS)
def test_rates_are_the_model_s(plain, name):
    """Assert that x' equals the right-hand side used by all other kernels."""
    system = SYSTEMS[name]
    x, u, modes, p, c = drawn(system, 11)
    expected = np.empty_like(x)
    plain(plain_model(system))["right_hand_side"](x, u, p, c, expected)
    rates = rates_of(plain(sensitivity_functions(system, "Test")), x, u, modes, p, c)
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
    rates = rates_of(functions, x, u, modes, p, c)
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


def test_terms_with_common_functions_are_computed_together(plain):
    """Assert one block for each group of such terms, which acts if any coefficient does."""
    functions = plain(sensitivity_functions(RIPPLES, "Test"))
    p = drawn(RIPPLES, 16)[3]
    places = {name: place for place, name in enumerate(RIPPLES.coefficients)}
    nowhere = np.zeros(len(p), dtype=np.int64)
    for name in ("fine", "sine", "cosine", "coarse"):
        p[places[name]] = 0.0
    assert acting(functions, p, nowhere).tolist() == [0.0, 0.0]
    for name, block in {"fine": 0, "cosine": 0, "coarse": 1}.items():
        used, at = p.copy(), nowhere.copy()
        used[places[name]], at[places[name]] = 1.0, 5
        expected = np.eye(2)[block]
        assert (acting(functions, used, nowhere) == 2.0 * expected).all()
        assert (acting(functions, used, at) == 2.0 * expected).all()
        assert (acting(functions, p, at) == expected).all()
    at = nowhere.copy()
    at[places["n"]] = 5
    assert acting(functions, p, at).tolist() == [1.0, 0.0]


def step_of(functions, system, x, u, modes, p, c, h):
    """Return the stages of a Runge-Kutta step of order 4, and its end."""
    stages, end = [x], x.copy()
    for weight, reach in ((1 / 6, 0.5), (1 / 3, 0.5), (1 / 3, 1.0), (1 / 6, 0.0)):
        rates = rates_of(functions, stages[-1], u, modes, p, c)
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
