"""Cutter radius compensation (G41, G42): offsets of the programmed moves for the tool's centre.

Moves are collected up to G40, then offset together as kerfs are: parallels of lines, arcs around
the same centres, an arc around each outside corner. At an inside corner both moves end where they
cross. Unlike a kerf, a move that is too short for its corners is refused, as in LinuxCNC.
Source: LinuxCNC manual, "Cutter Radius Compensation", and G Codes, G40, G41, G42.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray
from armcontour.files.drawings.gcode import codes
from armcontour.files.drawings.gcode.arcs import ArcPart, Circle, helix_points
from armcontour.files.drawings.gcode.arcs import Point as InPlane
from armcontour.files.drawings.gcode.draft import Feed, Point, ProgramDraft
from armcontour.files.drawings.gcode.words import Fault
from armcontour.geometry.segments import REPEATED_POINT
from armcontour.program.crossings import (
    CURVATURE,
    LENGTH,
    TX,
    TY,
    corner_cuts,
    offset_pieces,
    points_at,
    rotate_left,
    turns_between,
)
from armcontour.program.moves import Value

# Ends of parallels that are this near are one point [m]: half of what a path takes for a gap.
SAME_END = REPEATED_POINT / 2
# A move turns straight back if its turn is this near to half a turn [rad].
STRAIGHT_BACK = 1e-9


@dataclass(slots=True)
class _Move:
    """A programmed move in the plane XY."""

    row: tuple[float, ...]  # Its row in the table of pieces of `_crossings`
    end: InPlane  # End [m]
    z: float  # Height at the end [m]
    line: int
    feed: Feed | None = None  # Speed, tolerance and line; None for a rapid
    # Actions at its end, before the next move.
    actions: list[Callable[[], None]] = field(default_factory=list)


class Compensation:
    """Converts programmed moves to moves of the tool's centre."""

    def __init__(self, draft: ProgramDraft, chord_tolerance: float) -> None:
        self.draft, self.chord_tolerance = draft, chord_tolerance
        self.code = codes.NO_COMPENSATION
        # Offset of the tool's centre to the left of the contour [m].
        self.offset = 0.0
        # The programmed point; only while compensation is on.
        self.position: Point = draft.last
        # The moves since G41 or G42, which are not drafted yet.
        self.moves: list[_Move] = []
        # Whether the next move leads away from the contour.
        self.leaves = False

    @property
    def active(self) -> bool:
        """True if compensation is on."""
        return self.code != codes.NO_COMPENSATION

    @property
    def inactive(self) -> bool:
        """True if moves are drafted as programmed."""
        return not (self.active or self.leaves)

    @property
    def begun(self) -> bool:
        """True if a contour has begun."""
        return self.draft.begun

    def start(self, code: int, offset: float) -> None:
        """G41, G42: the next move in the plane leads to the contour."""
        self.refuse(codes.g_name(code))
        self.code, self.offset = code, offset
        if not self.leaves:
            self.position = self.draft.last

    def stop(self) -> None:
        """G40: the next move leads away from the contour."""
        if self.moves:
            self.leaves = True
            self._draft_moves()
        self.code, self.offset = codes.NO_COMPENSATION, 0.0

    def refuse(self, action: str) -> None:
        """Refuse what cannot be done while compensation is on."""
        if self.active:
            raise Fault(
                f"{action} while cutter radius compensation ({codes.g_name(self.code)}) is on: "
                "write G40, and a straight move away from the contour, before"
            )

    def start_of_arc(self) -> Point:
        """Start point of the next arc."""
        if self.leaves:
            raise Fault(
                "an arc as the first move after G40, which has to be straight: the tool's centre "
                "leaves the contour on it"
            )
        return self.position if self.offset else self.draft.last

    def feed(self, x: float, y: float, z: float, feed: Feed) -> None:
        """A straight feed move."""
        if not self.offset:
            self.leaves = False
            self.draft.feed(x, y, z, feed)
        elif math.dist((x, y), self.position[:2]) > REPEATED_POINT:
            self._follow_line((x, y), z, feed[2], feed)
        else:
            self._wait(lambda: self.draft.feed(*self.draft.last[:2], z, feed))
            self.position = (*self.position[:2], z)

    def go(self, x: float, y: float, z: float, line: int) -> None:
        """A rapid move."""
        if not self.offset:
            self.leaves = False
            self.draft.go(x, y, z)
        elif math.dist((x, y), self.position[:2]) > REPEATED_POINT:
            self._follow_line((x, y), z, line)
        else:
            self._wait(lambda: self.draft.go(*self.draft.last[:2], z))
            self.position = (*self.position[:2], z)

    def arc(
        self, piece: ArcPart, axes: tuple[int, int, int], feed: Feed, *, rise: float = 0.0
    ) -> None:
        """An arc; while compensation is on, in the plane XY, or a helix across it."""
        if not self.offset:
            self.draft.arc(piece, axes, feed)
            return
        (tx, ty), (nx, ny) = piece.tangent, piece.normal
        curvature = math.copysign(piece.curvature, tx * ny - ty * nx)
        radius = 1 / piece.curvature
        if radius * (1 - curvature * self.offset) <= REPEATED_POINT:
            raise Fault(
                "an inside arc of radius {} for a tool of {}: its diameter must be below {}",
                radius, 2 * abs(self.offset), 2 * radius,
            )  # fmt: skip
        if not self.moves:
            self._check_entry_length(math.dist(self.draft.last[:2], piece.end))
        row = (*self.position[:2], tx, ty, curvature, piece.length)
        self._follow(_Move(row, piece.end, self.position[2] + rise, feed[2], feed))

    def event(self, name: str, value: Value) -> None:
        """Record an event."""
        self._wait(partial(self.draft.event, name, value))

    def rest(self) -> None:
        """Record a stop of the tool."""
        self._wait(self.draft.rest)

    def dwell(self, duration: float) -> None:
        """Record a dwell [s]."""
        self._wait(partial(self.draft.dwell, duration))

    def resume_at(self, point: Sequence[float]) -> None:
        """Continue at a point; the file does not define the move to it."""
        self.draft.resume_at(point)

    def room_for(self, segments: int) -> None:
        """Count segments, as `ProgramDraft.room_for`."""
        self.draft.room_for(segments)

    def set_layer(self, number: str | None, kind: str | None) -> None:
        """Start a layer, as `ProgramDraft.set_layer`."""
        self._wait(partial(self.draft.set_layer, number, kind))

    def _wait(self, action: Callable[[], None]) -> None:
        """Run an action at the end of the last collected move, or now if there is none."""
        if self.moves:
            self.moves[-1].actions.append(action)
        else:
            action()

    def _follow_line(self, end: InPlane, z: float, line: int, feed: Feed | None = None) -> None:
        """Collects a straight move."""
        (x, y), length = self.position[:2], math.dist(self.position[:2], end)
        if not self.moves:
            self._check_entry_length(length)
        row = (x, y, (end[0] - x) / length, (end[1] - y) / length, 0.0, length)
        self._follow(_Move(row, end, z, line, feed))

    def _follow(self, move: _Move) -> None:
        self.moves.append(move)
        self.position, self.leaves = (*move.end, move.z), False

    def _check_entry_length(self, length: float) -> None:
        if length <= abs(self.offset):
            raise Fault(
                f"the first move under {codes.g_name(self.code)}, which is {{}} long and leads the "
                "tool beside the contour: it must be longer than the tool's radius of {}",
                length, abs(self.offset),
            )  # fmt: skip

    def _draft_moves(self) -> None:
        """Draft the collected moves with the tool offset to the side."""
        moves, self.moves = self.moves, []
        table = np.array([x.row for x in moves])
        parallel, tangents = (
            offset_pieces(table, self.offset),
            points_at(table, table[:, LENGTH], 1),
        )
        tips = np.array([x.end for x in moves]) + self.offset * rotate_left(tangents)
        if table[0, CURVATURE]:
            parallel[0] = self._entry_arc(moves[0], complex(*tips[0]), complex(*tangents[0]))
        turns = turns_between(tangents[:-1], table[1:, [TX, TY]])
        # A move straight back turns around the outside of the tip, as in LinuxCNC, unless it bends
        # away to the tool's side, where both make an inside corner.
        side = math.copysign(math.pi, self.offset)
        inside = (table[:-1, CURVATURE] + table[1:, CURVATURE]) * self.offset < 0
        back = np.abs(turns) >= math.pi - STRAIGHT_BACK
        turns = np.where(back, np.where(inside, side, -side), turns)
        turns[np.linalg.norm(parallel[1:, :2] - tips[:-1], axis=1) <= SAME_END] = 0.0
        first, last = self._cut_corners(moves, parallel, turns * self.offset > 0)
        ends = np.where((last < parallel[:, LENGTH])[:, None], points_at(parallel, last), tips)
        for i, move in enumerate(moves):
            if i and turns[i - 1] * self.offset < 0:
                self._turn_corner(move, parallel[i], tangents[i - 1], float(turns[i - 1]))
            self._draft_move(move, parallel[i : i + 1], first[i], last[i], tuple(ends[i].tolist()))
            for action in move.actions:
                action()

    def _entry_arc(self, move: _Move, tip: complex, tangent: complex) -> FloatArray:
        """The row of an arc from where the tool is, tangent to the first parallel at its end."""
        start = complex(*self.draft.last[:2])
        half = cmath.phase(tangent / (tip - start))
        curvature = 2 * math.sin(half) / abs(tip - start)
        if curvature * move.row[CURVATURE] <= 0:
            raise Fault(
                f"the first move under {codes.g_name(self.code)}, an arc that the tool cannot "
                "enter from where it is: enter by a straight move",
                line=move.line,
            )
        first = tangent * cmath.exp(-2j * half)
        return np.array(
            [start.real, start.imag, first.real, first.imag, curvature, 2 * half / curvature]
        )

    def _cut_corners(
        self, moves: Sequence[_Move], parallel: FloatArray, inside: BoolArray
    ) -> tuple[FloatArray, FloatArray]:
        """Lengths at which each parallel begins and ends, cut at inside corners [m], (n,) each."""
        cut, lengths = np.flatnonzero(inside), parallel[:, LENGTH]
        first, last = np.zeros(len(parallel)), lengths.copy()
        back, first[cut + 1] = corner_cuts(parallel[cut], parallel[cut + 1])
        last[cut] -= back
        for i, by in zip(cut.tolist(), back.tolist(), strict=True):
            position, cut_length, available = (
                "before it by {}, of which {} are left",
                by,
                lengths[i] - first[i],
            )
            # A straight entry may end before its start.
            fits = cut_length <= available + REPEATED_POINT or not (i or parallel[0, CURVATURE])
            if fits:
                position, cut_length, available = (
                    "after it by {}, which is {} long",
                    first[i + 1],
                    lengths[i + 1],
                )
            if fits and cut_length <= available + REPEATED_POINT:
                continue
            reason = (
                f"which shortens the move {position}"
                if not math.isnan(by)
                else "into which it does not fit"
            )
            raise Fault(
                f"an inside corner at ({{}}, {{}}) for a tool of {{}}, {reason}: take a smaller "
                "tool, or round the corner by more than the tool's radius",
                *moves[i].end, 2 * abs(self.offset), cut_length, available, line=moves[i + 1].line,
            )  # fmt: skip
        return first, last

    def _turn_corner(
        self, move: _Move, parallel: FloatArray, tangent: FloatArray, turn: float
    ) -> None:
        """Drafts the arc around the outside corner before a move; a rapid goes straight."""
        x, y = parallel[:2].tolist()
        if move.feed is None:
            self.draft.go(x, y, self.draft.last[2])
            return
        piece = _arc(tangent, -1 / self.offset, abs(turn * self.offset), (x, y))
        self.draft.arc(piece, (0, 1, 2), move.feed)

    def _draft_move(
        self, move: _Move, parallel: FloatArray, first: float, last: float, end: InPlane
    ) -> None:
        """Drafts a move along a part of its parallel; chords of an arc where the height changes."""
        if move.feed is None:
            self.draft.go(*end, move.z)
            return
        curvature, length = float(parallel[0, CURVATURE]), last - first
        if not curvature:
            self.draft.feed(*end, move.z, move.feed)
            return
        if length <= REPEATED_POINT:
            return
        begin = np.array([first])
        piece = _arc(points_at(parallel, begin, 1)[0], curvature, length, end)
        z, radius = self.draft.last[2], abs(1 / curvature)
        if abs(move.z - z) <= REPEATED_POINT:
            self.draft.arc(piece, (0, 1, 2), move.feed)
            return
        start, turn = points_at(parallel, begin)[0], int(math.copysign(1.0, curvature))
        center = (start + radius * np.array(piece.normal)).tolist()
        circle = Circle(center, start.tolist(), end, turn, length / radius, radius, radius)
        points = helix_points(circle, 1, self.chord_tolerance, self.draft.room_for)
        for i, point in enumerate(points, 1):
            self.draft.feed(*point, z + i / len(points) * (move.z - z), move.feed)


def _arc(tangent: FloatArray, curvature: float, length: float, end: InPlane) -> ArcPart:
    """An arc whose curvature is positive to the left."""
    (tx, ty), turn = tangent.tolist(), math.copysign(1.0, curvature)
    return ArcPart((tx, ty), (-turn * ty, turn * tx), abs(curvature), length, end)
