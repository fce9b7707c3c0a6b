"""The immersion ∫₀^v r dξ of a regressor: in closed form where that is plain, else as an integral.

Plain are polynomials in the velocity, its magnitude and its sign, and tanh of a straight line in
it. Of anything else generated code takes the integral by a fixed rule: an antiderivative that is
right on paper may return -inf or lose all digits.
"""

from collections.abc import Sequence
from functools import cache
from typing import cast

import numpy as np
import sympy as sp
from numpy.typing import NDArray

from flexid.derivation.symbolic import log_cosh

VARIABLE = sp.Symbol("_xi", real=True)
"""The variable of integration."""


def immersion(
    regressor: sp.Expr, velocity: sp.Symbol, constants: Sequence[sp.Symbol] = ()
) -> sp.Expr:
    """b = ∫₀^v r dξ, Huang (2003), eq. (2): a closed form, or an unevaluated integral.

    The constants stand for fixed numbers and may be taken to differ from zero.
    """
    # Between 0 and v the variable keeps the sign of v, so |ξ| = sign(v) ξ.
    side = sp.Dummy("side", nonzero=True, real=True)
    smooth = regressor.subs({sp.Abs(velocity): side * velocity, sp.sign(velocity): side})
    constant, varying = smooth.as_independent(velocity, as_Add=True)
    terms = [_integral(term, velocity, constants) for term in sp.Add.make_args(varying)]
    total = sp.Add(constant * velocity, *(term for term in terms if term is not None))
    if None not in terms and not total.has(sp.zoo):
        if total.has(side):
            total = sp.expand(total.subs(side, sp.Abs(velocity) / velocity))
        return cast(sp.Expr, total)
    factor, rest = regressor.as_independent(velocity, as_Add=False)
    return factor * sp.Integral(rest.subs(velocity, VARIABLE), (VARIABLE, 0, velocity))


def _integral(term: sp.Expr, velocity: sp.Symbol, constants: Sequence[sp.Symbol]) -> sp.Expr | None:
    """The closed form of one term; None if it has no plain one."""
    factor, rest = term.as_independent(velocity, as_Add=False)
    if rest.is_polynomial(velocity):
        # Term by term, not by substitution: ((v + a)³ - a³)/3 would cancel for small v.
        powers = sp.Poly(rest, velocity).terms()
        return factor * sp.Add(*(a * velocity ** (n + 1) / (n + 1) for (n,), a in powers))
    if not isinstance(rest, sp.tanh):
        return None
    argument = cast(sp.Expr, rest.args[0])
    slope = argument.diff(velocity)
    if not slope.free_symbols <= {*constants}:
        return None
    return factor * (log_cosh(argument) - log_cosh(argument.subs(velocity, 0))) / slope


# The fixed rule by which generated code integrates a regressor over a velocity. Friction changes
# within a fraction of a rad/s while velocities reach a hundred, so plain Gauss-Legendre nodes on
# [0, v] would step over all that happens near zero. Panels halve towards zero, with the same number
# of nodes each; as they scale with v, the whole rule is one table of nodes on [0, 1].

_PANELS = 10  # the first ends at v / 2⁹
_NODES_PER_PANEL = 8


@cache
def graded_rule() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Nodes and weights on [0, 1], dense towards 0: ∫₀^v r dξ ≈ v Σ weights r(v nodes)."""
    ends = np.concatenate([[0.0], 2.0 ** np.arange(1 - _PANELS, 1)])
    nodes, weights = np.polynomial.legendre.leggauss(_NODES_PER_PANEL)
    starts, widths = ends[:-1, None], np.diff(ends)[:, None]
    return (
        (starts + widths * (nodes + 1.0) / 2.0).ravel(),
        (widths * weights / 2.0).ravel(),
    )
