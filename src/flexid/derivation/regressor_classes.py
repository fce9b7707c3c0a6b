"""What a filter needs to know about each regressor: what can be filtered as it stands.

A regressor is split into three parts, r = g(q, u) + Σ a_j v_j + n(q, v, u). The first is a function
of measured positions and inputs and is filtered as it stands; the second is the derivative of the
positions, which the filter itself takes; only the third, nonlinear in velocities, needs an
estimate of them.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import sympy as sp

from flexid.derivation.model_functions import module_header, unpack_variables
from flexid.derivation.source import assignments, function, unpack
from flexid.derivation.symbolic import SymbolicSystem, symbolic_system
from flexid.models.parametric_system import ParametricSystem


@dataclass(frozen=True)
class RegressorParts:
    """The three parts of a regressor, or of a known part."""

    memoryless: sp.Expr  # g(q, u), a function of positions, inputs and constants alone
    # a_j, one per row: functions of constants alone, which multiply that row's velocity
    velocity_factors: tuple[sp.Expr, ...]
    remainder: sp.Expr  # n(q, v, u), whatever else depends on velocities
    depends_on_input: bool  # whether an input occurs, so that its hold between samples matters


def split_regressor(expression: sp.Expr, symbolic: SymbolicSystem) -> RegressorParts:
    """Split an expression, term by term, by its dependence on velocities."""
    velocities = tuple(row.velocity for row in symbolic.rows)
    measured = {row.coordinate for row in symbolic.rows} | set(symbolic.inputs)
    memoryless, remainder = [], []
    factors: list[list[sp.Expr]] = [[] for _ in velocities]
    for term in sp.Add.make_args(sp.expand(expression)):
        occurring = [place for place, v in enumerate(velocities) if term.has(v)]
        if not occurring:
            memoryless.append(term)
            continue
        factor = term / velocities[occurring[0]]
        if factor.free_symbols & (measured | set(velocities)):
            remainder.append(term)
        else:
            factors[occurring[0]].append(factor)
    return RegressorParts(
        sp.Add(*memoryless),
        tuple(sp.Add(*terms) for terms in factors),
        sp.Add(*remainder),
        expression.has(*symbolic.inputs) if symbolic.inputs else False,
    )


def filter_functions(system: ParametricSystem, purpose: str) -> str:
    """Source of what a filter kernel needs from a model.

    The *signals* of a model are its regressors, row by row, followed by one known part per row.
    Emitted are ``sampled_parts(x, u, c, g)``, their parts without the linear velocity terms;
    ``velocity_factors(c, a)``, the factors a_j of those; ``HELD``, which signals depend on an
    input; and ``VELOCITY_NEEDED``, the coefficients (or rows, for known parts) that need
    velocities.
    """
    symbolic = symbolic_system(system)
    names = [*system.coefficients, *(f"known part of {row.name}" for row in system.rows)]
    expressions = [r for row in symbolic.rows for r in row.regressor]
    expressions += [row.known for row in symbolic.rows]
    parts = [split_regressor(expression, symbolic) for expression in expressions]
    needed = tuple(name for name, part in zip(names, parts, strict=True) if part.remainder != 0)
    constants = (
        f"N_SIGNALS = {len(parts)}\n"
        f"HELD = {tuple(part.depends_on_input for part in parts)!r}\n"
        f"VELOCITY_NEEDED = {needed!r}\n"
    )
    return "\n\n".join(
        (
            module_header(system, purpose) + constants,
            _sampled_parts_function(symbolic, parts),
            _velocity_factors_function(symbolic, parts),
        )
    )


def _sampled_parts_function(symbolic: SymbolicSystem, parts: Sequence[RegressorParts]) -> str:
    return function(
        "sampled_parts(_x, _u, _c, _g)",
        "Signals at one sample, without the terms linear in velocities; _c holds the constants.",
        unpack_variables(symbolic),
        assignments(
            [f"_g[{i}]" for i in range(len(parts))],
            [part.memoryless + part.remainder for part in parts],
        ),
        decorator="inner",
    )


def _velocity_factors_function(symbolic: SymbolicSystem, parts: Sequence[RegressorParts]) -> str:
    return function(
        "velocity_factors(_c, _a)",
        "Factor _a[signal, row] that multiplies the velocity of each row in each signal.",
        unpack("_c", symbolic.constants),
        assignments(
            [f"_a[{i}, {j}]" for i in range(len(parts)) for j in range(len(symbolic.rows))],
            [factor for part in parts for factor in part.velocity_factors],
        ),
        decorator="inner",
    )
