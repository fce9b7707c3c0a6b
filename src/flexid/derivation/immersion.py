"""The immersion ∫₀^v r dξ of a regressor: in closed form where that is sound, else as an integral.

A closed form is taken only if generated code can print it and if it agrees with quadrature on a
spread of points, large velocities and vanishing parameters among them: an antiderivative that is
right on paper may still return -inf or lose all digits.
"""

from collections.abc import Callable, Sequence
from functools import cache
from typing import Literal, cast

import numpy as np
import sympy as sp
from numpy.typing import NDArray
from sympy.integrals.manualintegrate import manualintegrate

from flexid.derivation.source import ScalarPrinter
from flexid.derivation.symbolic import LogCosh, log_cosh

Kind = Literal["closed form", "quadrature"]
"""How generated code evaluates an immersion."""

VARIABLE = sp.Symbol("_xi", real=True)
"""The variable of integration."""

_PRINTABLE = (
    *(sp.sin, sp.cos, sp.tan, sp.tanh, sp.cosh, sp.exp, sp.log),
    *(sp.sign, sp.Abs, sp.erf, sp.atan, sp.asinh, LogCosh),
)
_MAX_OPERATIONS = 60  # beyond this SymPy's search may take seconds, quadrature takes none
_MAX_POWER = 4  # likewise: a twelfth power of a sine takes it half a minute
_SEED = 20030101
_POINTS = 120
_RELATIVE = 1e-9  # of the integral of |r|
_ABSOLUTE = 1e-13  # of the usual size of r: what is left where two terms cancel at small v


def immersion(
    regressor: sp.Expr, velocity: sp.Symbol, constants: Sequence[sp.Symbol] = ()
) -> tuple[sp.Expr, Kind]:
    """b = ∫₀^v r dξ, Huang (2003), eq. (2): a closed form, or an unevaluated integral.

    The constants stand for fixed numbers and may be taken to differ from zero.
    """
    closed = _closed_form(regressor, velocity, constants)
    if closed is not None and _agrees(closed, regressor, velocity):
        return closed, "closed form"
    factor, rest = regressor.as_independent(velocity, as_Add=False)
    integrand = rest.subs(velocity, VARIABLE)
    return factor * sp.Integral(integrand, (VARIABLE, 0, velocity)), "quadrature"


def _closed_form(
    regressor: sp.Expr, velocity: sp.Symbol, constants: Sequence[sp.Symbol]
) -> sp.Expr | None:
    if regressor.count_ops() > _MAX_OPERATIONS:
        return None
    # Between 0 and v the variable keeps the sign of v, so |ξ| = sign(v) ξ.
    side = sp.Dummy("side", nonzero=True, real=True)
    smooth = regressor.subs({sp.Abs(velocity): side * velocity, sp.sign(velocity): side})
    nonzero = {c: sp.Dummy(c.name, nonzero=True, real=True) for c in constants}
    smooth = cast(sp.Expr, smooth.xreplace(nonzero))
    constant, varying = smooth.as_independent(velocity, as_Add=True)
    total = constant * velocity
    for term in sp.Add.make_args(varying):
        integral = _integrate_term(term, velocity)
        if integral is None:
            return None
        total += integral
    back = {dummy: constant for constant, dummy in nonzero.items()}
    total = cast(sp.Expr, total.xreplace(back))
    if total.has(side):
        total = sp.expand(total.subs(side, sp.Abs(velocity) / velocity))
    return total if _is_printable(total) else None


def _integrate_term(term: sp.Expr, velocity: sp.Symbol) -> sp.Expr | None:
    factor, rest = term.as_independent(velocity, as_Add=False)
    if rest.is_polynomial(velocity):
        # Term by term, not by substitution: ((v + a)³ - a³)/3 would cancel for small v.
        powers = sp.Poly(rest, velocity).terms()
        return factor * sp.Add(*(a * velocity ** (n + 1) / (n + 1) for (n,), a in powers))
    if isinstance(rest, sp.tanh):
        return _integrate_tanh(factor, cast(sp.Expr, rest.args[0]), velocity)
    if any(abs(p.exp) > _MAX_POWER for p in rest.atoms(sp.Pow) if p.exp.is_number):
        return None
    antiderivative = manualintegrate(rest, velocity)
    if antiderivative.has(sp.Integral, sp.Piecewise):
        return None
    return factor * (antiderivative - antiderivative.subs(velocity, 0))


def _integrate_tanh(factor: sp.Expr, argument: sp.Expr, velocity: sp.Symbol) -> sp.Expr | None:
    """∫₀^v tanh(a ξ + c) dξ; SymPy's own log(tanh + 1) is -inf for large negative v."""
    slope = argument.diff(velocity)
    if slope.has(velocity) or slope.is_nonzero is not True:
        return None
    return factor * (log_cosh(argument) - log_cosh(argument.subs(velocity, 0))) / slope


def _is_printable(expression: sp.Expr) -> bool:
    if expression.has(sp.zoo, sp.nan, sp.oo, -sp.oo, sp.I):
        return False
    return all(isinstance(f, _PRINTABLE) for f in expression.atoms(sp.Function))


def _agrees(closed: sp.Expr, regressor: sp.Expr, velocity: sp.Symbol) -> bool:
    """Whether a closed form has the values of the integral wherever quadrature converges."""
    others = sorted((closed.free_symbols | regressor.free_symbols) - {velocity}, key=str)
    evaluate = sp.lambdify([velocity, *others], closed, "math", printer=ScalarPrinter)
    integrand = sp.lambdify([velocity, *others], regressor, "numpy")
    points = _spread(len(others))
    references = [_reference(integrand, point) for point in points]
    sizes = [r[1] / abs(point[0]) for r, point in zip(references, points, strict=True) if r]
    if len(sizes) < _POINTS // 10:
        return False
    floor = _ABSOLUTE * float(np.median(sizes))
    for reference, point in zip(references, points, strict=True):
        if reference is None:
            continue
        try:
            error = abs(evaluate(*point.tolist()) - reference[0])
        except (ArithmeticError, ValueError):
            return False
        if not error <= _RELATIVE * reference[1] + floor:  # also refuses NaN
            return False
    return True


def _spread(n_others: int) -> NDArray[np.float64]:
    """Points (v, others): |v| up to 1e4, the others around 1, some of them zero or nearly so."""
    rng = np.random.default_rng(_SEED)
    velocities = rng.choice([-1.0, 1.0], _POINTS) * 10.0 ** rng.uniform(-6, 4, _POINTS)
    others = rng.normal(0.0, 1.5, (_POINTS, n_others))
    others[rng.random(others.shape) < 0.1] = 0.0
    others[rng.random(others.shape) < 0.1] *= 1e-9
    return np.column_stack([velocities, others])


def _reference(
    integrand: Callable[..., NDArray[np.float64]], point: NDArray[np.float64]
) -> tuple[float, float] | None:
    """Integrals of the integrand and of its magnitude from 0 to v.

    None where they do not exist or quadrature has not converged.
    """
    velocity, *others = point.tolist()
    found = []
    for nodes_per_panel in (20, 31):
        nodes, weights = graded_rule(30, nodes_per_panel)
        try:
            with np.errstate(divide="raise", invalid="raise", over="raise"):
                samples = integrand(velocity * nodes, *others) * np.ones_like(nodes)
        except (ArithmeticError, ValueError):
            return None
        found.append((velocity * float(weights @ samples), float(weights @ np.abs(samples))))
    (first, _), (value, size) = found
    size *= abs(velocity)
    return (value, size) if abs(first - value) <= 0.1 * _RELATIVE * size else None


# The fixed rule by which generated code integrates a regressor over a velocity. Friction changes
# within a fraction of a rad/s while velocities reach a hundred, so plain Gauss-Legendre nodes on
# [0, v] would step over all that happens near zero. Panels halve towards zero, with the same number
# of nodes each; as they scale with v, the whole rule is one table of nodes on [0, 1].

_PANELS = 10  # of the generated code; the first ends at v / 2⁹
_NODES_PER_PANEL = 8


@cache
def graded_rule(
    panels: int = _PANELS, nodes_per_panel: int = _NODES_PER_PANEL
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Nodes and weights on [0, 1], dense towards 0: ∫₀^v r dξ ≈ v Σ weights r(v nodes)."""
    ends = np.concatenate([[0.0], 2.0 ** np.arange(1 - panels, 1)])
    nodes, weights = np.polynomial.legendre.leggauss(nodes_per_panel)
    starts, widths = ends[:-1, None], np.diff(ends)[:, None]
    return (
        (starts + widths * (nodes + 1.0) / 2.0).ravel(),
        (widths * weights / 2.0).ravel(),
    )
