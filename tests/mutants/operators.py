"""Small faults that can be planted in Python code, by its syntax."""

import ast
from collections.abc import Iterator
from copy import copy
from typing import NamedTuple

_SWAPS = [
    *((ast.Lt, ast.LtE), (ast.Gt, ast.GtE), (ast.Eq, ast.NotEq), (ast.Is, ast.IsNot)),
    *((ast.In, ast.NotIn), (ast.And, ast.Or), (ast.Add, ast.Sub), (ast.Mult, ast.Div)),
    *((ast.BitAnd, ast.BitOr), (ast.FloorDiv, ast.Mod)),
]
_OTHER_OPERATOR = dict(_SWAPS) | {second: first for first, second in _SWAPS} | {ast.Pow: ast.Mult}
_SAME_EITHER_WAY = (ast.Add, ast.Mult, ast.BitAnd, ast.BitOr)
_NAMES = [
    *(("min", "max"), ("minimum", "maximum"), ("argmin", "argmax"), ("amin", "amax")),
    *(("any", "all"), ("floor", "ceil"), ("sin", "cos"), ("zeros", "ones"), ("sum", "mean")),
]
_OTHER_NAME = dict(_NAMES) | {second: first for first, second in _NAMES}
# Parts of code that no test should notice, or whose positions Python 3.11 does not know.
_LEFT_ALONE = (ast.Raise, ast.Assert, ast.JoinedStr, ast.Import, ast.ImportFrom, ast.match_case)
_SKIPPED_FIELDS = {"annotation", "returns", "decorator_list", "type_comment"}


class Mutant(NamedTuple):
    """One deliberate fault in a file's text.

    Attributes:
        place: name of the function that it is in, "" outside of all.
        line: number, from 1.
        before, after: the code that changes, as one line.
        text: of the whole file with the fault.
    """

    place: str
    line: int
    before: str
    after: str
    text: str


def mutants(text: str) -> dict[str, list[Mutant]]:
    """Every fault that the operators can plant in a file: name of a function -> its mutants."""
    found: dict[str, list[Mutant]] = {}
    for place, node in _nodes(ast.parse(text), ""):
        for other in _variants(node):
            if (mutant := _planted(text, place, node, other)) is not None:
                found.setdefault(place, []).append(mutant)
    return found


def _nodes(tree: ast.AST, place: str) -> Iterator[tuple[str, ast.AST]]:
    """All parts of a tree that may change, each with the name of its function."""
    if isinstance(tree, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
        place = f"{place}.{tree.name}".lstrip(".")
    for field, value in ast.iter_fields(tree):
        for part in value if isinstance(value, list) else [value]:
            if field in _SKIPPED_FIELDS or isinstance(part, _LEFT_ALONE):
                continue
            if isinstance(part, ast.AST):
                yield place, part
                yield from _nodes(part, place)


def _variants(node: ast.AST) -> Iterator[ast.AST]:
    """A part with one fault each."""
    match node:
        case ast.Compare(ops=[op]) if type(op) in _OTHER_OPERATOR:
            yield _with(node, ops=[_OTHER_OPERATOR[type(op)]()])
        case ast.BinOp(left, op, right) if type(op) in _OTHER_OPERATOR:
            yield _with(node, op=_OTHER_OPERATOR[type(op)]())
            if not isinstance(op, _SAME_EITHER_WAY):
                yield _with(node, left=right, right=left)
        case ast.BinOp(left, ast.MatMult(), right):
            yield _with(node, left=right, right=left)
        case ast.BoolOp(op):
            yield _with(node, op=_OTHER_OPERATOR[type(op)]())
        case ast.UnaryOp(ast.Not() | ast.USub() | ast.Invert(), operand):
            yield operand
        case ast.Constant(bool(value)):
            yield ast.Constant(not value)
        case ast.Constant(int(value)):
            yield ast.Constant(value + 1)
        case ast.Constant(float(value)):
            yield ast.Constant(2 * value if value else 1.0)
        case ast.IfExp(_, body, orelse):
            yield _with(node, body=orelse, orelse=body)
        case ast.Call():
            yield from _other_calls(node)
        case ast.Return(value) if value and not isinstance(value, ast.Constant):
            yield ast.Return(ast.Constant(None))
        case ast.AugAssign() | ast.Expr(ast.Call()) | ast.Continue():
            yield ast.Pass()
        case ast.Assign([ast.Subscript() | ast.Attribute()]):
            yield ast.Pass()


def _other_calls(call: ast.Call) -> Iterator[ast.AST]:
    """A call of the opposite or with its first arguments swapped, and without each named one."""
    match call:
        case ast.Call(ast.Name(name)) if name in _OTHER_NAME:
            yield _with(call, func=ast.Name(_OTHER_NAME[name]))
        case ast.Call(ast.Attribute(_, name)) if name in _OTHER_NAME:
            yield _with(call, func=_with(call.func, attr=_OTHER_NAME[name]))
        case ast.Call(_, [first, second, *rest]) if ast.dump(first) != ast.dump(second):
            yield _with(call, args=[second, first, *rest])
    for keyword in call.keywords:
        yield _with(call, keywords=[other for other in call.keywords if other is not keyword])


def _with(node: ast.AST, **fields: object) -> ast.AST:
    changed = copy(node)
    for name, value in fields.items():
        setattr(changed, name, value)
    return changed


def _planted(text: str, place: str, node: ast.AST, other: ast.AST) -> Mutant | None:
    """The text with one part for another; None if that is no Python."""
    code = text.encode()  # columns count bytes
    starts = [0]
    for line in code.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    start = starts[node.lineno - 1] + node.col_offset
    end = starts[node.end_lineno - 1] + node.end_col_offset
    after = ast.unparse(other)
    # Parentheses keep together what an operator beside it would else take apart.
    put = f"({after})" if isinstance(other, ast.expr) else after
    mutated = (code[:start] + put.encode() + code[end:]).decode()
    try:
        compile(mutated, "mutant", "exec")
    except (SyntaxError, ValueError):
        return None
    return Mutant(place, node.lineno, ast.unparse(node), after, mutated)
