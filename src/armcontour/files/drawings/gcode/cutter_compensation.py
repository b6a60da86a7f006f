"""Cutter radius compensation (G41, G42): offset of the programmed moves by the tool radius.

Moves are collected up to G40 and then offset together, like contours with a kerf: lines become
parallels, arcs keep their centres, and an arc is added at each outside corner. At an inside corner,
both moves end at their intersection. A move that is too short for its corners is refused, as in
LinuxCNC.
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
from armcontour.files.drawings.gcode.arcs import ArcPart, ProgrammedArc, helix_points
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

# The ends of two parallels count as one point up to this distance [m]: half of the smallest gap of
# a path.
SAME_END = REPEATED_POINT / 2
# A move reverses the direction if its turn differs from half a turn by at most this [rad].
REVERSAL = 1e-9


@dataclass(slots=True)
class _Move:
    """A programmed move in the plane XY, which can also change the height."""

    # Row of the tables in `program.crossings`: start [m], tangent, curvature [1/m], length [m].
    row: tuple[float, ...]
    end: InPlane  # Programmed end [m]
    z: float  # Height at the end [m]
    line: int
    feed: Feed | None = None  # Speed, tolerance and line number; None for a rapid
    # Events and stops at the end of the move, before the next move.
    actions: list[Callable[[], None]] = field(default_factory=list)


class Compensation:
    """Converts programmed moves to moves of the tool's centre, and adds these to a draft."""

    def __init__(self, draft: ProgramDraft, chord_tolerance: float) -> None:
        self.draft, self.chord_tolerance = draft, chord_tolerance
        self.code = codes.NO_COMPENSATION
        # Offset of the tool's centre to the left of the contour [m].
        self.offset = 0.0
        # The programmed point [m]; valid only while compensation is on.
        self.position: Point = draft.last
        # The moves since G41 or G42, which are not in the draft yet.
        self.moves: list[_Move] = []
        # Whether the next move is the exit move, from the contour to an uncompensated point.
        self.exits_next = False

    @property
    def active(self) -> bool:
        """True if compensation is on."""
        return self.code != codes.NO_COMPENSATION

    @property
    def inactive(self) -> bool:
        """True if the next move is added to the draft as programmed."""
        return not (self.active or self.exits_next)

    @property
    def begun(self) -> bool:
        """True if the draft has a contour."""
        return self.draft.begun

    def start(self, code: int, offset: float) -> None:
        """G41, G42: start compensation by an offset [m]; the next move is the entry move."""
        self.refuse(codes.g_name(code))
        self.code, self.offset = code, offset
        if not self.exits_next:
            self.position = self.draft.last

    def stop(self) -> None:
        """G40: end compensation, and draft the collected moves; the next move is the exit move."""
        if self.moves:
            self.exits_next = True
            self._draft_moves()
        self.code, self.offset = codes.NO_COMPENSATION, 0.0

    def refuse(self, action: str) -> None:
        """Raise an error if compensation is on; `action` is the noun for the message."""
        if self.active:
            raise Fault(
                f"{action} is not possible while cutter radius compensation "
                f"({codes.g_name(self.code)}) is on: write G40, and a straight move away from the "
                "contour, before"
            )

    def arc_start(self) -> Point:
        """Programmed start point [m] of the next arc, which must not be the exit move."""
        if self.exits_next:
            raise Fault(
                "the first move after G40 must be straight, because the offset of the tool ends "
                "along this move, but it is an arc"
            )
        return self.position if self.offset else self.draft.last

    def add_line(self, x: float, y: float, z: float, feed: Feed) -> None:
        """Add a straight feed move to a point [m]."""
        if not self.offset:
            self.exits_next = False
            self.draft.add_line(x, y, z, feed)
        elif math.dist((x, y), self.position[:2]) > REPEATED_POINT:
            self._collect_line((x, y), z, feed[2], feed)
        else:
            self._defer(lambda: self.draft.add_line(*self.draft.last[:2], z, feed))
            self.position = (*self.position[:2], z)

    def add_rapid(self, x: float, y: float, z: float, line: int) -> None:
        """Add a rapid move to a point [m]."""
        if not self.offset:
            self.exits_next = False
            self.draft.add_rapid(x, y, z)
        elif math.dist((x, y), self.position[:2]) > REPEATED_POINT:
            self._collect_line((x, y), z, line)
        else:
            self._defer(lambda: self.draft.add_rapid(*self.draft.last[:2], z))
            self.position = (*self.position[:2], z)

    def add_arc(
        self, piece: ArcPart, axes: tuple[int, int, int], feed: Feed, *, rise: float = 0.0
    ) -> None:
        """Add an arc; while compensation is on, in the plane XY, with a rise in height [m]."""
        if not self.offset:
            self.draft.add_arc(piece, axes, feed)
            return
        (tx, ty), (nx, ny) = piece.tangent, piece.normal
        curvature = math.copysign(piece.curvature, tx * ny - ty * nx)
        radius = 1 / piece.curvature
        if radius * (1 - curvature * self.offset) <= REPEATED_POINT:
            raise Fault(
                "the diameter of the tool must be less than {} for an inside arc of radius {}, but "
                "is {}",
                2 * radius, radius, 2 * abs(self.offset),
            )  # fmt: skip
        if not self.moves:
            self._check_entry_length(math.dist(self.draft.last[:2], piece.end))
        row = (*self.position[:2], tx, ty, curvature, piece.length)
        self._collect(_Move(row, piece.end, self.position[2] + rise, feed[2], feed))

    def add_event(self, name: str, value: Value) -> None:
        """Record an event."""
        self._defer(partial(self.draft.add_event, name, value))

    def add_stop(self) -> None:
        """Record a stop of the tool."""
        self._defer(self.draft.add_stop)

    def add_dwell(self, duration: float) -> None:
        """Record a dwell [s]."""
        self._defer(partial(self.draft.add_dwell, duration))

    def resume_at(self, point: Sequence[float]) -> None:
        """Continue at a point; the file does not define the move to it."""
        self.draft.resume_at(point)

    def count_segments(self, segments: int) -> None:
        """Count segments of helices and full turns, see `ProgramDraft.count_segments`."""
        self.draft.count_segments(segments)

    def set_layer(self, number: str | None, kind: str | None) -> None:
        """Start a layer or a type of moves, see `ProgramDraft.set_layer`."""
        self._defer(partial(self.draft.set_layer, number, kind))

    def _defer(self, action: Callable[[], None]) -> None:
        """Defer an action to the end of the last collected move; run it now if there is none."""
        if self.moves:
            self.moves[-1].actions.append(action)
        else:
            action()

    def _collect_line(self, end: InPlane, z: float, line: int, feed: Feed | None = None) -> None:
        """Collect a straight move in the plane; `feed` is None for a rapid."""
        (x, y), length = self.position[:2], math.dist(self.position[:2], end)
        if not self.moves:
            self._check_entry_length(length)
        row = (x, y, (end[0] - x) / length, (end[1] - y) / length, 0.0, length)
        self._collect(_Move(row, end, z, line, feed))

    def _collect(self, move: _Move) -> None:
        """Collect a move, and set the programmed point to its end."""
        self.moves.append(move)
        self.position, self.exits_next = (*move.end, move.z), False

    def _check_entry_length(self, length: float) -> None:
        """Check that the entry move is longer than the radius of the tool."""
        if length <= abs(self.offset):
            raise Fault(
                f"the first move after {codes.g_name(self.code)} must be longer than the radius of "
                "the tool, {}, but its length is {}",
                abs(self.offset), length,
            )  # fmt: skip

    def _draft_moves(self) -> None:
        """Add the collected moves to the draft, offset by the radius of the tool."""
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
        # At a reversal of direction, an arc around the outside of the vertex is added, as in
        # LinuxCNC. If the sum of both curvatures points away from the tool's side, the moves form
        # an inside corner instead.
        side = math.copysign(math.pi, self.offset)
        inside = (table[:-1, CURVATURE] + table[1:, CURVATURE]) * self.offset < 0
        back = np.abs(turns) >= math.pi - REVERSAL
        turns = np.where(back, np.where(inside, side, -side), turns)
        turns[np.linalg.norm(parallel[1:, :2] - tips[:-1], axis=1) <= SAME_END] = 0.0
        first, last = self._cut_corners(moves, parallel, turns * self.offset > 0)
        ends = np.where((last < parallel[:, LENGTH])[:, None], points_at(parallel, last), tips)
        for i, move in enumerate(moves):
            if i and turns[i - 1] * self.offset < 0:
                self._draft_corner(move, parallel[i], tangents[i - 1], float(turns[i - 1]))
            self._draft_move(move, parallel[i : i + 1], first[i], last[i], tuple(ends[i].tolist()))
            for action in move.actions:
                action()

    def _entry_arc(self, move: _Move, tip: complex, tangent: complex) -> FloatArray:
        """Row of the entry arc from the position of the tool to `tip`, with `tangent` at `tip`."""
        start = complex(*self.draft.last[:2])
        half = cmath.phase(tangent / (tip - start))
        curvature = 2 * math.sin(half) / abs(tip - start)
        if curvature * move.row[CURVATURE] <= 0:
            raise Fault(
                f"the first move after {codes.g_name(self.code)} is an arc for which there is no "
                "entry arc of the same direction from the position of the tool: write a straight "
                "entry move",
                line=move.line,
            )
        first = tangent * cmath.exp(-2j * half)
        return np.array(
            [start.real, start.imag, first.real, first.imag, curvature, 2 * half / curvature]
        )

    def _cut_corners(
        self, moves: Sequence[_Move], parallel: FloatArray, inside: BoolArray
    ) -> tuple[FloatArray, FloatArray]:
        """Start and end arc lengths of parallels, cut at inside corners [m], (n,) each."""
        cut, lengths = np.flatnonzero(inside), parallel[:, LENGTH]
        first, last = np.zeros(len(parallel)), lengths.copy()
        back, first[cut + 1] = corner_cuts(parallel[cut], parallel[cut + 1])
        last[cut] -= back
        for i, by in zip(cut.tolist(), back.tolist(), strict=True):
            position, cut_length, available = (
                "before the corner by {}, but only {} are available",
                by,
                lengths[i] - first[i],
            )
            # The cut of a straight entry move may be longer than the move.
            fits = cut_length <= available + REPEATED_POINT or not (i or parallel[0, CURVATURE])
            if fits:
                position, cut_length, available = (
                    "after the corner by {}, but only {} are available",
                    first[i + 1],
                    lengths[i + 1],
                )
            if fits and cut_length <= available + REPEATED_POINT:
                continue
            reason = f": the tool would shorten the move {position}" if not math.isnan(by) else ""
            raise Fault(
                "the inside corner at ({}, {}) is too narrow for a tool with the diameter "
                f"{{}}{reason}. Use a smaller tool, or round the corner by more than the radius of "
                "the tool",
                *moves[i].end, 2 * abs(self.offset), cut_length, available, line=moves[i + 1].line,
            )  # fmt: skip
        return first, last

    def _draft_corner(
        self, move: _Move, parallel: FloatArray, tangent: FloatArray, turn: float
    ) -> None:
        """Draft the arc around the outside corner before a feed move; before a rapid, a rapid."""
        x, y = parallel[:2].tolist()
        if move.feed is None:
            self.draft.add_rapid(x, y, self.draft.last[2])
            return
        piece = _arc(tangent, -1 / self.offset, abs(turn * self.offset), (x, y))
        self.draft.add_arc(piece, (0, 1, 2), move.feed)

    def _draft_move(
        self, move: _Move, parallel: FloatArray, first: float, last: float, end: InPlane
    ) -> None:
        """Draft a move along its parallel from arc length `first` to `last` [m], up to `end`.

        An arc whose height changes becomes chords of a helix.
        """
        if move.feed is None:
            self.draft.add_rapid(*end, move.z)
            return
        curvature, length = float(parallel[0, CURVATURE]), last - first
        if not curvature:
            self.draft.add_line(*end, move.z, move.feed)
            return
        if length <= REPEATED_POINT:
            return
        begin = np.array([first])
        piece = _arc(points_at(parallel, begin, 1)[0], curvature, length, end)
        z, radius = self.draft.last[2], abs(1 / curvature)
        if abs(move.z - z) <= REPEATED_POINT:
            self.draft.add_arc(piece, (0, 1, 2), move.feed)
            return
        start, turn = points_at(parallel, begin)[0], int(math.copysign(1.0, curvature))
        center = (start + radius * np.array(piece.normal)).tolist()
        arc = ProgrammedArc(center, start.tolist(), end, turn, length / radius, radius, radius)
        points = helix_points(arc, 1, self.chord_tolerance, self.draft.count_segments)
        for i, point in enumerate(points, 1):
            self.draft.add_line(*point, z + i / len(points) * (move.z - z), move.feed)


def _arc(tangent: FloatArray, curvature: float, length: float, end: InPlane) -> ArcPart:
    """The arc with a tangent at its start and a signed curvature, positive to the left."""
    (tx, ty), turn = tangent.tolist(), math.copysign(1.0, curvature)
    return ArcPart((tx, ty), (-turn * ty, turn * tx), abs(curvature), length, end)
