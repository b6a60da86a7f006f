"""Checks of the words of an arc (G2, G3) in the active plane."""

from __future__ import annotations

from armcontour.io.drawings.gcode import codes
from armcontour.io.drawings.gcode.words import WHOLE, Block, Fault

# First, second and third axis of each plane; the third axis is normal to the plane, and the other
# two are counter-clockwise as seen from its positive end.
PLANES = {codes.XY: (0, 1, 2), codes.ZX: (2, 0, 1), codes.YZ: (1, 2, 0)}
AXES, OFFSETS = "XYZ", "IJK"


def turns_of(block: Block) -> int:
    """The number of turns of an arc (word P), where the last turn may be incomplete.

    Raises:
        Fault: P is not a whole number from 1.
    """
    given = block.words.get("P", 1.0)
    turns = round(given)
    if abs(given - turns) > WHOLE or turns < 1:
        raise Fault(f"an arc of P{given:g} turns, which must be a whole number from 1")
    return turns


def by_radius(block: Block, plane: int) -> bool:
    """Whether an arc is given by its radius (word R).

    Raises:
        Fault: The arc is given by its centre too, or has no end point.
    """
    words = block.words
    if "R" not in words:
        return False
    a, b, _ = PLANES[plane]
    given = [x for x in OFFSETS if x in words]
    if given:
        raise Fault(f"an arc with both R and {given[0]}: give its radius or its centre")
    if AXES[a] not in words and AXES[b] not in words:
        raise Fault(f"an arc by its radius R with neither {AXES[a]} nor {AXES[b]} to end at")
    return True


def center_letters(block: Block, plane: int, absolute: bool) -> tuple[str, str]:
    """The two words of the centre's coordinates, in the order of the plane's axes.

    Args:
        block: The line.
        plane: The active plane, a key of `PLANES`.
        absolute: Whether the centre is absolute (G90.1) and not relative to the start point.

    Raises:
        Fault: The centre is missing, an absolute centre lacks a coordinate, or there is a
            coordinate normal to the plane.
    """
    words = block.words
    a, b, c = PLANES[plane]
    both = f"{OFFSETS[min(a, b)]} and {OFFSETS[max(a, b)]}"
    # Post-processors for three axes write all three offsets, so zero normal to the plane is no
    # error.
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
