"""Check that no assignment packs several statements into one: `python -m tools.packing`.

`a, b = x, y` is two statements in one line. It is allowed where they are one thing:

- A swap or a step: a value reads what another value replaces, as in `a, b = b, a + b`.
- A pair: two local names that belong together (`PAIRS`) get values of the same form, in at most 60
  columns, as in `low, high = min(x), max(x)`.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
FOLDERS = ("src", "tests", "soak", "tools", "benchmarks", "docs", "examples")
# Longest pair of values with the same form [columns].
LONGEST_PAIR = 60
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)
# Names that belong together, in either order; also with digits behind them, as in `x1, y1`.
PAIRS = """
a b, above below, along across, before after, begin end, bottom top, c s, cosine sine, dq ddq,
ds dds, first last, first second, inner outer, kp kv, largest smallest, left right, low high,
lower upper, near far, old new, rx ry, start end, starts ends, u v, up down, width height, x y
"""
PAIR_NAMES = {frozenset(pair.split()) for pair in PAIRS.split(",")}


def packed(text: str) -> Iterator[int]:
    """Yield the line numbers of a module's assignments that pack several statements."""
    tree = ast.parse(text)
    local = {id(x) for f in ast.walk(tree) if isinstance(f, FUNCTIONS) for x in ast.walk(f)}
    for node in ast.walk(tree):
        if not isinstance(node, ast.Assign) or not isinstance(node.value, ast.Tuple):
            continue
        target = node.targets[0]
        values = node.value.elts
        if not isinstance(target, ast.Tuple) or len(target.elts) != len(values):
            continue
        if any(isinstance(x, ast.Starred) for x in [*target.elts, *values]):
            continue
        if not _is_one_thing(node, target.elts, values, id(node) in local):
            yield node.lineno


def _is_one_thing(
    node: ast.Assign, targets: list[ast.expr], values: list[ast.expr], is_local: bool
) -> bool:
    """Return whether an assignment of several values is a swap, a step or a pair."""
    for k, target in enumerate(targets):
        if _places([target], ast.Store) & _places(values[k + 1 :], ast.Load):
            return True
    names = [x.id.rstrip("0123456789") for x in targets if isinstance(x, ast.Name)]
    if not is_local or len(targets) != 2 or frozenset(names) not in PAIR_NAMES:
        return False
    is_short = node.lineno == node.end_lineno and _columns(node) <= LONGEST_PAIR
    return is_short and _same_form(*values)


def _columns(node: ast.Assign) -> int:
    return (node.end_col_offset or 0) - node.col_offset


def _places(expressions: list[ast.expr], context: type[ast.expr_context]) -> set[str]:
    """Return the names, attributes and elements that expressions store or load, as text."""
    kinds = (ast.Name, ast.Attribute, ast.Subscript)
    return {
        ast.unparse(x)
        for expression in expressions
        for x in ast.walk(expression)
        if isinstance(x, kinds) and isinstance(x.ctx, context)
    }


def _same_form(first: ast.expr, second: ast.expr) -> bool:
    """Return whether two values differ in at most one name, attribute or number."""
    pairs = list(zip(ast.walk(first), ast.walk(second), strict=False))
    if len(list(ast.walk(first))) != len(list(ast.walk(second))):
        return False
    if any(type(x) is not type(y) for x, y in pairs):
        return False
    return sum(_leaf(x) != _leaf(y) for x, y in pairs) <= 1


def _leaf(node: ast.AST) -> object:
    """Name, attribute or number of a node; None for a node that has parts only."""
    match node:
        case ast.Name(id=name) | ast.Attribute(attr=name):
            return name
        case ast.Constant(value=value):
            return type(value), value
    return None


def main() -> int:
    """Print the places of packed assignments; returns 1 if there are any."""
    found = 0
    for folder in FOLDERS:
        for file in sorted((ROOT / folder).rglob("*.py")):
            if "node_modules" in file.parts:
                continue
            for line in packed(file.read_text(encoding="utf-8")):
                print(f"{file.relative_to(ROOT)}:{line}: several statements in one assignment")
                found += 1
    return int(found > 0)


if __name__ == "__main__":
    sys.exit(main())
