"""Coordinate systems and offsets: from coordinates of a program to coordinates of the drawing.

The drawing lies in the first coordinate system that moves the tool. Where the origins of others are
relative to it is known only if the program says so; a move that needs another offset is refused.
Source: LinuxCNC manual, "Coordinate Systems", and G Codes, G10, G52, G53, G54-G59.3, G92.
"""

from __future__ import annotations

import math

from armcontour.io.drawings.gcode import codes
from armcontour.io.drawings.gcode.faults import Fault

AXES = "XYZ"


class Systems:
    """The nine coordinate systems G54 to G59.3, and the shift of G92 and G52; lengths in metres.

    Args:
        zero: Whether all offsets of the controller are zero, which a user can state.
    """

    def __init__(self, zero: bool) -> None:
        start = 0.0 if zero else None
        self.active = 0
        # Origins of the systems and of the machine in the drawing; None where nothing says them.
        self.origins: list[list[float | None]] = [[start] * 3 for _ in codes.SYSTEMS]
        self.machine: list[float | None] = [start] * 3
        self.rotations = [0.0] * len(codes.SYSTEMS)
        self.shift = [0.0] * 3
        self.kept = [0.0] * 3
        # Axes on which the tool is known to be somewhere in the drawing.
        self.placed = [zero] * 3
        # Axes whose G92 said where the tool is; how much it shifts them is not known.
        self.named = [False] * 3
        # Axes whose shift is not known any more since that G92 was taken back.
        self.unknown = [False] * 3
        self.erased = False

    @property
    def plain(self) -> bool:
        """Whether the drawing's coordinates are the program's and an offset on each axis."""
        known = None not in self.origins[self.active] and not any(self.unknown)
        return known and all(self.placed) and self.rotations[self.active] == 0.0

    @property
    def offset(self) -> tuple[float, float, float]:
        """What is added to coordinates of the program, where the systems are `plain`."""
        x, y, z = (
            (a or 0.0) + b for a, b in zip(self.origins[self.active], self.shift, strict=True)
        )
        return x, y, z

    def to_drawing(self, given: dict[int, float], at: list[float]) -> list[float]:
        """A point of the drawing from absolute coordinates of the program.

        Args:
            given: Coordinates by their axis; on axes left out the tool stays.
            at: Where the tool is in the drawing.

        Raises:
            Fault: A coordinate system whose place is not known.
        """
        point = list(at)
        if self.rotations[self.active] == 0.0 or given.keys().isdisjoint((0, 1)):
            for i, value in given.items():
                point[i] = value + self.shift[i] + self._origin(i)
            return point
        here = self.to_program(at)
        x, y = (given.get(i, here[i]) + self.shift[i] for i in (0, 1))
        x, y = self._turned(x, y, 1.0)
        point[0], point[1] = self._origin(0) + x, self._origin(1) + y
        if 2 in given:
            point[2] = given[2] + self.shift[2] + self._origin(2)
        return point

    def step(self, delta: list[float]) -> list[float]:
        """A relative move in the drawing."""
        x, y = self._turned(delta[0], delta[1], 1.0)
        return [x, y, delta[2]]

    def to_program(self, at: list[float]) -> list[float]:
        """Coordinates of the program of a point of the drawing.

        Raises:
            Fault: A coordinate system whose place is not known.
        """
        x, y, z = (at[i] - self._origin(i) for i in (0, 1, 2))
        x, y = self._turned(x, y, -1.0)
        return [x - self.shift[0], y - self.shift[1], z - self.shift[2]]

    def place(self) -> None:
        """The tool starts to work: where it is on every axis counts from now on."""
        for i in (0, 1, 2):
            if not self.placed[i]:
                self._origin(i)

    def select(self, number: int) -> None:
        """Makes a coordinate system the active one."""
        self.active = number

    def set_position(self, values: dict[int, float], at: list[float]) -> None:
        """G92: the tool is at these coordinates, by a shift of all systems.

        Where nothing said yet where the tool is, these coordinates say it.
        """
        turned = self.rotations[self.active] != 0.0
        for i, value in values.items():
            if not self.placed[i] and not turned:
                at[i] = value + self.shift[i] + self._origin(i)
                self.named[i] = True
            elif turned:
                self.shift[i] += self.to_program(at)[i] - value
            else:
                self.shift[i] = at[i] - self._origin(i, shifted=False) - value
                self.unknown[i] = False
        self.kept, self.erased = list(self.shift), False

    def set_local(self, values: dict[int, float]) -> None:
        """G52: the origin is at these coordinates of the systems."""
        for i, value in values.items():
            self.unknown[i] = self.unknown[i] or self.named[i]
            self.shift[i] = value
        self.kept = list(self.shift)

    def change_shift(self, code: int) -> None:
        """G92.1 erases the shift, G92.2 suspends it, G92.3 restores it."""
        restored = code == codes.SHIFT_STATES[2]
        if code == codes.SHIFT_STATES[0]:
            self.kept, self.erased = [0.0] * 3, True
        self.shift = list(self.kept) if restored else [0.0] * 3
        for i in (0, 1, 2):
            self.unknown[i] = self.named[i] and (self.erased or not restored)

    def set_origin(self, number: int, values: dict[int, float]) -> None:
        """G10 L2: the origin of a system in coordinates of the machine."""
        for i, value in values.items():
            if self.machine[i] is None and not self.placed[i]:
                self.machine[i] = 0.0
            origin = self.machine[i]
            self.origins[number][i] = None if origin is None else origin + value

    def set_origin_here(self, number: int, values: dict[int, float], at: list[float]) -> None:
        """G10 L20: the tool is at these coordinates of a system."""
        if self.rotations[number] != 0.0:
            raise Fault("G10 L20 for a coordinate system that is turned: set its origin by G10 L2")
        for i, value in values.items():
            if not self.placed[i] and number == self.active:
                at[i] = value + self.shift[i]
                self.origins[number][i], self.machine[i] = 0.0, None
            else:
                self.origins[number][i] = at[i] - value - self.shift[i]
            self.placed[i] = True

    def _origin(self, axis: int, *, shifted: bool = True) -> float:
        """Origin of the active system in the drawing; the first system that is used is at zero."""
        if shifted and self.unknown[axis]:
            raise Fault(
                f"a coordinate {AXES[axis]} after a G92 was taken back that said where the tool "
                "is: how far that shifts the coordinates depends on where the tool was before; "
                "start the program with a move to absolute coordinates"
            )
        found = self.origins[self.active][axis]
        if found is None:
            if self.placed[axis]:
                raise Fault(self._not_known(axis))
            # From now on the drawing lies in this system.
            for origins in self.origins:
                origins[axis] = None
            self.machine[axis] = None
            found = self.origins[self.active][axis] = 0.0
        self.placed[axis] = True
        return found

    def _not_known(self, axis: int) -> str:
        name = codes.g_name(codes.SYSTEMS[self.active])
        return (
            f"a coordinate {AXES[axis]} in the coordinate system {name}, whose offset from the "
            "system used before is in the table of the controller and not in the file: give it by "
            "G10 L2 before the first move, or state that all offsets are zero (offsets: zero)"
        )

    def _turned(self, x: float, y: float, direction: float) -> tuple[float, float]:
        angle = self.rotations[self.active]
        if angle == 0.0:
            return x, y
        c, s = math.cos(angle), direction * math.sin(angle)
        return x * c - y * s, x * s + y * c
