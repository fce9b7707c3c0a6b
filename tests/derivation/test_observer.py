"""The observer for the whole class, Huang (2003), eqs. (2), (3) and (7), and printed code."""

import ctypes
import shutil
import subprocess
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import quad
from systems import ALL, NO_CLOSED_FORM, PAPER, THREE_ROWS, UNKNOWN_GAIN

from flexid.errors import AccelerationError
from flexid.models.flexible_joint import flexible_joint
from flexid.models.parametric_system import ParametricSystem, Row
from flexid.paper.observer import SymbolicObserver, derive_observer, error_dynamics, graded_rule
from flexid.paper.printing import c_observer, latex_observer, python_observer


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

    def derived(regressor: str) -> SymbolicObserver:
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


def symbolic_values(observer: SymbolicObserver) -> tuple[list[np.ndarray], list, list]:
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
    compiler = shutil.which("gcc")
    if compiler is None:
        pytest.skip("there is no gcc to compile the printed C with")

    def build(source: str) -> ctypes.CDLL:
        folder = tmp_path_factory.mktemp("c")
        (folder / "observer.c").write_text(source, encoding="utf-8")
        options = "-std=c99 -pedantic -Wall -Wextra -Werror -O1 -shared -fPIC -o observer.so"
        command = [compiler, *options.split(), "observer.c", "-lm"]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        return ctypes.CDLL(str(folder / "observer.so"))

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
def test_printed_functions_have_the_symbolic_values(
    system: ParametricSystem, compile_c: Callable[[str], ctypes.CDLL]
):
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
