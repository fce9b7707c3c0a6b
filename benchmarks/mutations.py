"""Mutations of a source: changes of one operator, number or keyword."""

import ast
from collections.abc import Iterator
from typing import Any

_COMPARED: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.LtE, ast.Gt),
    ast.LtE: (ast.Lt, ast.GtE),
    ast.Gt: (ast.GtE, ast.Lt),
    ast.GtE: (ast.Gt, ast.LtE),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
_COMPUTED: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.Pow: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult,
    ast.BitOr: ast.BitAnd,
    ast.BitAnd: ast.BitOr,
}
_LEFT_OUT = {"annotation", "returns", "decorator_list", "type_params"}


def mutated(node: ast.AST) -> Iterator[ast.AST]:
    """Yield the mutations of a node."""
    match node:
        case ast.Compare():
            for place, operator in enumerate(node.ops):
                for other in _COMPARED[type(operator)]:
                    ops = [*node.ops[:place], other(), *node.ops[place + 1 :]]
                    yield ast.Compare(node.left, ops, node.comparators)
        case ast.BinOp() if type(node.op) in _COMPUTED:
            yield ast.BinOp(node.left, _COMPUTED[type(node.op)](), node.right)
        case ast.BoolOp():
            yield ast.BoolOp(ast.Or() if isinstance(node.op, ast.And) else ast.And(), node.values)
        case ast.UnaryOp(op=ast.Not() | ast.USub()):
            yield node.operand
        case ast.Constant(value=bool()):
            yield ast.Constant(not node.value)
        case ast.Constant(value=int()):
            yield ast.Constant(node.value + 1)
        case ast.Constant(value=float()):
            yield ast.Constant(2.0 * node.value or 1.0)
        case ast.Continue():
            yield ast.Break()
        case _:
            pass


def parts(node: ast.AST) -> Iterator[ast.AST]:
    """Yield the nodes of a tree, without annotations, decorators and formatted strings."""
    yield node
    for field, value in ast.iter_fields(node):
        if field not in _LEFT_OUT:
            children = value if isinstance(value, list) else [value]
            for child in children:
                if isinstance(child, ast.AST) and not isinstance(child, ast.JoinedStr):
                    yield from parts(child)


def changes(source: bytes) -> list[tuple[int, str, str, bytes]]:
    """Return line, text before and after, and the whole source of every change."""
    starts = [0]
    for line in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    found = []
    for node in parts(ast.parse(source)):
        for other in mutated(node):
            place: Any = node
            begin = starts[place.lineno - 1] + place.col_offset
            end = starts[place.end_lineno - 1] + place.end_col_offset
            before, after = ast.unparse(node), ast.unparse(other)
            text = after if isinstance(other, ast.stmt) else f"({after})"
            whole = source[:begin] + text.encode() + source[end:]
            found.append((place.lineno, *_near(before, after), whole))
    return found


def _near(before: str, after: str) -> tuple[str, str]:
    """Return an excerpt of both texts around their first difference."""
    pairs = enumerate(zip(f"{before} ", f"{after} ", strict=False))
    first = max(next((k for k, (a, b) in pairs if a != b), 0) - 25, 0)
    return before[first : first + 60], after[first : first + 60]
