"""Source of a model's linearisation about a state."""

from typing import cast

import sympy as sp

from flexid.derivation.model_functions import model_functions, unpack_variables
from flexid.derivation.sensitivities import derivative
from flexid.derivation.source import IMPORTS, assignments, function, unpack
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


def moving_model(system: ParametricSystem, purpose: str) -> str:
    """Source of what a model needs to move by itself: `model_functions`, and its linearisation."""
    linear = linearisation_function(symbolic_system(system))
    return "\n\n".join((model_functions(system, purpose), linear))


def linear_model(system: ParametricSystem) -> str:
    """Source of ``slopes(x, u, p, c, a, b)`` in plain Python: fills a = ∂x'/∂x, b = ∂x'/∂u."""
    symbolic = symbolic_system(system)
    derivatives = {
        f"_{array}[{i}, {j}]": derivative(rate, by)
        for array, others in (("a", symbolic.states), ("b", symbolic.inputs))
        for i, rate in enumerate(symbolic.right_hand_side)
        for j, by in enumerate(others)
    }
    slopes = function(
        "slopes(_x, _u, _p, _c, _a, _b)",
        "_a = ∂x'/∂x and _b = ∂x'/∂u for coefficients _p and constants _c.",
        unpack_variables(symbolic),
        unpack("_p", symbolic.coefficients),
        assignments([*derivatives], [*derivatives.values()]),
        decorator="",
    )
    return f"{IMPORTS}\n\n\n{slopes}"


def _jump(row: SymbolicRow) -> sp.Expr:
    """What the sign of a row's velocity is multiplied by at rest, in the row's acceleration."""
    mode = sp.Dummy(real=True)
    factor = row.acceleration.subs(sp.sign(row.velocity), mode).diff(mode)
    return cast(sp.Expr, factor.subs(mode, 0).subs(row.velocity, 0))
