"""Motions of a line: where the tool goes, and what of it is drafted."""

from __future__ import annotations

import math

from armcontour.files.drawings.gcode import codes
from armcontour.files.drawings.gcode.arcs import (
    Circle,
    around,
    helix_length,
    helix_points,
    pieces_of,
    with_radius,
)
from armcontour.files.drawings.gcode.arcs import Point as InPlane
from armcontour.files.drawings.gcode.codes import AXES, OFFSETS, PLANES
from armcontour.files.drawings.gcode.compensation import Compensation
from armcontour.files.drawings.gcode.draft import Feed
from armcontour.files.drawings.gcode.faults import Fault, Notes
from armcontour.files.drawings.gcode.modes import Modes
from armcontour.files.drawings.gcode.offsets import Offsets
from armcontour.files.drawings.gcode.words import WHOLE, Block

# Largest coordinate [m]: beyond it a double does not resolve a nanometre.
FARTHEST = 1e6
# Heights this near are one [m].
CLOSE = 1e-9

UNKNOWN = (
    "Moves to a reference position that the file does not give are only a stop: {}. The tool stays "
    "where it is, and goes straight on to the next point that the file gives: make sure that "
    "nothing stands between them."
)


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

    def lose(self, name: str, axes: set[int]) -> None:
        """The tool goes where the file does not say, on some axes: it comes to rest before.

        The program goes on from the next point that the file gives. Before the first contour the
        tool is at zero of the program, as where nothing is given.
        """
        self.notes.count(name, UNKNOWN)
        self.draft.rest()
        if self.draft.begun:
            self.lost |= axes
            self.away = True
            return
        for i in axes:
            self.at[i] = self.offsets.shift[i] or 0.0
        self.draft.resume_at(self.at)

    def go_to_reference(self, block: Block, code: int) -> None:
        """G28, G30: by the point of the line's coordinates to the reference position.

        Without coordinates all axes go there, otherwise those that the line names.
        """
        words = block.words
        words.pop("P", None)
        named = {i for i, x in enumerate(AXES) if x in words} or {0, 1, 2}
        for letter in AXES:
            if math.isnan(words.get(letter, 0.0)):
                del words[letter]
        if not words.keys().isdisjoint(AXES):
            self.go(self.target(block))
            for letter in AXES:
                words.pop(letter, None)
        self.lose(codes.g_name(code), named)

    def go_in_machine(self, block: Block, motion: int | None) -> None:
        """G53: a move to coordinates of the machine."""
        if motion != codes.RAPID:
            raise Fault(
                "a move in coordinates of the machine (G53) that is no rapid: their place is in "
                "the controller and not in the file; write it in coordinates of the program"
            )
        given = {i for i, x in enumerate(AXES) if block.words.pop(x, None) is not None}
        self.lose("G53", given)

    def pass_by(self, target: list[float]) -> None:
        """A feed move to a point of which the file does not give all axes; it draws nothing."""
        self.at[:] = target
        self.notes.count("G1 from there", UNKNOWN)

    def feed(self, target: list[float]) -> None:
        """A straight feed move."""
        self._refuse_lost()
        self.offsets.place()
        x, y, z = target
        self.draft.feed(x, y, z, self.feed_of(math.dist(self.at, target)))
        self.at[:] = target

    def feed_of(self, length: float) -> Feed:
        """Speed, tolerance and line of a feed move of a length [m]; notes a missing feed rate."""
        found = self.modes.speed_of(length)
        if found != found:
            self.notes.once(
                "The file gives no feed rate for moves, first in line {}: they have no speed of "
                "their own, and the job's limits hold."
            )
        return found, self.modes.tolerance, self.notes.line

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
            feed = self.feed_of(helix_length(circle, turns, rise))
            points = helix_points(circle, turns, self.chord_tolerance, self.draft.room_for)
            x = list(last)
            for i, (u, v) in enumerate(points, 1):
                x[a], x[b], x[c] = u, v, last[c] + i / len(points) * rise
                self.draft.feed(x[0], x[1], x[2], feed)
        else:
            self.draft.room_for(turns - 1)
            pieces = pieces_of(circle, turns)
            length = sum(x.length for x in pieces)
            feed = self.feed_of(math.hypot(length, rise))
            for piece in pieces:
                self.draft.bend(piece, axes, feed, rise=rise * piece.length / length)
        self.at[:] = target

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
