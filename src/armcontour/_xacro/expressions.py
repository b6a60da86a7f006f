"""Compilation of xacro expressions with a checked syntax tree and bounded operators."""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Callable
from typing import Any

# Longest expression [characters]; in public robot descriptions they have up to about 200.
LONGEST = 10_000
# Largest number of elements of a repeated text or list, and of a range.
MOST_ITEMS = 100_000
# Largest number of bits of a whole number; 1e308 has 1024.
MOST_BITS = 4096
# Largest width in the format of a text [characters].
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
# Prefixes of attributes that give access to the interpreter: private names, and attributes of
# frames, code objects, generators and functions.
INNER = ("_", "gi_", "f_", "cr_", "tb_", "ag_", "co_", "func_", "im_")
# Methods that read attributes by name, or that make texts of any length.
METHODS = {"format", "format_map", "mro"}
METHODS |= {"ljust", "rjust", "center", "zfill", "expandtabs", "to_bytes"}


class Refused(BaseException):
    """The refusal of a description; a BaseException, so that xacro does not catch it."""


class Lacking(Refused):
    """The refusal of a description that needs a package or an argument that is not given."""


def compile_expression(text: str) -> Any:
    """Compile an expression; the code must be evaluated with the names of `OPERATIONS`.

    Raises:
        Refused: The expression is too long, too deeply nested, or could access the interpreter.
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
    """Refuse a part of an expression that no robot description needs.

    Raises:
        Refused: The node is such a part.
    """
    bad = None
    if not isinstance(node, ALLOWED):
        bad = NAMED.get(type(node), f"syntax of the kind {type(node).__name__}")
    elif isinstance(node, ast.Name) and node.id.startswith("__"):
        bad = f"the name {node.id}"
    elif isinstance(node, ast.Attribute):
        if node.attr.startswith(INNER) or node.attr in METHODS:
            bad = f"the attribute {node.attr}"
    if bad is not None:
        raise Refused(f"the expression {_shown(text)} contains {bad}, which is refused")


def _shown(text: str) -> str:
    """The text of an expression in quotes, shortened to 80 characters, for messages."""
    return repr(text if len(text) <= 80 else f"{text[:77]}...")


def _power(base: Any, exponent: Any) -> Any:
    """The operator `**` with bounded results."""
    if isinstance(base, int) and isinstance(exponent, int):
        _refuse_bits(base.bit_length() * max(exponent, 0))
    return base**exponent


def _times(left: Any, right: Any) -> Any:
    """The operator `*` with bounded results."""
    if isinstance(left, int) and isinstance(right, int):
        _refuse_bits(left.bit_length() + right.bit_length())
    for items, count in ((left, right), (right, left)):
        if isinstance(items, str | bytes | list | tuple) and isinstance(count, int):
            _refuse_items(len(items) * count)
    return left * right


def _shift(value: Any, by: Any) -> Any:
    """The operator `<<` with bounded results."""
    if isinstance(value, int) and isinstance(by, int):
        _refuse_bits(value.bit_length() + max(by, 0))
    return value << by


def _remainder(left: Any, right: Any) -> Any:
    """The operator `%` with bounded results: a remainder, or a formatted text."""
    if isinstance(left, str | bytes):
        text = left if isinstance(left, str) else left.decode("latin-1")
        if "*" in text or any(int(x) > WIDEST for x in re.findall(r"[0-9]{1,9}", text)):
            raise Refused(f"a text is formatted to a width above {WIDEST}")
    return left % right


def _refuse_bits(count: int) -> None:
    """Refuse a whole number of more than `MOST_BITS` bits.

    Raises:
        Refused: It has more.
    """
    if count > MOST_BITS:
        raise Refused(f"an expression makes a whole number of more than {MOST_BITS} bits")


def _refuse_items(count: int) -> None:
    """Refuse more than `MOST_ITEMS` items.

    Raises:
        Refused: There are more.
    """
    if count > MOST_ITEMS:
        raise Refused(f"an expression makes more than {MOST_ITEMS} items")


def bounded_range(*args: int) -> range:
    """The function `range` with at most `MOST_ITEMS` items.

    Raises:
        Refused: The range is longer.
    """
    found = range(*args)
    # `len` fails for very long ranges, so the length is computed from the ends.
    if found and abs((found[-1] - found[0]) // found.step) >= MOST_ITEMS:
        raise Refused(f"an expression makes more than {MOST_ITEMS} items")
    return found


def bounded_factorial(n: int) -> int:
    """The function `math.factorial` for numbers below 500, whose results have up to 3800 bits.

    Raises:
        Refused: The number is larger.
    """
    if n >= 500:
        raise Refused(f"an expression makes a whole number of more than {MOST_BITS} bits")
    return math.factorial(n)


OPERATORS: dict[type[ast.operator], tuple[str, Callable[[Any, Any], Any]]] = {
    ast.Pow: ("__power", _power),
    ast.Mult: ("__times", _times),
    ast.LShift: ("__shifted", _shift),
    ast.Mod: ("__remainder", _remainder),
}
# Functions that compiled expressions call instead of operators, by their names.
OPERATIONS = dict(OPERATORS.values())


class _Bounded(ast.NodeTransformer):
    """Replaces operators whose results could be very large by calls of bounded functions."""

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:  # noqa: N802
        """Replace one operator; `ast` requires this name of the method."""
        self.generic_visit(node)
        if type(node.op) not in OPERATORS:
            return node
        name = ast.Name(id=OPERATORS[type(node.op)][0], ctx=ast.Load())
        call = ast.Call(func=name, args=[node.left, node.right], keywords=[])
        return ast.copy_location(call, node)
