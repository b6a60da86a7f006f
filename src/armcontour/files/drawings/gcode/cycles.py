"""The drilling cycles G81, G82 and G83 as moves.

Source: LinuxCNC manual, G Codes, "G80-G89 Canned Cycles". Heights are along the axis across the
plane in force; all lengths in metres.
"""

from __future__ import annotations

import math

from armcontour.files.drawings.gcode import codes
from armcontour.files.drawings.gcode.codes import AXES, PLANES
from armcontour.files.drawings.gcode.faults import Fault
from armcontour.files.drawings.gcode.modes import Modes
from armcontour.files.drawings.gcode.motions import Tool
from armcontour.files.drawings.gcode.words import Block, whole

# How far above the last depth a rapid of a peck cycle stops [m]: 0.254 mm, 0.010 inch.
CLEARANCE = 0.254e-3
# One line can ask for any number of holes and pecks; so many contours take half a gigabyte.
MOST_PECKS = 100_000
# Words that hold until another one, as long as the same cycle is in force.
STICKY = "RQP"


class Cycles:
    """The cycle in force, with its words, and its moves.

    Args:
        tool: What moves.
        modes: What is in force.
    """

    def __init__(self, tool: Tool, modes: Modes) -> None:
        self.tool, self.modes = tool, modes
        self.code: int | None = None
        self.sticky: dict[str, float] = {}
        # Axis and height at which the series began: the one initial level of all its lines.
        self.level: tuple[int, float] | None = None
        self.made = 0

    def end(self) -> None:
        """Another motion or G80 ends the series."""
        self.code = self.level = None

    def run(self, block: Block) -> None:
        """The cycle in force at the places of a line; takes its words from the line.

        Raises:
            Fault: Words that are missing or make no cycle.
        """
        code = self.modes.motion
        assert code is not None
        a, b, c = PLANES[self.modes.plane]
        self._take_sticky_words(block, code, AXES[c])
        repeats = whole(block.words.pop("L", 1.0), "a number L of repeats")
        if repeats < 1:
            raise Fault(f"L{repeats} repeats of a cycle, which must be from 1")
        if self.level is None or self.level[0] != c:
            self.level = (c, self.tool.at[c])
        level = self.level[1]
        retract, bottom = self._heights(c, level)
        step = self.sticky["Q"] * self.modes.unit if code == codes.PECK else math.inf
        given = {x: block.words.pop(x) for x in (AXES[a], AXES[b]) if x in block.words}
        if c in self.tool.lost:
            raise Fault(
                f"a cycle from a height that the file does not give: go to an absolute {AXES[c]} "
                "by G0 before"
            )
        self.made += math.ceil(repeats * max((retract - bottom) / step, 1.0))
        if self.made > MOST_PECKS:
            raise Fault(
                f"cycles of more than {MOST_PECKS} holes and pecks together: give fewer repeats L, "
                "or a larger Q"
            )
        if self.tool.at[c] < retract:
            self._rise(c, retract)
        clear = retract if self.modes.return_to_r else max(level, retract)
        for _ in range(repeats):
            place = Block()
            place.words = dict(given)
            target = self.tool.target(place)
            target[c] = self.tool.at[c]
            self.tool.go(target)
            self._rise(c, retract)
            depth = retract - step
            while depth > bottom:
                self._feed(c, depth)
                self._rise(c, retract)
                self._rise(c, depth + CLEARANCE)
                depth -= step
            self._feed(c, bottom)
            if code == codes.DRILL_AND_DWELL:
                self.tool.draft.dwell(self.sticky.get("P", 0.0))
            self._rise(c, clear)

    def _take_sticky_words(self, block: Block, code: int, height: str) -> None:
        """Takes from a line the words that hold for the next lines too."""
        if code != self.code:
            self.code, self.sticky = code, {}
        for letter in (*STICKY, height):
            if letter in block.words:
                self.sticky[letter] = block.words.pop(letter)
        name = codes.g_name(code)
        for letter in ("R", height):
            if letter not in self.sticky:
                raise Fault(f"the cycle {name} without {letter}: give it on the cycle's first line")
        if code == codes.PECK and self.sticky.get("Q", 0.0) <= 0:
            raise Fault(f"the cycle {name} without a depth Q above zero of each peck")
        if self.sticky.get("P", 0.0) < 0:
            raise Fault(f"the cycle {name} with a dwell P below zero")
        if self.modes.inverse_time:
            raise Fault(f"the cycle {name} under G93, which gives its feed moves no time")

    def _heights(self, c: int, level: float) -> tuple[float, float]:
        """The heights R and Z in the drawing; under G91, R is relative to the initial level."""
        r, z = (self.sticky[x] * self.modes.unit for x in ("R", AXES[c]))
        if self.modes.absolute:
            retract, bottom = (
                self.tool.offsets.to_drawing({c: x}, self.tool.at)[c] for x in (r, z)
            )
        else:
            retract = level + r
            bottom = retract + z
        if retract < bottom:
            raise Fault(f"a cycle whose R ({{}}) is below its {AXES[c]} ({{}})", retract, bottom)
        return retract, bottom

    def _rise(self, c: int, height: float) -> None:
        """A rapid move along the axis of the cycle."""
        target = list(self.tool.at)
        target[c] = height
        self.tool.go(target)

    def _feed(self, c: int, height: float) -> None:
        target = list(self.tool.at)
        target[c] = height
        self.tool.feed(target)
