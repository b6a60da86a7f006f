"""Cutter radius compensation (G41, G42): the tool's centre beside the programmed contour.

The centre goes parallel to lines and around the same centres as arcs, by an arc around outside
corners, and up to the point of intersection at inside corners. How a move ends depends on the next
one, so that one move always waits for its successor.
Source: LinuxCNC manual, "Cutter Radius Compensation", and G Codes, G40, G41, G42.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial

from armcontour.geometry.segments import REPEATED_POINT
from armcontour.io.drawings.gcode import codes
from armcontour.io.drawings.gcode.arcs import Circle, Piece, chords_of, point_of
from armcontour.io.drawings.gcode.arcs import Point as InPlane
from armcontour.io.drawings.gcode.draft import Draft, Point
from armcontour.io.drawings.gcode.faults import Fault
from armcontour.io.drawings.gcode.parallels import (
    Beside,
    cross,
    cut_corner,
    dot,
    minus,
    shifted,
    turn_between,
    turned,
    way_to,
)
from armcontour.program.moves import Value

# Ends of parallels that are this near are one point [m]: half of what a path takes for a gap.
SAME_END = REPEATED_POINT / 2


class Compensation:
    """Takes moves as they are programmed, and drafts those of the tool's centre.

    Args:
        draft: The program that takes the moves.
        chord_tolerance: Largest distance between a helix and its chords [m].
    """

    def __init__(self, draft: Draft, chord_tolerance: float) -> None:
        self.draft, self.chord_tolerance = draft, chord_tolerance
        self.code = codes.NO_COMPENSATION
        # How far the tool's centre is to the left of the contour [m].
        self.left = 0.0
        # The programmed point; only while compensation is on.
        self.at: Point = draft.last
        self.open: Beside | None = None
        # What comes after the open move and before the next one in the plane.
        self.waiting: list[Callable[[], None]] = []
        # Whether the next move leads away from the contour.
        self.leaves = False

    @property
    def on(self) -> bool:
        """Whether compensation is on."""
        return self.code != codes.NO_COMPENSATION

    @property
    def off(self) -> bool:
        """Whether moves are drafted as they are programmed, arcs too."""
        return not (self.on or self.leaves)

    @property
    def begun(self) -> bool:
        """Whether a contour has begun."""
        return self.draft.begun

    def start(self, code: int, left: float) -> None:
        """G41, G42: the next move in the plane leads to the contour.

        Args:
            code: The code.
            left: How far the tool's centre is to the left of the contour [m].
        """
        self.refuse(codes.g_name(code))
        self.code, self.left = code, left
        if not self.leaves:
            self.at = self.draft.last

    def stop(self) -> None:
        """G40: the next move leads away from the contour."""
        if self.open is not None:
            self.leaves = True
        self._close()
        self.code, self.left = codes.NO_COMPENSATION, 0.0

    def refuse(self, what: str) -> None:
        """Refuse what cannot be done while compensation is on."""
        if self.on:
            raise Fault(
                f"{what} while cutter radius compensation ({codes.g_name(self.code)}) is on: "
                "write G40, and a straight move away from the contour, before"
            )

    def start_of_arc(self) -> Point:
        """Where an arc starts that comes next.

        Raises:
            Fault: Behind a contour with compensation, where the move has to be straight.
        """
        if self.leaves:
            raise Fault(
                "an arc as the first move after G40, which has to be straight: the tool's centre "
                "leaves the contour on it"
            )
        return self.at if self.left else self.draft.last

    def feed(self, x: float, y: float, z: float, speed: float, tolerance: float, line: int) -> None:
        """A straight feed move."""
        if not self.left:
            self.leaves = False
            self.draft.feed(x, y, z, speed, tolerance, line)
        elif math.dist((x, y), self.at[:2]) > REPEATED_POINT:
            found = self._parallel((x, y), z)
            found.line, found.speed, found.tolerance = line, speed, tolerance
            self._follow(found, (x, y, z))
        else:
            self._wait(partial(self._plunge, z, speed, tolerance, line))
            self.at = (*self.at[:2], z)

    def go(self, x: float, y: float, z: float) -> None:
        """A rapid move."""
        if not self.left:
            self.leaves = False
            self.draft.go(x, y, z)
        elif math.dist((x, y), self.at[:2]) > REPEATED_POINT:
            self._follow(self._parallel((x, y), z), (x, y, z))
        else:
            self._wait(partial(self._rise, z))
            self.at = (*self.at[:2], z)

    def bend(
        self,
        piece: Piece,
        axes: tuple[int, int, int],
        speed: float,
        tolerance: float,
        line: int,
        *,
        rise: float = 0.0,
    ) -> None:
        """An arc; while compensation is on, in the plane XY, or a helix across it."""
        if not self.left:
            self.draft.bend(piece, axes, speed, tolerance, line)
            return
        x, y, z = self.at
        z += rise
        start, radius = (x, y), 1 / piece.curvature
        turn = math.copysign(1.0, cross(piece.tangent, piece.normal))
        inner = radius - turn * self.left
        if inner <= REPEATED_POINT:
            raise Fault(
                "an inside arc of radius {} for a tool of {}: its diameter must be below {}",
                radius, 2 * abs(self.left), 2 * radius,
            )  # fmt: skip
        tangent = turned(piece.tangent, turn * piece.length / radius)
        found = Beside(
            start=shifted(start, piece.tangent, self.left),
            end=shifted(piece.end, tangent, self.left),
            tangents=(piece.tangent, tangent),
            corner=start,
            z=z,
            length=inner * piece.length / radius,
            bend=turn / radius,
            curvature=turn / inner,
            line=line,
            speed=speed,
            tolerance=tolerance,
        )
        if self.open is None:
            self._enter_by_arc(found, piece.end)
        self._follow(found, (*piece.end, z))

    def event(self, name: str, value: Value) -> None:
        """Something is switched."""
        self._wait(partial(self.draft.event, name, value))

    def rest(self) -> None:
        """The tool comes to rest."""
        self._wait(self.draft.rest)

    def dwell(self, duration: float) -> None:
        """The tool rests for a time [s]."""
        self._wait(partial(self.draft.dwell, duration))

    def resume_at(self, point: Sequence[float]) -> None:
        """The tool is at a point to which the file does not say how it came."""
        self.draft.resume_at(point)

    def room_for(self, segments: int) -> None:
        """Counts segments, as `Draft.room_for` does."""
        self.draft.room_for(segments)

    def _wait(self, what: Callable[[], None]) -> None:
        """Does something where the open move ends, or now where none is open."""
        if self.open is None:
            what()
        else:
            self.waiting.append(what)

    def _plunge(self, z: float, speed: float, tolerance: float, line: int) -> None:
        x, y, _ = self.draft.last
        self.draft.feed(x, y, z, speed, tolerance, line)

    def _rise(self, z: float) -> None:
        x, y, _ = self.draft.last
        self.draft.go(x, y, z)

    def _parallel(self, end: InPlane, z: float) -> Beside:
        """The way beside a straight move.

        Raises:
            Fault: The first move, if it is not longer than the radius.
        """
        start = self.at[:2]
        length = math.dist(start, end)
        if self.open is None:
            self._refuse_short_entry(length)
        tangent = ((end[0] - start[0]) / length, (end[1] - start[1]) / length)
        return Beside(
            start=shifted(start, tangent, self.left),
            end=shifted(end, tangent, self.left),
            tangents=(tangent, tangent),
            corner=start,
            z=z,
            length=length,
            entry=self.open is None,
        )

    def _refuse_short_entry(self, length: float) -> None:
        if length <= abs(self.left):
            raise Fault(
                f"the first move under {codes.g_name(self.code)}, which is {{}} long and leads the "
                "tool beside the contour: it must be longer than the tool's radius of {}",
                length, abs(self.left),
            )  # fmt: skip

    def _enter_by_arc(self, found: Beside, end: InPlane) -> None:
        """Makes the first arc start where the tool is, tangent to its parallel at the end.

        Raises:
            Fault: It is too short, or starts on the wrong side.
        """
        start = self.draft.last[:2]
        self._refuse_short_entry(math.dist(start, end))
        back = minus(start, found.end)
        curvature = 2 * cross(found.tangents[1], back) / dot(back, back)
        if curvature * found.bend <= 0:
            raise Fault(
                f"the first move under {codes.g_name(self.code)}, an arc that the tool cannot "
                "enter from where it is: enter by a straight move"
            )
        way = -way_to(found.tangents[1], curvature, back)
        found.start, found.curvature = start, curvature
        found.length = way if way > 0 else way + 2 * math.pi / abs(curvature)
        first = turned(found.tangents[1], -curvature * found.length)
        found.tangents = (first, found.tangents[1])

    def _follow(self, found: Beside, end: Point) -> None:
        """Ends the open move where the next one begins, which is open from now on."""
        before = self.open
        if before is not None:
            self._turn_corner(before, found)
        self.open, self.at, self.leaves = found, end, False

    def _turn_corner(self, before: Beside, found: Beside) -> None:
        gap = math.dist(before.end, found.start)
        angle = turn_between(before, found, self.left)
        if gap > SAME_END and angle * self.left > 0:
            way = cut_corner(before, found, abs(self.left))
            self._end_open(way)
            return
        self._end_open(before.length)
        if gap <= SAME_END:
            return
        if not found.line:
            self.draft.go(*found.start, self.draft.last[2])
            return
        tangent = before.tangents[1]
        turn = -math.copysign(1.0, self.left)
        piece = Piece(
            tangent=tangent,
            normal=(-turn * tangent[1], turn * tangent[0]),
            curvature=1 / abs(self.left),
            length=abs(angle * self.left),
            end=found.start,
        )
        self.draft.bend(piece, (0, 1, 2), found.speed, found.tolerance, found.line)

    def _close(self) -> None:
        if self.open is not None:
            self._end_open(self.open.length)

    def _end_open(self, way: float) -> None:
        """Drafts the open move up to a length, and what waits for it."""
        x = self.open
        assert x is not None
        end = x.end if way == x.length else x.at(way)[0]
        if not x.line:
            self.draft.go(*end, x.z)
        elif not x.curvature:
            self.draft.feed(*end, x.z, x.speed, x.tolerance, x.line)
        elif way - x.first > REPEATED_POINT:
            self._draft_arc(x, way, end)
        self.open = None
        waiting, self.waiting = self.waiting, []
        for act in waiting:
            act()

    def _draft_arc(self, x: Beside, way: float, end: InPlane) -> None:
        """An arc up to a length; chords of it where the height changes."""
        start, tangent = x.at(x.first)
        turn, radius = math.copysign(1.0, x.curvature), 1 / abs(x.curvature)
        normal = (-turn * tangent[1], turn * tangent[0])
        last = self.draft.last[2]
        if abs(x.z - last) <= REPEATED_POINT:
            piece = Piece(tangent, normal, 1 / radius, way - x.first, end)
            self.draft.bend(piece, (0, 1, 2), x.speed, x.tolerance, x.line)
            return
        center = (start[0] + radius * normal[0], start[1] + radius * normal[1])
        sweep = (way - x.first) / radius
        circle = Circle(center, start, end, int(turn), sweep, radius, radius)
        n = chords_of(circle, 1, self.chord_tolerance)
        self.draft.room_for(n)
        for i in range(1, n + 1):
            point = point_of(circle, 1, i / n) if i < n else end
            z = last + i / n * (x.z - last)
            self.draft.feed(*point, z, x.speed, x.tolerance, x.line)
