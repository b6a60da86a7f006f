"""Moves to a reference position: G28, G30 and G53."""

from __future__ import annotations

import math
from collections.abc import Callable

from armcontour.io.drawings.gcode import codes
from armcontour.io.drawings.gcode.faults import Fault
from armcontour.io.drawings.gcode.motions import AXES, Tool
from armcontour.io.drawings.gcode.words import Block


class References:
    """Stored reference positions, and moves to them.

    A position that the file does not give is a stop: the program goes on from the next point that
    the file does give.

    Args:
        tool: What moves.
    """

    def __init__(self, tool: Tool) -> None:
        self.tool = tool
        self.stored: dict[int, list[float]] = {}
        # Name, count and first line of the moves whose end is not known.
        self.unknown: dict[str, list[int]] = {}

    def store(self, block: Block) -> None:
        """G28.1, G30.1: the reference position is where the tool is."""
        for code in codes.REFERENCE_STORES.intersection(block.g):
            self.tool.refuse_lost((0, 1, 2), codes.g_name(code))
            self.stored[code - 1] = list(self.tool.at)
            for letter in AXES:
                block.words.pop(letter, None)

    def move(self, block: Block, code: int) -> None:
        """G28, G30: by the point of the line's coordinates to the reference position.

        Without coordinates all axes go there, otherwise those that the line names.
        """
        words = block.words
        words.pop("P", None)
        named = {i for i, x in enumerate(AXES) if x in words} or {0, 1, 2}
        for letter in AXES:
            if math.isnan(words.get(letter, 0.0)):
                del words[letter]
        if not words.keys().isdisjoint(AXES):
            self.tool.go(self.tool.target(block))
            for letter in AXES:
                words.pop(letter, None)
        found = self.stored.get(code)
        if found is None:
            self._leave(codes.g_name(code), named)
        else:
            at = self.tool.at
            self.tool.lost -= named
            self.tool.go([found[i] if i in named else at[i] for i in (0, 1, 2)])

    def move_in_machine(self, block: Block, motion: int | None) -> None:
        """G53: a move to coordinates of the machine."""
        if motion not in (codes.RAPID, codes.LINE):
            raise Fault("G53 without G0 or G1 in force")
        tool, unit = self.tool, self.tool.modes.unit
        given = {i: block.words.pop(x) * unit for i, x in enumerate(AXES) if x in block.words}
        zeros = tool.systems.machine
        target = list(tool.at)
        for i, value in given.items():
            target[i] = (zeros[i] or 0.0) + value
        if all(zeros[i] is not None for i in given):
            tool.lost -= given.keys()
            (tool.go if motion == codes.RAPID else tool.feed)(target)
        elif motion == codes.RAPID:
            self._leave("G53", set(given))
        else:
            raise Fault(
                "a feed move in coordinates of the machine (G53), whose place relative to those of "
                "the program the file does not give: set the origin by G10 L2 before, or state "
                "that all offsets are zero (offsets: zero)"
            )

    def pass_by(self, target: list[float]) -> None:
        """A feed move to a point of which the file does not give all axes; it draws nothing."""
        self.tool.at[:] = target
        self.unknown.setdefault("G1 from there", [0, self.tool.line])[0] += 1

    def _leave(self, name: str, axes: set[int]) -> None:
        self.tool.lose(axes)
        self.unknown.setdefault(name, [0, self.tool.line])[0] += 1

    def notes(self, where: Callable[[int], str]) -> list[str]:
        """A sentence on the moves whose end is not known.

        Args:
            where: Names a line.
        """
        if not self.unknown:
            return []
        kinds = ", ".join(
            f"{name} ({count} time{'s' if count > 1 else ''}, first in {where(line)})"
            for name, (count, line) in self.unknown.items()
        )
        return [
            "Moves to a reference position that the file does not give are only a stop: "
            f"{kinds}. The tool stays where it is, and goes straight on to the next point that the "
            "file gives: make sure that nothing stands between them."
        ]
