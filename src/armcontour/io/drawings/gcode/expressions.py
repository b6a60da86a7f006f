"""Values that are computed: parameters, expressions and functions.

Operators, functions and their precedence are those of the LinuxCNC manual ("G-code Overview",
sections "Expressions", "Binary Operators", "Functions"). Text is compact: upper case, no spaces.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable

from armcontour.io.drawings.gcode.faults import Fault
from armcontour.io.drawings.gcode.parameters import Parameters

NUMBER = re.compile(r"(?:[0-9]+\.?[0-9]*|\.[0-9]+)")
OPERATOR = re.compile(r"\*\*|[-+*/]|MOD|AND|XOR|OR|EQ|NE|GT|GE|LT|LE")
FUNCTION = re.compile(r"(ABS|ACOS|ASIN|ATAN|COS|EXP|FIX|FUP|LN|ROUND|SIN|SQRT|TAN|EXISTS)\[")
# Two values this near are equal (TOLERANCE_EQUAL of LinuxCNC, in the units of the program).
EQUAL = 1e-6
# Brackets within brackets; more are no formula that a person or a post-processor writes.
DEEPEST = 50

Key = int | str
Assignments = list[tuple[Key, float]]


def read_value(text: str, at: int, parameters: Parameters, depth: int = 0) -> tuple[float, int]:
    """A number, a parameter, an expression in brackets or a function, with its sign.

    Args:
        text: Compact text.
        at: Where the value starts.
        parameters: Values of parameters.
        depth: How many brackets are open.

    Returns:
        The value, and where it ends.

    Raises:
        Fault: No value, or one that cannot be computed.
    """
    if depth > DEEPEST:
        raise Fault(f"an expression of more than {DEEPEST} brackets within each other: split it")
    sign = 1.0
    while text[at : at + 1] in ("+", "-"):
        sign = -sign if text[at] == "-" else sign
        at += 1
    found = NUMBER.match(text, at)
    if found is not None:
        return sign * float(found[0]), found.end()
    here = text[at : at + 1]
    if here == "#":
        key, at = _read_key(text, at, parameters, depth)
        return sign * parameters.get(key), at
    if here == "[":
        value, at = _read_expression(text, at, parameters, depth + 1)
        return sign * value, at
    found = FUNCTION.match(text, at)
    if found is None:
        shown = ascii(text[at : at + 12]) if here else "the end of the line"
        raise Fault(f"{shown} where a number, a parameter # or an expression [ ] is needed")
    value, at = _read_function(text, found, parameters, depth + 1)
    return sign * value, at


def read_assignment(text: str, at: int, parameters: Parameters) -> tuple[Key, float, int]:
    """An assignment such as `#1=[#2+1]`; the expression may lack its brackets, as Fanuc has it.

    Returns:
        What is assigned to, the value, and where the assignment ends.

    Raises:
        Fault: No assignment, or no value.
    """
    key, at = _read_key(text, at, parameters, 0)
    if text[at : at + 1] != "=":
        raise Fault(f"the parameter {parameters.show(key)} without a word before it or = after it")
    value, at = _read_operations(text, at + 1, parameters, 1, 0)
    if not math.isfinite(value):
        raise Fault(f"a value of {parameters.show(key)} that is no number any more")
    return key, value, at


def _read_key(text: str, at: int, parameters: Parameters, depth: int) -> tuple[Key, int]:
    """The number or the name of a parameter, from its # on."""
    if text[at + 1 : at + 2] == "<":
        end = text.find(">", at)
        if end < 0:
            raise Fault("the name of a parameter that does not end: close it with >")
        return text[at + 2 : end].lower(), end + 1
    value, at = read_value(text, at + 1, parameters, depth + 1)
    return parameters.number_of(value), at


def _read_expression(text: str, at: int, parameters: Parameters, depth: int) -> tuple[float, int]:
    """An expression from its opening bracket to the closing one."""
    value, at = _read_operations(text, at + 1, parameters, 1, depth)
    if text[at : at + 1] != "]":
        raise Fault("an expression that is not closed by ], or that has no operator there")
    if not math.isfinite(value):
        raise Fault("an expression whose value is no number any more")
    return value, at + 1


def _read_operations(
    text: str, at: int, parameters: Parameters, least: int, depth: int
) -> tuple[float, int]:
    """Operations of a precedence of at least `least`, from left to right."""
    left, at = read_value(text, at, parameters, depth)
    while (found := OPERATOR.match(text, at)) is not None:
        precedence, operate = OPERATIONS[found[0]]
        if precedence < least:
            break
        right, at = _read_operations(text, found.end(), parameters, precedence + 1, depth + 1)
        left = _computed(found[0], operate, left, right)
    return left, at


def _read_function(
    text: str, found: re.Match[str], parameters: Parameters, depth: int
) -> tuple[float, int]:
    """A function of what stands in the brackets after it."""
    name, at = found[1], found.end() - 1
    if name == "EXISTS":
        if text[at + 1 : at + 3] != "#<":
            raise Fault("EXISTS of something else than a named parameter #<name>")
        key, at = _read_key(text, at + 1, parameters, depth)
        if text[at : at + 1] != "]":
            raise Fault("EXISTS[ ] with more than a named parameter in it")
        return float(parameters.exists(key)), at + 1
    value, at = _read_expression(text, at, parameters, depth)
    if name != "ATAN":
        return _computed(name, FUNCTIONS[name], value), at
    if text[at : at + 2] != "/[":
        raise Fault("ATAN with one value: write ATAN[y]/[x]")
    other, at = _read_expression(text, at + 1, parameters, depth)
    return math.degrees(math.atan2(value, other)), at


def _computed(name: str, function: Callable[..., float], *values: float) -> float:
    """The value of a function or operator.

    Raises:
        Fault: It has none there.
    """
    try:
        return function(*values)
    except (ValueError, ZeroDivisionError, OverflowError, TypeError):
        shown = " and ".join(f"{x:g}" for x in values)
        raise Fault(f"{name} of {shown}, which has no value") from None


def _modulo(left: float, right: float) -> float:
    """What is left of a division, never below zero."""
    found = math.fmod(left, right)
    return found + abs(right) if found < 0 else found


def _power(left: float, right: float) -> float:
    found = left**right
    if isinstance(found, complex):
        raise ValueError
    return float(found)


OPERATIONS: dict[str, tuple[int, Callable[[float, float], float]]] = {
    "AND": (1, lambda a, b: float(a != 0 and b != 0)),
    "OR": (1, lambda a, b: float(a != 0 or b != 0)),
    "XOR": (1, lambda a, b: float((a != 0) != (b != 0))),
    "EQ": (2, lambda a, b: float(abs(a - b) < EQUAL)),
    "NE": (2, lambda a, b: float(abs(a - b) >= EQUAL)),
    "GT": (2, lambda a, b: float(a > b)),
    "GE": (2, lambda a, b: float(a >= b)),
    "LT": (2, lambda a, b: float(a < b)),
    "LE": (2, lambda a, b: float(a <= b)),
    "+": (3, lambda a, b: a + b),
    "-": (3, lambda a, b: a - b),
    "*": (4, lambda a, b: a * b),
    "/": (4, lambda a, b: a / b),
    "MOD": (4, _modulo),
    "**": (5, _power),
}
FUNCTIONS: dict[str, Callable[[float], float]] = {
    "ABS": abs,
    "ACOS": lambda x: math.degrees(math.acos(x)),
    "ASIN": lambda x: math.degrees(math.asin(x)),
    "COS": lambda x: math.cos(math.radians(x)),
    "EXP": math.exp,
    "FIX": lambda x: float(math.floor(x)),
    "FUP": lambda x: float(math.ceil(x)),
    "LN": math.log,
    "ROUND": lambda x: float(math.floor(abs(x) + 0.5)) * math.copysign(1.0, x),
    "SIN": lambda x: math.sin(math.radians(x)),
    "SQRT": math.sqrt,
    "TAN": lambda x: math.tan(math.radians(x)),
}
