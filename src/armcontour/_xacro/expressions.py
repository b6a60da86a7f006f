"""Expressions of xacro files: their syntax tree is checked, and their operators are bounded."""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Callable
from typing import Any

# Text of an expression; the longest of public robot descriptions have some 200 characters.
LONGEST = 10_000
# Elements of a repeated text or list, and of a range.
MOST_ITEMS = 100_000
# Bits of a whole number: 1e308 has 1024.
MOST_BITS = 4096
# Digits that a text is formatted with.
WIDEST = 100

ALLOWED = (
    ast.Expression,
    ast.Constant,
    ast.Name,
    ast.Attribute,
    ast.Subscript,
    ast.Slice,
    ast.Tuple,
    ast.List,
    ast.Set,
    ast.Dict,
    ast.BinOp,
    ast.UnaryOp,
    ast.BoolOp,
    ast.Compare,
    ast.IfExp,
    ast.Call,
    ast.keyword,
    ast.Starred,
    ast.expr_context,
    ast.operator,
    ast.unaryop,
    ast.boolop,
    ast.cmpop,
)
NAMED = {
    ast.Lambda: "a lambda",
    ast.ListComp: "a comprehension",
    ast.SetComp: "a comprehension",
    ast.DictComp: "a comprehension",
    ast.GeneratorExp: "a generator",
    ast.JoinedStr: "a formatted string",
    ast.NamedExpr: "an assignment",
}
# What leads from a value to the interpreter: private names; frames, code, generators, functions.
INNER = ("_", "gi_", "f_", "cr_", "tb_", "ag_", "co_", "func_", "im_")
# Methods that read attributes by name, or that make texts of any length.
METHODS = {"format", "format_map", "mro"}
METHODS |= {"ljust", "rjust", "center", "zfill", "expandtabs", "to_bytes"}


class Refused(BaseException):
    """What a description must not do; no `except Exception` of xacro catches it."""


def compile_expression(text: str) -> Any:
    """The code of an expression, to be evaluated where the names in `OPERATIONS` are known.

    Raises:
        Refused: The expression could reach the interpreter.
        SyntaxError: The text is not an expression.
    """
    text = text.strip()
    if len(text) > LONGEST:
        raise Refused(f"an expression has {len(text)} characters, more than {LONGEST}")
    try:
        tree = ast.parse(text, "<expression>", "eval")
        for node in ast.walk(tree):
            _check(node, text)
        bounded = ast.fix_missing_locations(_Bounded().visit(tree))
        return compile(bounded, "<expression>", "eval")
    except (RecursionError, MemoryError):
        raise Refused(f"the expression {_shown(text)} is nested too deeply") from None


def _check(node: ast.AST, text: str) -> None:
    """Refuse a part of an expression that no robot description needs."""
    found = None
    if not isinstance(node, ALLOWED):
        found = NAMED.get(type(node), f"syntax of the kind {type(node).__name__}")
    elif isinstance(node, ast.Name) and node.id.startswith("__"):
        found = f"the name {node.id}"
    elif isinstance(node, ast.Attribute):
        if node.attr.startswith(INNER) or node.attr in METHODS:
            found = f"the attribute {node.attr}"
    if found is not None:
        raise Refused(f"the expression {_shown(text)} holds {found}, which is refused")


def _shown(text: str) -> str:
    return repr(text if len(text) <= 80 else f"{text[:77]}...")


def _power(base: Any, exponent: Any) -> Any:
    if isinstance(base, int) and isinstance(exponent, int):
        _bits(base.bit_length() * max(exponent, 0))
    return base**exponent


def _times(left: Any, right: Any) -> Any:
    if isinstance(left, int) and isinstance(right, int):
        _bits(left.bit_length() + right.bit_length())
    for items, count in ((left, right), (right, left)):
        if isinstance(items, str | bytes | list | tuple) and isinstance(count, int):
            _items(len(items) * count)
    return left * right


def _shift(value: Any, by: Any) -> Any:
    if isinstance(value, int) and isinstance(by, int):
        _bits(value.bit_length() + max(by, 0))
    return value << by


def _remainder(left: Any, right: Any) -> Any:
    """`%`: a remainder, or a text with values put in."""
    if isinstance(left, str | bytes):
        text = left if isinstance(left, str) else left.decode("latin-1")
        if "*" in text or any(int(x) > WIDEST for x in re.findall(r"[0-9]{1,9}", text)):
            raise Refused(f"a text is formatted to a width above {WIDEST}")
    return left % right


def _bits(count: int) -> None:
    if count > MOST_BITS:
        raise Refused(f"an expression makes a whole number of more than {MOST_BITS} bits")


def _items(count: int) -> None:
    if count > MOST_ITEMS:
        raise Refused(f"an expression makes more than {MOST_ITEMS} items")


def bounded_range(*args: int) -> range:
    """`range`, not longer than `MOST_ITEMS`."""
    found = range(*args)
    # The length of a longer one may not even be a number that `len` gives.
    if found and abs((found[-1] - found[0]) // found.step) >= MOST_ITEMS:
        raise Refused(f"an expression makes more than {MOST_ITEMS} items")
    return found


def bounded_factorial(n: int) -> int:
    """`math.factorial` of numbers below 500, whose result has some 3800 bits."""
    if n >= 500:
        raise Refused(f"an expression makes a whole number of more than {MOST_BITS} bits")
    return math.factorial(n)


OPERATORS: dict[type[ast.operator], tuple[str, Callable[[Any, Any], Any]]] = {
    ast.Pow: ("__power", _power),
    ast.Mult: ("__times", _times),
    ast.LShift: ("__shifted", _shift),
    ast.Mod: ("__remainder", _remainder),
}
# What the code of `compiled` calls in the place of operators, by name.
OPERATIONS = dict(OPERATORS.values())


class _Bounded(ast.NodeTransformer):
    """Puts calls of bounded functions in the place of operators that could explode."""

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:  # noqa: N802
        """Replace one operator; the name is the one that `ast` calls."""
        self.generic_visit(node)
        if type(node.op) not in OPERATORS:
            return node
        name = ast.Name(id=OPERATORS[type(node.op)][0], ctx=ast.Load())
        call = ast.Call(func=name, args=[node.left, node.right], keywords=[])
        return ast.copy_location(call, node)
