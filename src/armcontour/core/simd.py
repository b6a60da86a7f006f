"""Vectors of eight floats for compiled functions, processed by SIMD instructions.

The compiler vectorizes loops only if no array overlaps another, which it cannot prove for
arguments.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, models, register_model

LANES = 8
_KIND = ir.VectorType(ir.DoubleType(), LANES)
_INDEX = ir.IntType(32)
_FUSED = ("contract",)


class _Vector(types.Type):
    def __init__(self) -> None:
        super().__init__("Vector")


VECTOR = _Vector()


@register_model(_Vector)
class _Model(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _KIND)


def _spread(builder: Any, value: Any, kind: Any) -> Any:
    """Broadcast a number to all lanes; a vector is returned unchanged."""
    if kind is VECTOR:
        return value
    none = ir.Constant(_KIND, ir.Undefined)
    one = builder.insert_element(none, value, ir.Constant(_INDEX, 0))
    return builder.shuffle_vector(one, none, ir.Constant(ir.VectorType(_INDEX, LANES), [0] * LANES))


def _lanewise(make: Callable[..., Any], count: int) -> Any:
    """Make an intrinsic that applies `make` to vectors and numbers lane by lane."""

    def typed(typing: Any, *args: Any) -> Any:
        """Return the signature for the types of the arguments, and the code generator."""

        def build(context: Any, builder: Any, types_: Any, values: Any) -> Any:
            return make(builder, *map(_spread, [builder] * count, values, types_.args))

        return VECTOR(*(x if x is VECTOR else types.float64 for x in args)), build

    shapes = {
        1: lambda typing, a: typed(typing, a),
        2: lambda typing, a, b: typed(typing, a, b),
        4: lambda typing, a, b, c, d: typed(typing, a, b, c, d),
    }
    return intrinsic(shapes[count])


def _pick(comparison: str) -> Callable[..., Any]:
    """Make the generator of `a if a < b else b`, or with another comparison, lane by lane."""
    return lambda builder, a, b: builder.select(builder.fcmp_ordered(comparison, a, b), a, b)


def _size(builder: Any, a: Any) -> Any:
    """Generate the absolute value of each lane."""
    # Clear the sign bit.
    bits = ir.VectorType(ir.IntType(64), LANES)
    mask = ir.Constant(bits, [(1 << 63) - 1] * LANES)
    return builder.bitcast(builder.and_(builder.bitcast(a, bits), mask), _KIND)


# Lane by lane: the lower and the higher one of two numbers, and the absolute value.
lower = _lanewise(_pick("<"), 2)
higher = _lanewise(_pick(">"), 2)
size = _lanewise(_size, 1)
# Lane by lane: `c if a < b else d`.
choose = _lanewise(
    lambda builder, a, b, c, d: builder.select(builder.fcmp_ordered("<", a, b), c, d), 4
)


def _load(typing: Any, array: Any, index: Any) -> Any:
    """Load eight numbers of an array, beginning at an index."""

    def build(context: Any, builder: Any, call: Any, values: Any) -> Any:
        data = context.make_array(call.args[0])(context, builder, values[0]).data
        pointer = builder.bitcast(builder.gep(data, [values[1]]), _KIND.as_pointer())
        return builder.load(pointer, align=8)

    return VECTOR(array, types.intp), build


def _store(typing: Any, array: Any, index: Any, value: Any) -> Any:
    """Store eight numbers in an array, beginning at an index."""

    def build(context: Any, builder: Any, call: Any, values: Any) -> Any:
        """Generate the instruction that stores the vector."""
        data = context.make_array(call.args[0])(context, builder, values[0]).data
        pointer = builder.bitcast(builder.gep(data, [values[1]]), _KIND.as_pointer())
        builder.store(values[2], pointer, align=8)
        return context.get_dummy_value()

    return types.void(array, types.intp, VECTOR), build


load: Any = intrinsic(_load)
store: Any = intrinsic(_store)


def _across(comparison: str) -> Any:
    """Make an intrinsic that returns the lowest or highest number of a vector."""

    def across(typing: Any, a: Any) -> Any:
        """Return the signature of the intrinsic, and its code generator."""

        def build(context: Any, builder: Any, call: Any, values: Any) -> Any:
            """Generate comparisons of halves until one number remains."""
            (v,) = values
            n = LANES
            while n > 1:
                n //= 2
                halves = [
                    builder.shuffle_vector(
                        v, v, ir.Constant(ir.VectorType(_INDEX, n), list(range(k, k + n)))
                    )
                    for k in (0, n)
                ]
                v = _pick(comparison)(builder, *halves)
            return builder.extract_element(v, ir.Constant(_INDEX, 0))

        return types.float64(VECTOR), build

    return intrinsic(across)


# Lowest and highest number of a vector.
lowest = _across("<")
highest = _across(">")


def _define(symbol: Any, make: Callable[..., Any]) -> None:
    """Define an operator on vectors for compiled functions."""

    class Template(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            if VECTOR in args and all(x is VECTOR or isinstance(x, types.Number) for x in args):
                return signature(VECTOR, *(x if x is VECTOR else types.float64 for x in args))
            return None

    infer_global(symbol)(Template)

    def build(context: Any, builder: Any, call: Any, values: Any) -> Any:
        return make(builder, *map(_spread, [builder] * 2, values, call.args))

    for kinds in ((_Vector, _Vector), (_Vector, types.Float), (types.Float, _Vector)):
        lower_builtin(symbol, *kinds)(build)


_define(operator.add, lambda builder, a, b: builder.fadd(a, b, _FUSED))
_define(operator.sub, lambda builder, a, b: builder.fsub(a, b, _FUSED))
_define(operator.mul, lambda builder, a, b: builder.fmul(a, b, _FUSED))
_define(operator.truediv, lambda builder, a, b: builder.fdiv(a, b))
