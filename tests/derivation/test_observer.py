"""Immersions, the observer of Huang (2003), eqs. (2), (3) and (7), and printed code."""

import ctypes
import math
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import quad
from systems import ALL, NO_CLOSED_FORM, PAPER, THREE_ROWS, UNKNOWN_GAIN
from tests.exports.drive import STRICT, run, tool

from flexid.derivation.model_functions import signal_module, split_regressor
from flexid.derivation.source import ScalarPrinter
from flexid.derivation.symbolic import symbol, symbolic_system, to_sympy
from flexid.errors import AccelerationError, ExpressionError
from flexid.models.flexible_joint import TERMS, flexible_joint
from flexid.models.parametric_system import ParametricSystem, Row
from flexid.paper.observer import derive_observer, error_dynamics, graded_rule, immersion
from flexid.paper.printing import c_observer, latex_observer, python_observer

q, v, width = symbol("q"), symbol("v"), symbol("width")

CLOSED = {
    "1": "v",
    "q": "q*v",
    "-v": "-v**2/2",
    "(q + v)**2": "q**2*v + q*v**2 + v**3/3",
    "sign(v)": "Abs(v)",
    "v*abs(v)": "v**2*Abs(v)/3",
    "tanh(10*v)": "LogCosh(10*v)/10",
    "tanh(v/width)*q": "q*width*LogCosh(v/width)",
    "tanh(v + q)*q": "q*(-LogCosh(q) + LogCosh(q + v))",
}

QUADRATURE = ["exp(-v**2)*tanh(v)", "cos(q*v)", "tanh(q*v)", "v/abs(q - v)"]


@pytest.mark.parametrize("text", CLOSED)
def test_closed_form(text: str):
    """Assert the antiderivative found by hand, and the value of its integral."""
    regressor = to_sympy(text, {"q", "v", "width"})
    found = immersion(regressor, v, [width])
    assert str(found) == CLOSED[text]
    values: dict[Any, Any] = {q: 0.7, width: 0.3}
    printed = sp.lambdify(v, found.subs(values), "math", printer=ScalarPrinter)
    integrand = sp.lambdify(v, regressor.subs(values), "math")
    for end in (-300.0, -2.5, -1e-3, 0.0, 1e-3, 2.5, 300.0):
        breaks = sorted(math.copysign(p, end) for p in (1.0, 10.0, 100.0) if p < abs(end))
        wanted, _ = quad(integrand, 0.0, end, points=breaks or None, epsabs=1e-12, epsrel=1e-10)
        assert printed(end) == pytest.approx(wanted, rel=1e-9, abs=1e-11)


@pytest.mark.parametrize("text", QUADRATURE)
def test_quadrature_where_no_plain_closed_form(text: str):
    """Assert that a regressor without a closed form that is valid everywhere stays an integral."""
    assert immersion(to_sympy(text, {"q", "v"}), v).has(sp.Integral)


@pytest.mark.parametrize(
    "text", ["1/0", "q/0", "0/0*q", "q**(1/0)", "sqrt(-1)*q", "(-8)**(1/3)", "tan(pi/2) + q"]
)
def test_no_finite_real_value(text: str):
    """Assert that an expression without any finite real value is refused with its place."""
    with pytest.raises(ExpressionError, match=r"here: .*no finite real value"):
        to_sympy(text, {"q"}, "here")


JOINT = symbolic_system(flexible_joint(TERMS))
X1, X2, X3, X4, U = (symbol(name) for name in ("x1", "x2", "x3", "x4", "u"))


PARTS = {
    "positions and inputs": (sp.sin(X1) * X3 + U**2, sp.sin(X1) * X3 + U**2, (0, 0), 0),
    "the joint's damping": (3 * X1 + X2 - X4, 3 * X1, (1, -1), 0),
    "a product": (X2 * sp.cos(X1) + X2 * (X1 + 1), 0, (1, 0), X2 * sp.cos(X1) + X1 * X2),
    "a bracket": ((X1 + X2) ** 2, X1**2, (0, 0), 2 * X1 * X2 + X2**2),
}
"""Regressor; by hand its memoryless part, factors of velocities, and the remainder."""


@pytest.mark.parametrize("case", PARTS)
def test_parts(case):
    """Assert that a regressor is split, term by term, by its dependence on velocities."""
    regressor, *expected = PARTS[case]
    parts = split_regressor(regressor, JOINT)
    assert [parts.memoryless, parts.velocity_factors, parts.remainder] == expected


@pytest.mark.parametrize(
    ("system", "name", "value"),
    [
        (flexible_joint(), "VELOCITY_NEEDED", "()"),
        (flexible_joint(TERMS), "VELOCITY_NEEDED", "('theta_coulomb', 'alpha_coulomb')"),
        (NO_CLOSED_FORM, "HELD", "(False, False, False, True)"),  # the known part has an input
        (THREE_ROWS, "N_SIGNALS", str(len(THREE_ROWS.coefficients) + 3)),
    ],
)
def test_what_is_emitted(system, name, value):
    """Assert that velocities are required only if needed, and the hold only if it matters."""
    lines = signal_module(system).splitlines()
    assert f"{name} = {value}" in lines


@pytest.mark.parametrize("name", ALL)
def test_error_dynamics_are_equation_7(name: str):
    """Assert that inserting (1) into p̂' leaves -c r rᵀ p̃ for symbolic gains."""
    observer = derive_observer(ALL[name])
    for row, derived in zip(observer.rows, error_dynamics(observer), strict=True):
        regressor = row.row.regressor
        product = sp.Add(*(r * e for r, e in zip(regressor, row.errors, strict=True)))
        for found, r in zip(derived, regressor, strict=True):
            # At z = 0 alone sign(z) is not |z|/z; simplify needs minutes to see the rest.
            apart = (found + row.gain * r * product).replace(sp.sign, lambda z: sp.Abs(z) / z)
            assert sp.simplify(sp.expand(apart)) == 0


@pytest.mark.parametrize(
    ("system", "quadratures", "rates"),
    [
        (PAPER, (), []),
        (NO_CLOSED_FORM, ("stribeck",), []),
        (UNKNOWN_GAIN, (), ["u_rate"]),
        (THREE_ROWS, (), ["u2_rate"]),  # of two inputs only the one in a regressor
    ],
)
def test_what_an_observer_needs_is_reported(system, quadratures, rates):
    """Assert that exactly the integrals by quadrature and the required input rates are named."""
    observer = derive_observer(system)
    assert observer.quadratures == quadratures
    assert [str(rate) for rate in observer.input_rates] == rates


def test_names_of_the_model_are_left_to_it():
    """Assert that a model may use the names y1, c1 or u_rate."""
    system = ParametricSystem(
        "clash", (Row("arm", "y1", "c1", {"a": "-y1*u", "a_hat": "u_rate"}),), ("u", "u_rate")
    )
    row = derive_observer(system).rows[0]
    assert (str(row.gain), str(row.intermediate[0])) == ("c1_", "y1_")
    assert [str(p) for p in row.estimates] == ["a_hat_", "a_hat_hat"]
    assert str(derive_observer(system).rates[0]) == "u_rate_"


REFUSED = ("1/v", "q/v**2", "v/abs(v)", "1/sqrt(abs(v))", "sign(q)*v", "sign(u)", "q - q", "v*2")


def test_what_cannot_be_integrated_is_refused(refusals: Any):
    """Assert that regressors without a valid integral, and accelerations, are refused."""

    def derived(regressor: str) -> Any:
        row = Row("arm", "q", "v", {"a": regressor, "b": "-2*v"})
        return derive_observer(ParametricSystem("arm", (row,)))

    damped = partial(derive_observer, flexible_joint(("joint_damping",)))
    refusals({one: partial(derived, one) for one in REFUSED} | {"a damped joint": damped})
    with pytest.raises(AccelerationError) as caught:
        damped()
    error = caught.value
    assert (error.row, error.coefficient, error.velocity) == ("link", "theta_damping", "x4")


@pytest.mark.parametrize("regressor", ["q/(1 + v**2)", "1/q", "sign(v)*exp(-(v/0.1)**2)", "u/q*v"])
def test_regressor_with_value_at_rest_is_derived(regressor: str):
    """Assert that regressors with other divisions, finite at rest, are accepted."""
    derive_observer(ParametricSystem("rest", (Row("arm", "q", "v", {"a": regressor}),)))


PRINTERS = {"latex": (latex_observer, "tex"), "python": (python_observer, "py.txt")}
PRINTERS |= {"c": (c_observer, "c")}

GOLDEN = Path(__file__).parent / "golden"


@pytest.mark.parametrize("target", PRINTERS)
@pytest.mark.parametrize("name", ["paper", "unknown input gain", "three rows"])
def test_golden_text(target: str, name: str, request: pytest.FixtureRequest):
    """Assert that the printed equations equal the reviewed golden files."""
    printer, suffix = PRINTERS[target]
    printed = printer(derive_observer(ALL[name]))
    file = GOLDEN / f"{name.replace(' ', '_')}.{suffix}"
    if request.config.getoption("--update-golden"):
        file.write_text(printed, encoding="utf-8")
    assert printed == file.read_text("utf-8")


def symbolic_values(observer: Any) -> tuple[list[np.ndarray], list, list]:
    """Return random inputs of an observer, and values of (2) and (3) with integrals by SymPy."""
    rng, symbolic = np.random.default_rng(7), observer.symbolic
    signals = (
        symbolic.states,
        symbolic.inputs,
        observer.rates if observer.input_rates else (),
        [y for row in observer.rows for y in row.intermediate],
    )
    constants = (observer.gains, symbolic.constants)
    values = [rng.normal(size=len(group)) for group in signals]
    values += [rng.uniform(0.5, 2.0, len(group)) for group in constants]
    named = [symbol for group in (*signals, *constants) for symbol in group]
    point: dict[Any, Any] = dict(zip(named, np.concatenate(values).tolist(), strict=True))
    estimates = [float(e.subs(point).evalf()) for row in observer.rows for e in row.outputs]
    hats = [p for row in observer.rows for p in row.estimates]
    point |= dict(zip(hats, estimates, strict=True))
    rates = [float(e.subs(point).evalf()) for row in observer.rows for e in row.updates]
    return values, estimates, rates


@pytest.fixture(scope="module")
def compile_c(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], ctypes.CDLL]:
    """Return a function that compiles C99, with warnings as errors, and loads it."""

    def build(source: str) -> ctypes.CDLL:
        file = tmp_path_factory.mktemp("c") / "observer.c"
        file.write_text(source, encoding="utf-8")
        library = file.with_suffix(".so")
        run(tool("gcc"), *STRICT, "-O1", "-shared", "-fPIC", file, "-lm", "-o", library)
        return ctypes.CDLL(str(library))

    return build


def call_c(function, values: list[np.ndarray], size: int) -> np.ndarray:
    """Call one printed C function."""
    result = np.empty(size)
    pointer = ctypes.POINTER(ctypes.c_double)
    function.restype = None
    function(*(a.ctypes.data_as(pointer) for a in (*values, result)))
    return result


AWKWARD = ParametricSystem(
    "awkward names",
    (
        Row(
            "arm",
            "double",
            "θ",
            {"s": "-double*θ", "sum": "gains*sign(θ)", "estimates": "exp(-θ**2)*tanh(θ)"},
            known="zip*int",
        ),
    ),
    inputs=("zip", "int"),
    constants={"gains": 1.0},
)


@pytest.mark.parametrize("system", [*ALL.values(), AWKWARD], ids=[*ALL, "awkward names"])
def test_printed_functions_have_the_symbolic_values(system: ParametricSystem, compile_c: Any):
    """Assert that printed Python and C compute (2) and (3), for any names, without warnings."""
    observer = derive_observer(system)
    values, estimates, rates = symbolic_values(observer)
    namespace: dict = {}
    exec(compile(python_observer(observer), "printed", "exec"), namespace)
    arguments = [v.tolist() for v in values if len(v)]
    assert namespace["estimates"](*arguments) == pytest.approx(estimates, rel=1e-9)
    assert namespace["rates"](*arguments) == pytest.approx(rates, rel=1e-9)
    library, size = compile_c(c_observer(observer)), len(estimates)
    found = call_c(library.observer_estimates, values, size)
    assert found == pytest.approx(estimates, rel=1e-9)
    assert call_c(library.observer_rates, values, size) == pytest.approx(rates, rel=1e-9)


@pytest.mark.parametrize("width", [0.02, 0.1, 1.0, 10.0])
@pytest.mark.parametrize("velocity", [-10.0, 0.3, 10.0])
def test_quadrature_error_of_friction_curves(width: float, velocity: float):
    """Assert an error below 1e-7 for Stribeck curves down to 1/500 of the velocity."""
    nodes, weights = graded_rule()

    def curve(v: float | np.ndarray) -> Any:
        return np.exp(-((v / width) ** 2)) * np.tanh(3 * v / width)

    end = min(abs(velocity), 7 * width)
    wanted, _ = quad(curve, 0.0, end, epsabs=1e-14, epsrel=1e-12, limit=200)
    found = velocity * weights @ curve(velocity * nodes)
    assert found == pytest.approx(wanted, rel=1e-7)  # the curve is even in v
