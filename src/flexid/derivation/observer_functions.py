"""Source of the observer's own functions, for kernels: immersion and cancelling term."""

from collections.abc import Sequence
from typing import cast

import sympy as sp

from flexid.derivation.immersion import VARIABLE
from flexid.derivation.observer import SymbolicObserver, derive_observer
from flexid.derivation.quadrature import graded_rule
from flexid.derivation.source import assignments, function, print_scalar, unpack
from flexid.models.parametric_system import ParametricSystem


def observer_functions(system: ParametricSystem) -> str:
    """Source of ``immersion`` and ``cancelling_term``, to follow `model_functions`.

    Where an immersion has no sound closed form, both sum an integrand over the fixed nodes of
    `flexid.derivation.quadrature`; for friction curves of any width above 1/500 of the velocity
    the error is below 1e-7 of the integral of |r|.

    Parameters
    ----------
    system : ParametricSystem
        The model.

    Returns
    -------
    str
        Source of ``immersion(_x, _u, _c, _b)``, which fills _b with ∫₀^v r dξ for all rows in
        turn, and of ``cancelling_term(_x, _u, _du, _c, _C)``, which fills _C with Σ xᵢ' ∂b/∂xᵢ;
        _du holds the inputs' rates.

    Raises
    ------
    AccelerationError
        If a regressor depends on the velocity of another row.
    ModelError
        If a regressor jumps with a coordinate or an input.
    """
    observer = derive_observer(system)
    immersions = [b for row in observer.rows for b in row.immersion]
    cancelling = [C for row in observer.rows for C in row.cancelling]
    symbolic = observer.symbolic
    variables = [
        unpack("_x", symbolic.states),
        unpack("_u", symbolic.inputs),
        unpack("_c", symbolic.constants),
    ]
    return "\n\n".join(
        (
            *_rule(observer),
            function(
                "immersion(_x, _u, _c, _b)",
                "_b = the regressors integrated over their rows' velocities.  # eq. (2)",
                *variables,
                *_filled("_b", immersions),
            ),
            function(
                "cancelling_term(_x, _u, _du, _c, _C)",
                "_C = rate of _b but for the velocity's part; _du holds u'.  # eq. (3)",
                *variables,
                unpack("_du", observer.rates),
                *_filled("_C", cancelling),
            ),
        )
    )


def split_integrals(
    expressions: Sequence[sp.Expr],
) -> tuple[dict[sp.Symbol, sp.Integral], list[sp.Expr]]:
    """Replace the unevaluated integrals in expressions by symbols ``_q0``, ``_q1``, ….

    Parameters
    ----------
    expressions : sequence of sympy.Expr
        Expressions with integrals from 0 to a velocity.

    Returns
    -------
    integrals : dict of sympy.Symbol to sympy.Integral
        What each symbol stands for.
    expressions : list of sympy.Expr
        Free of integrals.
    """
    found = sorted({i for e in expressions for i in e.atoms(sp.Integral)}, key=sp.default_sort_key)
    names = {i: sp.Symbol(f"_q{n}", real=True) for n, i in enumerate(found)}
    plain = [cast(sp.Expr, e.xreplace(names)) for e in expressions]
    return {name: i for i, name in names.items()}, plain


def _rule(observer: SymbolicObserver) -> tuple[str, ...]:
    if not observer.quadratures:
        return ()
    nodes, weights = graded_rule()
    return (f"_NODES = {tuple(nodes.tolist())!r}\n_WEIGHTS = {tuple(weights.tolist())!r}\n",)


def _filled(array: str, expressions: Sequence[sp.Expr]) -> tuple[str, ...]:
    integrals, plain = split_integrals(expressions)
    targets = [f"{array}[{i}]" for i in range(len(plain))]
    return *_loops(integrals), assignments(targets, plain)


def _loops(integrals: dict[sp.Symbol, sp.Integral]) -> list[str]:
    """One loop over the nodes for each velocity that is integrated over."""
    loops = []
    for velocity in dict.fromkeys(upper_limit(i) for i in integrals.values()):
        sums = {
            q: cast(sp.Expr, i.function) for q, i in integrals.items() if upper_limit(i) == velocity
        }
        parts = [f"_f{q}" for q in sums]
        loops.append(
            "\n".join(
                [
                    *(f"    {q} = 0.0" for q in sums),
                    "    for _n in range(len(_NODES)):",
                    f"        {VARIABLE} = {velocity}*_NODES[_n]",
                    assignments(parts, list(sums.values()), indent="        "),
                    *(
                        f"        {q} += {print_scalar(velocity)}*_WEIGHTS[_n]*{part}"
                        for q, part in zip(sums, parts, strict=True)
                    ),
                ]
            )
        )
    return loops


def upper_limit(integral: sp.Integral) -> sp.Expr:
    """The velocity up to which an immersion's integral runs."""
    _, _, upper = cast(tuple[sp.Expr, ...], integral.limits[0])
    return upper
