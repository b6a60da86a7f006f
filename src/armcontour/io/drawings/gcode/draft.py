"""The moves of a G-code file while it is read, and their conversion to a `Program`."""

from __future__ import annotations

from array import array
from dataclasses import dataclass, field

import numpy as np

from armcontour.errors import InvalidInput
from armcontour.geometry import Path
from armcontour.geometry.segments import REPEATED_POINT, Segments
from armcontour.io.drawings.gcode.arcs import Piece
from armcontour.io.drawings.gcode.words import Fault
from armcontour.program import Contour, Dwell, Event, Program, Rapid
from armcontour.program.moves import Move, Value

NEAR = REPEATED_POINT**2
# A z below this [m] is zero with the rounding errors of summed relative moves.
FLAT = 1e-12
# Largest number of segments of helices and full turns together: a single line can program any
# number of turns.
MOST_SEGMENTS = 1_000_000

Point = tuple[float, float, float]


@dataclass(slots=True)
class Chain:
    """Feed moves without a rapid or a dwell between them, which become one contour.

    Args:
        points: Coordinates x, y, z of the start point and of each move's end point [m].
        line: First line of the file.
        speeds: Speed of each move [m/s].
        tolerances: Corner tolerance of each move [m].
        lines: Line of each move in the file.
        arcs: For each arc: index of the move, tangent and normal at its start, curvature [1/m],
            length [m].
        events: For each event: number of moves before it, name and value.
    """

    points: array[float]
    line: int
    speeds: array[float] = field(default_factory=lambda: array("d"))
    tolerances: array[float] = field(default_factory=lambda: array("d"))
    lines: array[int] = field(default_factory=lambda: array("l"))
    arcs: list[tuple[int, Point, Point, float, float]] = field(default_factory=list)
    events: list[tuple[int, str, Value]] = field(default_factory=list)


class Draft:
    """A program under construction: the tool position and all moves so far.

    Attributes:
        moves: Completed moves and events.
        last: Position of the tool [m].
        chain: The feed moves since the last rapid or dwell, if any.
        rapid: Coordinates of the current rapid [m], if any.
        begun: Whether there has been a feed move.
        across: Whether an arc lies in a plane other than XY.
        segments: Number of segments of helices and further turns.
    """

    def __init__(self) -> None:
        self.moves: list[Chain | array[float] | Event | Dwell] = []
        self.last: Point = (0.0, 0.0, 0.0)
        self.chain: Chain | None = None
        self.rapid: array[float] | None = None
        self.begun = False
        self.across = False
        self.segments = 0

    def feed(self, x: float, y: float, z: float, speed: float, tolerance: float, line: int) -> None:
        """Add a straight feed move; ignored if the tool is already at its end point.

        Args:
            x: Coordinate x of the end point [m].
            y: Coordinate y of the end point [m].
            z: Coordinate z of the end point [m].
            speed: Speed [m/s], NaN if not given.
            tolerance: Corner tolerance [m], NaN if not given.
            line: Number of the line in the file.
        """
        px, py, pz = self.last
        if (x - px) ** 2 + (y - py) ** 2 + (z - pz) ** 2 <= NEAR:
            return
        chain = self.chain if self.chain is not None else self._begin(line)
        chain.points.extend((x, y, z))
        chain.speeds.append(speed)
        chain.tolerances.append(tolerance)
        chain.lines.append(line)
        self.last = (x, y, z)

    def bend(
        self,
        piece: Piece,
        axes: tuple[int, int, int],
        speed: float,
        tolerance: float,
        line: int,
    ) -> None:
        """Add a feed move along an arc from the tool's position.

        Args:
            piece: The arc.
            axes: Indices of the axes of the arc's plane, and of the axis normal to it.
            speed: Speed [m/s], NaN if not given.
            tolerance: Corner tolerance [m], NaN if not given.
            line: Number of the line in the file.
        """
        chain = self.chain if self.chain is not None else self._begin(line)
        a, b, _ = axes
        end, tangent, normal = list(self.last), [0.0] * 3, [0.0] * 3
        end[a], end[b] = piece.end
        tangent[a], tangent[b] = piece.tangent
        normal[a], normal[b] = piece.normal
        chain.arcs.append(
            (len(chain.speeds), _point(tangent), _point(normal), piece.curvature, piece.length)
        )
        chain.points.extend(end)
        chain.speeds.append(speed)
        chain.tolerances.append(tolerance)
        chain.lines.append(line)
        self.last = _point(end)
        self.across = self.across or 2 in (a, b)

    def room_for(self, segments: int) -> None:
        """Count segments of helices and of further turns before they are made.

        Raises:
            Fault: There are more than `MOST_SEGMENTS`.
        """
        self.segments += segments
        if self.segments > MOST_SEGMENTS:
            raise Fault(
                f"helices and further turns of more than {MOST_SEGMENTS} segments together: "
                "program fewer turns P, or give a wider chord tolerance"
            )

    def go(self, x: float, y: float, z: float) -> None:
        """Add a rapid move to a point; before the first contour only the position is stored."""
        px, py, pz = self.last
        if (x - px) ** 2 + (y - py) ** 2 + (z - pz) ** 2 <= NEAR:
            return
        self._close()
        if self.begun:
            if self.rapid is None:
                self.rapid = array("d", self.last)
            self.rapid.extend((x, y, z))
        self.last = (x, y, z)

    def event(self, name: str, value: Value) -> None:
        """Add an event: on the current contour, or at the position where the tool rests."""
        if self.chain is not None:
            self.chain.events.append((len(self.chain.speeds), name, value))
        else:
            self._flush()
            self.moves.append(Event(name=name, value=value))

    def rest(self) -> None:
        """End the current contour and the current rapid."""
        self._close()
        self._flush()

    def dwell(self, duration: float) -> None:
        """Add a dwell of a duration [s]; 0 only ends the current contour and rapid."""
        self.rest()
        if duration > 0:
            self.moves.append(Dwell(duration=duration))

    def program(self, source: str, notes: tuple[str, ...]) -> Program:
        """The program of all moves, in the plane if all moves are in z = 0.

        Args:
            source: Name of the file.
            notes: Sentences for the user.

        Raises:
            InvalidInput: There is no contour, or a contour makes no path.
        """
        self.rest()
        if not self.begun:
            raise InvalidInput(
                f"{source} has no contour to follow: none of its lines moves the tool by G1, G2 or "
                "G3."
            )
        dimension = 3 if self.across or self._leaves_the_plane() else 2
        return Program(
            moves=tuple(_move(x, dimension, source) for x in self.moves),
            source=source,
            notes=notes,
        )

    def _begin(self, line: int) -> Chain:
        """Start a contour at the tool's position."""
        self._flush()
        self.begun = True
        self.chain = Chain(points=array("d", self.last), line=line)
        return self.chain

    def _close(self) -> None:
        """End the current contour."""
        if self.chain is not None:
            self.moves.append(self.chain)
            self.chain = None

    def _flush(self) -> None:
        """End the current rapid."""
        if self.rapid is not None:
            self.moves.append(self.rapid)
            self.rapid = None

    def _leaves_the_plane(self) -> bool:
        """Whether a point has a z other than zero."""
        for x in self.moves:
            if isinstance(x, Chain | array):
                points = np.frombuffer(x.points if isinstance(x, Chain) else x)
                if (np.abs(points[2::3]) > FLAT).any():
                    return True
        return False


def _point(values: list[float]) -> Point:
    return (values[0], values[1], values[2])


def _move(x: Chain | array[float] | Event | Dwell, dimension: int, source: str) -> Move:
    """The move of a program: a contour, a rapid, an event or a dwell."""
    if isinstance(x, Chain):
        return _contour(x, dimension, source)
    if isinstance(x, array):
        return Rapid(path=_path(x, dimension))
    return x


def _contour(chain: Chain, dimension: int, source: str) -> Contour:
    """The contour of a chain of feed moves.

    Raises:
        InvalidInput: The moves make no path; names the line.
    """
    try:
        path = _path(chain.points, dimension, chain)
    except InvalidInput as error:
        line = chain.lines[error.index] if error.index is not None else chain.line
        raise InvalidInput(f"{source}, line {line}: {error}", index=line - 1) from None
    events = tuple(
        Event(name=name, value=value, s=float(path.breaks[i])) for i, name, value in chain.events
    )
    return Contour(path=path, name=f"line {chain.line}", events=events, keep_start=True)


def _path(points: array[float], dimension: int, chain: Chain | None = None) -> Path:
    """The path through the points, with the chain's arcs; without a chain all straight."""
    vertices = np.frombuffer(points).reshape(-1, 3)[:, :dimension]
    if chain is None:
        return Path(segments=Segments.lines(vertices))
    steps = np.diff(vertices, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    # A full circle ends where it starts.
    tangents = steps / np.where(lengths > 0, lengths, 1.0)[:, None]
    normals, curvatures = np.zeros_like(steps), np.zeros(len(steps))
    for i, tangent, normal, curvature, length in chain.arcs:
        tangents[i], normals[i] = tangent[:dimension], normal[:dimension]
        curvatures[i], lengths[i] = curvature, length
    return Path(
        segments=Segments(
            starts=vertices[:-1],
            tangents=tangents,
            normals=normals,
            curvatures=curvatures,
            lengths=lengths,
            speeds=np.frombuffer(chain.speeds),
            tolerances=np.frombuffer(chain.tolerances),
        )
    )
