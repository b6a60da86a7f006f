"""Drafts of programs: collected moves and events, which are converted to a `Program`."""

from __future__ import annotations

import math
from array import array
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.text import list_some
from armcontour.files.drawings.gcode.arcs import ArcPart
from armcontour.files.drawings.gcode.words import Fault
from armcontour.geometry import Path
from armcontour.geometry.biarcs import join_by_quintics, tangent_and_curvature
from armcontour.geometry.origins import first_line
from armcontour.geometry.segments import REPEATED_POINT, Segments
from armcontour.program import Contour, Dwell, Event, Program, Rapid
from armcontour.program.moves import Move, Value

# Two points are the same if their squared distance is at most this [m²].
SAME_POINT_SQUARED = REPEATED_POINT**2
# Largest rounding error of z after relative moves that return to zero [m].
Z_ROUNDING = 1e-12
# An arc that meets a move at this angle or above turns back [rad]: the tool would move along the
# same line again.
TURNED_BACK = math.radians(178)
# Maximum number of lines that a note lists.
MAX_LISTED = 12
# Maximum number of helix segments; more do not fit into the planner's memory.
MAX_SEGMENTS = 1_000_000
REVERSED_NOTE = (
    "Arcs turn back at both ends, but would be tangent to the moves before and after them in the "
    "other direction: {}. Check whether G2 and G3 are exchanged."
)

Point = tuple[float, float, float]
# Speed [m/s], maximum permitted corner error [m] and origin of a feed move. Speed and error are NaN
# if the file does not specify them.
Feed = tuple[float, float, int]


@dataclass(slots=True)
class FeedChain:
    """Consecutive feed moves without a stop, which become one contour."""

    points: array[float]  # x, y and z of each move's start and end [m], flattened
    line: int  # Line number of the first move
    # Speed [m/s], maximum permitted corner error [m] and origin of each move.
    speeds: array[float] = field(default_factory=lambda: array("d"))
    tolerances: array[float] = field(default_factory=lambda: array("d"))
    origins: array[int] = field(default_factory=lambda: array("q"))
    # Of each arc: index of its move, tangent at the start, normal, curvature [1/m], length [m].
    arcs: list[tuple[int, Point, Point, float, float]] = field(default_factory=list)
    # Of each helix: index of its first move, and its knots: points [m], first and second
    # derivatives with respect to the fraction of the helix, (3, knots, 3); first derivatives in the
    # middle between two knots, (knots - 1, 3).
    helices: list[tuple[int, FloatArray, FloatArray]] = field(default_factory=list)
    # Of each event: index of the move that follows, name, value.
    events: list[tuple[int, str, Value]] = field(default_factory=list)


@dataclass(slots=True)
class RapidChain:
    """Consecutive rapid moves."""

    points: array[float]  # x, y and z of each move's start and end [m], flattened
    origins: array[int] = field(default_factory=lambda: array("q"))


class ProgramDraft:
    """Moves and events that have been read so far, in the order of the file."""

    def __init__(self) -> None:
        self.moves: list[FeedChain | RapidChain | Event | Dwell] = []
        self.last: Point = (0.0, 0.0, 0.0)
        self.chain: FeedChain | None = None
        self.rapid: RapidChain | None = None
        self.begun = False
        self.has_vertical_arc = False
        self.segments = 0

    def add_line(self, x: float, y: float, z: float, feed: Feed) -> None:
        """Add a straight feed move; a move without length is ignored."""
        px, py, pz = self.last
        if (x - px) ** 2 + (y - py) ** 2 + (z - pz) ** 2 <= SAME_POINT_SQUARED:
            return
        self._extend(feed, (x, y, z))

    def add_arc(self, piece: ArcPart, axes: tuple[int, int, int], feed: Feed) -> None:
        """Add an arc in the plane of the first two of `axes` (axis indices)."""
        a, b, _ = axes
        end = list(self.last)
        tangent = [0.0] * 3
        normal = [0.0] * 3
        parts = (end, piece.end), (tangent, piece.tangent), (normal, piece.normal)
        for point, x in parts:
            point[a] = x.real
            point[b] = x.imag
        chain = self._extend(feed, _point(end))
        number = len(chain.speeds) - 1
        arc = (number, _point(tangent), _point(normal), piece.curvature, piece.length)
        chain.arcs.append(arc)
        self.has_vertical_arc = self.has_vertical_arc or 2 in (a, b)

    def add_helix(self, knots: FloatArray, middles: FloatArray, feed: Feed) -> None:
        """Add a helix as a chain of transitions.

        - `knots`: its knots [m], and the first and second derivatives at them with respect to the
          fraction of the helix, (3, knots, 3).
        - `middles`: first derivatives in the middle between two knots, (knots - 1, 3).
        """
        for point in knots[0, 1:].tolist():
            chain = self._extend(feed, _point(point))
        chain.helices.append((len(chain.speeds) - len(middles), knots, middles))

    def count_segments(self, segments: int) -> None:
        """Count segments of helices; raise an error if there are too many."""
        self.segments += segments
        if self.segments > MAX_SEGMENTS:
            raise Fault(
                f"the helices of the program need more than {MAX_SEGMENTS} segments in total. "
                "Increase the chord tolerance"
            )

    def add_rapid(self, x: float, y: float, z: float, origin: int) -> None:
        """Add a rapid move. Before the first contour, only the end point of the move is stored."""
        px, py, pz = self.last
        if (x - px) ** 2 + (y - py) ** 2 + (z - pz) ** 2 <= SAME_POINT_SQUARED:
            return
        self._close()
        if self.begun:
            if self.rapid is None:
                self.rapid = RapidChain(points=array("d", self.last))
            self.rapid.points.extend((x, y, z))
            self.rapid.origins.append(origin)
        self.last = (x, y, z)

    def resume_at(self, point: Sequence[float]) -> None:
        """Stop, and continue at a point [m]; the move to the point is not part of the program."""
        self.add_stop()
        self.last = _point(point)

    def add_event(self, name: str, value: Value) -> None:
        """Add an event to the open contour, or between moves if no contour is open."""
        if self.chain is not None:
            self.chain.events.append((len(self.chain.speeds), name, value))
        else:
            self._flush()
            self.moves.append(Event(name=name, value=value))

    def add_stop(self) -> None:
        """End the open contour or rapid move, so that the tool stops."""
        self._close()
        self._flush()

    def add_dwell(self, duration: float) -> None:
        """Add a dwell [s]; a dwell of 0 s is only a stop."""
        self.add_stop()
        if duration > 0:
            self.moves.append(Dwell(duration=duration))

    def program(self, source: str, notes: tuple[str, ...]) -> Program:
        """Convert the draft to a program, in the plane if all its points have z = 0."""
        self.add_stop()
        if not self.begun:
            raise InvalidInput(
                f"{source} has no contour to follow, because it has no feed move (G1, G2 or G3) "
                "with a length."
            )
        dimension = 3 if self.has_vertical_arc or self._leaves_the_plane() else 2
        counts: Counter[int] = Counter()
        moves: list[Move] = []
        reversed_arcs: list[str] = []
        for move in self.moves:
            if isinstance(move, FeedChain):
                counts[move.line] += 1
                contour = _contour(move, dimension, counts, source)
                moves.append(contour)
                reversed_arcs += _reversed_arcs(contour.path, move)
            elif isinstance(move, RapidChain):
                moves.append(Rapid(path=_rapid_path(move, dimension)))
            else:
                moves.append(move)
        if reversed_arcs:
            notes = (*notes, REVERSED_NOTE.format(list_some(reversed_arcs, MAX_LISTED)))
        return Program(moves=tuple(moves), source=source, notes=notes)

    def _extend(self, feed: Feed, end: Point) -> FeedChain:
        """Append a move to the open contour, or to a new contour; return the contour."""
        speed, tolerance, origin = feed
        chain = self.chain
        if chain is None:
            self._flush()
            self.begun = True
            chain = self.chain = FeedChain(points=array("d", self.last), line=first_line(origin))
        chain.points.extend(end)
        chain.speeds.append(speed)
        chain.tolerances.append(tolerance)
        chain.origins.append(origin)
        self.last = end
        return chain

    def _close(self) -> None:
        """Append the chain of feed moves, if there is one, to the moves."""
        if self.chain is not None:
            self.moves.append(self.chain)
            self.chain = None

    def _flush(self) -> None:
        """Append the rapid, if there is one, to the moves."""
        if self.rapid is not None:
            self.moves.append(self.rapid)
            self.rapid = None

    def _leaves_the_plane(self) -> bool:
        """Return whether a point of the moves has a z coordinate other than zero."""
        for move in self.moves:
            if isinstance(move, FeedChain | RapidChain):
                points = np.frombuffer(move.points)
                if (np.abs(points[2::3]) > Z_ROUNDING).any():
                    return True
        return False


def _point(values: Sequence[float]) -> Point:
    return (values[0], values[1], values[2])


def _contour(chain: FeedChain, dimension: int, counts: Counter[int], source: str) -> Contour:
    """Return the contour of a chain of feed moves.

    - `dimension`: 2 or 3.
    - `counts`: number of contours so far, by the line in which they start.
    - `source`: name of the file, for messages.
    """
    try:
        path = _path(chain, dimension)
    except InvalidInput as error:
        line = chain.line if error.index is None else first_line(chain.origins[error.index])
        raise InvalidInput(f"{source}, line {line}: {error}", index=line - 1) from None
    events = tuple(
        Event(name=name, value=value, s=float(path.breaks[i])) for i, name, value in chain.events
    )
    count = counts[chain.line]
    name = f"line {chain.line}" if count == 1 else f"line {chain.line} ({count})"
    return Contour(path=path, name=name, number=counts.total(), events=events, keep_start=True)


def _reversed_arcs(path: Path, chain: FeedChain) -> list[str]:
    """Describe arcs whose direction is probably wrong, with their lines in the file.

    Such an arc turns back at both ends, so the arc around the same centre in the other direction is
    tangent to both of its neighbours.
    """
    if not chain.arcs:
        return []
    turns = path.turns
    points = path.vertices
    found = []
    for i, _, _, curvature, length in chain.arcs:
        if not 0 < i < len(turns) or min(turns[i - 1], turns[i]) < TURNED_BACK:
            continue
        # A move that goes back and forth along the same arc turns back, too.
        ends = points[i : i + 2]
        beyond = points[[i + 2, i - 1]]
        if np.linalg.norm(ends - beyond, axis=1).min() > REPEATED_POINT:
            sweep = math.degrees(curvature * length)
            line = first_line(chain.origins[i])
            found.append(f"line {line} ({sweep:.4g}° instead of {360 - sweep:.4g}°)")
    return found


def _rapid_path(rapid: RapidChain, dimension: int) -> Path:
    """Return the path of straight lines of a rapid, in 2 or 3 dimensions."""
    vertices = np.frombuffer(rapid.points).reshape(-1, 3)[:, :dimension]
    return Path(segments=Segments.lines(vertices, origins=np.array(rapid.origins, dtype=np.intp)))


def _path(chain: FeedChain, dimension: int) -> Path:
    """Return the path of feed moves in 2 or 3 dimensions, with its arcs and limits."""
    vertices = np.frombuffer(chain.points).reshape(-1, 3)[:, :dimension]
    steps = np.diff(vertices, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    # A full circle ends at its start, so the length of its step is 0.
    tangents = steps / np.where(lengths > 0, lengths, 1.0)[:, None]
    normals = np.zeros_like(steps)
    curvatures = np.zeros(len(steps))
    for i, tangent, normal, curvature, length in chain.arcs:
        tangents[i] = tangent[:dimension]
        normals[i] = normal[:dimension]
        curvatures[i] = curvature
        lengths[i] = length
    table = Segments(
        starts=vertices[:-1],
        tangents=tangents,
        normals=normals,
        curvatures=curvatures,
        lengths=lengths,
        speeds=np.frombuffer(chain.speeds),
        tolerances=np.frombuffer(chain.tolerances),
        origins=np.array(chain.origins, dtype=np.intp),
    )
    return Path(segments=_with_helices(table, chain) if chain.helices else table)


def _with_helices(table: Segments, chain: FeedChain) -> Segments:
    """Return a chain's table with transitions instead of the chords of helices."""
    parts = []
    done = 0
    for first, (points, slopes, bends), middles in chain.helices:
        tangents, curvatures = tangent_and_curvature(slopes, bends)
        count = len(middles)
        # The length of each part of the helix, by Simpson's rule.
        speed = np.linalg.norm(slopes, axis=1)
        lengths = (speed[:-1] + 4 * np.linalg.norm(middles, axis=1) + speed[1:]) / (6 * count)
        begin = points[:-1], tangents[:-1], curvatures[:-1]
        end = np.diff(points, axis=0), tangents[1:], curvatures[1:]
        helix = join_by_quintics(begin, end, lengths)
        limits = table[first : first + count].limit_columns
        parts += [table[done:first], helix.replace(**limits)]
        done = first + count
    parts.append(table[done:])
    return Segments.join([x for x in parts if len(x)])
