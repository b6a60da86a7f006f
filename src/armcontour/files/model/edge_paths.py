"""Paths along chains of edges: lines and circles are exact, other curves are fitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import radians

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.files.model.edge_chains import Chain, Link
from armcontour.files.model.edge_rules import CIRCLE, LINE
from armcontour.files.model.tables import Conic
from armcontour.geometry import Arc, Path, Segments
from armcontour.geometry.primitives import tabulate
from armcontour.geometry.rounding.tangent_repair import repair_tangents
from armcontour.geometry.segments import REPEATED_POINT
from armcontour.geometry.spline import fit_spline, interpolate

# Curves that meet at a smaller angle are tangent, although rounded coordinates turn them [rad].
TANGENT_ANGLE = radians(0.1)
# Number of intervals per edge with which a fit begins.
FIRST_INTERVALS = 8
# Fractions of an interval at which a fit is compared with the curve.
CHECKED = (0.25, 0.5, 0.75)
# Shares of the tolerance for the spline through points of the curve, and for the transitions that
# draw the spline.
SPLINE_SHARE = 0.4
DRAWING_SHARE = 0.5
# Largest number of points of a spline.
MAX_POINTS = 100_000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LinkPlaces:
    """Where a link lies on its path.

    Args:
        s: Arc lengths on the path [m], increasing, (n,).
        v: Fractions of the link there, from 0 to 1, (n,).
    """

    s: FloatArray
    v: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EdgePath:
    """The path of a chain, without tool orientation.

    Args:
        chain: The chain.
        path: The path, in the coordinates of the model.
        places: Where each link lies on the path.
    """

    chain: Chain
    path: Path
    places: tuple[LinkPlaces, ...]

    def locate(self, s: FloatArray) -> tuple[IntArray, FloatArray]:
        """Return the link and the fraction of the link that are nearest to points of the path.

        - `s`: arc lengths [m], (n,).
        """
        ends = np.array([x.s[-1] for x in self.places])
        which = np.minimum(np.searchsorted(ends, s, side="right"), len(ends) - 1)
        points = self.path(s)
        v = np.empty(len(s))
        for k in np.unique(which).tolist():
            on = which == k
            estimate = np.interp(s[on], self.places[k].s, self.places[k].v)
            v[on] = self.chain.links[k].project(points[on], estimate)
        return which, v


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Piece:
    """Segments of consecutive links, with the vertices at which known fractions lie."""

    segments: Segments
    vertices: list[IntArray]
    fractions: list[FloatArray]


def make_path(chain: Chain, tolerance: float, repair: float) -> EdgePath:
    """Return the path of a chain.

    Args:
        chain: The chain.
        tolerance: Largest distance between the path and curves other than lines and circles [m].
        repair: Largest rounding error of coordinates, which must not make corners [m].
    """
    pieces = []
    for run in _runs(chain):
        if _is_exact(chain.links[run[0]]):
            pieces.append(_exact_piece(chain, run[0]))
        else:
            pieces.append(_fitted_piece(chain, run, tolerance))
    vertices: list[IntArray] = []
    first = 0
    for piece in pieces:
        vertices += [first + x for x in piece.vertices]
        first += len(piece.segments)
    path = Path(segments=Segments.join([x.segments for x in pieces]))
    at = [path.breaks[x] for x in vertices]
    repaired = repair_tangents(path, repair) if repair > 0 else None
    if repaired is not None:
        path = repaired.path
        at = [repaired.place(x) for x in at]
    fractions = [v for piece in pieces for v in piece.fractions]
    places = [LinkPlaces(s=s, v=v) for s, v in zip(at, fractions, strict=True)]
    return EdgePath(chain=chain, path=path, places=tuple(places))


def _is_exact(link: Link) -> bool:
    """Return whether the edge becomes a line or an arc."""
    return link.edge.kind in (LINE, CIRCLE)


def _runs(chain: Chain) -> list[list[int]]:
    """Return the links of each piece: single lines and circles, and tangent curves together."""
    runs: list[list[int]] = []
    for k, link in enumerate(chain.links):
        tangent = k > 0 and chain.turns[k - 1] <= TANGENT_ANGLE
        if tangent and not _is_exact(link) and not _is_exact(chain.links[k - 1]):
            runs[-1].append(k)
        else:
            runs.append([k])
    return runs


def _exact_piece(chain: Chain, k: int) -> _Piece:
    """Return a line or an arc between the corners of a chain."""
    link = chain.links[k]
    start = chain.corners[k]
    end = chain.corners[k + 1]
    if link.edge.kind == LINE:
        segments = Segments.lines(np.stack([start, end]))
    else:
        segments = tabulate([_arc(link, start, end)])
    count = len(segments)
    return _Piece(
        segments=segments,
        vertices=[np.array([0, count])],
        fractions=[np.array([0.0, 1.0])],
    )


def _arc(link: Link, start: FloatArray, end: FloatArray) -> Arc:
    """Return the arc of a link, whose ends are moved to the corners of its chain."""
    drawn = link.points(np.array([0.0, 0.5, 1.0]))
    moved = max(np.linalg.norm(drawn[0] - start), np.linalg.norm(drawn[2] - end))
    if moved > REPEATED_POINT:
        return Arc.through(start.tolist(), drawn[1].tolist(), end.tolist())
    slope = link.slopes(np.array([0.0]))[0]
    circle = link.edge.curve
    assert isinstance(circle, Conic)
    normal = np.cross(start - circle.center, slope)
    angle = min(abs(circle.end - circle.begin), 2 * np.pi)
    return Arc(start.tolist(), circle.center.tolist(), angle, normal=normal.tolist())


def _fitted_piece(chain: Chain, run: Sequence[int], tolerance: float) -> _Piece:
    """Return the transitions along tangent curves."""
    links = [chain.links[k] for k in run]
    whole = len(run) == len(chain.links) and chain.turns[-1] <= TANGENT_ANGLE
    ends = None if whole else (_tangent(chain, run[0], 0.0), _tangent(chain, run[-1], 1.0))
    v = [np.linspace(0.0, 1.0, FIRST_INTERVALS + 1) for _ in run]
    # Where two ends are not quite the same point, the path goes through their mean.
    allowed = [SPLINE_SHARE * tolerance + _moved(chain, k) for k in run]
    while True:
        points = _points(chain, run, v)
        errors = _spline_errors(links, v, points, whole, ends)
        wide = [x > y for x, y in zip(errors, allowed, strict=True)]
        if not any(x.any() for x in wide):
            break
        v = [np.sort(np.append(x, (x[:-1] + x[1:])[y] / 2)) for x, y in zip(v, wide, strict=True)]
        if sum(map(len, v)) > MAX_POINTS:
            raise InvalidInput(
                f"Edge {links[0].index + 1} would need more than {MAX_POINTS} points for the "
                f"tolerance of {tolerance * 1e3:g} mm. Specify a larger chord_tolerance."
            )
    drawing = DRAWING_SHARE * tolerance
    segments, at_points = fit_spline(points, drawing, whole, ends=ends or "not-a-knot")
    counts = np.cumsum([0, *(len(x) - 1 for x in v)])
    vertices = [at_points[a : b + 1] for a, b in zip(counts[:-1], counts[1:], strict=True)]
    return _Piece(segments=segments, vertices=vertices, fractions=v)


def _moved(chain: Chain, k: int) -> float:
    """Return the largest distance between the ends of link k and the corners of its chain [m]."""
    ends = chain.links[k].points(np.array([0.0, 1.0]))
    return float(np.linalg.norm(ends - chain.corners[k : k + 2], axis=1).max())


def _tangent(chain: Chain, k: int, v: float) -> FloatArray:
    """Return the tangent at the start (v = 0) or the end (v = 1) of link k.

    A tangent line or circle beside the link decides, so that the path is exactly tangent there.
    """
    link = chain.links[k]
    beside = k - 1 if v == 0.0 else k + 1
    turn = chain.turns[k - 1] if v == 0.0 else chain.turns[k]
    count = len(chain.links)
    if count > 1 and turn <= TANGENT_ANGLE and _is_exact(chain.links[beside % count]):
        piece = _exact_piece(chain, beside % count).segments
        return np.asarray(piece.end_tangents[-1] if v == 0.0 else piece.tangents[0])
    return np.asarray(link.tangents(np.array([v]))[0])


def _points(chain: Chain, run: Sequence[int], v: Sequence[FloatArray]) -> FloatArray:
    """Return the points of a run at fractions of its links, with the corners of the chain [m]."""
    points = []
    for k, fractions in zip(run, v, strict=True):
        own = chain.links[k].points(fractions)
        own[0] = chain.corners[k]
        own[-1] = chain.corners[k + 1]
        points.append(own if k == run[0] else own[1:])
    return np.concatenate(points)


def _spline_errors(
    links: Sequence[Link],
    v: Sequence[FloatArray],
    points: FloatArray,
    closed: bool,
    ends: tuple[FloatArray, FloatArray] | None,
) -> list[FloatArray]:
    """Return the distances of links from the spline through points, for each interval [m].

    The spline is that of `fit_spline`.
    """
    spline = interpolate(points, closed, ends=ends or "not-a-knot")
    steps = np.diff(spline.x)
    slope = spline.derivative()
    errors = []
    first = 0
    for link, fractions in zip(links, v, strict=True):
        count = len(fractions) - 1
        begin = spline.x[first : first + count]
        width = steps[first : first + count]
        worst = np.zeros(count)
        for share in CHECKED:
            target = link.points(fractions[:-1] + share * np.diff(fractions))
            x = begin + share * width
            for _ in range(2):
                d = slope(x)
                x = x + np.sum((target - spline(x)) * d, axis=1) / np.sum(d * d, axis=1)
            worst = np.maximum(worst, np.linalg.norm(target - spline(x), axis=1))
        errors.append(worst)
        first += count
    return errors
