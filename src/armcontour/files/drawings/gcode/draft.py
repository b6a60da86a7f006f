"""Moves as they are read, and the `Program` that they make."""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from armcontour.core.errors import InvalidInput
from armcontour.files.drawings.gcode.arcs import ArcPart
from armcontour.files.drawings.gcode.faults import Fault
from armcontour.geometry import Path
from armcontour.geometry.segments import REPEATED_POINT, Segments
from armcontour.program import Contour, Dwell, Event, Program, Rapid
from armcontour.program.moves import Move, Value

NEAR = REPEATED_POINT**2
# What adding up relative moves leaves of a z that is zero [m].
FLAT = 1e-12
# One line can ask for any number of turns; more segments than this fit no planner's memory.
MOST_SEGMENTS = 1_000_000

Point = tuple[float, float, float]
# Speed [m/s], largest corner error [m] and line of a feed move; NaN where the file gives none.
Feed = tuple[float, float, int]


@dataclass(slots=True)
class Chain:
    """Feed moves without a stop: their points, flat, and what belongs to every one of them."""

    points: array[float]
    line: int
    layer: str
    speeds: array[float] = field(default_factory=lambda: array("d"))
    tolerances: array[float] = field(default_factory=lambda: array("d"))
    lines: array[int] = field(default_factory=lambda: array("l"))
    arcs: list[tuple[int, Point, Point, float, float]] = field(default_factory=list)
    events: list[tuple[int, str, Value]] = field(default_factory=list)


class Draft:
    """A program in the making."""

    def __init__(self) -> None:
        self.moves: list[Chain | array[float] | Event | Dwell] = []
        self.last: Point = (0.0, 0.0, 0.0)
        self.chain: Chain | None = None
        self.rapid: array[float] | None = None
        self.begun = False
        self.across = False
        self.segments = 0
        self.layer, self.layers, self.typed = "", 0, False

    def set_layer(self, number: str | None, kind: str | None) -> None:
        """A slicer's comment: a layer or a type begins, and with it another contour.

        Contours are on the layers of their types; in a file without types, of their layers.

        Args:
            number: The layer's number, None if the comment has none.
            kind: The type, None for a layer.
        """
        name = self.layer
        if kind is not None:
            name, self.typed = "".join(filter(str.isprintable, kind)).strip(), True
        else:
            self.layers += 1
            if not self.typed:
                name = f"layer {self.layers if number is None else number}"
        if kind is None or name != self.layer:
            self.rest()
        self.layer = name

    def feed(self, x: float, y: float, z: float, feed: Feed) -> None:
        """A straight feed move; none where the tool is there already."""
        px, py, pz = self.last
        if (x - px) ** 2 + (y - py) ** 2 + (z - pz) ** 2 <= NEAR:
            return
        self._extend(feed, (x, y, z))

    def bend(self, piece: ArcPart, axes: tuple[int, int, int], feed: Feed) -> None:
        """An arc in the plane of the first two of `axes`."""
        a, b, _ = axes
        end, tangent, normal = list(self.last), [0.0] * 3, [0.0] * 3
        end[a], end[b] = piece.end
        tangent[a], tangent[b] = piece.tangent
        normal[a], normal[b] = piece.normal
        chain = self._extend(feed, _point(end))
        number = len(chain.speeds) - 1
        arc = (number, _point(tangent), _point(normal), piece.curvature, piece.length)
        chain.arcs.append(arc)
        self.across = self.across or 2 in (a, b)

    def room_for(self, segments: int) -> None:
        """Counts segments of helices and of further turns.

        Raises:
            Fault: More than fit.
        """
        self.segments += segments
        if self.segments > MOST_SEGMENTS:
            raise Fault(
                f"helices and further turns of more than {MOST_SEGMENTS} segments together: ask "
                "for fewer turns P, or for a wider chord tolerance"
            )

    def go(self, x: float, y: float, z: float) -> None:
        """A rapid move. Where it comes from is not known before the first contour."""
        px, py, pz = self.last
        if (x - px) ** 2 + (y - py) ** 2 + (z - pz) ** 2 <= NEAR:
            return
        self._close()
        if self.begun:
            if self.rapid is None:
                self.rapid = array("d", self.last)
            self.rapid.extend((x, y, z))
        self.last = (x, y, z)

    def resume_at(self, point: Sequence[float]) -> None:
        """The tool is at a point to which the file does not say how it came."""
        self.rest()
        self.last = _point(point)

    def event(self, name: str, value: Value) -> None:
        """Something is switched: on the open contour, or where the tool stands."""
        if self.chain is not None:
            self.chain.events.append((len(self.chain.speeds), name, value))
        else:
            self._flush()
            self.moves.append(Event(name=name, value=value))

    def rest(self) -> None:
        """The tool comes to rest: what is open ends."""
        self._close()
        self._flush()

    def dwell(self, duration: float) -> None:
        """The tool rests for a time [s]; 0 only brings it to rest."""
        self.rest()
        if duration > 0:
            self.moves.append(Dwell(duration=duration))

    def program(self, source: str, notes: tuple[str, ...]) -> Program:
        """What was drafted.

        Args:
            source: Name of the file.
            notes: Sentences on what was left out.

        Raises:
            InvalidInput: No contour, or one that makes no path.
        """
        self.rest()
        if not self.begun:
            raise InvalidInput(
                f"{source} has no contour to follow: none of its lines moves the tool by G1, G2 or "
                "G3."
            )
        dimension = 3 if self.across or self._leaves_the_plane() else 2
        counts: Counter[int] = Counter()
        moves: list[Move] = []
        for x in self.moves:
            if isinstance(x, Chain):
                counts[x.line] += 1
                moves.append(_contour(x, dimension, counts[x.line], source))
            elif isinstance(x, array):
                moves.append(Rapid(path=_path(x, dimension)))
            else:
                moves.append(x)
        return Program(moves=tuple(moves), source=source, notes=notes)

    def _extend(self, feed: Feed, end: Point) -> Chain:
        """Lead the open contour, or a new one, to a point."""
        speed, tolerance, line = feed
        chain = self.chain
        if chain is None:
            self._flush()
            self.begun = True
            chain = self.chain = Chain(points=array("d", self.last), line=line, layer=self.layer)
        chain.points.extend(end)
        chain.speeds.append(speed)
        chain.tolerances.append(tolerance)
        chain.lines.append(line)
        self.last = end
        return chain

    def _close(self) -> None:
        if self.chain is not None:
            self.moves.append(self.chain)
            self.chain = None

    def _flush(self) -> None:
        if self.rapid is not None:
            self.moves.append(self.rapid)
            self.rapid = None

    def _leaves_the_plane(self) -> bool:
        for x in self.moves:
            if isinstance(x, Chain | array):
                points = np.frombuffer(x.points if isinstance(x, Chain) else x)
                if (np.abs(points[2::3]) > FLAT).any():
                    return True
        return False


def _point(values: Sequence[float]) -> Point:
    return (values[0], values[1], values[2])


def _contour(chain: Chain, dimension: int, count: int, source: str) -> Contour:
    """The contour of feed moves, named after its line, which may have started others before."""
    try:
        path = _path(chain.points, dimension, chain)
    except InvalidInput as error:
        line = chain.lines[error.index] if error.index is not None else chain.line
        raise InvalidInput(f"{source}, line {line}: {error}", index=line - 1) from None
    events = tuple(
        Event(name=name, value=value, s=float(path.breaks[i])) for i, name, value in chain.events
    )
    name = f"line {chain.line}" if count == 1 else f"line {chain.line} ({count})"
    return Contour(path=path, name=name, layer=chain.layer, events=events, keep_start=True)


def _path(points: array[float], dimension: int, chain: Chain | None = None) -> Path:
    """Straight segments between the points, and the chain's arcs."""
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
