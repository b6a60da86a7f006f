"""What a program switches, as events: spindle, coolant, tool, outputs, extruder."""

from __future__ import annotations

from armcontour.files.drawings.gcode import codes
from armcontour.files.drawings.gcode.compensation import Compensation
from armcontour.files.drawings.gcode.faults import Fault, Notes
from armcontour.files.drawings.gcode.words import Block, Dialect, whole
from armcontour.program.moves import Value

SPINDLE: dict[float, Value] = {3: True, 4: "reverse", 5: False}
COOLANT: dict[float, Value] = {7: "mist", 8: "flood", 9: False}
BOTH = "mist and flood"
DIGITAL: dict[float, bool] = {62: True, 63: False, 64: True, 65: False}
ANALOG = (67, 68)
TOOL_CHANGE = 6


class Switches:
    """The states of what is switched; a change of one is an event.

    Args:
        draft: What takes the events.
        dialect: Properties of the whole program.
    """

    def __init__(self, draft: Compensation, dialect: Dialect) -> None:
        self.draft, self.dialect = draft, dialect
        self.states: dict[str, Value] = {}
        self.selected: int | None = None
        self.tool = 0

    def apply(self, block: Block) -> None:
        """What a line switches, in the order of the manual; takes its words from the line.

        Raises:
            Fault: A speed below zero, a tool or an output that has no number.
        """
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
                value, now = COOLANT[code], self.states.get("coolant")
                self.set("coolant", BOTH if value and now and now != value else value)

    def _select_tool(self, block: Block) -> None:
        if "T" not in block.words:
            return
        self.selected = whole(block.words.pop("T"), "a tool T")
        if not self.dialect.changes_tools:
            self._change_tool()

    def _change_tool(self) -> None:
        """The tool comes to rest, and is another one."""
        self.draft.refuse("another tool")
        self.draft.rest()
        value: Value = True if self.selected is None else float(self.selected)
        self.tool = self.selected or 0
        if self.states.get("tool") != value or value is True:
            self.draft.event("tool", value)
            self.states["tool"] = value

    def off(self) -> None:
        """What M2 and M30 do besides: M5 and M9 (LinuxCNC manual, M Codes, "M2, M30")."""
        for name in ("extruder", "spindle", "coolant"):
            if self.states.get(name):
                self.set(name, False)

    def set(self, name: str, value: Value) -> None:
        """Switches something, if it is not so already."""
        if name not in self.states or self.states[name] != value:
            self.draft.event(name, value)
            self.states[name] = value


class Extruder:
    """E of printers and glue guns: on along moves that feed material, off along all others.

    Args:
        switches: What takes the events.
    """

    def __init__(self, switches: Switches) -> None:
        self.switches = switches
        self.absolute = True
        self.at = 0.0
        # Whether M83 is in force, and since then G90.
        self.stated = self.kept = False

    @property
    def on(self) -> bool:
        """Whether material is fed."""
        return bool(self.switches.states.get("extruder"))

    def set_mode(self, block: Block) -> None:
        """G90, G91, M82, M83: whether E is absolute; G90 does not end M83."""
        if codes.ABSOLUTE in block.g:
            self.absolute, self.kept = not self.stated, self.stated
        if codes.RELATIVE in block.g:
            self.absolute = False
        if 82 in block.m or 83 in block.m:
            self.stated, self.kept = 83 in block.m, False
            self.absolute = not self.stated

    def advance(self, block: Block, notes: Notes) -> float:
        """Takes E from a line; returns how much material it feeds, in the program's unit."""
        value = block.words.pop("E", None)
        if value is None:
            return 0.0
        if self.kept:
            notes.once(
                "E in line {} is relative, because G90 does not end M83, as in Klipper and "
                "RepRapFirmware; Marlin reads it as absolute. Write M83 after G90."
            )
        fed = value - self.at if self.absolute else value
        self.at += fed
        return fed

    def feed_alone(self, length: float, speed: float) -> None:
        """Material is fed while the tool rests: primed, or retracted.

        Args:
            length: Length of material, negative if it is retracted [m].
            speed: Its speed [m/s]; the time is 0 where the file gives none.
        """
        draft = self.switches.draft
        self.switch(False)
        draft.rest()
        # A tenth of a micrometre is finer than any E is written.
        draft.event("extruder feed", round(length * 1e3, 4))
        if speed > 0:
            draft.dwell(abs(length) / speed)

    def switch(self, feeds: bool) -> None:
        """Material flows or not along the next move."""
        if feeds or self.on:
            self.switches.set("extruder", feeds)


def _number(block: Block, letter: str, code: float) -> int:
    if letter not in block.words:
        raise Fault(f"M{code:g} without {letter}, the number of its output")
    return whole(block.words.pop(letter), f"an output {letter}")
