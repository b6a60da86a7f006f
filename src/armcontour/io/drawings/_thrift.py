"""A reader of structs in the compact protocol of Apache Thrift, which Parquet files use.

The format is defined in thrift-compact-protocol.md of the Apache Thrift project.
"""

from __future__ import annotations

from typing import Any

# Types of the compact protocol.
TRUE, FALSE, BYTE, I16, I32, I64, DOUBLE, BINARY, LIST, SET, MAP, STRUCT = range(1, 13)
STOP = 0
WHOLE = (I16, I32, I64)
# Largest depth of nested structs; Parquet's structs are less deep.
DEEPEST = 16
MOST_FIELD = 2**15 - 1
# Largest number of bits of an integer, which is stored in groups of seven bits.
LONGEST = 70


class Reader:
    """Reads structs from bytes, one after the other.

    Args:
        data: The bytes.
        at: Index of the next byte to read.
    """

    def __init__(self, data: bytes, at: int) -> None:
        self.data = data
        self.at = at

    def struct(self, depth: int = 0) -> dict[int, Any]:
        """Read a struct: its values by field numbers, None for texts, bytes and floating point.

        Raises:
            ValueError: The bytes are not a struct, or the struct is cut off.
        """
        if depth > DEEPEST:
            raise ValueError("its structs are nested too deeply")
        found: dict[int, Any] = {}
        field = 0
        while (byte := self._byte()) != STOP:
            step, kind = byte >> 4, byte & 15
            field = field + step if step else self._whole()
            # A C library would read a number beyond 16 bits as another one, and of a repeated field
            # it might use the other value.
            if field in found or not 0 < field <= MOST_FIELD:
                raise ValueError("a field occurs twice, or its number is invalid")
            found[field] = kind == TRUE if kind in (TRUE, FALSE) else self._value(kind, depth)
        return found

    def _value(self, kind: int, depth: int) -> Any:
        """Read a value of a type; None for a type whose values are not needed."""
        if kind in WHOLE:
            return self._whole()
        if kind == BINARY:
            size = self._varint()
            return self._skip(size)
        if kind == STRUCT:
            return self.struct(depth + 1)
        if kind in (LIST, SET):
            return self._list(depth)
        if kind in (TRUE, FALSE, BYTE):
            return self._skip(1)
        if kind == DOUBLE:
            return self._skip(8)
        # Parquet has no maps.
        raise ValueError("it has a value of an unknown type")

    def _list(self, depth: int) -> list[Any]:
        """Read a list or a set."""
        byte = self._byte()
        count, kind = byte >> 4, byte & 15
        if count == 15:
            count = self._varint()
        if count > len(self.data) - self.at:
            raise ValueError("a list is cut off")
        return [self._value(kind, depth) for _ in range(count)]

    def _skip(self, size: int) -> None:
        """Skip a number of bytes."""
        if size > len(self.data) - self.at:
            raise ValueError("a value is cut off")
        self.at += size

    def _byte(self) -> int:
        """Read a byte."""
        if self.at >= len(self.data):
            raise ValueError("a struct is cut off")
        self.at += 1
        return self.data[self.at - 1]

    def _varint(self) -> int:
        """Read an unsigned integer of variable length."""
        value = 0
        for shift in range(0, LONGEST, 7):
            byte = self._byte()
            value |= (byte & 127) << shift
            if byte < 128:
                return value
        raise ValueError("a number has no end")

    def _whole(self) -> int:
        """Read a signed integer, whose lowest bit is the sign."""
        value = self._varint()
        return (value >> 1) ^ -(value & 1)
