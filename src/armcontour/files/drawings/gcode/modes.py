"""Modal state of a G-code program: offsets, units, planes, feed and M codes."""

from __future__ import annotations

import dataclasses
import math

from armcontour.files.drawings.gcode import codes
from armcontour.files.drawings.gcode.codes import AXES
from armcontour.files.drawings.gcode.cutter_compensation import Compensation
from armcontour.files.drawings.gcode.words import (
    INCH,
    MILLIMETRE,
    Block,
    Dialect,
    Fault,
    Notes,
    whole_number,
)
from armcontour.program.moves import Value


class Offsets:
    """The active coordinate system and the shift of G92; lengths in metres."""

    def __init__(self) -> None:
        self.system = codes.SYSTEMS[0]
        # The coordinate system of the drawing: the first one with a coordinate or a feed move.
        self.used: int | None = None
        # From the program to the drawing; None on axes where a G92 was cancelled that defined the
        # position of the tool.
        self.shift: list[float | None] = [0.0] * 3
        # Axes on which the position of the tool in the drawing is known.
        self.placed = [False] * 3
        # Axes on which G92 defined the position of the tool.
        self.named = [False] * 3

    @property
    def plain(self) -> bool:
        """True if coordinates of the drawing are those of the program plus a known shift."""
        return self.system == self.used and all(self.placed) and None not in self.shift

    def to_drawing(self, coordinates: dict[int, float], position: list[float]) -> list[float]:
        """A point of the drawing from absolute coordinates of the program."""
        point = list(position)
        for i, value in coordinates.items():
            shift = self.shift[i]
            if shift is None:
                raise Fault(
                    f"a coordinate {AXES[i]} after G92.1 or G92.2 took back a G92 that said where "
                    "the tool is, so that its place is not known: start the program with a move to "
                    "absolute coordinates"
                )
            point[i] = value + shift
        self._use(coordinates)
        return point

    def place(self) -> None:
        """Fix the coordinate system of the drawing at the start of a feed move."""
        if not all(self.placed):
            self.used = self.used or self.system
            self.placed = [True] * 3

    def set_position(self, values: dict[int, float], position: list[float]) -> None:
        """G92: assign coordinates to the position of the tool, by a shift."""
        # If the position of the tool is unknown, these coordinates define it.
        for i, value in values.items():
            if self.placed[i]:
                self.shift[i] = position[i] - value
            else:
                position[i], self.named[i] = value, True
        self._use(values)

    def clear(self) -> None:
        """G92.1, G92.2: cancel the shift."""
        self.shift = [None if x else 0.0 for x in self.named]

    def _use(self, axes: dict[int, float]) -> None:
        """Mark axes as defined in the active coordinate system."""
        if not axes:
            return
        self.used = self.used or self.system
        if self.used != self.system:
            second, first = codes.g_name(self.system), codes.g_name(self.used)
            raise Fault(
                f"a coordinate {AXES[min(axes)]} in {second} after others in {first}: only one "
                "coordinate system is read, because their offsets are in the controller; let the "
                f"CAM system write one, or, if both offsets are equal, skip {second} "
                f"(unknown: {{skip: [{second}]}}, or --skip {second})"
            )
        for i in axes:
            self.placed[i] = True


# Largest feed rate [m/s].
FASTEST = 1e6
# Units that differ by less are equal [relative].
SAME = 1e-9


@dataclasses.dataclass(slots=True)
class Modes:
    """Modal state: units, plane, distance mode, motion and feed."""

    unit: float  # Length of the program's unit [m]
    stated: bool  # Whether the file or the options give the unit
    plane: int = codes.XY  # Code of the plane of arcs and cycles
    absolute: bool = True  # Whether coordinates are absolute (G90)
    arc_absolute: bool = False  # Whether centres of arcs are absolute (G90.1)
    motion: int | None = None  # Code of the active motion, None after G80
    tolerance: float = math.nan  # Largest corner error [m], NaN if not specified
    # Whether cycles return to R (G99) and not to their first height (G98).
    return_to_r: bool = False
    # Whether F is the inverse of a move's minutes (G93), not a rate (G94).
    inverse_time: bool = False
    feed: float | None = None  # F [m/s], under G93 [1/min]; None if no feed is active
    feed_given: bool = False  # Whether the file has given an F

    @property
    def inch(self) -> bool:
        """True if tolerances for programs in inches apply."""
        return self.unit == INCH

    def set_feed(self, block: Block) -> None:
        """Take feed mode and F from a line."""
        for code, inverse_time in ((codes.INVERSE_TIME, True), (codes.PER_MINUTE, False)):
            if code in block.g and self.inverse_time != inverse_time:
                self.inverse_time, self.feed = inverse_time, None
        value = block.words.pop("F", None)
        if self.inverse_time:
            # It is valid for the moves of its line only.
            self.feed = value
            if value is not None and value < 0:
                raise Fault(f"F{value:g} under G93, which must not be negative")
        elif value is not None:
            self.feed = _in_metres(value, self._unit_for(block))
        self.feed_given = self.feed_given or value is not None

    def feed_per_minute(self, value: float) -> None:
        """Set F of a line with only coordinates, under G94."""
        self.feed = _in_metres(value, self.unit)

    def speed_of(self, length: float) -> float:
        """The speed of a feed move [m/s]; NaN if the file gives none."""
        feed = self.feed
        if self.inverse_time:
            if not feed:
                raise Fault(
                    "a feed move under G93 without F above zero on its own line, where F is one "
                    "over the minutes that the move takes"
                )
            return length * feed / 60
        if feed is None and not self.feed_given:
            return math.nan
        if not feed:
            raise Fault(
                "no feed rate for G1, G2 or G3: give F above zero, in units per minute, here or "
                "before"
            )
        return feed

    def _unit_for(self, block: Block) -> float:
        """The unit of length of F on a line [m]."""
        # On a line that changes the unit, machines read F in the old or in the new unit. If no unit
        # was stated before, only the new one is possible.
        unit = unit_of(block)
        if unit is None or abs(unit - self.unit) <= SAME * self.unit:
            return self.unit
        if not self.stated:
            return unit
        raise Fault(
            "F on the line that changes the unit of length, which some machines read in the old "
            "unit and some in the new: write F on a separate line"
        )


def unit_of(block: Block) -> float | None:
    """The unit that a line selects [m]; None if it selects none."""
    if codes.INCH in block.g:
        return INCH
    return MILLIMETRE if codes.MILLIMETRE in block.g else None


def _in_metres(value: float, unit: float) -> float:
    """F per minute in metres per second."""
    speed = value * unit / 60
    if speed < 0 or speed > FASTEST:
        maximum, name = FASTEST * 60 / unit, "inch" if unit == INCH else "mm"
        raise Fault(
            f"a feed rate F of {value:g} {name} per minute, which is not from 0 to {maximum:.3g}"
        )
    return speed


SPINDLE: dict[float, Value] = {3: True, 4: "reverse", 5: False}
COOLANT: dict[float, Value] = {7: "mist", 8: "flood", 9: False}
BOTH = "mist and flood"
DIGITAL: dict[float, bool] = {62: True, 63: False, 64: True, 65: False}
ANALOG = (67, 68)
TOOL_CHANGE = 6


class Switches:
    """States of spindle, coolant, tool and outputs; a change is an event."""

    def __init__(self, draft: Compensation, dialect: Dialect) -> None:
        self.draft, self.dialect = draft, dialect
        self.states: dict[str, Value] = {}
        self.selected: int | None = None
        self.tool = 0

    def apply(self, block: Block) -> None:
        """Switch outputs by a line, in the order of the manual; removes its words from the line."""
        speed = block.words.pop("S", None)
        if speed is not None:
            if speed < 0:
                raise Fault(f"a spindle speed S of {speed:g}, which must not be negative")
            self.set("spindle speed", speed)
        self._select_tool(block)
        for code in block.m:
            if code in DIGITAL:
                self.set(f"output {_number(block, 'P', code)}", DIGITAL[code])
            elif code in ANALOG:
                name = f"analog output {_number(block, 'E', code)}"
                self.set(name, block.words.pop("Q", 0.0))
        if TOOL_CHANGE in block.m:
            self._change_tool()
        for code in block.m:
            if code in SPINDLE:
                self.set("spindle", SPINDLE[code])
        for code in block.m:
            if code in COOLANT:
                value, current = COOLANT[code], self.states.get("coolant")
                self.set("coolant", BOTH if value and current and current != value else value)

    def _select_tool(self, block: Block) -> None:
        if "T" not in block.words:
            return
        self.selected = whole_number(block.words.pop("T"), "a tool T")
        if not self.dialect.changes_tools:
            self._change_tool()

    def _change_tool(self) -> None:
        """Stop for a tool change."""
        self.draft.refuse("another tool")
        self.draft.rest()
        value: Value = True if self.selected is None else float(self.selected)
        self.tool = self.selected or 0
        if self.states.get("tool") != value or value is True:
            self.draft.event("tool", value)
            self.states["tool"] = value

    def switch_off(self) -> None:
        """Switch off at M2 and M30, as M5 and M9 do (LinuxCNC manual, M Codes, "M2, M30")."""
        for name in ("extruder", "spindle", "coolant"):
            if self.states.get(name):
                self.set(name, False)

    def set(self, name: str, value: Value) -> None:
        """Set a state; records an event if it changes."""
        if name not in self.states or self.states[name] != value:
            self.draft.event(name, value)
            self.states[name] = value


class Extruder:
    """E of printers and glue guns: on along moves that feed material, off along all others."""

    def __init__(self, switches: Switches) -> None:
        self.switches = switches
        self.absolute = True
        self.position = 0.0
        # True if M83 is active, and if G90 followed it.
        self.stated = self.g90_ignored = False

    @property
    def active(self) -> bool:
        """True if material is fed."""
        return bool(self.switches.states.get("extruder"))

    def set_mode(self, block: Block) -> None:
        """G90, G91, M82, M83: whether E is absolute; G90 does not end M83."""
        if codes.ABSOLUTE in block.g:
            self.absolute, self.g90_ignored = not self.stated, self.stated
        if codes.RELATIVE in block.g:
            self.absolute = False
        if 82 in block.m or 83 in block.m:
            self.stated, self.g90_ignored = 83 in block.m, False
            self.absolute = not self.stated

    def advance(self, block: Block, notes: Notes) -> float:
        """Take E from a line; returns the length of fed material, in the program's unit."""
        value = block.words.pop("E", None)
        if value is None:
            return 0.0
        if self.g90_ignored:
            notes.once(
                "E in line {} is relative, because G90 does not end M83, as in Klipper and "
                "RepRapFirmware; Marlin reads it as absolute. Write M83 after G90."
            )
        fed = value - self.position if self.absolute else value
        self.position += fed
        return fed

    def feed_alone(self, length: float, speed: float) -> None:
        """Feed material while the tool rests, to prime or to retract."""
        draft = self.switches.draft
        self.switch(False)
        draft.rest()
        # A tenth of a micrometre is finer than any E is written.
        draft.event("extruder feed", round(length * 1e3, 4))
        if speed > 0:
            draft.dwell(abs(length) / speed)

    def switch(self, feeds: bool) -> None:
        """Set whether material is fed along the next move."""
        if feeds or self.active:
            self.switches.set("extruder", feeds)


def _number(block: Block, letter: str, code: float) -> int:
    if letter not in block.words:
        raise Fault(f"M{code:g} without {letter}, the number of its output")
    return whole_number(block.words.pop(letter), f"an output {letter}")
