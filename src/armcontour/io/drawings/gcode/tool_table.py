"""Diameters of tools for cutter radius compensation."""

from __future__ import annotations

from collections.abc import Mapping

from armcontour.io.drawings.gcode import codes
from armcontour.io.drawings.gcode.faults import Fault
from armcontour.io.drawings.gcode.words import Block, whole


def diameter_for(
    block: Block, code: int, unit: float, in_spindle: int, diameters: Mapping[int, float]
) -> float:
    """The diameter that G41 or G42 of a line goes by [m]; takes its words from the line.

    Args:
        block: The line.
        code: G41, G41.1, G42 or G42.1.
        unit: Length of the program's unit [m].
        in_spindle: Number of the tool in the spindle, 0 for none.
        diameters: Diameters that the user has given [m], by the numbers of tools.

    Raises:
        Fault: A diameter that nothing gives.
    """
    name, given = codes.g_name(code), block.words.pop("D", None)
    if code in codes.BY_DIAMETER:
        if block.words.pop("L", 0.0) != 0.0:
            raise Fault(f"{name} with L, the orientation of a lathe's tool, which is not read")
        if given is None:
            raise Fault(f"{name} without D, the tool's diameter")
        return given * unit
    if not given and not in_spindle and 0 not in diameters:
        raise Fault(
            f"{name} without D, while no tool is in the spindle (T, M6): give D, the number of "
            f"a tool, and {_how_to_give(1)}"
        )
    # D0 is the tool in the spindle, as in LinuxCNC.
    number = whole(given or 0.0, f"{name} with a tool D") or in_spindle
    if number not in diameters:
        raise Fault(
            f"{name}, cutter radius compensation by the tool {number}, whose diameter is in "
            f"the table of the controller and not in the file: give {_how_to_give(number)}, "
            "or let the post-processor write the path of the tool's centre"
        )
    return diameters[number]


def _how_to_give(number: int) -> str:
    return (
        f"its diameter (tools: {{{number}: 3 mm}} under path, or --tool '{number}: 3 mm', with "
        "the tool's own diameter)"
    )
