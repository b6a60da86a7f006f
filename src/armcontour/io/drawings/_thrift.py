"""Structs in the compact protocol of Apache Thrift, as Parquet files have them.

The format is thrift-compact-protocol.md of the Apache Thrift project.
"""

from __future__ import annotations

from typing import Any

# Types of the compact protocol.
TRUE, FALSE, BYTE, I16, I32, I64, DOUBLE, BINARY, LIST, SET, MAP, STRUCT = range(1, 13)
STOP = 0
WHOLE = (I16, I32, I64)
# Structs in structs of Parquet are fewer.
DEEPEST = 16
MOST_FIELD = 2**15 - 1
# Bits of the longest number, in groups of seven.
LONGEST = 70


class Reader:
    """Reads one struct after another.

    Args:
        data: The bytes.
        at: Where a struct begins, and after it is read, where it ends.
    """

    def __init__(self, data: bytes, at: int) -> None:
        self.data = data
        self.at = at

    def struct(self, depth: int = 0) -> dict[int, Any]:
        """Values of a struct by the numbers of its fields, without texts and broken numbers.

        Raises:
            ValueError: No struct, or one that is cut off.
        """
        if depth > DEEPEST:
            raise ValueError("its structs are nested too deeply")
        found: dict[int, Any] = {}
        field = 0
        while (byte := self._byte()) != STOP:
            step, kind = byte >> 4, byte & 15
            field = field + step if step else self._whole()
            # Numbers beyond 16 bits would be others to a library in C, and one of two values its.
            if field in found or not 0 < field <= MOST_FIELD:
                raise ValueError("a field is there twice, or has no number")
            found[field] = kind == TRUE if kind in (TRUE, FALSE) else self._value(kind, depth)
        return found

    def _value(self, kind: int, depth: int) -> Any:
        if kind in WHOLE:
            return self._whole()
        if kind == BINARY:
            size = self._varint()
            return self._pass(size)
        if kind == STRUCT:
            return self.struct(depth + 1)
        if kind in (LIST, SET):
            return self._list(depth)
        if kind in (TRUE, FALSE, BYTE):
            return self._pass(1)
        if kind == DOUBLE:
            return self._pass(8)
        # Parquet has no maps.
        raise ValueError("it has a value of an unknown type")

    def _list(self, depth: int) -> list[Any]:
        byte = self._byte()
        count, kind = byte >> 4, byte & 15
        if count == 15:
            count = self._varint()
        if count > len(self.data) - self.at:
            raise ValueError("a list is cut off")
        return [self._value(kind, depth) for _ in range(count)]

    def _pass(self, size: int) -> None:
        """Go on after some bytes, which do not matter."""
        if size > len(self.data) - self.at:
            raise ValueError("a value is cut off")
        self.at += size

    def _byte(self) -> int:
        if self.at >= len(self.data):
            raise ValueError("a struct is cut off")
        self.at += 1
        return self.data[self.at - 1]

    def _varint(self) -> int:
        value = 0
        for shift in range(0, LONGEST, 7):
            byte = self._byte()
            value |= (byte & 127) << shift
            if byte < 128:
                return value
        raise ValueError("a number has no end")

    def _whole(self) -> int:
        """A number with its sign in its last bit."""
        value = self._varint()
        return (value >> 1) ^ -(value & 1)
