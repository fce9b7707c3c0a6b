"""Source of a model's motion together with its exact derivatives: the variational equations."""

from collections.abc import Sequence
from dataclasses import replace
from typing import cast

import sympy as sp

from flexid.derivation.model_functions import module_header
from flexid.derivation.source import function, print_scalar, unpack
from flexid.derivation.symbolic import SymbolicMemory, SymbolicSystem, derivative, symbolic_system
from flexid.derivation.term_blocks import ACTING, SOUGHT, Blocks, Entries, divided
from flexid.models.parametric_system import ParametricSystem

# With x' = f(x, u, p), the derivatives by the state s at the start of a segment and by p obey
#     (∂x/∂s)' = (∂f/∂x) ∂x/∂s,    (∂x/∂p)' = (∂f/∂x) ∂x/∂p + ∂f/∂p.
# They are columns of one matrix: x, ∂x/∂s, ∂x/∂p of the unknowns, and optionally the derivative by
# the delay of the inputs, with the source (∂f/∂u) du. A Runge-Kutta step first advances the state.
# The columns then follow along the same four stages, several per instruction.
#
# The sign of a row's own velocity is its *mode*, which the kernel sets. A magnitude |g| in the
# equations, g of positions, causes a *corner* at g = 0: the kernel ends a step there.
KNOWN = -1  # marks in ``DRY`` a known part with dry friction, which has no coefficient

_TOGETHER = 8  # largest number of columns per instruction


def sensitivity_functions(system: ParametricSystem, purpose: str) -> str:
    """Return the header, ``WIDTH``, ``DRY`` and the functions of the state and its derivatives."""
    symbolic = _with_modes(symbolic_system(system))
    blocks = divided(symbolic)
    parts = (
        f"N_MEMORIES = {len(symbolic.memories)}\nN_BLOCKS = {len(blocks.optional)}\n",
        f"WIDTH = {_width(symbolic)}\n",
        _dry(symbolic),
        blocks.acting(),
        _rates(blocks),
        _corners(symbolic),
        _remember(symbolic),
        _slopes(blocks),
        _memory_slopes(symbolic),
        variation(
            [list(jacobian) for _, jacobian in _equations(symbolic)[: len(symbolic.rows)]],
            [sorted(_path_slopes(symbolic, memory)) for memory in symbolic.memories],
        ),
    )
    return "\n\n".join((module_header(system, purpose), *parts))


def mode_of(place: int) -> sp.Symbol:
    """Return the symbol of a row's mode: the sign of its velocity, or 0 if the row sticks."""
    return sp.Symbol(f"_m{place}", real=True)


def _with_modes(symbolic: SymbolicSystem) -> SymbolicSystem:
    """Replace the sign of each row's velocity by the row's mode."""
    modes = [(sp.sign(row.velocity), mode_of(j)) for j, row in enumerate(symbolic.rows)]
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
        own = [first + i for i, r in enumerate(row.regressor) if r.has(mode_of(j))]
        places.append((*own, *([KNOWN] if row.known.has(mode_of(j)) else [])))
        first += len(row.regressor)
    return f"DRY = {tuple(places)!r}\n"


def width_of(states: int, coefficients: int, rows: int) -> int:
    """Return the number of columns: value, states, coefficients, delays of inputs and of rows."""
    columns = 1 + states + coefficients + 1 + rows
    return _TOGETHER * -(-columns // _TOGETHER)


def _width(symbolic: SymbolicSystem) -> int:
    return width_of(len(symbolic.states), len(symbolic.coefficients), len(symbolic.rows))


def _variables(symbolic: SymbolicSystem) -> tuple[str, ...]:
    return (
        unpack("_x", symbolic.states),
        unpack("_m", [mode_of(j) for j in range(len(symbolic.rows))]),
        unpack("_u", symbolic.inputs),
        unpack("_p", symbolic.coefficients),
        unpack("_c", symbolic.constants),
    )


def _rates(blocks: Blocks) -> str:
    velocities = [row.velocity for row in blocks.whole.rows]

    def entries(part: SymbolicSystem) -> tuple[Entries, Entries]:
        rates = {f"_dx[{2 * j + 1}]": row.acceleration for j, row in enumerate(part.rows)}
        first = 2 * len(part.rows)
        memories = {f"_dx[{first + m}]": memory.rate for m, memory in enumerate(part.memories)}
        return rates | memories, {}

    return function(
        "state_rates(_x, _u, _m, _p, _c, _on, _dx)",
        "_dx = x' for modes _m, coefficients _p, constants _c.  # Huang (2003), eq. (1)",
        *_variables(blocks.whole),
        "\n".join(f"    _dx[{2 * j}] = {velocity}" for j, velocity in enumerate(velocities)),
        blocks.lines(ACTING, entries),
        decorator="inlined",
    )


def _corners(symbolic: SymbolicSystem) -> str:
    positions = {row.coordinate for row in symbolic.rows}
    known = {*symbolic.constants, *symbolic.coefficients}
    found = {call for e in symbolic.right_hand_side for call in e.atoms(sp.Abs)}
    own = [call for call in found if call.args[0].free_symbols <= positions | known]
    used = {name for call in own for name in call.free_symbols}
    lines = []
    for i, call in enumerate(sorted(own, key=sp.default_sort_key)):
        users = _coefficients_using(symbolic, call)
        value = print_scalar(cast(sp.Expr, call.args[0]))
        if users is not None:
            value += f" if {' or '.join(f'_p[{place}] != 0.0' for place in users)} else 1.0"
        lines.append(f"    _k[{i}] = {value}")
    text = function(
        "corners(_x, _p, _c, _k)",
        "_k = functions of positions in _x that are zero at the corners of x'.",
        unpack("_x", symbolic.states, used),
        unpack("_p", symbolic.coefficients, used),
        unpack("_c", symbolic.constants, used),
        "\n".join(lines) or "    pass",
        decorator="inlined",
    )
    return f"N_CORNERS = {len(own)}\n\n\n{text}"


def _coefficients_using(symbolic: SymbolicSystem, call: sp.Basic) -> list[int] | None:
    """Indices of the coefficients whose terms contain a call; None if other terms contain it."""
    others = [row.known for row in symbolic.rows] + [memory.rate for memory in symbolic.memories]
    if any(other.has(call) for other in others):
        return None
    regressors = [r for row in symbolic.rows for r in row.regressor]
    return [place for place, regressor in enumerate(regressors) if regressor.has(call)]


def _path_slopes(symbolic: SymbolicSystem, memory: SymbolicMemory) -> dict[int, float]:
    """Derivative of a memory's path by each position, by index of the position's state."""
    return {
        2 * j: float(cast(sp.Expr, sp.diff(memory.path, row.coordinate)))
        for j, row in enumerate(symbolic.rows)
        if memory.path.has(row.coordinate)
    }


# While the path q keeps its direction d, a memory is h = d + (h0 - d) exp(-s |q - q0|) at any
# velocity. With this closed form a large grip s does not make the equations stiff.
def _along_path(symbolic: SymbolicSystem, m: int) -> str:
    """Lines that compute a memory's path, direction and decay, and the remainder of its start."""
    place, grip = _places_of(symbolic, m)
    slopes = _path_slopes(symbolic, symbolic.memories[m]).items()
    return (
        f"    _path = {' + '.join(f'{a!r} * (_x[{i}] - _start[{i}])' for i, a in slopes)}\n"
        f"    _d = copysign(1.0, _path)\n"
        f"    _e = exp(-_p[{grip}] * abs(_path))\n"
        f"    _left = (_start[{place}] - _d) * _e"
    )


def _places_of(symbolic: SymbolicSystem, m: int) -> tuple[int, int]:
    """Index of a memory among the states, and of its grip among the coefficients."""
    grips = len(symbolic.coefficients) - len(symbolic.memories)
    return 2 * len(symbolic.rows) + m, grips + m


def _remember(symbolic: SymbolicSystem) -> str:
    blocks = []
    for m in range(len(symbolic.memories)):
        place, _ = _places_of(symbolic, m)
        blocks.append(f"{_along_path(symbolic, m)}\n    _x[{place}] = _d + _left")
    return function(
        "remember(_x, _start, _p)",
        "Memories of _x after the path from _start.  # Dahl (1968)",
        "\n".join(blocks) or "    pass",
        decorator="inlined",
    )


def _memory_slopes(symbolic: SymbolicSystem) -> str:
    blocks = []
    for m, memory in enumerate(symbolic.memories):
        place, grip = _places_of(symbolic, m)
        lines = [_along_path(symbolic, m), f"    _b[{m} * N_STATES + {place}] = _e"]
        lines += [
            f"    _b[{m} * N_STATES + {i}] = -_left * _d * _p[{grip}] * {slope!r}"
            for i, slope in _path_slopes(symbolic, memory).items()
        ]
        lines.append(f"    _q[{m} * WIDTH + _at[{grip}]] = -_left * abs(_path)")
        blocks.append("\n".join(lines))
    return function(
        "memory_slopes(_x, _start, _p, _at, _b, _q)",
        "Derivatives of the memories of _x by both ends of the path, and by the grip.",
        "\n".join(blocks) or "    pass",
        decorator="inlined",
    )


def _equations(symbolic: SymbolicSystem) -> list[tuple[sp.Expr, dict[int, sp.Expr]]]:
    """Rates of velocities and memories, each with its derivatives by index of the state."""
    rates = [row.acceleration for row in symbolic.rows]
    rates += [memory.rate for memory in symbolic.memories]
    states = [*enumerate(symbolic.states)]

    def derivatives(rate: sp.Expr) -> dict[int, sp.Expr]:
        return {place: derivative(rate, state) for place, state in states if rate.has(state)}

    return [(rate, derivatives(rate)) for rate in rates]


def _slopes(blocks: Blocks) -> str:
    return function(
        "slopes(_x, _u, _du, _m, _p, _c, _on, _at, _delay, _a, _r)",
        "Derivatives of the rates of velocities and memories: _a by the states, _r by the rest.",
        *_variables(blocks.whole),
        blocks.lines(SOUGHT, _slope_entries),
        decorator="inlined",
    )


def _slope_entries(part: SymbolicSystem) -> tuple[Entries, Entries]:
    """Entries to which several terms contribute, and those of one coefficient."""
    n, width = len(part.states), _width(part)
    sums, own = {}, {}
    for j, (rate, jacobian) in enumerate(_equations(part)):
        sums |= {f"_a[{j * n + place}]": slope for place, slope in jacobian.items()}
        for i, coefficient in enumerate(part.coefficients):
            if rate.has(coefficient):
                own[f"_r[{j * width} + _at[{i}]]"] = derivative(rate, coefficient)
        gains = {i: derivative(rate, u) for i, u in enumerate(part.inputs) if rate.has(u)}
        if gains:  # in column 0, which is unused, without a delay
            products = (gain * sp.Symbol(f"_du[{i}]") for i, gain in gains.items())
            sums[f"_r[{j * width} + _delay]"] = sp.Add(*products)
    return sums, own


def variation(patterns: Sequence[Sequence[int]], paths: Sequence[Sequence[int]] = ()) -> str:
    """Return the source of ``vary``: the four stages of a column, unrolled in one loop."""
    rows, memories = len(patterns), len(paths)
    size = 2 * rows + memories
    ahead: list[str] = []
    body: list[str] = [f"        _s{i} = _z[{i} * WIDTH + _j]" for i in range(size)]
    body += [f"        _d{j} = _free{j} * _d[{j} * WIDTH + _j]" for j in range(rows)]

    def known(name: str, source: str) -> str:
        ahead.append(f"    {name} = {source}")
        return name

    for j in range(rows):
        known(f"_free{j}", f"_free[{j}]")
    at = "_s"  # the names of the column's states at a stage
    for stage in range(4):
        for j, pattern in enumerate(patterns):
            products = [f"_r[({stage} * {rows + memories} + {j}) * WIDTH + _j]", f"_d{j}"]
            first = (stage * (rows + memories) + j) * size
            products += [
                f"{known(f'_a{stage}_{j}_{i}', f'_a[{first + i}]')} * {at}{i}" for i in pattern
            ]
            body.append(f"        _k{stage}_{2 * j} = {at}{2 * j + 1}")
            body.append(f"        _k{stage}_{2 * j + 1} = {' + '.join(products)}")
        if stage < 3:
            reach = "_half" if stage < 2 else "_step"
            then = f"_t{stage}_"
            for i in range(2 * rows):
                body.append(f"        {then}{i} = _s{i} + {reach} * _k{stage}_{i}")
        else:
            then = "_y"
            for i in range(2 * rows):
                total = f"_k0_{i} + 2.0 * (_k1_{i} + _k2_{i}) + _k3_{i}"
                body.append(f"        {then}{i} = _s{i} + _sixth * ({total})")
        for m, path in enumerate(paths):
            place = 2 * rows + m
            first = (stage * memories + m) * size
            kept = known(f"_b{stage}_{m}_{place}", f"_b[{first + place}]")
            terms = [f"_q[({stage} * {memories} + {m}) * WIDTH + _j]", f"{kept} * _s{place}"]
            terms += [
                f"{known(f'_b{stage}_{m}_{i}', f'_b[{first + i}]')} * ({then}{i} - _s{i})"
                for i in path
            ]
            body.append(f"        {then}{place} = {' + '.join(terms)}")
        at = then
    body += [f"        _z[{i} * WIDTH + _j] = _y{i}" for i in range(size)]
    return function(
        "vary(_z, _n, _step, _a, _r, _b, _q, _d, _free)",
        "Columns 1 to _n - 1 of _z after a step, along the four stages of the state.",
        "    _half = 0.5 * _step\n    _sixth = _step / 6.0",
        "\n".join(ahead),
        "    for _j in range(1, _n):",
        "\n".join(body),
        decorator="uncounted",
    )
