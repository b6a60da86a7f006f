"""Modal state of a G-code program: offsets, units, plane, feed, and the outputs of M codes."""

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
    """The active coordinate system and the shift of G92 [m]."""

    def __init__(self) -> None:
        self.active_system = codes.SYSTEMS[0]
        # Code of the coordinate system of the drawing, which is the first system in which the
        # program has a coordinate or a feed move; None before.
        self.drawing_system: int | None = None
        # Shift from coordinates of the program to coordinates of the drawing [m], per axis. None
        # if G92.1 or G92.2 cancelled the G92 that had defined the position of the tool.
        self.shift: list[float | None] = [0.0] * 3
        # Whether the position of the tool in the drawing is known, per axis.
        self.known = [False] * 3
        # Whether G92 defined the position of the tool, per axis.
        self.defined_by_g92 = [False] * 3

    @property
    def is_shift_known(self) -> bool:
        """True if points of the drawing are coordinates of the program plus a known shift."""
        return (
            self.active_system == self.drawing_system and all(self.known) and None not in self.shift
        )

    def to_drawing(self, coordinates: dict[int, float], position: list[float]) -> list[float]:
        """The point of the drawing [m] for absolute coordinates of the program, by axis index.

        The coordinates of the other axes are those of `position`.
        """
        point = list(position)
        for i, value in coordinates.items():
            shift = self.shift[i]
            if shift is None:
                raise Fault(
                    f"the coordinate {AXES[i]} has no known position, because G92.1 or G92.2 "
                    "cancelled the G92 that had defined the position of the tool: start the "
                    "program with a move to absolute coordinates"
                )
            point[i] = value + shift
        self._mark_known(coordinates)
        return point

    def fix_system(self) -> None:
        """Make the active coordinate system that of the drawing, before the first feed move."""
        if not all(self.known):
            self.drawing_system = self.drawing_system or self.active_system
            self.known = [True] * 3

    def set_position(self, values: dict[int, float], position: list[float]) -> None:
        """G92: assign coordinates [m] to the current position of the tool, by axis index."""
        # If the position of the tool is known, the shift changes; otherwise the coordinates
        # define the position.
        for i, value in values.items():
            if self.known[i]:
                self.shift[i] = position[i] - value
            else:
                position[i], self.defined_by_g92[i] = value, True
        self._mark_known(values)

    def clear(self) -> None:
        """G92.1, G92.2: cancel the shift."""
        self.shift = [None if x else 0.0 for x in self.defined_by_g92]

    def _mark_known(self, axes: dict[int, float]) -> None:
        """Mark the position on some axes as known, in the active coordinate system."""
        if not axes:
            return
        self.drawing_system = self.drawing_system or self.active_system
        if self.drawing_system != self.active_system:
            second, first = codes.g_name(self.active_system), codes.g_name(self.drawing_system)
            raise Fault(
                f"the program has a coordinate {AXES[min(axes)]} in {second} after coordinates in "
                f"{first}, but must have one coordinate system only, because the offsets between "
                "systems are in the controller: post-process the program with one system. If "
                f"both offsets are equal, skip {second} (unknown: {{skip: [{second}]}}, or --skip "
                f"{second})"
            )
        for i in axes:
            self.known[i] = True


# Largest feed rate [m/s].
FASTEST = 1e6
# Two units are equal if their relative difference is at most this.
SAME = 1e-9


@dataclasses.dataclass(slots=True)
class Modes:
    """Modal state: units, plane, distance mode, motion and feed."""

    unit: float  # Length of the program's unit [m]
    unit_specified: bool  # Whether the file or the options specify the unit
    plane: int = codes.XY  # Code of the plane of arcs and cycles
    absolute: bool = True  # Whether coordinates are absolute (G90)
    arc_absolute: bool = False  # Whether centres of arcs are absolute (G90.1)
    motion: int | None = None  # Code of the active motion, None after G80
    tolerance: float = math.nan  # Maximum permitted corner error [m], NaN if not specified
    # Whether cycles end at the height R (G99), not at the initial level (G98).
    return_to_r: bool = False
    # Whether F is the inverse of the duration of a move [1/min] (G93), not a feed rate (G94).
    inverse_time: bool = False
    feed: float | None = None  # F [m/s], or [1/min] under G93; None if no F is active
    feed_given: bool = False  # Whether a line of the file had an F

    @property
    def inch(self) -> bool:
        """True if the unit is the inch, so that tolerances for programs in inches apply."""
        return self.unit == INCH

    def set_feed(self, block: Block) -> None:
        """Set the feed mode and F of a line; removes F from the line."""
        for code, inverse_time in ((codes.INVERSE_TIME, True), (codes.PER_MINUTE, False)):
            if code in block.g and self.inverse_time != inverse_time:
                self.inverse_time, self.feed = inverse_time, None
        value = block.words.pop("F", None)
        if self.inverse_time:
            # Under G93, F is valid only for the move on the same line.
            self.feed = value
            if value is not None and value < 0:
                raise Fault(f"F under G93 must not be negative, but is {value:g}")
        elif value is not None:
            self.feed = _in_metres(value, self._unit_for(block))
        self.feed_given = self.feed_given or value is not None

    def set_feed_per_minute(self, value: float) -> None:
        """Set F [units per minute] of a line with only coordinates, under G94."""
        self.feed = _in_metres(value, self.unit)

    def speed_of(self, length: float) -> float:
        """The speed of a feed move of a length [m] in m/s; NaN if the file has no F up to here."""
        feed = self.feed
        if self.inverse_time:
            if not feed:
                raise Fault(
                    "a feed move under G93 needs an F above zero on the same line as the move, "
                    "because F is the inverse of the duration of this move in minutes"
                )
            return length * feed / 60
        if feed is None and not self.feed_given:
            return math.nan
        if not feed:
            raise Fault(
                "there is no feed rate for G1, G2 or G3: write F above zero, in units per minute, "
                "on this line or before it"
            )
        return feed

    def _unit_for(self, block: Block) -> float:
        """The unit of length of F on a line [m]; a line that changes the unit can be refused."""
        # On a line that changes the unit, controllers differ: they interpret F in the old or in the
        # new unit. If no unit was specified before, only the new unit is possible.
        unit = unit_of(block)
        if unit is None or abs(unit - self.unit) <= SAME * self.unit:
            return self.unit
        if not self.unit_specified:
            return unit
        raise Fault(
            "the line changes the unit of length and has an F, which some controllers interpret "
            "in the old unit and some in the new unit: write F on a separate line"
        )


def unit_of(block: Block) -> float | None:
    """The unit of length that a line selects [m]; None if it selects no unit."""
    if codes.INCH in block.g:
        return INCH
    return MILLIMETRE if codes.MILLIMETRE in block.g else None


def _in_metres(value: float, unit: float) -> float:
    """Convert F from units per minute to m/s; `unit` is the length of the unit [m]."""
    speed = value * unit / 60
    if speed < 0 or speed > FASTEST:
        maximum, name = FASTEST * 60 / unit, "inch" if unit == INCH else "mm"
        raise Fault(
            f"the feed rate F must be from 0 to {maximum:.3g} {name} per minute, but is {value:g}"
        )
    return speed


SPINDLE: dict[float, Value] = {3: True, 4: "reverse", 5: False}
COOLANT: dict[float, Value] = {7: "mist", 8: "flood", 9: False}
BOTH = "mist and flood"
DIGITAL: dict[float, bool] = {62: True, 63: False, 64: True, 65: False}
ANALOG = (67, 68)
TOOL_CHANGE = 6


class Switches:
    """States of spindle, coolant, tool and outputs; each change becomes an event."""

    def __init__(self, draft: Compensation, dialect: Dialect) -> None:
        self.draft, self.dialect = draft, dialect
        self.states: dict[str, Value] = {}
        self.spindles = {0: "spindle"}
        self.selected: int | None = None
        self.tool = 0

    def apply(self, block: Block) -> None:
        """Switch outputs as a line commands, in the order of the manual; removes the words used."""
        spindles = self._spindles(block)
        speed = block.words.pop("S", None)
        if speed is not None:
            if speed < 0:
                raise Fault(f"the spindle speed S must not be negative, but is {speed:g}")
            for name in spindles:
                self.set(f"{name} speed", speed)
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
            for name in spindles if code in SPINDLE else ():
                self.set(name, SPINDLE[code])
        for code in block.m:
            if code in COOLANT:
                value, current = COOLANT[code], self.states.get("coolant")
                self.set("coolant", BOTH if value and current and current != value else value)

    def _spindles(self, block: Block) -> list[str]:
        """Names of the spindles that M3, M4, M5 and S address with $; $-1 addresses all."""
        if "S" not in block.words and SPINDLE.keys().isdisjoint(block.m):
            return []
        number = whole_number(block.words.pop("$", 0.0), "the number of a spindle $")
        if number < -1:
            raise Fault(f"the number of a spindle $ must not be below -1, but is {number}")
        if number == -1:
            return list(self.spindles.values())
        return [self.spindles.setdefault(number, f"spindle {number}")]

    def _select_tool(self, block: Block) -> None:
        if "T" not in block.words:
            return
        self.selected = whole_number(block.words.pop("T"), "the number of a tool T")
        if not self.dialect.changes_tools:
            self._change_tool()

    def _change_tool(self) -> None:
        """Stop, and record an event for the selected tool."""
        self.draft.refuse("a tool change")
        self.draft.add_stop()
        value: Value = True if self.selected is None else float(self.selected)
        self.tool = self.selected or 0
        if self.states.get("tool") != value or value is True:
            self.draft.add_event("tool", value)
            self.states["tool"] = value

    def switch_off(self) -> None:
        """End of the program: switch off extruder, spindle and coolant.

        Source: LinuxCNC manual, M Codes, "M2, M30".
        """
        for name in ("extruder", *self.spindles.values(), "coolant"):
            if self.states.get(name):
                self.set(name, False)

    def set(self, name: str, value: Value) -> None:
        """Set a state; records an event if it changes."""
        if name not in self.states or self.states[name] != value:
            self.draft.add_event(name, value)
            self.states[name] = value


class Extruder:
    """Extrusion E of printers and glue guns, as a switch that is on during moves that feed."""

    def __init__(self, switches: Switches) -> None:
        self.switches = switches
        self.absolute = True
        self.position = 0.0
        # Whether M83 is active, and whether a G90 after M83 was ignored for E.
        self.m83_active = self.g90_ignored = False

    @property
    def active(self) -> bool:
        """True if the extruder is on."""
        return bool(self.switches.states.get("extruder"))

    def set_mode(self, block: Block) -> None:
        """G90, G91, M82, M83: select absolute or relative E; G90 does not end M83."""
        if codes.ABSOLUTE in block.g:
            self.absolute, self.g90_ignored = not self.m83_active, self.m83_active
        if codes.RELATIVE in block.g:
            self.absolute = False
        if 82 in block.m or 83 in block.m:
            self.m83_active, self.g90_ignored = 83 in block.m, False
            self.absolute = not self.m83_active

    def advance(self, block: Block, notes: Notes) -> float:
        """Remove E from a line; return the length of fed material, in the unit of the program."""
        value = block.words.pop("E", None)
        if value is None:
            return 0.0
        if self.g90_ignored:
            notes.add_once(
                "E in line {} is relative, because G90 does not end M83 in Klipper and "
                "RepRapFirmware. Marlin interprets this E as absolute. Write M83 after G90."
            )
        fed = value - self.position if self.absolute else value
        self.position += fed
        return fed

    def feed_at_rest(self, length: float, speed: float) -> None:
        """Feed material (length in m, at a speed in m/s) while the tool is at rest."""
        draft = self.switches.draft
        self.switch(False)
        draft.add_stop()
        # The value is rounded to 0.1 µm, which is finer than the decimals of E in programs.
        draft.add_event("extruder feed", round(length * 1e3, 4))
        if speed > 0:
            draft.add_dwell(abs(length) / speed)

    def switch(self, feeds: bool) -> None:
        """Switch the extruder on or off for the next move."""
        if feeds or self.active:
            self.switches.set("extruder", feeds)


def _number(block: Block, letter: str, code: float) -> int:
    """The number of the output of an M code; removes it from the line."""
    if letter not in block.words:
        raise Fault(f"M{code:g} needs the number of its output, {letter}")
    return whole_number(block.words.pop(letter), f"the number of an output {letter}")
