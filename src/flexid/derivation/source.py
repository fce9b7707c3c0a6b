"""SymPy expressions as scalar, CSE-reduced Python source for numba."""

from collections.abc import Collection, Sequence

import sympy as sp
from sympy.printing.pycode import PythonCodePrinter


class ScalarPrinter(PythonCodePrinter):
    """Printer of plain `math` calls and products, which numba compiles to fast code."""

    def _print_Integer(self, expr: sp.Integer) -> str:
        return repr(float(expr))

    _print_Rational = _print_NumberSymbol = _print_Integer  # pyright: ignore
    _print_Pi = _print_Exp1 = _print_Integer  # pyright: ignore

    def _print_Function(self, expr: sp.Function) -> str:
        arguments = ", ".join(self._print(argument) for argument in expr.args)
        return f"{type(expr).__name__.lower()}({arguments})"

    _print_sin = _print_cos = _print_tan = _print_tanh = _print_Function
    _print_exp = _print_log = _print_Abs = _print_Function

    def _print_sign(self, e: sp.Function) -> str:
        argument = self._print(e.args[0])
        return f"copysign(1.0*({argument} != 0.0), {argument})"  # for arrays, too

    def _print_Pow(self, expr: sp.Pow, rational: bool = False) -> str:
        base, exponent = expr.args
        if isinstance(exponent, sp.Integer) and abs(int(exponent)) <= 4:
            product = "*".join([f"({self._print(base)})"] * abs(int(exponent)))
            return f"({product})" if exponent.is_positive else f"(1.0/({product}))"
        if exponent == sp.S.Half:
            return f"sqrt({self._print(base)})"
        return f"({self._print(base)})**({self._print(exponent)})"


_printer = ScalarPrinter({"fully_qualified_modules": False})

IMPORTS = "from math import copysign, cos, exp, log, sin, sqrt, tan, tanh"
"""Import line of the generated modules of scalars."""

ARRAY_IMPORTS = "from numpy import copysign, cos, exp, log, sin, sqrt, tan, tanh"
"""Import line of the generated modules of arrays."""


def print_scalar(expression: sp.Basic) -> str:
    """Return an expression as Python source."""
    return str(_printer.doprint(expression))


def assignments(
    targets: Sequence[str], expressions: Sequence[sp.Expr], indent: str = "    "
) -> str:
    """Return lines that assign expressions to targets; common subexpressions are computed once."""
    # A leading underscore marks the generator's own names; declarations cannot have one.
    names = sp.numbered_symbols("_e", real=True)
    temporaries, reduced = sp.cse(list(expressions), symbols=names, optimizations="basic")
    lines = [f"{name} = {print_scalar(value)}" for name, value in temporaries]
    lines += [
        f"{target} = {print_scalar(sp.sympify(value))}"
        for target, value in zip(targets, reduced, strict=True)
    ]
    return "\n".join(indent + line for line in lines or ["pass"])


def unpack(
    array: str, symbols: Sequence[sp.Symbol], used: Collection[sp.Basic] | None = None
) -> str:
    """Return lines that read symbols, or only those used, from consecutive entries of an array."""
    wanted = symbols if used is None else used
    lines = (f"    {name} = {array}[{i}]" for i, name in enumerate(symbols) if name in wanted)
    return "\n".join(lines)


CALLED_IMPORTS = f"""{IMPORTS}

from numba import cfunc, types

_numbers = types.CPointer(types.float64)"""
"""Import lines of a module with functions that kernels call by address."""


def called(arrays: int) -> str:
    """Return the decorator of a function of arrays that kernels call by address."""
    return f"""cfunc(
    types.void({", ".join(["_numbers"] * arrays)}),
    cache=True, error_model="numpy", _nrt=False,
)"""


def function(
    signature: str,
    docstring: str,
    *body: str,
    decorator: str = 'njit(cache=True, error_model="numpy", no_cfunc_wrapper=True)',
) -> str:
    """Return a function's source from its signature, docstring and blocks of indented lines."""
    blocks = "\n".join(block for block in body if block)
    head = f"@{decorator}\n" * bool(decorator)
    return f'{head}def {signature}:\n    """{docstring}"""\n{blocks}\n'
