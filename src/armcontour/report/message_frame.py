"""Message frames: binary messages from the server to the page."""

from __future__ import annotations

import json
import math
import re
import struct
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from armcontour.core.errors import InvalidInput
from armcontour.core.render import jsonable

# Layout of the bytes: length of the header (u32), JSON header, zeros, little-endian arrays. The
# arrays begin at multiples of 8 bytes. Their offsets count from the first byte after the zeros.
# Numbers that are not finite are null in the header.
ALIGNED = 8
LENGTH = struct.Struct("<I")
# Array types that the page can read.
TYPES = ("f4", "f8", "u1", "u2", "u4", "i4")
# Command line options in a message, which the Studio removes. The message also names the job key.
_OPTION = r"--[a-z][a-z-]*(?: (?:'[^']*'|[^\s,.;:()']+))?"
_BEFORE = r",? (?:or|also with|such as)| as"
_OPTIONS = re.compile(rf" \([a-z ]*{_OPTION}\)|(?:{_BEFORE}) {_OPTION}|, {_OPTION}(?=\))")


@dataclass(frozen=True, slots=True, eq=False)
class MessageFrame:
    """A message to the page: kind, JSON header and numeric arrays."""

    # Kind of the frame, such as "picture".
    kind: str
    header: Mapping[str, Any] = field(default_factory=dict)
    arrays: Mapping[str, npt.NDArray[Any]] = field(default_factory=dict)

    @classmethod
    def of_file(cls, name: str, content: bytes, header: Mapping[str, Any]) -> MessageFrame:
        """Create a frame `result` with the bytes of a file as array `content`."""
        facts = {**header, "name": name, "bytes": len(content)}
        return cls("result", facts, {"content": bytes_array(content)})

    def stamped(self, **facts: Any) -> MessageFrame:
        """Return the frame with additional values in its header."""
        return replace(self, header={**self.header, **facts})

    def pack(self) -> bytes:
        """Encode the frame as bytes."""
        layouts: dict[str, Any] = {}
        parts: list[bytes] = []
        end = 0
        for name, values in self.arrays.items():
            kind = f"{values.dtype.kind}{values.dtype.itemsize}"
            if kind not in TYPES:
                raise InvalidInput(
                    f"The array {name} of a frame must have one of the types {', '.join(TYPES)}, "
                    f"but has {kind}."
                )
            layouts[name] = {"type": kind, "shape": list(values.shape), "at": end}
            data = np.ascontiguousarray(values, dtype=f"<{kind}").tobytes()
            parts += [data, bytes(-len(data) % ALIGNED)]
            end += len(data) + len(parts[-1])
        header = {**self.header, "kind": self.kind, "arrays": layouts}
        text = _to_json(header).encode(errors="replace")
        gap = bytes(-(LENGTH.size + len(text)) % ALIGNED)
        return b"".join([LENGTH.pack(len(text)), text, gap, *parts])

    @classmethod
    def unpack(cls, data: bytes) -> MessageFrame:
        """Decode a frame from bytes; its arrays are read-only."""
        (count,) = LENGTH.unpack_from(data)
        header = json.loads(data[LENGTH.size : LENGTH.size + count])
        begin = LENGTH.size + count
        begin += -begin % ALIGNED
        arrays = {}
        for name, layout in header.pop("arrays").items():
            size = math.prod(layout["shape"])
            values = np.frombuffer(data, f"<{layout['type']}", size, begin + layout["at"])
            arrays[name] = values.reshape(layout["shape"])
        return cls(header.pop("kind"), header, arrays)


def bytes_array(content: bytes) -> npt.NDArray[np.uint8]:
    """Convert bytes to an array for a frame."""
    return np.frombuffer(content, np.uint8)


def _to_json(header: Mapping[str, Any]) -> str:
    """Return a header as JSON, with arrays and numbers that are not finite converted."""
    try:
        return json.dumps(header, ensure_ascii=False, allow_nan=False, default=jsonable)
    except (TypeError, ValueError):
        # The slower conversion of the whole header is needed only for keys that are not text and
        # for numbers that are not finite.
        return json.dumps(jsonable(header), ensure_ascii=False, allow_nan=False)


def without_options(sentence: str) -> str:
    """Remove command line options from a message, because the Studio does not have them."""
    return _OPTIONS.sub("", sentence)
