"""What the words of a G2 or G3 have to be, in the plane that is in force."""

from __future__ import annotations

from armcontour.io.drawings.gcode import codes
from armcontour.io.drawings.gcode.faults import Fault
from armcontour.io.drawings.gcode.words import WHOLE, Block

# First and second axis of every plane, as seen from the positive end of the third.
PLANES = {codes.XY: (0, 1, 2), codes.ZX: (2, 0, 1), codes.YZ: (1, 2, 0)}
AXES, OFFSETS = "XYZ", "IJK"


def turns_of(block: Block) -> int:
    """P, the number of turns begun; takes it from the line.

    Raises:
        Fault: Not a whole number from 1.
    """
    given = block.words.pop("P", 1.0)
    turns = round(given)
    if abs(given - turns) > WHOLE or turns < 1:
        raise Fault(f"an arc of P{given:g} turns, which must be a whole number from 1")
    return turns


def by_radius(block: Block, plane: int) -> bool:
    """Whether the arc is given by its radius.

    Raises:
        Fault: And by its centre too, or without an end.
    """
    words = block.words
    if "R" not in words:
        return False
    a, b, _ = PLANES[plane]
    given = [x for x in OFFSETS if x in words]
    if given:
        raise Fault(f"an arc with both R and {given[0]}, of which only one can be meant")
    if AXES[a] not in words and AXES[b] not in words:
        raise Fault(f"an arc by its radius R with neither {AXES[a]} nor {AXES[b]} to end at")
    return True


def center_letters(block: Block, plane: int, absolute: bool) -> tuple[str, str]:
    """The letters of the centre's coordinates, in the order of the plane's axes.

    Raises:
        Fault: No centre, half of an absolute one, or a coordinate across the plane.
    """
    words = block.words
    a, b, c = PLANES[plane]
    both = f"{OFFSETS[min(a, b)]} and {OFFSETS[max(a, b)]}"
    # Posts for three axes write all three offsets: one of zero across the plane says nothing.
    if words.get(OFFSETS[c], 0.0) != 0:
        raise Fault(
            f"the word {OFFSETS[c]} for an arc in the plane {codes.g_name(plane)}, whose centre is "
            f"given by {both}"
        )
    given = [x for x in OFFSETS if x in words and x != OFFSETS[c]]
    if not given:
        raise Fault(f"an arc without its centre ({both}) or radius (R)")
    if absolute and len(given) < 2:
        raise Fault(
            f"an arc by its absolute centre (G90.1) that gives only {given[0]}: it needs {both}"
        )
    return OFFSETS[a], OFFSETS[b]
