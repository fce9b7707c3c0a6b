"""Derivation and source of closed loops, in the coordinates of their controller."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from textwrap import indent

import sympy as sp

from flexid.derivation.model_functions import module_header
from flexid.derivation.source import assignments, function
from flexid.derivation.symbolic import SymbolicSystem, symbol, symbolic_system, to_sympy
from flexid.errors import ModelError
from flexid.paper.laws import REFERENCE_NAMES
from flexid.paper.loop import LoopDeclaration, Multisine
from flexid.paper.observer import check_acceleration_free


def insert(values: Mapping[sp.Symbol, sp.Expr], expression: sp.Expr) -> sp.Expr:
    """Replace symbols by values, all at once, with SymPy's automatic simplifications."""
    result = expression.xreplace(dict(values))
    assert isinstance(result, sp.Expr)
    return result


# The states of the composed loop are the coordinates z and the estimation errors p̃, with
#     z_i = x_i + g_i(z_1 … z_{i-1}, t)              the controller's triangular map,
#     p̃' = -c r (rᵀ p̃)                               Huang (2003), eq. (7), row by row.
# In plain coordinates small errors of a high-gain loop are differences of large terms. In these the
# large terms cancel symbolically, also where one signal is another's derivative (w2N = w1N').
class Signals:
    """Functions of time: reference, derivatives, and definitions, each one symbol."""

    def __init__(self, reference: Multisine) -> None:
        names = {"t", *reference.parameters}
        self._reference = to_sympy(reference.expression, names, "reference")
        self._values: dict[sp.Symbol, sp.Expr] = {}
        self._rates: dict[sp.Symbol, sp.Expr] = {}

    @staticmethod
    def reference(order: int) -> sp.Symbol:
        """Return the symbol of the reference's derivative of an order."""
        # Time derivatives contain higher orders than a controller may use.
        return symbol(REFERENCE_NAMES[order] if order < len(REFERENCE_NAMES) else f"_qd_{order}")

    def add(self, name: sp.Symbol, value: sp.Expr) -> None:
        """Add a function of the reference, its derivatives, parameters and earlier signals."""
        self._values[name] = insert(self._values, value)

    def derivative(self, expression: sp.Expr) -> sp.Expr:
        """Return the time derivative; symbols other than signals are constant."""
        return sp.Add(*(sp.diff(expression, s) * self._rate(s) for s in self._in(expression)))

    def assignments(self, used: Collection[sp.Basic]) -> tuple[str, set[sp.Basic]]:
        """Return the lines that compute the used signals, and all symbols used with them."""
        values = {s: v for s, v in self._values.items() if s in used}
        needed = set(used).union(*(v.free_symbols for v in values.values()))
        orders = [order for order in range(20) if self.reference(order) in needed]
        time = symbol("t")
        references = [sp.diff(self._reference, time, order) for order in orders]
        needed |= set().union(*(r.free_symbols for r in references))
        blocks = [
            assignments([str(self.reference(order)) for order in orders], references),
            assignments([str(s) for s in values], list(values.values())),
        ]
        return "\n".join(
            b for b, some in zip(blocks, (orders, values), strict=True) if some
        ), needed

    def _in(self, expression: sp.Expr) -> list[sp.Symbol]:
        found = (s for s in expression.free_symbols if isinstance(s, sp.Symbol))
        return sorted((s for s in found if s in self._values or self._order(s) >= 0), key=str)

    def _order(self, name: sp.Basic) -> int:
        orders = (order for order in range(20) if name == self.reference(order))
        return next(orders, -1)

    def _rate(self, signal: sp.Symbol) -> sp.Expr:
        if signal not in self._values:
            return self.reference(self._order(signal) + 1)
        if signal not in self._rates:
            value = self.derivative(self._values[signal])
            self._rates[signal] = self._named(value, symbol(f"_d_{signal}"))
        return self._rates[signal]

    def _named(self, value: sp.Expr, name: sp.Symbol) -> sp.Expr:
        """Return the signal with this value; add a new one if necessary."""
        if sp.expand(value) == 0:
            return sp.S.Zero
        for signal, known in self._values.items():
            if sp.expand(known - value) == 0:
                return signal
        self.add(name, value)
        return name


@dataclass(frozen=True)
class SymbolicLoop:
    """Closed loop in symbols."""

    declaration: LoopDeclaration
    signals: Signals  # the functions of time in the expressions below
    # variables of the integration: coordinates of the plant, then the estimation errors
    variables: tuple[sp.Symbol, ...]
    # the variables as functions of the plain states and of `start_estimates`
    start: tuple[sp.Expr, ...]
    # time derivatives of the variables; these and all below are functions of the variables
    rates: tuple[sp.Expr, ...]
    states: tuple[sp.Expr, ...]  # x
    inputs: tuple[sp.Expr, ...]  # u
    estimates: tuple[sp.Expr, ...]  # p̂
    errors: tuple[sp.Expr, ...]  # p̃
    tracking_error: sp.Expr  # the tracked state minus the reference
    regressors: tuple[sp.Expr, ...]  # r of all rows in turn


def start_estimates(symbolic: SymbolicSystem) -> tuple[sp.Symbol, ...]:
    """Return the symbols of the initial estimates."""
    return tuple(symbol(f"_start_{p}") for p in symbolic.coefficients)


def compose_loop(declaration: LoopDeclaration) -> SymbolicLoop:
    """Derive a closed loop in its controller's coordinates."""
    symbolic = symbolic_system(declaration.system)
    check_acceleration_free(symbolic)
    signals, law = control_law(declaration, symbolic)
    coordinates = tuple(symbol(name) for name in declaration.coordinates)
    shifts, states = _invert(declaration, symbolic, coordinates, law)
    plain = dict(zip(symbolic.states, states, strict=True))
    law_inputs = [law[symbol(name)] for name in declaration.system.inputs]
    inputs = tuple(_cancelled(insert(plain, u)) for u in law_inputs)
    known = plain | dict(zip(symbolic.inputs, inputs, strict=True))
    rates: list[sp.Expr] = []
    for shift, velocity in zip(shifts, symbolic.right_hand_side, strict=True):
        # The chain rule uses the earlier rates, in which terms are already cancelled.
        moved = (sp.diff(shift, z) * rate for z, rate in zip(coordinates, rates, strict=False))
        rates.append(insert(known, velocity) + signals.derivative(shift) + sp.Add(*moved))
    regressors = [[insert(known, r) for r in row.regressor] for row in symbolic.rows]
    errors, error_rates = _error_dynamics(symbolic, regressors)
    true = symbolic.coefficients
    start_errors = (s - p for s, p in zip(start_estimates(symbolic), true, strict=True))
    tracked = plain[symbol(declaration.controller.tracked)]
    return SymbolicLoop(
        declaration,
        signals,
        (*coordinates, *errors),
        (*(law.get(z, z) for z in coordinates), *start_errors),
        (*rates, *error_rates),
        states,
        inputs,
        tuple(p + error for p, error in zip(true, errors, strict=True)),
        errors,
        _cancelled(tracked - signals.reference(0)),
        tuple(r for row in regressors for r in row),
    )


def control_law(
    declaration: LoopDeclaration, symbolic: SymbolicSystem
) -> tuple[Signals, dict[sp.Symbol, sp.Expr]]:
    """Return the signals, and the law's inputs and coordinates in terms of states and signals."""
    controller = declaration.controller
    signals = Signals(declaration.reference)
    names = {*declaration.system.states, *declaration.system.constants, *controller.parameters}
    names |= set(controller.derived)
    names |= {str(signals.reference(order)) for order in range(5)}
    inlined: dict[sp.Symbol, sp.Expr] = {}
    for name, text in controller.definitions.items():
        value = insert(inlined, to_sympy(text, names, f"{controller.name}: {name}"))
        if value.free_symbols.isdisjoint(symbolic.states):
            signals.add(symbol(name), value)
        else:
            inlined[symbol(name)] = value
        names.add(name)
    law = {
        symbol(name): insert(inlined, to_sympy(text, names, f"{controller.name}: {name}"))
        for name, text in {**controller.inputs, **controller.coordinates}.items()
    }
    return signals, law


def _invert(
    declaration: LoopDeclaration,
    symbolic: SymbolicSystem,
    coordinates: Sequence[sp.Symbol],
    law: dict[sp.Symbol, sp.Expr],
) -> tuple[list[sp.Expr], tuple[sp.Expr, ...]]:
    """Return the shifts g_i(z_<i, t) of the triangular map, and the states in terms of z."""
    shifts: list[sp.Expr] = []
    states: dict[sp.Symbol, sp.Expr] = {}
    for place, (state, z) in enumerate(zip(symbolic.states, coordinates, strict=True)):
        shift = sp.expand(law.get(z, state)) - state
        if not shift.free_symbols.isdisjoint(symbolic.states[place:]):
            raise ModelError(
                declaration.controller.name,
                f"the coordinate {z} must be {state} plus a function of the states before it",
            )
        shift = _cancelled(insert(states, law.get(z, state) - state))
        shifts.append(shift)
        states[state] = z - shift
    return shifts, tuple(states.values())


def _error_dynamics(
    symbolic: SymbolicSystem, regressors: Sequence[Sequence[sp.Expr]]
) -> tuple[tuple[sp.Symbol, ...], list[sp.Expr]]:
    """Return the estimation errors and their rates, Huang (2003), eq. (7)."""
    errors = tuple(symbol(f"_error_{p}") for p in symbolic.coefficients)
    rates: list[sp.Expr] = []
    for place, regressor in enumerate(regressors):
        row_errors = errors[len(rates) : len(rates) + len(regressor)]
        innovation = sp.Add(*(r * e for r, e in zip(regressor, row_errors, strict=True)))
        rates += [-symbol(f"_gain{place}") * r * innovation for r in regressor]
    return errors, rates


def _cancelled(expression: sp.Expr) -> sp.Expr:
    """Return the expression, expanded if that cancels a symbol."""
    expanded = sp.expand(expression)
    return expanded if expanded.free_symbols < expression.free_symbols else expression


def stiff_loop_source(loop: SymbolicLoop) -> str:
    """Print the functions of a loop for an implicit integrator."""
    size = range(len(loop.variables))
    rates = {f"_dz[{i}]": rate for i, rate in enumerate(loop.rates)}
    jacobian = {
        f"_jacobian[{i}, {j}]": sp.diff(loop.rates[i], loop.variables[j])
        for i in size
        for j in size
        if loop.rates[i].has(loop.variables[j])
    }
    slopes = {f"_slope[{i}]": loop.signals.derivative(rate) for i, rate in enumerate(loop.rates)}
    printed = partial(loop_function, loop.declaration, loop.signals)
    variables = {"_z": loop.variables}
    functions = (
        printed(
            "rates(_t, _z, _p, _dz)",
            "_dz = z' at time _t for the parameters _p.",
            variables,
            rates,
        ),
        printed(
            "rates_and_jacobian(_t, _z, _p, _dz, _jacobian, _slope)",
            "_dz = z', _jacobian = ∂z'/∂z (zeros are not written), _slope = ∂z'/∂t.",
            variables,
            rates | jacobian | slopes,
        ),
    )
    return "\n\n".join((_loop_source(loop), *functions))


# Fused multiply-add instructions are faster, and no less accurate.
_FUSED = (
    'njit(error_model="numpy", fastmath={"contract"}, no_cpython_wrapper=True, '
    "no_cfunc_wrapper=True)"
)


def lane_loop_source(loop: SymbolicLoop, lanes: int) -> str:
    """Print the functions of a loop for several runs at once; see the template ``dopri5``."""
    observed = [*loop.inputs, *loop.errors, loop.tracking_error, *loop.regressors]
    parts = {"RATES": loop.rates, "NEXT_OBSERVED": observed}
    rates, outputs = (
        {_of_lane(start).format(i): value for i, value in enumerate(expressions)}
        for start, expressions in parts.items()
    )
    places = {
        _of_lane("STAGE"): loop.variables,
        _of_lane("PARAMETERS"): parameters(loop.declaration),
    }

    def function_of_lanes(name: str, what: str, results: Mapping[str, sp.Expr]) -> str:
        body = _body(loop.signals, places, "_w[at(STAGE_TIME, _lane)]", results)
        body = "    for _lane in range(LANES):\n" + indent(body, "    ")
        what = f"{what} at every lane's STAGE and STAGE_TIME."
        return function(f"{name}(_w)", what, body, decorator=_FUSED)

    return "\n\n".join(
        (
            _loop_source(loop) + f"\nN_OBSERVED = {len(observed)}\nLANES = {lanes}\n",
            function_of_lanes("lane_rates", "RATES", rates),
            function_of_lanes("lane_rates_and_outputs", "RATES and NEXT_OBSERVED", rates | outputs),
        )
    )


def _of_lane(start: str) -> str:
    """Return the format of the place of a block's number in a lane."""
    return f"_w[at({start} + {{}}, _lane)]"


def _loop_source(loop: SymbolicLoop) -> str:
    """Print the functions of a loop for any integrator: outputs and start."""
    outputs = [*loop.states, *loop.inputs, *loop.estimates, *loop.errors, loop.tracking_error]
    outputs += loop.regressors
    symbolic = symbolic_system(loop.declaration.system)
    printed = partial(loop_function, loop.declaration, loop.signals)
    functions = (
        printed(
            "outputs(_t, _z, _p, _y)",
            "_y = plain states, inputs, estimates, their errors, tracking error, regressors.",
            {"_z": loop.variables},
            {f"_y[{i}]": expression for i, expression in enumerate(outputs)},
        ),
        printed(
            "start(_t, _x, _estimates, _p, _z)",
            "_z from the plain states _x and the estimates.",
            {"_x": symbolic.states, "_estimates": start_estimates(symbolic)},
            {f"_z[{i}]": expression for i, expression in enumerate(loop.start)},
        ),
    )
    return "\n\n".join((_header(loop), *functions))


def _header(loop: SymbolicLoop) -> str:
    declaration = loop.declaration
    head = module_header(declaration.system, f"Closed loop with {declaration.controller.name!r}")
    starts = (0, *(part.stop for _, part in declaration.system.row_slices()))
    return f"""{head}
# variables   {", ".join(map(str, loop.variables))}
# parameters  {", ".join(declaration.parameter_names)}
N_PARAMETERS = {len(declaration.parameter_names)}
SIZE = {len(loop.variables)}
ROW_STARTS = {starts}
"""


def loop_function(
    declaration: LoopDeclaration,
    signals: Signals,
    signature: str,
    docstring: str,
    arrays: Mapping[str, Sequence[sp.Symbol]],
    results: Mapping[str, sp.Expr],
    last: str = "",
) -> str:
    """Print a compiled function of time, arrays and the loop's parameters ``_p``."""
    every = {**arrays, "_p": parameters(declaration)}
    places = {f"{array}[{{}}]": names for array, names in every.items()}
    return function(signature, docstring, _body(signals, places, "_t", results), last)


def parameters(declaration: LoopDeclaration) -> list[sp.Symbol]:
    """Return the symbols of a loop's parameters, in order."""
    return [symbol(name) for name in declaration.parameter_names]


def _body(
    signals: Signals,
    places: Mapping[str, Sequence[sp.Symbol]],  # symbols by the text that gets their number
    time: str,
    results: Mapping[str, sp.Expr],
) -> str:
    """Return a function's lines: reads of the used symbols, signals, then results."""
    used = set().union(*(expression.free_symbols for expression in results.values()))
    lines, used = signals.assignments(used)
    found = {s: place.format(i) for place, names in places.items() for i, s in enumerate(names)}
    found[symbol("t")] = time
    reads = [f"    {name} = {place}" for name, place in found.items() if name in used]
    body = assignments(list(results), list(results.values()))
    return "\n".join(block for block in ("\n".join(reads), lines, body) if block)
