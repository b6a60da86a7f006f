"""Moves to positions that the file does not give: G28, G30 and G53."""

from __future__ import annotations

import math

from armcontour.io.drawings.gcode import codes
from armcontour.io.drawings.gcode.arc_words import AXES
from armcontour.io.drawings.gcode.faults import Fault
from armcontour.io.drawings.gcode.motions import Tool
from armcontour.io.drawings.gcode.words import Block

UNKNOWN = (
    "Moves to a reference position that the file does not give are only a stop: {}. The tool stays "
    "where it is, and goes straight on to the next point that the file gives: make sure that "
    "nothing stands between them."
)


class References:
    """Moves to positions of the machine, which are only a stop.

    The program goes on from the next point that the file gives.

    Args:
        tool: What moves.
    """

    def __init__(self, tool: Tool) -> None:
        self.tool = tool

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
        self._leave(codes.g_name(code), named)

    def move_in_machine(self, block: Block, motion: int | None) -> None:
        """G53: a move to coordinates of the machine."""
        if motion != codes.RAPID:
            raise Fault(
                "a move in coordinates of the machine (G53) that is no rapid: their place is in "
                "the controller and not in the file; write it in coordinates of the program"
            )
        given = {i for i, x in enumerate(AXES) if block.words.pop(x, None) is not None}
        self._leave("G53", given)

    def pass_by(self, target: list[float]) -> None:
        """A feed move to a point of which the file does not give all axes; it draws nothing."""
        self.tool.at[:] = target
        self.tool.notes.count("G1 from there", UNKNOWN)

    def _leave(self, name: str, axes: set[int]) -> None:
        self.tool.lose(axes)
        self.tool.notes.count(name, UNKNOWN)
