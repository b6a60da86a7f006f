"""Rounded corners beside arcs, measured from points and angles, without the package's geometry."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

import armcontour as ac
from soak import Outcome

SAMPLES = np.linspace(0.0, 1.0, 41)
ROUNDING = 1e-12
TANGENT = 1e-9
SAME_POINT = 1e-9
# Corners that reverse up to this angle may have too little room [rad].
NEARLY_BACK = 1e-3


@dataclass(frozen=True)
class Piece:
    """A line or an arc from its own start: point, tangent, normal, curvature, length."""

    start: np.ndarray
    tangent: np.ndarray
    normal: np.ndarray
    bend: float
    length: float

    def at(self, u):
        """Return the points at distances u from the start."""
        if self.bend == 0:
            return self.start + np.multiply.outer(u, self.tangent)
        angle = np.asarray(u) * self.bend
        r = 1 / self.bend
        # 1 - cos as a square, for arcs of a huge radius.
        across = 2 * r * np.sin(angle / 2) ** 2
        return (
            self.start
            + np.multiply.outer(r * np.sin(angle), self.tangent)
            + np.multiply.outer(across, self.normal)
        )

    def direction(self, u):
        """Return the tangent at a distance u from the start."""
        angle = u * self.bend
        return np.cos(angle) * self.tangent + np.sin(angle) * self.normal

    def distance(self, points):
        """Return the distances of points to the piece: its line or circle, or the nearer end."""
        v = points - self.start
        x, y = v @ self.tangent, v @ self.normal
        vectors = v - np.multiply.outer(x, self.tangent) - np.multiply.outer(y, self.normal)
        out = np.linalg.norm(vectors, axis=-1)
        ends = np.minimum(
            *(np.linalg.norm(points - self.at(u), axis=-1) for u in (0.0, self.length))
        )
        if self.bend == 0:
            flat = np.linalg.norm(v - np.multiply.outer(x, self.tangent), axis=-1)
            return np.where((x >= 0) & (x <= self.length), flat, ends)
        turned = np.arctan2(x, 1 / self.bend - y) % (2 * np.pi)
        power = self.bend * (x * x + y * y) - 2 * y
        radial = power / (1 + np.sqrt(np.maximum(1 + self.bend * power, 0.0)))
        inside = turned <= self.length * self.bend
        return np.where(inside, np.hypot(radial, out), ends)


@dataclass(frozen=True)
class Case:
    """One corner: two pieces that leave it, how much the path turns there, and what is allowed."""

    away: tuple[Piece, Piece]
    turn: float
    tolerance: float
    kind: str

    @property
    def path(self):
        """The path over the corner."""
        back, ahead = self.away
        begin = back.at(back.length)
        turned = Piece(
            start=begin,
            tangent=-back.direction(back.length),
            normal=_normal(back, back.length),
            bend=back.bend,
            length=back.length,
        )
        return ac.Path(segments=[_segment(turned), _segment(ahead)])


def _normal(piece, u):
    angle = u * piece.bend
    return np.cos(angle) * piece.normal - np.sin(angle) * piece.tangent


def _segment(piece):
    if piece.bend == 0:
        return ac.Line(start=piece.start.tolist(), end=piece.at(piece.length).tolist())
    center = (piece.start + piece.normal / piece.bend).tolist()
    angle = piece.bend * piece.length
    if len(piece.start) == 3:
        axis = np.cross(piece.tangent, piece.normal)
        return ac.Arc(start=piece.start.tolist(), center=center, angle=angle, normal=axis.tolist())
    side = piece.tangent[0] * piece.normal[1] - piece.tangent[1] * piece.normal[0]
    return ac.Arc(start=piece.start.tolist(), center=center, angle=float(np.sign(side)) * angle)


def draw(seed):
    """Draw a random corner with an arc on at least one side."""
    rng = np.random.default_rng((13, seed))
    kind = str(rng.choice(["any", "nearly tangent", "nearly back"], p=[0.6, 0.25, 0.15]))
    turn = {
        "any": rng.uniform(0.01, 3.1),
        "nearly tangent": 10 ** rng.uniform(-8, -2),
        "nearly back": np.pi - 10 ** rng.uniform(-7, -2),
    }[kind]
    arcs = int(rng.integers(1, 4))
    away = []
    for side, heading in ((1, np.pi), (2, turn * rng.choice([-1, 1]))):
        tangent = np.array([np.cos(heading), np.sin(heading)])
        bend = 0.0
        normal = np.zeros(2)
        length = 10 ** rng.uniform(-5, 0)
        if arcs & side:
            # Radii from tiny to large; arcs up to full circles.
            bend = 10 ** rng.uniform(-2, 4)
            normal = rng.choice([-1, 1]) * np.array([-tangent[1], tangent[0]])
            sweep = rng.uniform(3, 6.28) if rng.random() < 0.3 else 10 ** rng.uniform(-3, 0.5)
            length = sweep / bend
        away.append(Piece(np.zeros(2), tangent, normal, bend, length))
    if rng.random() < 0.4:
        kind += ", in space"
        away = [_lift(x) for x in away]
        if rng.random() < 0.5:
            kind += ", out of plane"
            twist = Rotation.from_rotvec(rng.uniform(-3, 3) * away[1].tangent)
            away[1] = _turned(away[1], twist)
        away = [_turned(x, Rotation.random(random_state=seed)) for x in away]
    return Case(tuple(away), turn, 10 ** rng.uniform(-6, -2), kind)


def _lift(piece):
    deeper = (np.append(x, 0.0) for x in (piece.start, piece.tangent, piece.normal))
    return Piece(*deeper, piece.bend, piece.length)


def _turned(piece, rotation):
    vectors = (rotation.apply(x) for x in (piece.start, piece.tangent, piece.normal))
    return Piece(*vectors, piece.bend, piece.length)


def judge(case):
    """Return what is wrong with the rounded corner, or "", and whether it is a full stop."""
    path = case.path
    rounded = ac.round_corners(path, tolerance=case.tolerance)
    (stopped,) = rounded.corners.stopped
    (reason,) = rounded.corners.reason
    if stopped:
        few = case.turn > np.pi - NEARLY_BACK and reason in ("no room", "turn-back")
        return "" if few else f"a full stop: {reason}", True
    table = rounded.segments
    columns = (table.starts, table.tangents, table.normals, table.curvatures, table.lengths)
    drawn = [Piece(*row) for row in zip(*columns, strict=True)]
    for a, b in zip(drawn, drawn[1:], strict=False):
        u = a.direction(a.length)
        v = b.tangent
        jump = 2 * np.arctan2(np.linalg.norm(u - v), np.linalg.norm(u + v))
        if jump > TANGENT:
            return f"tangents jump by {jump:.2g}", False
        if np.linalg.norm(a.at(a.length) - b.start) > SAME_POINT:
            return "a gap", False
    corner = case.away[0].start[None]
    allowed = case.tolerance + ROUNDING
    # A long arc returns to its corner, so only the rounded part counts.
    (begin,) = rounded.corners.start
    (end,) = rounded.corners.end
    middles = (rounded.breaks[1:] + rounded.breaks[:-1]) / 2
    blend = [x for x, s in zip(drawn, middles, strict=True) if begin < s < end]
    error = min(float(x.distance(corner)[0]) for x in blend)
    if error > allowed or abs(error - rounded.corners.error[0]) > ROUNDING + 1e-9 * error:
        return f"corner error {error:.12g}, reported {rounded.corners.error[0]:.12g}", False
    replaced = [(x, min(float(rounded.corners.tangent[0]), x.length)) for x in case.away]
    for name, one, other in (
        ("drawn", [(x, x.length) for x in drawn], case.away),
        ("coverage_error", [*replaced, *((x, x.length) for x in case.away)], drawn),
    ):
        points = np.concatenate([x.at(length * SAMPLES) for x, length in one])
        distance = np.min([x.distance(points) for x in other], axis=0).max()
        if distance > allowed:
            return f"{name} {distance:.12g} off, {case.tolerance:.12g} allowed", False
    return "", False


def run(seed: int) -> Outcome:
    """Round and judge the corner of a seed."""
    case = draw(seed)
    wrong, stopped = judge(case)
    notes = [f"turn {case.turn:.9g}: {wrong}"] if wrong else []
    return Outcome(kind=case.kind, result="full stop" if stopped else "rounded", notes=notes)
