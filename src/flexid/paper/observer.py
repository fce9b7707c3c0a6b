"""Derivation of the parametric observer of Huang (2003), eqs. (2)-(3), for any model."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import cast

import numpy as np
import sympy as sp
from numpy.typing import NDArray
from sympy.printing.codeprinter import CodePrinter
from sympy.printing.latex import LatexPrinter

from flexid.derivation.symbolic import FreshNames, SymbolicRow, SymbolicSystem, symbolic_system
from flexid.errors import AccelerationError, ModelError
from flexid.models.parametric_system import ParametricSystem


@dataclass(frozen=True)
class ObserverRow:
    """Observer of one row; every tuple has one entry per coefficient of the row."""

    row: SymbolicRow
    gain: sp.Symbol  # c, a positive number
    immersion: tuple[sp.Expr, ...]  # b: a closed form or an unevaluated integral
    cancelling: tuple[sp.Expr, ...]  # C
    intermediate: tuple[sp.Symbol, ...]  # the observer's states y
    estimates: tuple[sp.Symbol, ...]  # p̂
    errors: tuple[sp.Symbol, ...]  # p̃ = p̂ - p

    @property
    def prediction(self) -> sp.Expr:
        """Acceleration rᵀp̂ + k that the estimates predict."""
        products = (p * r for p, r in zip(self.estimates, self.row.regressor, strict=True))
        return sp.Add(*products) + self.row.known

    @property
    def outputs(self) -> tuple[sp.Expr, ...]:
        """Estimates p̂ as functions of y and x: Huang (2003), eq. (2)."""
        pairs = zip(self.intermediate, self.immersion, strict=True)
        return tuple(y + self.gain * b for y, b in pairs)

    @property
    def updates(self) -> tuple[sp.Expr, ...]:
        """Rates y' as functions of p̂, x and u: Huang (2003), eq. (3)."""
        pairs = zip(self.row.regressor, self.cancelling, strict=True)
        return tuple(-self.gain * (r * self.prediction + C) for r, C in pairs)


@dataclass(frozen=True)
class SymbolicObserver:
    """Parametric observer of a model."""

    symbolic: SymbolicSystem
    rows: tuple[ObserverRow, ...]
    rates: tuple[sp.Symbol, ...]  # of all inputs, one each

    @property
    def input_rates(self) -> tuple[sp.Symbol, ...]:
        """Rates u' of the inputs that occur in a regressor, as the observer needs only these."""
        used = {s for row in self.rows for C in row.cancelling for s in C.free_symbols}
        return tuple(rate for rate in self.rates if rate in used)

    @property
    def quadratures(self) -> tuple[str, ...]:
        """Names of the coefficients whose immersion is evaluated by quadrature."""
        return tuple(
            str(p)
            for row in self.rows
            for p, b in zip(row.row.coefficients, row.immersion, strict=True)
            if b.has(sp.Integral)
        )

    @property
    def gains(self) -> tuple[sp.Symbol, ...]:
        """Gain of each row."""
        return tuple(row.gain for row in self.rows)


# For a row v' = rᵀp + k with gain c,
#     p̂ = y + c b,                        b = ∫₀^v r dξ        (2)
#     y' = -c [ r (rᵀp̂ + k) + C ],        C = Σ xᵢ' ∂b/∂xᵢ  over all xᵢ but v, and the inputs  (3)
# so that p̂' = y' + c (r v' + C) = -c r rᵀ(p̂ - p), which is eq. (7).
def derive_observer(system: ParametricSystem) -> SymbolicObserver:
    """Derive the observer of Huang (2003), eqs. (2)-(3), with gains c1, ... and states y1, ..."""
    symbolic = symbolic_system(system)
    names = FreshNames([*system.variables, *system.coefficients])
    rates = tuple(names.take(f"{name}_rate") for name in system.inputs)
    rows = tuple(
        _derive_row(symbolic, row, number, rates, names)
        for number, row in enumerate(symbolic.rows, start=1)
    )
    return SymbolicObserver(symbolic, rows, rates)


def check_acceleration_free(symbolic: SymbolicSystem) -> None:
    """Raise `AccelerationError` unless the observer can be built from states and inputs."""
    for row in symbolic.rows:
        for coefficient, regressor in zip(row.coefficients, row.regressor, strict=True):
            _without_other_velocities(symbolic, row, str(coefficient), regressor)


def error_dynamics(observer: SymbolicObserver) -> tuple[tuple[sp.Expr, ...], ...]:
    """Return p̃' of each row, from eqs. (1) to (3) of Huang (2003)."""
    symbolic = observer.symbolic
    moving = [*symbolic.states, *symbolic.inputs]
    rates = [*symbolic.right_hand_side, *observer.rates]
    result = []
    for row in observer.rows:
        true = (p + e for p, e in zip(row.row.coefficients, row.errors, strict=True))
        insert = dict(zip(row.estimates, true, strict=True))
        result.append(
            tuple(
                sp.expand(
                    cast(sp.Expr, update.xreplace(insert))
                    + sum(rate * output.diff(x) for x, rate in zip(moving, rates, strict=True))
                )
                for update, output in zip(row.updates, row.outputs, strict=True)
            )
        )
    return tuple(result)


def _derive_row(
    symbolic: SymbolicSystem,
    row: SymbolicRow,
    number: int,
    rates: tuple[sp.Symbol, ...],
    names: FreshNames,
) -> ObserverRow:
    _check_distinct(symbolic, row)
    immersions, cancelling = [], []
    for coefficient, regressor in zip(row.coefficients, row.regressor, strict=True):
        regressor = _without_other_velocities(symbolic, row, str(coefficient), regressor)
        _check_rest(symbolic, row, str(coefficient), regressor)
        b = immersion(regressor, row.velocity, symbolic.constants)
        immersions.append(b)
        cancelling.append(_cancelling(symbolic, row, str(coefficient), b, rates))
    letter = "yzw"[number - 1] if number <= 3 else f"w{number}_"
    return ObserverRow(
        row,
        names.take(f"c{number}"),
        tuple(immersions),
        tuple(cancelling),
        tuple(names.take(f"{letter}{j}") for j in range(1, len(immersions) + 1)),
        tuple(names.take(f"{p}_hat") for p in row.coefficients),
        tuple(names.take(f"{p}_error") for p in row.coefficients),
    )


def _check_distinct(symbolic: SymbolicSystem, row: SymbolicRow) -> None:
    """Raise `ModelError` if a regressor is 0, or equals plus or minus another one of the row."""
    found: dict[sp.Expr, str] = {}
    for coefficient, regressor in zip(map(str, row.coefficients), row.regressor, strict=True):
        other = found.get(regressor, found.get(-regressor))
        if regressor == 0 or other is not None:
            equals = "is 0" if regressor == 0 else f"equals that of {other!r}"
            raise ModelError(
                symbolic.system.name,
                f"row {row.name!r}: the regressor of {coefficient!r} {equals}, so that no motion "
                f"determines it: leave it out",
            )
        found[regressor] = coefficient


def _without_other_velocities(
    symbolic: SymbolicSystem, row: SymbolicRow, coefficient: str, regressor: sp.Expr
) -> sp.Expr:
    """Return the simplified regressor; raise if its cancelling term needs an acceleration."""
    others = [other.velocity for other in symbolic.rows if other.velocity != row.velocity]
    if any(regressor.has(velocity) for velocity in others):
        regressor = sp.simplify(regressor)  # sin(v)**2 + cos(v)**2 does not depend on v
    for velocity in others:
        if regressor.has(velocity):
            raise AccelerationError(symbolic.system.name, row.name, coefficient, str(velocity))
    return regressor


def _check_rest(
    symbolic: SymbolicSystem, row: SymbolicRow, coefficient: str, regressor: sp.Expr
) -> None:
    """Raise `ModelError` if a regressor is undefined at rest, where its integral starts."""
    if regressor.subs(row.velocity, 0).has(sp.zoo, sp.nan, sp.oo, -sp.oo):
        v = row.velocity
        raise ModelError(
            symbolic.system.name,
            f"row {row.name!r}: the regressor of {coefficient!r} divides by zero at {v} = 0, where "
            f"its integral begins: write it so that it has a value there, for example "
            f"{v}/({v}**2 + 0.01**2) instead of 1/{v}, or sign({v}) instead of {v}/abs({v})",
        )


def _cancelling(
    symbolic: SymbolicSystem,
    row: SymbolicRow,
    coefficient: str,
    b: sp.Expr,
    rates: tuple[sp.Symbol, ...],
) -> sp.Expr:
    """Return C = Σ xᵢ' ∂b/∂xᵢ over the coordinates and the inputs."""
    moving = [(other.coordinate, other.velocity) for other in symbolic.rows]
    moving += zip(symbolic.inputs, rates, strict=True)
    total = sp.S.Zero
    for variable, rate in moving:
        slope = b.diff(variable)
        if slope.has(sp.DiracDelta, sp.Derivative):
            raise ModelError(
                symbolic.system.name,
                f"row {row.name!r}: the regressor of {coefficient!r} jumps with {str(variable)!r}, "
                f"so it has no cancelling term: smooth it, for example tanh({variable}/0.01) "
                f"instead of sign({variable})",
            )
        total += rate * slope
    return sp.factor_terms(total)


VARIABLE = sp.Symbol("_xi", real=True)  # the variable of integration


# There are closed forms for polynomials in v, |v| and sign v, and for tanh of a linear function of
# v. Other antiderivatives may evaluate to -inf or lose all digits.
def immersion(
    regressor: sp.Expr, velocity: sp.Symbol, constants: Sequence[sp.Symbol] = ()
) -> sp.Expr:
    """Return b = ∫₀^v r dξ, Huang (2003), eq. (2): a closed form or an unevaluated integral."""
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
    """Return the closed form of one term's integral; None if it has no simple one."""
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


class LogCosh(sp.Function):
    """ln cosh z, the integral of tanh z, printed in a form that is accurate for any z."""

    nargs = 1

    @classmethod
    def eval(cls, z: sp.Expr) -> sp.Expr | None:  # type: ignore[override] - SymPy takes any arity
        """Simplify the value at zero, and the sign of z, as the function is even."""
        if z.is_zero:
            return sp.S.Zero
        return cls(-z) if z.could_extract_minus_sign() else None

    def fdiff(self, argindex: int = 1) -> sp.Expr:  # noqa: ARG002, the protocol of SymPy
        """Return the derivative tanh z."""
        return sp.tanh(self.args[0])

    def stable(self) -> sp.Expr:
        """Return |z| + ln(1 + exp(-2|z|)) - ln 2, which is accurate for large |z| as well."""
        size = sp.Abs(self.args[0])
        return size + sp.log(1 + sp.exp(-2 * size)) - sp.log(2)

    def _pythoncode(self, printer: CodePrinter) -> str:
        return f"({printer.doprint(self.stable())})"

    _ccode = _pythoncode

    def _latex(self, printer: LatexPrinter) -> str:
        return rf"\ln\cosh{{\left({printer.doprint(self.args[0])} \right)}}"

    def _eval_evalf(self, prec: int) -> sp.Expr:
        return self.stable()._eval_evalf(prec) or self.stable()

    def _eval_is_extended_real(self) -> bool | None:
        return self.args[0].is_extended_real


def log_cosh(z: sp.Expr) -> sp.Expr:
    """Return ln cosh z as an `sp.Expr`."""
    return cast(sp.Expr, LogCosh(z))


# Generated code integrates a regressor over a velocity with this fixed rule. Friction changes
# within a fraction of a rad/s while velocities reach a hundred, so Gauss-Legendre nodes on all of
# [0, v] would miss the changes near zero. Panels halve towards zero, each with as many nodes. They
# scale with v, so one table of nodes on [0, 1] is enough.

_PANELS = 10  # the first ends at v / 2⁹
_NODES_PER_PANEL = 8


@cache
def graded_rule() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return nodes and weights on [0, 1], dense near 0: ∫₀^v r dξ ≈ v Σ weights r(v nodes)."""
    ends = np.concatenate([[0.0], 2.0 ** np.arange(1 - _PANELS, 1)])
    nodes, weights = np.polynomial.legendre.leggauss(_NODES_PER_PANEL)
    starts, widths = ends[:-1, None], np.diff(ends)[:, None]
    return (
        (starts + widths * (nodes + 1.0) / 2.0).ravel(),
        (widths * weights / 2.0).ravel(),
    )
