"""What a program switches: spindle and coolant, as events."""

from __future__ import annotations

from armcontour.io.drawings.gcode.draft import Draft
from armcontour.io.drawings.gcode.words import Block, Fault
from armcontour.program.moves import Value

SPINDLE: dict[int, Value] = {3: True, 4: "reverse", 5: False}
COOLANT: dict[int, Value] = {7: "mist", 8: "flood", 9: False}
BOTH = "mist and flood"


class Switches:
    """The states of what is switched; a change of one is an event.

    Args:
        draft: The program that takes the events.
    """

    def __init__(self, draft: Draft) -> None:
        self.draft = draft
        self.states: dict[str, Value] = {}

    def apply(self, block: Block) -> None:
        """What a line switches.

        Raises:
            Fault: A speed below zero.
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
                value, now = COOLANT[code], self.states.get("coolant")
                self._set("coolant", BOTH if value and now and now != value else value)

    def off(self) -> None:
        """What M2 and M30 do besides: M5 and M9 (LinuxCNC manual, M Codes, "M2, M30")."""
        for name in ("spindle", "coolant"):
            if self.states.get(name):
                self._set(name, False)

    def _set(self, name: str, value: Value) -> None:
        if name not in self.states or self.states[name] != value:
            self.draft.event(name, value)
            self.states[name] = value
