"""Closed loops in their controller's coordinates: system, controller, reference and observer.

States of the composed loop are the coordinates z and the estimation errors p̃, with

    z_i = x_i + g_i(z_1 … z_{i-1}, t)              the controller's triangular map,
    p̃' = -c r (rᵀ p̃)                               Huang (2003), eq. (7), row by row.

In plain coordinates (x, y, z) a high-gain loop hides small errors behind large terms; here those
terms cancel while they are still symbols.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import sympy as sp

from flexid.control.loop import LoopDeclaration
from flexid.derivation.loop_signals import Signals, insert
from flexid.derivation.source import IMPORTS, assignments, function
from flexid.derivation.symbolic import SymbolicSystem, symbol, symbolic_system, to_sympy
from flexid.errors import ModelError


@dataclass(frozen=True)
class SymbolicLoop:
    """A closed loop in symbols.

    Parameters
    ----------
    declaration : LoopDeclaration
    signals : Signals
        The functions of time in the expressions below.
    coordinates : tuple of Symbol
        z.
    errors : tuple of Symbol
        p̃.
    map : tuple of Expr
        z as functions of the plain states.
    states, inputs : tuple of Expr
        x and u as functions of z.
    rates : tuple of Expr
        z' and p̃' as functions of z and p̃.
    tracking_error : Expr
        The tracked state minus the reference, as a function of z.
    """

    declaration: LoopDeclaration
    signals: Signals
    coordinates: tuple[sp.Symbol, ...]
    errors: tuple[sp.Symbol, ...]
    map: tuple[sp.Expr, ...]
    states: tuple[sp.Expr, ...]
    inputs: tuple[sp.Expr, ...]
    rates: tuple[sp.Expr, ...]
    tracking_error: sp.Expr


def compose_loop(declaration: LoopDeclaration) -> SymbolicLoop:
    """Compose a closed loop in its controller's coordinates.

    Raises
    ------
    ModelError
        If a coordinate is not its state plus a function of the states before it.
    """
    symbolic = symbolic_system(declaration.system)
    signals, law = _controller(declaration, symbolic)
    coordinates = tuple(symbol(name) for name in declaration.coordinates)
    shifts, states = _invert(declaration, symbolic, coordinates, law)
    plain = dict(zip(symbolic.states, states, strict=True))
    law_inputs = [law[symbol(name)] for name in declaration.system.inputs]
    inputs = tuple(_cancelled(insert(plain, u)) for u in law_inputs)
    known = plain | dict(zip(symbolic.inputs, inputs, strict=True))
    rates: list[sp.Expr] = []
    for shift, velocity in zip(shifts, symbolic.right_hand_side, strict=True):
        # The chain runs through the rates found before, so what cancelled there stays cancelled.
        moved = (sp.diff(shift, z) * rate for z, rate in zip(coordinates, rates, strict=False))
        rates.append(insert(known, velocity) + signals.derivative(shift) + sp.Add(*moved))
    errors, error_rates = _error_dynamics(symbolic, known)
    tracked = plain[symbol(declaration.controller.tracked)]
    return SymbolicLoop(
        declaration,
        signals,
        coordinates,
        errors,
        tuple(law.get(z, z) for z in coordinates),
        states,
        inputs,
        (*rates, *error_rates),
        _cancelled(tracked - signals.reference(0)),
    )


def _controller(
    declaration: LoopDeclaration, symbolic: SymbolicSystem
) -> tuple[Signals, dict[sp.Symbol, sp.Expr]]:
    """The signals, and the law's inputs and coordinates as functions of states and signals."""
    controller = declaration.controller
    signals = Signals(declaration.reference)
    names = {*declaration.system.states, *declaration.system.constants, *controller.parameters}
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
    """The shifts g_i(z_<i, t) of the triangular map, and the states as functions of z."""
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
    symbolic: SymbolicSystem, known: dict[sp.Symbol, sp.Expr]
) -> tuple[tuple[sp.Symbol, ...], list[sp.Expr]]:
    """The estimation errors and their rates, Huang (2003), eq. (7)."""
    errors = tuple(symbol(f"_error_{p}") for p in symbolic.coefficients)
    rates: list[sp.Expr] = []
    for place, row in enumerate(symbolic.rows):
        regressor = [insert(known, r) for r in row.regressor]
        row_errors = errors[len(rates) : len(rates) + len(regressor)]
        innovation = sp.Add(*(r * e for r, e in zip(regressor, row_errors, strict=True)))
        rates += [-symbol(f"_gain{place}") * r * innovation for r in regressor]
    return errors, rates


def _cancelled(expression: sp.Expr) -> sp.Expr:
    """The expression, expanded if a symbol drops out of it that way."""
    expanded = sp.expand(expression)
    return expanded if expanded.free_symbols < expression.free_symbols else expression


def closed_loop_source(declaration: LoopDeclaration) -> str:
    """Source of a closed loop's functions; see `loop_functions`."""
    return loop_functions(compose_loop(declaration))


def loop_functions(loop: SymbolicLoop) -> str:
    """Print the functions of a composed loop.

    Returns
    -------
    str
        A module with the constants N_STATES (of the plain system), N_INPUTS, N_COEFFICIENTS and
        SIZE (of the composed loop) and the functions ``rates``, ``rates_and_jacobian``,
        ``outputs`` (x, u, p̂, p̃ and the tracking error in turn) and ``coordinates_of``.
    """
    state = (*loop.coordinates, *loop.errors)
    size = range(len(state))
    rates = list(loop.rates)
    rate_names = [f"_dz[{i}]" for i in size]
    entries = {
        (i, j): entry for i in size for j in size if (entry := sp.diff(rates[i], state[j])) != 0
    }
    slopes = [loop.signals.derivative(rate) for rate in rates]
    estimates = [
        symbol(p) + error
        for p, error in zip(loop.declaration.system.coefficients, loop.errors, strict=True)
    ]
    outputs = [*loop.states, *loop.inputs, *estimates, *loop.errors, loop.tracking_error]
    plain = [symbol(name) for name in loop.declaration.system.states]
    return "\n\n".join(
        (
            _header(loop),
            _loop_function(
                loop,
                "rates(_t, _z, _p, _dz)",
                "_dz = z' at time _t for the parameters _p.",
                {"_z": state},
                dict(zip(rate_names, rates, strict=True)),
            ),
            _loop_function(
                loop,
                "rates_and_jacobian(_t, _z, _p, _dz, _jacobian, _slope)",
                "_dz = z', _jacobian = ∂z'/∂z (entries that vanish are not touched), "
                "_slope = ∂z'/∂t.",
                {"_z": state},
                dict(zip(rate_names, rates, strict=True))
                | {f"_jacobian[{i}, {j}]": entry for (i, j), entry in entries.items()}
                | {f"_slope[{i}]": slopes[i] for i in size},
            ),
            _loop_function(
                loop,
                "outputs(_t, _z, _p, _y)",
                "_y = plain states, inputs, estimates, their errors, tracking error.",
                {"_z": state},
                {f"_y[{i}]": expression for i, expression in enumerate(outputs)},
            ),
            _loop_function(
                loop,
                "coordinates_of(_t, _x, _p, _z)",
                "_z = the loop's coordinates of the plain states _x.",
                {"_x": plain},
                {f"_z[{i}]": expression for i, expression in enumerate(loop.map)},
            ),
        )
    )


def _header(loop: SymbolicLoop) -> str:
    system = loop.declaration.system
    law = loop.declaration.controller.name
    return f'''"""{law!r} in the loop with {system.name!r}. Generated by flexid; edits are lost.

coordinates  {", ".join(map(str, loop.coordinates))}
errors of    {", ".join(system.coefficients)}
parameters   {", ".join(loop.declaration.parameter_names)}
"""

{IMPORTS}

import numpy as np
from numba import njit, prange

N_STATES = {len(system.states)}
N_INPUTS = {len(system.inputs)}
N_COEFFICIENTS = {len(system.coefficients)}
SIZE = {len(loop.coordinates) + len(loop.errors)}
'''


def _loop_function(
    loop: SymbolicLoop,
    signature: str,
    docstring: str,
    arrays: dict[str, Sequence[sp.Symbol]],
    results: dict[str, sp.Expr],
) -> str:
    used = set().union(*(expression.free_symbols for expression in results.values()))
    signals, used = loop.signals.assignments(used)
    arrays = arrays | {"_p": [symbol(name) for name in loop.declaration.parameter_names]}
    reads = [
        f"    {name} = {array}[{place}]"
        for array, names in arrays.items()
        for place, name in enumerate(names)
        if name in used
    ]
    if symbol("t") in used:
        reads.append("    t = _t")
    body = assignments(list(results), list(results.values()))
    return function(signature, docstring, "\n".join(reads), signals, body)
