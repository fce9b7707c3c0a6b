"""A model's right-hand side in C99, for simulators: the operations of the compiled Python."""

import sympy as sp

from flexid.derivation.source import ScalarPrinter
from flexid.derivation.symbolic import symbolic_system
from flexid.models.parametric_system import ParametricSystem


class _PlantPrinter(ScalarPrinter):
    """Scalar C on doubles; every symbol of the model is a place in an array."""

    def __init__(self, places: dict[sp.Symbol, str]) -> None:
        super().__init__({"fully_qualified_modules": False})
        self._places = places

    def _print_Symbol(self, expr: sp.Symbol) -> str:  # noqa: N802, SymPy's printer protocol
        return self._places.get(expr, expr.name)

    def _print_Abs(self, expr: sp.Function) -> str:  # noqa: N802, the same
        return f"fabs({self._print(expr.args[0])})"

    def _print_sign(self, e: sp.Function) -> str:
        argument = self._print(e.args[0])
        return f"(({argument} == 0.0) ? 0.0 : copysign(1.0, {argument}))"

    def _print_Pow(self, expr: sp.Pow, rational: bool = False) -> str:  # noqa: N802, the same
        base, exponent = expr.args
        small = isinstance(exponent, sp.Integer) and abs(int(exponent)) <= 4
        if small or exponent == sp.S.Half:
            return super()._print_Pow(expr, rational)
        return f"pow({self._print(base)}, {self._print(exponent)})"


def plant_rates(system: ParametricSystem) -> str:
    """Source of ``rates(x, u, p, dx)``."""
    symbolic = symbolic_system(system)
    groups = {
        "x": symbolic.states,
        "u": symbolic.inputs,
        "p": (*symbolic.coefficients, *symbolic.constants),
    }
    places = {
        symbol: f"{array}[{place}]"
        for array, symbols in groups.items()
        for place, symbol in enumerate(symbols)
    }
    printer = _PlantPrinter(places)
    names = sp.numbered_symbols("e", real=True)
    expressions = list(symbolic.right_hand_side)
    temporaries, reduced = sp.cse(expressions, symbols=names, optimizations="basic")
    lines = [f"const double {name} = {printer.doprint(value)};" for name, value in temporaries]
    used = set().union(*(e.free_symbols for e in expressions))
    lines += [f"(void){array};" for array, group in groups.items() if used.isdisjoint(group)]
    lines += [
        f"dx[{place}] = {printer.doprint(value)}; /* {state}' */"
        for place, (state, value) in enumerate(zip(symbolic.states, reduced, strict=True))
    ]
    body = "\n".join(f"    {line}" for line in lines)
    arguments = "const double x[], const double u[], const double p[], double dx[]"
    return f"static void rates({arguments})\n{{\n{body}\n}}\n"
