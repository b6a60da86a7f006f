"""The speed of feed moves: per minute, or one over the time of a move."""

from __future__ import annotations

import math

from armcontour.io.drawings.gcode import codes
from armcontour.io.drawings.gcode.faults import Fault
from armcontour.io.drawings.gcode.modes import INCH, MILLIMETRE, Modes
from armcontour.io.drawings.gcode.words import Block

# Largest feed rate [m/s].
FASTEST = 1e6
# Units this near are one [relative].
SAME = 1e-9


def set_feed(block: Block, modes: Modes) -> None:
    """Takes feed mode and F from a line.

    Raises:
        Fault: F below zero or too large.
    """
    for code, inverse_time in ((codes.INVERSE_TIME, True), (codes.PER_MINUTE, False)):
        if code in block.g and modes.inverse_time != inverse_time:
            modes.inverse_time, modes.feed = inverse_time, None
    value = block.words.pop("F", None)
    if modes.inverse_time:
        # It holds for the moves of its own line only.
        modes.feed = value
        if value is not None and value < 0:
            raise Fault(f"F{value:g} under G93, which must not be negative")
    elif value is not None:
        modes.feed = _in_metres(value, _unit_for(block, modes))
    modes.feed_given = modes.feed_given or value is not None


def feed_per_minute(value: float, modes: Modes) -> None:
    """Takes F of a line that has nothing else but coordinates, under G94."""
    modes.feed = _in_metres(value, modes.unit)


def unit_of(block: Block) -> float | None:
    """The unit that a line changes to [m]."""
    if codes.INCH in block.g:
        return INCH
    return MILLIMETRE if codes.MILLIMETRE in block.g else None


def speed_of(modes: Modes, length: float) -> float:
    """The speed of a feed move [m/s]; NaN where the file gives none.

    Args:
        modes: What is in force.
        length: Length of the move [m].

    Raises:
        Fault: No feed rate.
    """
    feed = modes.feed
    if modes.inverse_time:
        if not feed:
            raise Fault(
                "a feed move under G93 without F above zero on its own line, where F is one over "
                "the minutes that the move takes"
            )
        return length * feed / 60
    if feed is None and not modes.feed_given:
        return math.nan
    if not feed:
        raise Fault(
            "no feed rate for G1, G2 or G3: give F above zero, in units per minute, here or before"
        )
    return feed


def _unit_for(block: Block, modes: Modes) -> float:
    """The unit that F on a line is in.

    On the line that changes the unit, some machines read F in the old unit and some in the new.
    Where no unit was stated before there is only the new one.
    """
    wanted = unit_of(block)
    if wanted is None or abs(wanted - modes.unit) <= SAME * modes.unit:
        return modes.unit
    if not modes.stated:
        return wanted
    raise Fault(
        "F on the line that changes the unit of length, which some machines read in the old unit "
        "and some in the new: write F on a line of its own"
    )


def _in_metres(value: float, unit: float) -> float:
    """F per minute in metres per second."""
    speed = value * unit / 60
    if speed < 0 or speed > FASTEST:
        most, name = FASTEST * 60 / unit, "inch" if unit == INCH else "mm"
        raise Fault(
            f"a feed rate F of {value:g} {name} per minute, which is not from 0 to {most:.3g}"
        )
    return speed
