"""Functions that an observer may need beyond those of a declaration."""

from typing import cast

import sympy as sp


class LogCosh(sp.Function):
    """ln cosh z, the integral of tanh z, in a form that is right for any size of z."""

    nargs = 1

    @classmethod
    def eval(cls, z: sp.Expr) -> sp.Expr | None:  # type: ignore[override] - SymPy takes any arity
        """Value at zero; the function is even."""
        if z.is_zero:
            return sp.S.Zero
        return cls(-z) if z.could_extract_minus_sign() else None

    def fdiff(self, argindex: int = 1) -> sp.Expr:  # noqa: ARG002, the protocol of SymPy
        """Derivative: tanh z."""
        return sp.tanh(self.args[0])

    def stable(self) -> sp.Expr:
        """|z| + ln(1 + exp(-2|z|)) - ln 2, which neither overflows nor cancels for large |z|."""
        size = sp.Abs(self.args[0])
        return size + sp.log(1 + sp.exp(-2 * size)) - sp.log(2)

    def _eval_evalf(self, prec: int) -> sp.Expr:
        return self.stable()._eval_evalf(prec) or self.stable()

    def _eval_is_extended_real(self) -> bool | None:
        return self.args[0].is_extended_real


def log_cosh(z: sp.Expr) -> sp.Expr:
    """ln cosh z as a plain expression."""
    return cast(sp.Expr, LogCosh(z))
