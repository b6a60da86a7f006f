"""What SVG's shapes are made of, and what becomes of it under a transform: lines and arcs."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from armcontour._checks import FloatArray
from armcontour.geometry import Path
from armcontour.geometry.curves import arcs_of
from armcontour.geometry.path import REPEATED_POINT
from armcontour.io.drawings._svg_units import Affine

# An ellipse whose axes differ by less than this part of the chord tolerance is a circle.
SAME_AXES = 0.01
# From its chord, an arc of more than this [rad] is not known well; it is cut in two.
WELL_KNOWN = 1.5 * math.pi
# Ends of a subpath that meet within this part of its last stroke are one point.
SMALL_GAP = 0.1
# What a block of segments holds, in the order of the arrays of a path.
ARRAYS = ("starts", "tangents", "inwards", "curvatures", "lengths")


@dataclass(frozen=True, slots=True, eq=False)
class Straight:
    """Straight lines through `points`, (n, 2)."""

    points: FloatArray

    @property
    def reach(self) -> FloatArray:
        """Points between which it lies."""
        return self.points


@dataclass(frozen=True, slots=True, eq=False)
class Bend:
    """A cubic Bézier curve with the control points `points`, (4, 2)."""

    points: FloatArray

    @property
    def reach(self) -> FloatArray:
        """Points between which it lies."""
        return self.points


@dataclass(frozen=True, slots=True, eq=False)
class Round:
    """Part of an ellipse: `center + axes @ (cos, sin)`, from `begin` on by `turn` [rad].

    `ends`, (2, 2), are its ends as they are written, without the rounding of the rest.
    """

    center: FloatArray
    axes: FloatArray
    begin: float
    turn: float
    ends: FloatArray

    def at(self, share: FloatArray, order: int = 0) -> FloatArray:
        """Points (order 0), or derivatives by the share of the turn (order 1), (n, 2)."""
        off = self.ends - self._on_ellipse(np.array([0.0, 1.0]))
        spread = off[1] - off[0]
        added = off[0] + share[:, None] * spread if order == 0 else spread
        return np.asarray(self._on_ellipse(share, order) + added)

    def _on_ellipse(self, share: FloatArray, order: int = 0) -> FloatArray:
        angle = self.begin + share * self.turn + order * np.pi / 2
        circle = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        moved = circle @ self.axes.T * self.turn**order
        return np.asarray(moved if order else moved + self.center)

    @property
    def reach(self) -> FloatArray:
        """Points from which it is not far."""
        return self.at(np.linspace(0.0, 1.0, 9))

    @property
    def rise(self) -> float:
        """Largest distance that it can have from its chord."""
        return float(np.abs(self.axes).max() * min(self.turn**2 / 4, 4.0))

    @property
    def off_circle(self) -> float:
        """By how much the longest radius is longer than the shortest."""
        long, short = np.linalg.svd(self.axes, compute_uv=False)
        return float(long - short)


Stroke = Straight | Bend | Round


@dataclass(frozen=True, slots=True, eq=False)
class Subpath:
    """Strokes that follow each other; `closed` if the last is to end where the first begins."""

    strokes: Sequence[Stroke]
    closed: bool


def round_between(
    first: FloatArray,
    last: FloatArray,
    radii: tuple[float, float],
    tilt: float,
    *,
    large: bool,
    sweep: bool,
) -> Round:
    """The elliptical arc between two points that SVG's command A means.

    Radii that are too small are made larger until the ellipse reaches both points.

    Args:
        first: Where it begins.
        last: Where it ends, which is somewhere else.
        radii: Of the ellipse, above zero.
        tilt: By which it is turned [rad].
        large: Whether to take the way of more than half a turn.
        sweep: Whether the angle grows.
    """
    c, s = math.cos(tilt), math.sin(tilt)
    axes = np.array([[c, -s], [s, c]]) * radii
    # In coordinates in which the ellipse is a unit circle, from the first point.
    step = np.array([[c, s], [-s, c]]) @ (last - first) / radii
    half = math.hypot(*step) / 2
    if half > 1:
        axes, step, half = axes * half, step / half, 1.0
    across = np.array([-step[1], step[0]]) / (2 * half)
    side = 1.0 if sweep != large else -1.0
    center = step / 2 + side * math.sqrt((1 - half) * (1 + half)) * across
    turn = 2 * math.asin(half)
    turn = 2 * math.pi - turn if large else turn
    begin = math.atan2(-center[1], -center[0])
    turn = turn if sweep else -turn
    return Round(first + axes @ center, axes, begin, turn, np.stack([first, last]))


def ellipse(center: tuple[float, float], radii: tuple[float, float]) -> Round:
    """A whole ellipse as SVG draws it, from the right."""
    start = np.array([center[0] + radii[0], center[1]])
    return Round(np.array(center), np.diag(radii), 0.0, 2 * math.pi, np.stack([start, start]))


def mapped(subpath: Subpath, to: Affine, tolerance: float, join: float) -> Path | None:
    """The path of a subpath under a transform, in metres; None if it has no length.

    Lines stay lines. Arcs of circles that stay circles stay arcs; other curves become tangent arcs.

    Args:
        subpath: In the coordinates of its element.
        to: From those to metres.
        tolerance: Largest distance between a curve and its arcs [m].
        join: A closed subpath whose ends are nearer than this has them in one point [m].

    Raises:
        InvalidInput: A curve that is too large for the tolerance.
    """
    strokes = [_moved(x, to) for x in subpath.strokes]
    strokes = _closed(strokes, join) if subpath.closed else strokes
    blocks: list[tuple[FloatArray, ...]] = []
    tip = _ends(strokes[0])[0]
    for run in _runs(strokes):
        block = _block(run, tip, tolerance)
        if block is not None:
            blocks.append(block[:-1])
            tip = block[-1]
    if not blocks:
        return None
    starts, tangents, inwards, curvatures, lengths = (
        np.concatenate(x) for x in zip(*blocks, strict=True)
    )
    return Path(
        starts=starts, tangents=tangents, inwards=inwards, curvatures=curvatures, lengths=lengths
    )


def _moved(stroke: Stroke, to: Affine) -> Stroke:
    if isinstance(stroke, Round):
        ends = to(stroke.ends)
        return Round(to(stroke.center), to.turn @ stroke.axes, stroke.begin, stroke.turn, ends)
    return type(stroke)(to(stroke.points))


def _ends(stroke: Stroke) -> FloatArray:
    return stroke.ends if isinstance(stroke, Round) else stroke.points[[0, -1]]


def _closed(strokes: list[Stroke], join: float) -> list[Stroke]:
    """Strokes whose last end is the first one: moved there if it is near, else by a line."""
    start, last = _ends(strokes[0])[0], strokes[-1]
    end = _ends(last)[1]
    gap = math.dist(start, end)
    before = last.points[-2] if isinstance(last, Straight) else _ends(last)[0]
    if gap > min(join, SMALL_GAP * math.dist(before, end)):
        return [*strokes, Straight(np.stack([end, start]))]
    if isinstance(last, Round):
        ends = np.stack([last.ends[0], start])
        return [*strokes[:-1], dataclasses.replace(last, ends=ends)]
    points = last.points.copy()
    if isinstance(last, Bend):
        points[-2] += start - end
    points[-1] = start
    return [*strokes[:-1], type(last)(points)]


def _runs(strokes: Sequence[Stroke]) -> Iterator[list[Stroke]]:
    """Strokes in groups that are drawn at once: lines in a row, and Béziers in a row."""
    group: list[Stroke] = []
    for x in strokes:
        if group and (isinstance(x, Round) or type(x) is not type(group[-1])):
            yield group
            group = []
        group.append(x)
    yield group


def _block(
    run: Sequence[Stroke], tip: FloatArray, tolerance: float
) -> tuple[FloatArray, ...] | None:
    """Arrays of the segments of a run and its last point; None if it is shorter than a point."""
    first = run[0]
    if isinstance(first, Round) and first.rise > REPEATED_POINT:
        return _elliptical(first, tip, tolerance)
    if isinstance(first, Bend):
        return _bent(np.stack([x.points for x in run if isinstance(x, Bend)]), tip, tolerance)
    return _lines(np.concatenate([x.ends if isinstance(x, Round) else x.points for x in run]), tip)


def _lines(points: FloatArray, tip: FloatArray) -> tuple[FloatArray, ...] | None:
    points[0] = tip
    if (np.linalg.norm(points - tip, axis=1) <= REPEATED_POINT).all():
        return None
    steps = np.diff(points, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    if (lengths <= REPEATED_POINT).any():
        return _arrays(Path.polyline(points))
    zero = np.zeros_like(steps)
    return points[:-1], steps / lengths[:, None], zero, zero[:, 0], lengths, points[-1]


def _bent(controls: FloatArray, tip: FloatArray, tolerance: float) -> tuple[FloatArray, ...] | None:
    """Of Bézier curves in a row, with control points (n, 4, 2)."""
    controls[0, 0] = tip
    controls = controls[np.abs(controls - controls[:, :1]).max(axis=(1, 2)) > REPEATED_POINT]
    if not len(controls):
        return None
    controls[0, 0], controls[1:, 0] = tip, controls[:-1, 3]
    return _arrays(arcs_of(_beziers(controls), np.arange(len(controls) + 1.0), tolerance))


def _elliptical(arc: Round, tip: FloatArray, tolerance: float) -> tuple[FloatArray, ...]:
    moved = dataclasses.replace(arc, ends=np.stack([tip, arc.ends[1]]))
    if moved.off_circle <= SAME_AXES * tolerance:
        return _circular(moved)
    return _arrays(arcs_of(moved.at, [0.0, 1.0], tolerance))


def _arrays(path: Path) -> tuple[FloatArray, ...]:
    return (*(getattr(path, x) for x in ARRAYS), path.vertices[-1])


def _beziers(controls: FloatArray) -> Callable[[FloatArray, int], FloatArray]:
    """Cubic Béziers in a row, the k-th from t = k to k + 1; controls (n, 4, 2)."""
    steps = np.diff(controls, axis=1)

    def curve(t: FloatArray, order: int) -> FloatArray:
        k = np.clip(np.floor(t).astype(np.intp), 0, len(controls) - 1)
        u = (t - k)[:, None]
        v = 1 - u
        if order == 0:
            p = controls[k]
            return np.asarray(
                v**3 * p[:, 0] + 3 * v * v * u * p[:, 1] + 3 * v * u * u * p[:, 2] + u**3 * p[:, 3]
            )
        d = steps[k]
        return np.asarray(3 * (v * v * d[:, 0] + 2 * v * u * d[:, 1] + u * u * d[:, 2]))

    return curve


def _circular(arc: Round) -> tuple[FloatArray, ...]:
    """Arrays of the arc of a circle through its ends, and its last point."""
    turn = arc.turn * math.copysign(1.0, float(np.linalg.det(arc.axes)))
    p0, p1 = arc.ends
    if math.dist(p0, p1) <= REPEATED_POINT and abs(turn) > math.pi:
        center = arc.center
        radius = math.dist(p0, center)
        inward = (center - p0) / radius
        tangent = np.array([inward[1], -inward[0]]) * math.copysign(1.0, turn)
        one = (p0, tangent, inward, 1 / radius, radius * 2 * math.pi)
        return (*(np.array([x]) for x in one), p0)
    parts = 2 if abs(turn) > WELL_KNOWN else 1
    points = arc.at(np.linspace(0.0, 1.0, parts + 1))
    chords = np.diff(points, axis=0)
    half = turn / parts / 2
    size = np.linalg.norm(chords, axis=1)
    unit = chords / size[:, None]
    c, s = math.cos(half), math.sin(half)
    tangents = unit @ np.array([[c, -s], [s, c]])
    inwards = np.stack([-tangents[:, 1], tangents[:, 0]], axis=1) * math.copysign(1.0, turn)
    curvatures = 2 * abs(s) / size
    return points[:-1], tangents, inwards, curvatures, 2 * abs(half) / curvatures, points[-1]
