"""Modes of a machine that hold until another word changes them, such as the feed rate."""

from __future__ import annotations

import dataclasses
import math

from armcontour.files.drawings.gcode import codes
from armcontour.files.drawings.gcode.faults import INCH, MILLIMETRE, Fault
from armcontour.files.drawings.gcode.words import Block

# Largest feed rate [m/s].
FASTEST = 1e6
# Units this near are one [relative].
SAME = 1e-9


@dataclasses.dataclass(slots=True)
class Modes:
    """What is in force.

    Attributes:
        unit: Length of the program's unit [m].
        stated: Whether the file or the reading said the unit.
        plane: Code of the plane of arcs and cycles.
        absolute: Whether coordinates are absolute (G90).
        arc_absolute: Whether centres of arcs are absolute (G90.1).
        motion: Code of the motion in force, None after G80.
        tolerance: Largest corner error [m], NaN for none of its own.
        return_to_r: Whether cycles return to R (G99) and not to their first height (G98).
        inverse_time: Whether F is one over the minutes of a move (G93) and not per minute (G94).
        feed: F [m/s], under G93 [1/min]; None where none is in force.
        feed_given: Whether the file has given an F.
    """

    unit: float
    stated: bool
    plane: int = codes.XY
    absolute: bool = True
    arc_absolute: bool = False
    motion: int | None = None
    tolerance: float = math.nan
    return_to_r: bool = False
    inverse_time: bool = False
    feed: float | None = None
    feed_given: bool = False

    @property
    def inch(self) -> bool:
        """Whether tolerances of programs in inches hold."""
        return self.unit == INCH

    def set_feed(self, block: Block) -> None:
        """Takes feed mode and F from a line.

        Raises:
            Fault: F below zero or too large.
        """
        for code, inverse_time in ((codes.INVERSE_TIME, True), (codes.PER_MINUTE, False)):
            if code in block.g and self.inverse_time != inverse_time:
                self.inverse_time, self.feed = inverse_time, None
        value = block.words.pop("F", None)
        if self.inverse_time:
            # It holds for the moves of its own line only.
            self.feed = value
            if value is not None and value < 0:
                raise Fault(f"F{value:g} under G93, which must not be negative")
        elif value is not None:
            self.feed = _in_metres(value, self._unit_for(block))
        self.feed_given = self.feed_given or value is not None

    def feed_per_minute(self, value: float) -> None:
        """Takes F of a line that has nothing else but coordinates, under G94."""
        self.feed = _in_metres(value, self.unit)

    def speed_of(self, length: float) -> float:
        """The speed of a feed move [m/s]; NaN where the file gives none.

        Args:
            length: Length of the move [m].

        Raises:
            Fault: No feed rate.
        """
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
        """The unit that F on a line is in.

        On the line that changes the unit, some machines read F in the old unit and some in the new.
        Where no unit was stated before there is only the new one.
        """
        wanted = unit_of(block)
        if wanted is None or abs(wanted - self.unit) <= SAME * self.unit:
            return self.unit
        if not self.stated:
            return wanted
        raise Fault(
            "F on the line that changes the unit of length, which some machines read in the old "
            "unit and some in the new: write F on a line of its own"
        )


def unit_of(block: Block) -> float | None:
    """The unit that a line changes to [m]."""
    if codes.INCH in block.g:
        return INCH
    return MILLIMETRE if codes.MILLIMETRE in block.g else None


def _in_metres(value: float, unit: float) -> float:
    """F per minute in metres per second."""
    speed = value * unit / 60
    if speed < 0 or speed > FASTEST:
        most, name = FASTEST * 60 / unit, "inch" if unit == INCH else "mm"
        raise Fault(
            f"a feed rate F of {value:g} {name} per minute, which is not from 0 to {most:.3g}"
        )
    return speed
