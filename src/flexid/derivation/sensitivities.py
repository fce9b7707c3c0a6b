"""Source of a model's motion together with its exact derivatives: the variational equations.

With x' = f(x, u, p), the derivatives of x with respect to the state s at the start of a segment
and to the coefficients p obey

    (∂x/∂s)' = (∂f/∂x) ∂x/∂s,    (∂x/∂p)' = (∂f/∂x) ∂x/∂p + ∂f/∂p.

All of them are the columns of one matrix: first x, then ∂x/∂s, then ∂x/∂p. Coefficients that
are not sought need no column. One more column may hold the derivative by the delay of the inputs,
whose source is (∂f/∂u) du, with du the derivative of the inputs by that delay.

The sign of a row's own velocity is the row's *mode*, which the kernel sets: a dry friction is
smooth while the joint slides to one side.

A memory follows the direction of its path. While the path q does not turn it is a function of it,

    h = d + (h0 - d) exp(-s |q - q0|),    d the direction,

whatever the velocity. So a step of the integrator takes it from the path, and no reach however
short makes the equations stiff.
"""

from dataclasses import replace
from typing import cast

import sympy as sp

from flexid.derivation.model_functions import module_header
from flexid.derivation.source import assignments, function, unpack
from flexid.derivation.symbolic import SymbolicSystem, symbolic_system
from flexid.models.parametric_system import ParametricSystem

KNOWN = -1
"""Stands in ``DRY`` for a known part with dry friction, which has no coefficient."""


def sensitivity_functions(system: ParametricSystem, purpose: str) -> str:
    """Header, ``DRY``, ``remember(z, start, p, at)`` and ``variation_rates(z, u, ..., dz)``.

    Parameters
    ----------
    system : ParametricSystem
        Any model.
    purpose : str
        First words of the module's docstring.

    Returns
    -------
    str
        A module with the sizes of the model and ``variation_rates(z, u, du, m, p, c, at, delay,
        dz)``, which fills dz = z' for the matrix z of shape (N_STATES, n_columns); at[i] is the
        column of coefficient i, or 0 if it has none, `delay` that of the inputs' delay, m[j] the
        mode of row j. ``DRY[j]`` holds the places of the coefficients of row j that multiply its
        mode, and `KNOWN` if its known part does. ``remember`` fills the memories of z from its
        positions and from all that was at the start of a step. A z of one column is x alone.
    """
    symbolic = _with_modes(symbolic_system(system))
    parts = (_dry(symbolic), _remember(symbolic), _variation_rates(symbolic))
    return "\n\n".join((module_header(system, purpose), *parts))


def _mode(place: int) -> sp.Symbol:
    return sp.Symbol(f"_m{place}", real=True)


def _with_modes(symbolic: SymbolicSystem) -> SymbolicSystem:
    """The same with the mode of each row in the place of its velocity's sign."""
    modes = [(sp.sign(row.velocity), _mode(j)) for j, row in enumerate(symbolic.rows)]
    rows = tuple(
        replace(
            row,
            regressor=tuple(cast(sp.Expr, r.subs(modes)) for r in row.regressor),
            known=cast(sp.Expr, row.known.subs(modes)),
        )
        for row in symbolic.rows
    )
    return replace(symbolic, rows=rows)


def _dry(symbolic: SymbolicSystem) -> str:
    places, first = [], 0
    for j, row in enumerate(symbolic.rows):
        own = [first + i for i, r in enumerate(row.regressor) if r.has(_mode(j))]
        places.append((*own, *([KNOWN] if row.known.has(_mode(j)) else [])))
        first += len(row.regressor)
    return f"DRY = {tuple(places)!r}\n"


def _remember(symbolic: SymbolicSystem) -> str:
    grips = len(symbolic.coefficients) - len(symbolic.memories)
    blocks = []
    for m, memory in enumerate(symbolic.memories):
        place, grip = 2 * len(symbolic.rows) + m, grips + m
        slopes = {
            2 * j: float(cast(sp.Expr, sp.diff(memory.path, row.coordinate)))
            for j, row in enumerate(symbolic.rows)
            if memory.path.has(row.coordinate)
        }
        path = " + ".join(f"{a!r} * (_z[{i}, _j] - _start[{i}, _j])" for i, a in slopes.items())
        blocks.append(
            f"    _path = {path.replace('_j]', '0]')}\n"
            f"    _d = copysign(1.0, _path)\n"
            f"    _e = exp(-_p[{grip}] * abs(_path))\n"
            f"    _left = (_start[{place}, 0] - _d) * _e\n"
            f"    _z[{place}, 0] = _d + _left\n"
            f"    for _j in range(1, _z.shape[1]):\n"
            f"        _step = {path}\n"
            f"        _z[{place}, _j] = _e * _start[{place}, _j]\n"
            f"        _z[{place}, _j] -= _left * _d * _p[{grip}] * _step\n"
            f"    if _z.shape[1] > 1 and _at[{grip}]:\n"
            f"        _z[{place}, _at[{grip}]] -= _left * abs(_path)"
        )
    return function(
        "remember(_z, _start, _p, _at)",
        "Memories in every column of _z after the path from _start.  # Dahl (1968)",
        "\n".join(blocks) or "    pass",
    )


def _variation_rates(symbolic: SymbolicSystem) -> str:
    targets: list[str] = []
    expressions: list[sp.Expr] = []
    loop, sources, delayed = [], [], []
    coefficient = 0
    for j, row in enumerate(symbolic.rows):
        jacobian = {
            place: derivative(row.acceleration, state)
            for place, state in enumerate(symbolic.states)
            if row.acceleration.has(state)
        }
        targets += [f"_dz[{2 * j + 1}, 0]", *(f"_a{j}_{place}" for place in jacobian)]
        expressions += [row.acceleration, *jacobian.values()]
        gains = {i: derivative(row.acceleration, u) for i, u in enumerate(symbolic.inputs)}
        gains = {i: gain for i, gain in gains.items() if gain != 0}
        targets += [f"_g{j}_{i}" for i in gains]
        expressions += list(gains.values())
        delayed += [f"            _dz[{2 * j + 1}, _delay] += _g{j}_{i} * _du[{i}]" for i in gains]
        products = [f"_a{j}_{place} * _z[{place}, _j]" for place in jacobian]
        loop.append(f"        _dz[{2 * j}, _j] = _z[{2 * j + 1}, _j]")
        loop.append(f"        _dz[{2 * j + 1}, _j] = {' + '.join(products) or '0.0'}")
        for i, regressor in enumerate(row.regressor):
            targets.append(f"_r{j}_{i}")
            expressions.append(regressor)
            sources.append(
                f"        if _at[{coefficient}]:\n"
                f"            _dz[{2 * j + 1}, _at[{coefficient}]] += _r{j}_{i}"
            )
            coefficient += 1
    for m, memory in enumerate(symbolic.memories):
        place = 2 * len(symbolic.rows) + m
        jacobian = {
            i: derivative(memory.rate, state)
            for i, state in enumerate(symbolic.states)
            if memory.rate.has(state)
        }
        targets += [f"_dz[{place}, 0]", *(f"_b{m}_{i}" for i in jacobian), f"_s{m}"]
        by_grip = derivative(memory.rate, memory.grip)
        expressions += [memory.rate, *jacobian.values(), by_grip]
        products = [f"_b{m}_{i} * _z[{i}, _j]" for i in jacobian]
        loop.append(f"        _dz[{place}, _j] = {' + '.join(products)}")
        sources.append(
            f"        if _at[{coefficient}]:\n            _dz[{place}, _at[{coefficient}]] += _s{m}"
        )
        coefficient += 1
    states = [f"    {name} = _z[{place}, 0]" for place, name in enumerate(symbolic.states)]
    return function(
        "variation_rates(_z, _u, _du, _m, _p, _c, _at, _delay, _dz)",
        "_dz = _z' for the columns x, ∂x/∂s, ∂x/∂p of _z.  # Huang (2003), eq. (1)",
        "\n".join(states),
        unpack("_m", [_mode(j) for j in range(len(symbolic.rows))]),
        unpack("_u", symbolic.inputs),
        unpack("_p", symbolic.coefficients),
        unpack("_c", symbolic.constants),
        assignments(targets, expressions),
        "\n".join(f"    _dz[{2 * j}, 0] = {row.velocity}" for j, row in enumerate(symbolic.rows)),
        "    for _j in range(1, _z.shape[1]):",
        "\n".join(loop),
        "    if _z.shape[1] > 1:",
        "\n".join(sources),
        "        if _delay:\n" + ("\n".join(delayed) or "            pass"),
    )


def derivative(expression: sp.Expr, state: sp.Symbol) -> sp.Expr:
    """∂/∂state; the jump of a sign has derivative zero on either side, and no other is wanted."""
    derivative = sp.diff(expression, state).replace(sp.DiracDelta, lambda *_: sp.S.Zero)
    return cast(sp.Expr, derivative)
