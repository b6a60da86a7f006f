"""Diameters of tools, by which cutter radius compensation goes."""

from __future__ import annotations

import math
from collections.abc import Mapping

from armcontour.io.drawings.gcode import codes
from armcontour.io.drawings.gcode.faults import Fault
from armcontour.io.drawings.gcode.words import Block, whole

# G10 with these L sets radii of tools in LinuxCNC, with those in other controllers.
SETS_RADIUS, SETS_WEAR = (1, 10, 11), (12, 13)


class ToolTable:
    """Diameters of tools [m], by their numbers.

    Args:
        diameters: What the user has given.
    """

    def __init__(self, diameters: Mapping[int, float]) -> None:
        self.diameters = dict(diameters)

    def set_radius(self, kind: int, number: int, radius: float) -> bool:
        """G10 with P and R: the radius of a tool [m]; whether it is read.

        Args:
            kind: L, which says what is set.
            number: Number of the tool.
            radius: Its radius, if L means that [m].
        """
        if kind in SETS_RADIUS:
            self.diameters[number] = 2 * radius
        elif kind in SETS_WEAR:
            self.diameters[number] = math.nan
        return kind in SETS_RADIUS

    def diameter_for(self, block: Block, code: int, unit: float, in_spindle: int) -> float:
        """The diameter that G41 or G42 of a line goes by [m]; takes its words from the line.

        Args:
            block: The line.
            code: G41, G41.1, G42 or G42.1.
            unit: Length of the program's unit [m].
            in_spindle: Number of the tool in the spindle, 0 for none.

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
        if not given and not in_spindle and 0 not in self.diameters:
            raise Fault(
                f"{name} without D, while no tool is in the spindle (T, M6): give D, the number of "
                f"a tool, and {_how_to_give(1)}"
            )
        # D0 is the tool in the spindle, as in LinuxCNC.
        number = whole(given or 0.0, f"{name} with a tool D") or in_spindle
        return self._diameter(name, number)

    def _diameter(self, name: str, number: int) -> float:
        found = self.diameters.get(number)
        if found is None:
            raise Fault(
                f"{name}, cutter radius compensation by the tool {number}, whose diameter is in "
                f"the table of the controller and not in the file: give {_how_to_give(number)}, "
                "or let the post-processor write the path of the tool's centre"
            )
        if math.isnan(found):
            raise Fault(
                f"{name} with the tool {number}, whose radius the program changes by G10 L12 or "
                "L13, which are not read: give its diameter by G41.1 or G42.1 with D"
            )
        return found


def _how_to_give(number: int) -> str:
    return (
        f"its diameter (tools: {{{number}: 3 mm}} under path, or --tool '{number}: 3 mm', with "
        "the tool's own diameter)"
    )
