"""Canned cycles G73, G74, G81 to G86 and G89 as moves.

Source: LinuxCNC manual, G Codes, "G80-G89 Canned Cycles". Heights are along the axis across the
plane in force; all lengths in metres.
"""

from __future__ import annotations

import math

from armcontour.io.drawings.gcode import codes
from armcontour.io.drawings.gcode.arc_words import PLANES
from armcontour.io.drawings.gcode.faults import Fault
from armcontour.io.drawings.gcode.modes import Modes
from armcontour.io.drawings.gcode.motions import AXES, Tool
from armcontour.io.drawings.gcode.switches import Switches
from armcontour.io.drawings.gcode.words import Block, whole
from armcontour.program.moves import Value

# How far above the last depth a rapid of a peck cycle stops [m]: 0.254 mm, 0.010 inch.
CLEARANCE = 0.254e-3
# One line can ask for any number of holes and pecks; so many contours take half a gigabyte.
MOST_PECKS = 100_000
PECK, CHIP_BREAKING = 830, 730
# Words that hold until another one, as long as the same cycle is in force.
STICKY = "RQPD"
DWELLING = (740, 820, 840, 860, 890)
TAPPING: dict[int, Value] = {840: "reverse", 740: True}


class Cycles:
    """The cycle in force, with its words, and its moves.

    Args:
        tool: What moves.
        modes: What is in force.
        switches: The spindle.
    """

    def __init__(self, tool: Tool, modes: Modes, switches: Switches) -> None:
        self.tool, self.modes, self.switches = tool, modes, switches
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
        given = {x: block.words.pop(x) for x in (AXES[a], AXES[b]) if x in block.words}
        if c in self.tool.lost:
            raise Fault(
                f"a cycle from a height that the file does not give: go to an absolute {AXES[c]} "
                "by G0 before"
            )
        self._count(repeats, retract - bottom)
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
            self._work(code, c, retract, bottom, clear)

    def _count(self, repeats: int, depth: float) -> None:
        """Counts pecks, each of which is a contour of its own.

        Raises:
            Fault: More than a program may have.
        """
        pecks = 1.0
        if self.code in (PECK, CHIP_BREAKING):
            pecks = max(depth / (self.sticky["Q"] * self.modes.unit), 1.0)
        self.made += math.ceil(repeats * pecks)
        if self.made > MOST_PECKS:
            raise Fault(
                f"cycles of more than {MOST_PECKS} holes and pecks together: give fewer repeats L, "
                "or a larger Q"
            )

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
        if code in (PECK, CHIP_BREAKING) and self.sticky.get("Q", 0.0) <= 0:
            raise Fault(f"the cycle {name} without a depth Q above zero of each peck")
        if self.sticky.get("P", 0.0) < 0:
            raise Fault(f"the cycle {name} with a dwell P below zero")
        if self.modes.feed_mode == codes.INVERSE_TIME:
            raise Fault(f"the cycle {name} under G93, which gives its feed moves no time")

    def _heights(self, c: int, level: float) -> tuple[float, float]:
        """The heights R and Z in the drawing; under G91, R is relative to the initial level."""
        r, z = (self.sticky[x] * self.modes.unit for x in ("R", AXES[c]))
        if self.modes.absolute:
            retract, bottom = (
                self.tool.systems.to_drawing({c: x}, self.tool.at)[c] for x in (r, z)
            )
        else:
            retract = level + r
            bottom = retract + z
        if retract < bottom:
            raise Fault(f"a cycle whose R ({{}}) is below its {AXES[c]} ({{}})", retract, bottom)
        return retract, bottom

    def _work(self, code: int, c: int, retract: float, bottom: float, clear: float) -> None:
        """From the height R to the bottom and back."""
        if code in (PECK, CHIP_BREAKING):
            self._peck(code, c, retract, bottom)
        self._feed(c, bottom)
        if code in TAPPING:
            before = self.switches.states.get("spindle")
            self.switches.set("spindle", False)
            self.switches.set("spindle", TAPPING[code])
            self._dwell()
            self._feed(c, clear)
            if before is not None:
                self.switches.set("spindle", before)
            return
        if code in DWELLING:
            self._dwell()
        if code == 860:
            self._bore_out(c, clear)
        elif code == 850:
            self._feed(c, retract)
        elif code == 890:
            self._feed(c, clear)
        self._rise(c, clear)

    def _peck(self, code: int, c: int, retract: float, bottom: float) -> None:
        """All pecks but the last, each with its rapids."""
        step = self.sticky["Q"] * self.modes.unit
        gap = self.sticky["D"] * self.modes.unit if "D" in self.sticky else CLEARANCE
        depth = retract - step
        while depth > bottom:
            self._feed(c, depth)
            if code == PECK:
                self._rise(c, retract)
            self._rise(c, depth + gap)
            depth -= step

    def _bore_out(self, c: int, clear: float) -> None:
        """G86: out of the hole with the spindle at rest."""
        before = self.switches.states.get("spindle")
        if not before:
            raise Fault("the cycle G86, which stops the spindle, while the spindle is off")
        self.switches.set("spindle", False)
        self._rise(c, clear)
        self.switches.set("spindle", before)

    def _dwell(self) -> None:
        self.tool.draft.dwell(self.sticky.get("P", 0.0))

    def _rise(self, c: int, height: float) -> None:
        """A rapid move along the axis of the cycle."""
        target = list(self.tool.at)
        target[c] = height
        self.tool.go(target)

    def _feed(self, c: int, height: float) -> None:
        target = list(self.tool.at)
        target[c] = height
        self.tool.feed(target)
