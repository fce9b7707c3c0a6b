"""Source of a model's linearisation about a state."""

from typing import cast

import sympy as sp

from flexid.derivation.model_functions import model_functions, unpack_variables
from flexid.derivation.sensitivities import derivative
from flexid.derivation.source import assignments, function, unpack
from flexid.derivation.symbolic import SymbolicRow, SymbolicSystem, symbolic_system
from flexid.models.parametric_system import ParametricSystem


def linearisation_function(symbolic: SymbolicSystem) -> str:
    """Source of ``linearised(x, u, p, c, a, jumps)``.

    It fills a, of shape (N_STATES, N_STATES), with the derivatives ∂x'/∂x, and jumps[j] with
    half the jump of row j's acceleration where its velocity changes its sign.
    """
    states, rates = symbolic.states, symbolic.right_hand_side
    places = range(len(states))
    targets = [f"_a[{i}, {j}]" for i in places for j in places]
    expressions = [derivative(rate, state) for rate in rates for state in states]
    for place, row in enumerate(symbolic.rows):
        targets.append(f"_jumps[{place}]")
        expressions.append(_jump(row))
    return function(
        "linearised(_x, _u, _p, _c, _a, _jumps)",
        "_a = ∂x'/∂x for coefficients _p and constants _c; _jumps = half the jumps at rest.",
        unpack_variables(symbolic),
        unpack("_p", symbolic.coefficients),
        assignments(targets, expressions),
    )


def input_slopes_function(symbolic: SymbolicSystem) -> str:
    """Source of ``input_slopes(x, u, p, c, b)``: fills b, (N_STATES, N_INPUTS), with ∂x'/∂u."""
    rates, inputs = symbolic.right_hand_side, symbolic.inputs
    targets = [f"_b[{i}, {j}]" for i in range(len(rates)) for j in range(len(inputs))]
    return function(
        "input_slopes(_x, _u, _p, _c, _b)",
        "_b = ∂x'/∂u for coefficients _p and constants _c.",
        unpack_variables(symbolic),
        unpack("_p", symbolic.coefficients),
        assignments(targets, [derivative(rate, u) for rate in rates for u in inputs]),
    )


def moving_model(system: ParametricSystem, purpose: str) -> str:
    """Source of what a model needs to move by itself: `model_functions`, and its linearisation."""
    symbolic = symbolic_system(system)
    linear = linearisation_function(symbolic), input_slopes_function(symbolic)
    return "\n\n".join((model_functions(system, purpose), *linear))


def _jump(row: SymbolicRow) -> sp.Expr:
    """What the sign of a row's velocity is multiplied by at rest, in the row's acceleration."""
    mode = sp.Dummy(real=True)
    factor = row.acceleration.subs(sp.sign(row.velocity), mode).diff(mode)
    return cast(sp.Expr, factor.subs(mode, 0).subs(row.velocity, 0))
