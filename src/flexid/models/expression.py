"""Text expressions: parsed to Python's syntax tree, checked by a whitelist, never evaluated."""

import ast
import math
import operator
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Generic, TypeVar

from flexid.errors import ExpressionError

FUNCTIONS = ("sin", "cos", "tan", "tanh", "exp", "log", "sqrt", "sign", "abs")
"""Names of the functions an expression may call, each with one argument."""

CONSTANTS = ("pi",)

_ALIASES = {"Abs": "abs"}  # how SymPy prints it
_MAX_LENGTH = 4000
_MAX_DEPTH = 60
_MAX_EXPONENT = 12
_MAX_POWER_LEVELS = 2  # limits the size of numbers: 9e300 to the 12th twice has 43 000 digits

T = TypeVar("T")


@dataclass(frozen=True)
class Algebra(Generic[T]):
    """Meaning of the parts of an expression."""

    number: Callable[[str], T]  # value of a number in decimal text
    name: Callable[[str], T]  # value of a declared name or of the constant ``pi``
    operations: Mapping[str, Callable[..., T]]  # by the names in `OPERATIONS` and `FUNCTIONS`


_OPERATORS: dict[type[ast.operator], str] = {
    ast.Add: "+",
    ast.Sub: "-",
    ast.Mult: "*",
    ast.Div: "/",
    ast.Pow: "**",
}

OPERATIONS: dict[str, Callable[..., Any]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
    "**": operator.pow,
    "negate": operator.neg,
}
"""Operations of most algebras by their sign, and ``negate``, the unary minus."""


def fold(expression: str, names: Collection[str], algebra: Algebra[T], place: str) -> T:
    """Parse an expression and return its value in an algebra."""
    if len(expression) > _MAX_LENGTH:
        raise ExpressionError(expression, f"is longer than {_MAX_LENGTH} characters", place)
    try:
        tree = _parsed(expression.strip())
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise ExpressionError(
            expression, "is not a formula: write one expression such as -sin(x1) + x2**2", place
        ) from None
    return _Folder(expression, names, algebra, place).visit(tree.body, 0)


@lru_cache(maxsize=256)
def _parsed(expression: str) -> ast.Expression:
    return ast.parse(expression, mode="eval")


@lru_cache(maxsize=1024)  # a process often makes the same model many times
def check_expression(expression: str, names: frozenset[str], place: str) -> None:
    """Raise `ExpressionError` if an expression uses anything but the whitelist and the names."""
    fold(expression, names, _CHECKS_ONLY, place)


def evaluate(expression: str, values: Mapping[str, float], place: str) -> float:
    """Return the value of an expression."""
    numbers = Algebra(float, {"pi": math.pi, **values}.__getitem__, _NUMERIC_OPERATIONS)
    try:
        value = fold(expression, values, numbers, place)
    except (ArithmeticError, ValueError):
        value = math.nan
    if not math.isfinite(value):
        given = ", ".join(f"{name} = {value:g}" for name, value in values.items())
        raise ExpressionError(expression, f"has no finite value for {given}: change these", place)
    return value


@dataclass(frozen=True)
class _Folder:
    _expression: str
    _names: Collection[str]
    _algebra: Algebra
    _place: str

    def _operate(self, name: str, *operands: Any):
        return self._algebra.operations[name](*operands)

    def refuse(self, reason: str) -> ExpressionError:
        return ExpressionError(self._expression, reason, self._place)

    def visit(self, node: ast.expr, depth: int):
        if depth > _MAX_DEPTH:
            raise self.refuse(f"is nested deeper than {_MAX_DEPTH} levels")
        if isinstance(node, ast.Constant):
            return self._algebra.number(self.decimal(node))
        if isinstance(node, ast.Name):
            return self._algebra.name(self.known(node.id))
        if isinstance(node, ast.BinOp) and type(node.op) in _OPERATORS:
            return self.binary(node, depth)
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.UAdd):
            operand = self.visit(node.operand, depth + 1)
            return operand if isinstance(node.op, ast.UAdd) else self._operate("negate", operand)
        if isinstance(node, ast.Call):
            return self.call(node, depth)
        raise self.refuse(
            f"{ast.unparse(node)[:40]!r} is not allowed: only numbers, declared names, + - * / ** "
            f"and {', '.join(FUNCTIONS)}"
        )

    def decimal(self, node: ast.Constant) -> str:
        value = node.value
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self.refuse(f"{str(value)[:20]!r} is not a number")
        if isinstance(value, int) and value.bit_length() > 60:
            raise self.refuse("has an integer of more than 18 digits: write it as 1e20")
        if not math.isfinite(value):
            raise self.refuse("has a number that overflows")
        return repr(value)

    def known(self, name: str) -> str:
        if name not in self._names and name not in CONSTANTS:
            declared = ", ".join(sorted(self._names)) or "none"
            raise self.refuse(f"{name!r} is not declared here; declared are {declared}")
        return name

    def binary(self, node: ast.BinOp, depth: int):
        # Python nests a + b + c as (a + b) + c; the loop keeps a long sum from counting as deep.
        chain, first = [], node
        while isinstance(first, ast.BinOp) and type(first.op) in _OPERATORS:
            chain.append(first)
            first = first.left
        value = self.visit(first, depth + 1)
        for part in reversed(chain):
            sign = _OPERATORS[type(part.op)]
            if sign == "**":
                self.check_exponent(part.right)
                if _power_levels(part) > _MAX_POWER_LEVELS:
                    raise self.refuse(f"has powers of powers over {_MAX_POWER_LEVELS} levels deep")
            value = self._operate(sign, value, self.visit(part.right, depth + 1))
        return value

    def check_exponent(self, node: ast.expr) -> None:
        # Only literal exponents: the computer algebra would never finish with a power tower.
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
            node = node.operand
        match node:
            case ast.Constant(int() | float() as value):
                pass
            case ast.BinOp(ast.Constant(int() | float() as value), ast.Div(), ast.Constant()):
                pass
            case _:
                value = math.inf
        if abs(value) > _MAX_EXPONENT:
            raise self.refuse(f"an exponent must be a number between ±{_MAX_EXPONENT}")

    def call(self, node: ast.Call, depth: int):
        name = node.func.id if isinstance(node.func, ast.Name) else ast.unparse(node.func)
        function = _ALIASES.get(name, name)
        if function not in FUNCTIONS:
            raise self.refuse(
                f"the function {name[:40]!r} is not allowed; allowed are {', '.join(FUNCTIONS)}"
            )
        if len(node.args) != 1 or node.keywords:
            raise self.refuse(f"{function} takes one argument")
        return self._operate(function, self.visit(node.args[0], depth + 1))


_NUMERIC_OPERATIONS: dict[str, Callable[..., Any]] = {
    **OPERATIONS,
    "**": math.pow,  # which has no complex values
    **{name: getattr(math, name) for name in ("sin", "cos", "tan", "tanh", "exp", "log", "sqrt")},
    "sign": lambda x: math.copysign(1.0, x) if x else 0.0,
    "abs": abs,
}

_CHECKS_ONLY = Algebra[None](
    lambda _: None, lambda _: None, dict.fromkeys(_NUMERIC_OPERATIONS, lambda *_: None)
)
"""Algebra for checks alone: every part has the value None."""


def _power_levels(node: ast.AST) -> int:
    deepest, waiting = 0, [(node, 0)]
    while waiting:
        part, level = waiting.pop()
        level += isinstance(part, ast.BinOp) and isinstance(part.op, ast.Pow)
        deepest = max(deepest, level)
        waiting += [(child, level) for child in ast.iter_child_nodes(part)]
    return deepest
