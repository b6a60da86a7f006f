"""Motions of G-code: rapids, lines, arcs, moves to reference positions, and drilling cycles."""

from __future__ import annotations

import math

from armcontour.files.drawings.gcode import codes
from armcontour.files.drawings.gcode.arcs import Point as InPlane
from armcontour.files.drawings.gcode.arcs import (
    ProgrammedArc,
    arc_around,
    arc_parts,
    arc_with_radius,
    helix_length,
    helix_points,
)
from armcontour.files.drawings.gcode.codes import AXES, OFFSETS, PLANES
from armcontour.files.drawings.gcode.cutter_compensation import Compensation
from armcontour.files.drawings.gcode.draft import Feed
from armcontour.files.drawings.gcode.modes import Modes, Offsets
from armcontour.files.drawings.gcode.words import WHOLE_TOLERANCE, Block, Fault, Notes, whole_number

# Largest coordinate [m]. Above this value a double does not resolve a nanometre.
FARTHEST = 1e6
# Two heights are equal if their difference is at most this [m].
SAME_HEIGHT = 1e-9

REFERENCE_NOTE = (
    "Moves to a reference position are replaced by a stop, because the file does not define the "
    "position: {}. From the stop the tool moves straight to the next point that the file defines. "
    "Make sure that there is no obstacle between these points."
)


class ProgrammedTool:
    """The programmed position of the tool in the drawing [m], and the moves from there."""

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
        self.position = [0.0, 0.0, 0.0]
        # Axes on which the tool moved to a position that the file does not define.
        self.undefined_axes: set[int] = set()
        # Whether the tool is away from the end of the last drafted move.
        self.away = False

    def target(self, block: Block) -> list[float]:
        """The point of the drawing [m] that the coordinates of a line define."""
        words, unit = block.words, self.modes.unit
        coordinates = {i: words[x] * unit for i, x in enumerate(AXES) if x in words}
        for i, value in coordinates.items():
            if not abs(value) <= FARTHEST:
                raise Fault(
                    f"coordinates must be within {FARTHEST:g} m, but {AXES[i]}{value / unit:g} is "
                    f"{value:g} m"
                )
        if self.modes.absolute:
            self.undefined_axes -= coordinates.keys()
            point = self.offsets.to_drawing(coordinates, self.position)
        else:
            point = [self.position[i] + coordinates.get(i, 0.0) for i in (0, 1, 2)]
        self._check_range(point)
        return point

    def _check_range(self, point: list[float]) -> None:
        if max(point) <= FARTHEST and min(point) >= -FARTHEST:
            return
        for i, coordinate in enumerate(point):
            if not abs(coordinate) <= FARTHEST:
                raise Fault(
                    f"coordinates must be within {FARTHEST:g} m, but the move ends at {AXES[i]} = "
                    f"{coordinate:g} m"
                )

    def move_rapid(self, target: list[float]) -> None:
        """Make a rapid move to a point [m]."""
        if not self.away:
            x, y, z = target
            self.draft.add_rapid(x, y, z, self.notes.line)
        elif not self.undefined_axes:
            self.draft.resume_at(target)
            self.away = False
        self.position[:] = target

    def set_position(self, values: dict[int, float]) -> None:
        """G92: assign coordinates [m] to the current position, by axis index."""
        for i in self.undefined_axes.intersection(values):
            raise Fault(
                "G92 is not possible at a reference position (G28, G30, G53), because the file "
                f"does not define the position: write a G0 with an absolute {AXES[i]} before"
            )
        self.offsets.set_position(values, self.position)
        if not self.draft.begun:
            self.draft.resume_at(self.position)

    def lose_position(self, name: str, axes: set[int]) -> None:
        """Stop, and mark the position of some axes as undefined; `name` is the code for the note.

        The draft continues at the next defined point. Before the first contour, the axes are set
        to zero of the program instead.
        """
        self.notes.count(name, REFERENCE_NOTE)
        self.draft.add_stop()
        if self.draft.begun:
            self.undefined_axes |= axes
            self.away = True
            return
        for i in axes:
            self.position[i] = self.offsets.shift[i] or 0.0
        self.draft.resume_at(self.position)

    def move_to_reference(self, block: Block, code: int) -> None:
        """G28, G30: move through the point of the line to the reference position."""
        # The axes of the line move to the reference position; without coordinates, all axes move.
        words = block.words
        words.pop("P", None)
        named = {i for i, x in enumerate(AXES) if x in words} or {0, 1, 2}
        for letter in AXES:
            if math.isnan(words.get(letter, 0.0)):
                del words[letter]
        if not words.keys().isdisjoint(AXES):
            self.move_rapid(self.target(block))
            for letter in AXES:
                words.pop(letter, None)
        self.lose_position(codes.g_name(code), named)

    def move_in_machine(self, block: Block, motion: int | None) -> None:
        """G53: make a rapid move to machine coordinates; the position is undefined afterwards."""
        if motion != codes.RAPID:
            raise Fault(
                "only a rapid move can have machine coordinates (G53), because their offset is in "
                "the controller and not in the file: write the move in coordinates of the program"
            )
        axes = {i for i, x in enumerate(AXES) if block.words.pop(x, None) is not None}
        self.lose_position("G53", axes)

    def skip_move(self, target: list[float]) -> None:
        """Make a feed move from an undefined position; the move is not part of the program."""
        self.position[:] = target
        self.notes.count("G1 from such a position", REFERENCE_NOTE)

    def move_line(self, target: list[float]) -> None:
        """Make a straight feed move to a point [m]."""
        self._check_position_known()
        self.offsets.fix_system()
        x, y, z = target
        self.draft.add_line(x, y, z, self.feed_of(math.dist(self.position, target)))
        self.position[:] = target

    def feed_of(self, length: float) -> Feed:
        """Speed, tolerance and line of a feed move of a length [m]; notes a missing feed rate."""
        speed = self.modes.speed_of(length)
        if speed != speed:
            self.notes.add_once(
                "Feed moves without a feed rate, first in line {}, have no programmed speed; only "
                "the limits of the job apply."
            )
        return speed, self.modes.tolerance, self.notes.line

    def _check_position_known(self) -> None:
        if self.away:
            names = ", ".join(AXES[i] for i in sorted(self.undefined_axes)) or "X, Y and Z"
            raise Fault(
                "a feed move cannot start at a reference position (G28, G30, G53), because the "
                f"file does not define the position: write a G0 with absolute {names} before"
            )

    def move_arc(self, block: Block, target: list[float]) -> None:
        """Make an arc or helix in the active plane; remove its words from the line."""
        self._check_position_known()
        self.offsets.fix_system()
        modes = self.modes
        a, b, c = axes = PLANES[modes.plane]
        turns = pop_turns(block)
        last = self.draft.arc_start()
        arc = self._programmed_arc(block, (last[a], last[b]), (target[a], target[b]))
        rise = target[c] - last[c]
        if abs(rise) > SAME_HEIGHT and not self.draft.offset:
            feed = self.feed_of(helix_length(arc, turns, rise))
            points = helix_points(arc, turns, self.chord_tolerance, self.draft.count_segments)
            point = list(last)
            for i, (u, v) in enumerate(points, 1):
                point[a], point[b], point[c] = u, v, last[c] + i / len(points) * rise
                self.draft.add_line(point[0], point[1], point[2], feed)
        else:
            self.draft.count_segments(turns - 1)
            pieces = arc_parts(arc, turns)
            length = sum(x.length for x in pieces)
            feed = self.feed_of(math.hypot(length, rise))
            for piece in pieces:
                self.draft.add_arc(piece, axes, feed, rise=rise * piece.length / length)
        self.position[:] = target

    def _programmed_arc(self, block: Block, start: InPlane, end: InPlane) -> ProgrammedArc:
        modes = self.modes
        turn = 1 if modes.motion == codes.COUNTER_CLOCKWISE else -1
        dialect = "inch" if modes.inch else "mm"
        if is_arc_by_radius(block, modes.plane):
            radius = self._length("R", block.words.pop("R"))
            return arc_with_radius(start, end, radius, turn)
        letters = find_center_letters(block, modes.plane, modes.arc_absolute)
        a, b, _ = PLANES[modes.plane]
        u, v = (self._length(x, block.words.get(x, 0.0)) for x in letters)
        block.drop(OFFSETS)
        if modes.arc_absolute:
            point = self.offsets.to_drawing({a: u, b: v}, self.position)
            center = (point[a], point[b])
        else:
            center = (start[0] + u, start[1] + v)
        return arc_around(start, end, center, turn, dialect)

    def _length(self, letter: str, value: float) -> float:
        length = value * self.modes.unit
        if not abs(length) <= FARTHEST:
            raise Fault(
                f"lengths must be within {FARTHEST:g} m, but {letter}{value:g} is {length:g} m"
            )
        return length


def pop_turns(block: Block) -> int:
    """Number of turns P of an arc, counting a partial turn as 1; removes P from the line."""
    word = block.words.pop("P", 1.0)
    turns = round(word)
    if abs(word - turns) > WHOLE_TOLERANCE or turns < 1:
        raise Fault(
            f"the number of turns P of an arc must be a whole number above zero, but is {word:g}"
        )
    return turns


def is_arc_by_radius(block: Block, plane: int) -> bool:
    """True if the arc of a line is defined by its radius."""
    words = block.words
    if "R" not in words:
        return False
    a, b, _ = PLANES[plane]
    centre_words = [x for x in OFFSETS if x in words]
    if centre_words:
        raise Fault(
            f"an arc has both R and {centre_words[0]}: write either the radius or the centre"
        )
    if AXES[a] not in words and AXES[b] not in words:
        raise Fault(
            f"an arc with the radius R needs an end point, but has neither {AXES[a]} nor {AXES[b]}"
        )
    return True


def find_center_letters(block: Block, plane: int, absolute: bool) -> tuple[str, str]:
    """The letters of the two coordinates of the centre, in the order of the plane's axes."""
    words = block.words
    a, b, c = PLANES[plane]
    both = f"{OFFSETS[min(a, b)]} and {OFFSETS[max(a, b)]}"
    # Some post-processors write all three offsets. A zero offset normal to the plane is ignored.
    if words.get(OFFSETS[c], 0.0) != 0:
        raise Fault(
            f"the word {OFFSETS[c]} is not valid for an arc in the plane {codes.g_name(plane)}: "
            f"write the centre as {both}"
        )
    centre_words = [x for x in OFFSETS if x in words and x != OFFSETS[c]]
    if not centre_words:
        raise Fault(f"an arc needs its centre ({both}) or its radius (R)")
    if absolute and len(centre_words) < 2:
        raise Fault(
            f"an absolute centre of an arc (G90.1) needs {both}, but the line has only "
            f"{centre_words[0]}"
        )
    return OFFSETS[a], OFFSETS[b]


# Height above the previous depth at which the rapid of a peck cycle ends [m] (0.010 inch).
CLEARANCE = 0.254e-3
# Maximum number of holes and pecks; this number of contours needs 0.5 GB of memory.
MAX_PECKS = 100_000
# Words that stay valid on the next lines while the same cycle is active.
STICKY = "RQP"


class Cycles:
    """The active drilling cycle, its words and its moves."""

    def __init__(self, tool: ProgrammedTool, modes: Modes) -> None:
        self.tool, self.modes = tool, modes
        self.code: int | None = None
        self.sticky: dict[str, float] = {}
        # Axis and height [m] of the tool before the first cycle of a series: the initial level.
        self.level: tuple[int, float] | None = None
        self.made = 0

    def end(self) -> None:
        """End the series of cycles, at another motion or G80."""
        self.code = self.level = None

    def run(self, block: Block) -> None:
        """Run the active cycle at the position of a line; remove its words from the line."""
        code = self.modes.motion
        assert code is not None
        a, b, c = PLANES[self.modes.plane]
        self._take_sticky_words(block, code, AXES[c])
        repeats = whole_number(block.words.pop("L", 1.0), "the number of cycle repeats L")
        if repeats < 1:
            raise Fault(f"the number of cycle repeats L must be at least 1, but is {repeats}")
        if self.level is None or self.level[0] != c:
            self.level = (c, self.tool.position[c])
        level = self.level[1]
        retract, bottom = self._heights(c, level)
        step = self.sticky["Q"] * self.modes.unit if code == codes.PECK else math.inf
        coordinates = {x: block.words.pop(x) for x in (AXES[a], AXES[b]) if x in block.words}
        if c in self.tool.undefined_axes:
            raise Fault(
                "a cycle cannot start here, because the file does not define the height of the "
                f"tool: write a G0 with an absolute {AXES[c]} before"
            )
        self.made += math.ceil(repeats * max((retract - bottom) / step, 1.0))
        if self.made > MAX_PECKS:
            raise Fault(
                f"the cycles of the program have more than {MAX_PECKS} holes and pecks in total: "
                "reduce the repeats L, or increase Q"
            )
        if self.tool.position[c] < retract:
            self._move_to_height(c, retract)
        clear = retract if self.modes.return_to_r else max(level, retract)
        for _ in range(repeats):
            hole = Block()
            hole.words = dict(coordinates)
            target = self.tool.target(hole)
            target[c] = self.tool.position[c]
            self.tool.move_rapid(target)
            self._move_to_height(c, retract)
            depth = retract - step
            while depth > bottom:
                self._feed_to_height(c, depth)
                self._move_to_height(c, retract)
                self._move_to_height(c, depth + CLEARANCE)
                depth -= step
            self._feed_to_height(c, bottom)
            if code == codes.DRILL_AND_DWELL:
                self.tool.draft.add_dwell(self.sticky.get("P", 0.0))
            self._move_to_height(c, clear)

    def _take_sticky_words(self, block: Block, code: int, height: str) -> None:
        """Store and remove the words of a line that stay valid on the next lines."""
        if code != self.code:
            self.code, self.sticky = code, {}
        for letter in (*STICKY, height):
            if letter in block.words:
                self.sticky[letter] = block.words.pop(letter)
        name = codes.g_name(code)
        for letter in ("R", height):
            if letter not in self.sticky:
                raise Fault(f"the cycle {name} needs the word {letter} on its first line")
        if code == codes.PECK and self.sticky.get("Q", 0.0) <= 0:
            raise Fault(f"the cycle {name} needs the depth of each peck, Q, above zero")
        if self.sticky.get("P", 0.0) < 0:
            raise Fault(f"the dwell P of the cycle {name} must not be negative")
        if self.modes.inverse_time:
            raise Fault(
                f"the cycle {name} is not possible under G93, because F does not define the speed "
                "of its feed moves: write G94, with F per minute"
            )

    def _heights(self, c: int, level: float) -> tuple[float, float]:
        """The heights R and Z in the drawing [m].

        Under G91, R is relative to the initial level and Z to R.
        """
        r, z = (self.sticky[x] * self.modes.unit for x in ("R", AXES[c]))
        if self.modes.absolute:
            retract, bottom = (
                self.tool.offsets.to_drawing({c: x}, self.tool.position)[c] for x in (r, z)
            )
        else:
            retract = level + r
            bottom = retract + z
        if retract < bottom:
            raise Fault(
                f"the height R of a cycle must not be below its {AXES[c]}, but R is {{}} and "
                f"{AXES[c]} is {{}}",
                retract,
                bottom,
            )
        return retract, bottom

    def _move_to_height(self, c: int, height: float) -> None:
        """Make a rapid move to a height along the axis of the cycle."""
        target = list(self.tool.position)
        target[c] = height
        self.tool.move_rapid(target)

    def _feed_to_height(self, c: int, height: float) -> None:
        target = list(self.tool.position)
        target[c] = height
        self.tool.move_line(target)
