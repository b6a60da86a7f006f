"""Motions of a line: where the tool goes, and what of it is drafted."""

from __future__ import annotations

import math

from armcontour.io.drawings.gcode import codes
from armcontour.io.drawings.gcode.arc_words import (
    AXES,
    OFFSETS,
    PLANES,
    by_radius,
    center_letters,
    turns_of,
)
from armcontour.io.drawings.gcode.arcs import (
    Circle,
    around,
    helix_length,
    helix_points,
    pieces_of,
    with_radius,
)
from armcontour.io.drawings.gcode.arcs import Point as InPlane
from armcontour.io.drawings.gcode.compensation import Compensation
from armcontour.io.drawings.gcode.faults import Fault, Notes
from armcontour.io.drawings.gcode.feed import speed_of
from armcontour.io.drawings.gcode.modes import Modes
from armcontour.io.drawings.gcode.offsets import Offsets
from armcontour.io.drawings.gcode.words import Block

# Largest coordinate [m]: beyond it a double does not resolve a nanometre.
FARTHEST = 1e6
# Heights this near are one [m].
CLOSE = 1e-9


class Tool:
    """Where the tool is in the drawing, and its moves from there.

    Args:
        draft: What takes the moves.
        notes: Takes notes, and has the line.
        modes: What is in force.
        offsets: From the program to the drawing.
        chord_tolerance: Largest distance between a helix and its chords [m].
    """

    def __init__(
        self,
        draft: Compensation,
        notes: Notes,
        modes: Modes,
        offsets: Offsets,
        chord_tolerance: float,
    ) -> None:
        self.draft, self.notes, self.modes, self.offsets = draft, notes, modes, offsets
        self.chord_tolerance = chord_tolerance
        self.at = [0.0, 0.0, 0.0]
        # Axes on which the tool went to a place that the file does not give.
        self.lost: set[int] = set()
        # Whether the last drafted move ends somewhere else than where the tool is now.
        self.away = False

    def target(self, block: Block) -> list[float]:
        """Where the coordinates of a line lead, in the drawing.

        Raises:
            Fault: Too far, or in a coordinate system whose place is not known.
        """
        words, unit = block.words, self.modes.unit
        given = {i: words[x] * unit for i, x in enumerate(AXES) if x in words}
        for i, value in given.items():
            if not abs(value) <= FARTHEST:
                raise Fault(
                    f"{AXES[i]}{value / unit:g} leads to {value:g} m, beyond the {FARTHEST:g} m "
                    "that are read"
                )
        if self.modes.absolute:
            self.lost -= given.keys()
            point = self.offsets.to_drawing(given, self.at)
        else:
            point = [self.at[i] + given.get(i, 0.0) for i in (0, 1, 2)]
        self._refuse_far(point)
        return point

    def _refuse_far(self, point: list[float]) -> None:
        if max(point) <= FARTHEST and min(point) >= -FARTHEST:
            return
        for i, x in enumerate(point):
            if not abs(x) <= FARTHEST:
                raise Fault(
                    f"a move to {AXES[i]} = {x:g} m, beyond the {FARTHEST:g} m that are read"
                )

    def go(self, target: list[float]) -> None:
        """A rapid move."""
        if not self.away:
            x, y, z = target
            self.draft.go(x, y, z, self.notes.line)
        elif not self.lost:
            self.draft.resume_at(target)
            self.away = False
        self.at[:] = target

    def set_position(self, values: dict[int, float]) -> None:
        """G92: the tool is at these coordinates."""
        for i in self.lost.intersection(values):
            raise Fault(
                "G92 at a reference position (G28, G30, G53) that the file does not give: go to an "
                f"absolute {AXES[i]} by G0 before"
            )
        self.offsets.set_position(values, self.at)
        if not self.draft.begun:
            self.draft.resume_at(self.at)

    def lose(self, axes: set[int]) -> None:
        """The tool goes where the file does not say, on some axes: it comes to rest before.

        Before the first contour the tool is at zero of the program, as where nothing is given.
        """
        self.draft.rest()
        if self.draft.begun:
            self.lost |= axes
            self.away = True
            return
        for i in axes:
            self.at[i] = self.offsets.shift[i] or 0.0
        self.draft.resume_at(self.at)

    def feed(self, target: list[float]) -> None:
        """A straight feed move."""
        self._refuse_lost()
        self.offsets.place()
        speed = self.speed(math.dist(self.at, target))
        x, y, z = target
        self.draft.feed(x, y, z, speed, self.modes.tolerance, self.notes.line)
        self.at[:] = target

    def speed(self, length: float) -> float:
        """The speed of a feed move of a length [m/s]; NaN, and noted, where the file gives none."""
        found = speed_of(self.modes, length)
        if found != found:
            self.notes.once(
                "The file gives no feed rate for moves, first in line {}: they have no speed of "
                "their own, and the job's limits hold."
            )
        return found

    def _refuse_lost(self) -> None:
        if self.away:
            names = ", ".join(AXES[i] for i in sorted(self.lost)) or "X, Y and Z"
            raise Fault(
                "a feed move from a reference position (G28, G30, G53) that the file does not "
                f"give: go back by G0 with absolute {names} before"
            )

    def arc(self, block: Block, target: list[float]) -> None:
        """An arc or a helix of the plane in force; takes its words from the line."""
        self._refuse_lost()
        self.offsets.place()
        modes = self.modes
        a, b, c = axes = PLANES[modes.plane]
        turns = turns_of(block)
        last = self.draft.start_of_arc()
        circle = self._circle(block, (last[a], last[b]), (target[a], target[b]))
        rise = target[c] - last[c]
        if abs(rise) > CLOSE and not self.draft.left:
            speed = self.speed(helix_length(circle, turns, rise))
            self._helix(circle, turns, target, speed)
        else:
            self.draft.room_for(turns - 1)
            pieces = pieces_of(circle, turns)
            length = sum(x.length for x in pieces)
            speed = self.speed(math.hypot(length, rise))
            for x in pieces:
                share = rise * x.length / length
                self.draft.bend(x, axes, speed, modes.tolerance, self.notes.line, rise=share)
        self.at[:] = target

    def _helix(self, circle: Circle, turns: int, target: list[float], speed: float) -> None:
        """Chords of a helix."""
        a, b, c = PLANES[self.modes.plane]
        points = helix_points(circle, turns, self.chord_tolerance, self.draft.room_for)
        point = list(self.draft.start_of_arc())
        first = point[c]
        for i, (u, v) in enumerate(points, 1):
            point[a], point[b], point[c] = u, v, first + i / len(points) * (target[c] - first)
            x, y, z = point
            self.draft.feed(x, y, z, speed, self.modes.tolerance, self.notes.line)

    def _circle(self, block: Block, start: InPlane, end: InPlane) -> Circle:
        modes = self.modes
        turn = 1 if modes.motion == codes.COUNTER_CLOCKWISE else -1
        dialect = "inch" if modes.inch else "mm"
        if by_radius(block, modes.plane):
            radius = self._length("R", block.words.pop("R"))
            return with_radius(start, end, radius, turn)
        letters = center_letters(block, modes.plane, modes.arc_absolute)
        a, b, _ = PLANES[modes.plane]
        u, v = (self._length(x, block.words.get(x, 0.0)) for x in letters)
        block.drop(OFFSETS)
        if modes.arc_absolute:
            point = self.offsets.to_drawing({a: u, b: v}, self.at)
            center = (point[a], point[b])
        else:
            center = (start[0] + u, start[1] + v)
        return around(start, end, center, turn, dialect)

    def _length(self, letter: str, value: float) -> float:
        length = value * self.modes.unit
        if not abs(length) <= FARTHEST:
            raise Fault(
                f"{letter}{value:g} leads to {length:g} m, beyond the {FARTHEST:g} m that are read"
            )
        return length
