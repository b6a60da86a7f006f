"""The state of spindle and coolant, whose changes become events."""

from __future__ import annotations

from armcontour.io.drawings.gcode.draft import Draft
from armcontour.io.drawings.gcode.words import Block, Fault
from armcontour.program.moves import Value

SPINDLE: dict[int, Value] = {3: True, 4: "reverse", 5: False}
COOLANT: dict[int, Value] = {7: "mist", 8: "flood", 9: False}
BOTH = "mist and flood"


class Switches:
    """The states of spindle and coolant; each change of a state adds an event.

    Args:
        draft: The program to which the events are added.
    """

    def __init__(self, draft: Draft) -> None:
        self.draft = draft
        self.states: dict[str, Value] = {}

    def apply(self, block: Block) -> None:
        """Execute the codes and words of a line for spindle and coolant.

        Raises:
            Fault: The spindle speed is negative.
        """
        speed = block.words.get("S")
        if speed is not None:
            if speed < 0:
                raise Fault(f"a spindle speed S of {speed:g}, which must not be negative")
            self._set("spindle speed", speed)
        for code in block.m:
            if code in SPINDLE:
                self._set("spindle", SPINDLE[code])
        for code in block.m:
            if code in COOLANT:
                value, before = COOLANT[code], self.states.get("coolant")
                self._set("coolant", BOTH if value and before and before != value else value)

    def off(self) -> None:
        """Switch spindle and coolant off, as M2 and M30 do (LinuxCNC manual, M Codes)."""
        for name in ("spindle", "coolant"):
            if self.states.get(name):
                self._set(name, False)

    def _set(self, name: str, value: Value) -> None:
        """Set a state; a change adds an event."""
        if name not in self.states or self.states[name] != value:
            self.draft.event(name, value)
            self.states[name] = value
