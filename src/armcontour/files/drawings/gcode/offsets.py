"""From coordinates of the program to coordinates of the drawing: G54 to G59.3 and G92.

The drawing lies in the one coordinate system that the program uses; G92 shifts it.
"""

from __future__ import annotations

from armcontour.files.drawings.gcode import codes
from armcontour.files.drawings.gcode.codes import AXES
from armcontour.files.drawings.gcode.faults import Fault


class Offsets:
    """The coordinate system in force and the shift of G92; lengths in metres."""

    def __init__(self) -> None:
        self.system = codes.SYSTEMS[0]
        # The coordinate system of the drawing: the first one with a coordinate or a feed move.
        self.used: int | None = None
        # From the program to the drawing; None on axes where G92 was taken back that said where
        # the tool is.
        self.shift: list[float | None] = [0.0] * 3
        # Axes on which the tool is known to be somewhere in the drawing.
        self.placed = [False] * 3
        # Axes on which G92 said where the tool is.
        self.named = [False] * 3

    @property
    def plain(self) -> bool:
        """Whether coordinates of the drawing are those of the program and a known shift."""
        return self.system == self.used and all(self.placed) and None not in self.shift

    def to_drawing(self, given: dict[int, float], at: list[float]) -> list[float]:
        """A point of the drawing from absolute coordinates of the program.

        Args:
            given: Coordinates by their axis; on axes left out the tool stays.
            at: Where the tool is in the drawing.

        Raises:
            Fault: A second coordinate system, or a shift that is not known.
        """
        point = list(at)
        for i, value in given.items():
            shift = self.shift[i]
            if shift is None:
                raise Fault(
                    f"a coordinate {AXES[i]} after G92.1 or G92.2 took back a G92 that said where "
                    "the tool is, so that its place is not known: start the program with a move to "
                    "absolute coordinates"
                )
            point[i] = value + shift
        self._use(given)
        return point

    def place(self) -> None:
        """The tool starts to work: where it is on every axis counts from now on."""
        if not all(self.placed):
            self.used = self.used or self.system
            self.placed = [True] * 3

    def set_position(self, values: dict[int, float], at: list[float]) -> None:
        """G92: the tool is at these coordinates, by a shift.

        Where nothing said yet where the tool is, these coordinates say it.
        """
        for i, value in values.items():
            if self.placed[i]:
                self.shift[i] = at[i] - value
            else:
                at[i], self.named[i] = value, True
        self._use(values)

    def clear(self) -> None:
        """G92.1, G92.2: no shift any more."""
        self.shift = [None if x else 0.0 for x in self.named]

    def _use(self, axes: dict[int, float]) -> None:
        """The tool's place on some axes is given in the coordinate system in force.

        Raises:
            Fault: It is the second one of the program.
        """
        if not axes:
            return
        self.used = self.used or self.system
        if self.used != self.system:
            second, first = codes.g_name(self.system), codes.g_name(self.used)
            raise Fault(
                f"a coordinate {AXES[min(axes)]} in {second} after others in {first}: only one "
                "coordinate system is read, because their offsets are in the controller; let the "
                f"CAM system write one, or, if both offsets are equal, leave out {second} "
                f"(unknown: {{skip: [{second}]}}, or --skip {second})"
            )
        for i in axes:
            self.placed[i] = True
