"""Codes that shift coordinates: G10, G52, G92 and its states."""

from __future__ import annotations

import math

from armcontour.io.drawings.gcode import codes
from armcontour.io.drawings.gcode.faults import Fault
from armcontour.io.drawings.gcode.motions import AXES, Tool
from armcontour.io.drawings.gcode.switches import Extruder
from armcontour.io.drawings.gcode.tool_table import ToolTable
from armcontour.io.drawings.gcode.unknown import Unknown
from armcontour.io.drawings.gcode.words import Block, whole

# G10 with L: origins of coordinate systems, or lengths and radii of tools.
ORIGIN, ORIGIN_HERE = 2, 20
OF_TOOLS = (0, 1, 3, 10, 11, 12, 13)


def set_offsets(
    block: Block, tool: Tool, extruder: Extruder, unknown: Unknown, table: ToolTable
) -> bool:
    """Carries out G10, G52, G92 and G92.1 to G92.3; takes their words from the line.

    Args:
        block: The line.
        tool: What the coordinates belong to.
        extruder: What E of G92 belongs to.
        unknown: Counts what is left out.
        table: Takes radii of tools.

    Returns:
        Whether there is one on the line.

    Raises:
        Fault: One that cannot be carried out.
    """
    g = block.g
    if codes.SET_DATA in g:
        _set_data(block, tool, unknown, table)
    elif codes.LOCAL in g:
        tool.systems.set_local(_lengths(block, tool))
    elif codes.SHIFT in g:
        if "E" in block.words:
            extruder.at = block.words.pop("E")
            if block.words.keys().isdisjoint(AXES):
                return True
        values = _lengths(block, tool)
        if not values:
            raise Fault("G92 without coordinates: say which axes it sets, such as G92 X0 Y0 Z0")
        tool.set_position(values)
    elif not set(codes.SHIFT_STATES).isdisjoint(g):
        tool.systems.change_shift(next(x for x in codes.SHIFT_STATES if x in g))
        return False
    else:
        return False
    return True


def _lengths(block: Block, tool: Tool) -> dict[int, float]:
    """Coordinates of a line [m], by axis."""
    unit = tool.modes.unit
    return {i: block.words.pop(x) * unit for i, x in enumerate(AXES) if x in block.words}


def _set_data(block: Block, tool: Tool, unknown: Unknown, table: ToolTable) -> None:
    """G10: origins of coordinate systems, radii of tools; what else it says of them is left out."""
    words = block.words
    kind = whole(words.pop("L"), "G10 L") if "L" in words else None
    if kind is None and words.keys().isdisjoint(AXES):
        # A printer's retraction of filament, or temperatures of its tools.
        for letter in [x for x in words if x in "PRS"]:
            del words[letter]
        unknown.count("G10", tool.line)
    elif kind in OF_TOOLS:
        read = _set_radius(words, kind, tool.modes.unit, table)
        rest = [x for x in words if x in "XYZPRIJQ"]
        for letter in rest:
            del words[letter]
        if rest or not read:
            unknown.count(f"G10 L{kind}", tool.line)
    elif kind in (ORIGIN, ORIGIN_HERE):
        _set_origin(block, tool, here=kind == ORIGIN_HERE)
    else:
        said = "without L" if kind is None else f"L{kind}"
        raise Fault(f"G10 {said}, which this reader does not know: it reads L2 and L20")


def _set_radius(words: dict[str, float], kind: int, unit: float, table: ToolTable) -> bool:
    """G10 with R for a tool P: takes both from the line if it reads them; whether it does."""
    if "R" not in words or "P" not in words:
        return False
    number = whole(words["P"], "G10 with a tool P")
    if not table.set_radius(kind, number, words["R"] * unit):
        return False
    del words["P"], words["R"]
    return True


def _set_origin(block: Block, tool: Tool, *, here: bool) -> None:
    """G10 L2 and L20: the origin of a coordinate system."""
    systems = tool.systems
    number = whole(block.words.pop("P", 0.0), "G10 with a coordinate system P")
    if not 0 <= number <= len(codes.SYSTEMS):
        raise Fault(f"G10 with P{number}, which must be 1 (G54) to 9 (G59.3), or 0")
    index = systems.active if number == 0 else number - 1
    turn = block.words.pop("R", None)
    values = _lengths(block, tool)
    if here:
        if turn is not None:
            raise Fault("G10 L20 with R: turn a coordinate system by G10 L2")
        tool.set_origin_here(index, values)
        return
    if turn is not None:
        systems.rotations[index] = math.radians(turn)
    systems.set_origin(index, values)
