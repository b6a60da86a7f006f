"""Where lines and arcs in the plane cross each other, compiled."""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour._kernels import compiled

# Points nearer than this are one [m].
SAME_PLACE = 1e-9
# Sine of the angle between two lines below which they are parallel.
PARALLEL = 1e-12

# Columns of a table of pieces: start x, y, unit tangent x, y, curvature, positive to the left,
# and length.
X, Y, TX, TY, CURVATURE, LENGTH = range(6)


@compiled(inner=True, allocates=True)
def box_of(piece: FloatArray) -> FloatArray:
    """Smallest and largest x, then y, of a piece, (4,)."""
    k, length = piece[CURVATURE], piece[LENGTH]
    angle = k * length
    along = length * _sinc(angle)
    across = length * _cosc(angle)
    ex = piece[X] + along * piece[TX] - across * piece[TY]
    ey = piece[Y] + along * piece[TY] + across * piece[TX]
    found = np.array([min(piece[X], ex), max(piece[X], ex), min(piece[Y], ey), max(piece[Y], ey)])
    if k != 0:
        cx, cy, r = piece[X] - piece[TY] / k, piece[Y] + piece[TX] / k, 1 / abs(k)
        for side in range(4):
            px = cx + r * (1.0 if side == 0 else -1.0 if side == 1 else 0.0)
            py = cy + r * (1.0 if side == 2 else -1.0 if side == 3 else 0.0)
            if _place(piece, px, py) <= length:
                found[0], found[1] = min(found[0], px), max(found[1], px)
                found[2], found[3] = min(found[2], py), max(found[3], py)
    return found


@compiled(inner=True)
def _sinc(x: float) -> float:
    """The function sin(x) / x."""
    return float(np.sinc(x / np.pi))


@compiled(inner=True)
def _cosc(x: float) -> float:
    """The function (1 - cos(x)) / x."""
    return float(2 * np.sin(x / 2) ** 2 / x) if abs(x) > 1e-8 else x / 2


@compiled(inner=True)
def _place(piece: FloatArray, x: float, y: float) -> float:
    """Distance along a piece at which it comes to a point that lies on it or on its going on."""
    k = piece[CURVATURE]
    dx, dy = x - piece[X], y - piece[Y]
    if k == 0:
        return float(dx * piece[TX] + dy * piece[TY])
    # The direction from the centre: angle 0 at the start, growing along the arc.
    along = (dx * piece[TX] + dy * piece[TY]) * abs(k)
    across = 1 - (dy * piece[TX] - dx * piece[TY]) * k
    angle = np.arctan2(along, across)
    if angle < 0:
        angle += 2 * np.pi
    r = 1 / abs(k)
    u = angle * r
    # Just before the start, and not after nearly a full turn.
    if u > piece[LENGTH] and 2 * np.pi * r - u <= SAME_PLACE:
        u -= 2 * np.pi * r
    return float(u)


@compiled(inner=True)
def _common_points(a: FloatArray, b: FloatArray, out: FloatArray) -> int:
    """Points that two pieces, gone on, have in common: how many; ends where they run together."""
    ka, kb = a[CURVATURE], b[CURVATURE]
    if ka == 0 and kb == 0:
        return _on_lines(a, b, out)
    if ka == 0 or kb == 0:
        return _on_line_and_circle(a if ka == 0 else b, b if ka == 0 else a, out)
    ax, ay, ra = a[X] - a[TY] / ka, a[Y] + a[TX] / ka, 1 / abs(ka)
    bx, by, rb = b[X] - b[TY] / kb, b[Y] + b[TX] / kb, 1 / abs(kb)
    dx, dy = bx - ax, by - ay
    d = np.hypot(dx, dy)
    if d <= SAME_PLACE and abs(ra - rb) <= SAME_PLACE:
        return _ends_of(a, b, out)
    if d == 0 or d > ra + rb + SAME_PLACE or d < abs(ra - rb) - SAME_PLACE:
        return 0
    along = (d * d + (ra - rb) * (ra + rb)) / (2 * d)
    across = np.sqrt(max((ra - along) * (ra + along), 0.0))
    for k, sign in enumerate((1.0, -1.0)):
        out[k, 0] = ax + (along * dx - sign * across * dy) / d
        out[k, 1] = ay + (along * dy + sign * across * dx) / d
    return 2


@compiled(inner=True)
def _on_lines(a: FloatArray, b: FloatArray, out: FloatArray) -> int:
    """Points in which two lines meet."""
    sine = a[TX] * b[TY] - a[TY] * b[TX]
    dx, dy = b[X] - a[X], b[Y] - a[Y]
    if abs(sine) < PARALLEL:
        apart = abs(a[TX] * dy - a[TY] * dx) > SAME_PLACE
        return 0 if apart else _ends_of(a, b, out)
    u = (dx * b[TY] - dy * b[TX]) / sine
    out[0, 0], out[0, 1] = a[X] + u * a[TX], a[Y] + u * a[TY]
    return 1


@compiled(inner=True)
def _on_line_and_circle(a: FloatArray, b: FloatArray, out: FloatArray) -> int:
    """Points in which the line of a meets the circle of b."""
    k = b[CURVATURE]
    cx, cy, r = b[X] - b[TY] / k, b[Y] + b[TX] / k, 1 / abs(k)
    dx, dy = cx - a[X], cy - a[Y]
    along, across = dx * a[TX] + dy * a[TY], dy * a[TX] - dx * a[TY]
    if abs(across) > r + SAME_PLACE:
        return 0
    half = np.sqrt(max((r - across) * (r + across), 0.0))
    for i, sign in enumerate((1.0, -1.0)):
        u = along + sign * half
        out[i, 0], out[i, 1] = a[X] + u * a[TX], a[Y] + u * a[TY]
    return 2


@compiled(inner=True)
def _ends_of(a: FloatArray, b: FloatArray, out: FloatArray) -> int:
    """The four ends of two pieces on one line or circle."""
    for i, piece in enumerate((a, b)):
        angle, length = piece[CURVATURE] * piece[LENGTH], piece[LENGTH]
        along, across = length * _sinc(angle), length * _cosc(angle)
        out[2 * i, 0], out[2 * i, 1] = piece[X], piece[Y]
        out[2 * i + 1, 0] = piece[X] + along * piece[TX] - across * piece[TY]
        out[2 * i + 1, 1] = piece[Y] + along * piece[TY] + across * piece[TX]
    return 4


@compiled(inner=True)
def _snap(u: float, length: float) -> float:
    """A place along a piece; one near an end is this end."""
    if u <= SAME_PLACE:
        return 0.0
    return length if length - u <= SAME_PLACE else u


@compiled()
def crossings(pieces: FloatArray) -> tuple[IntArray, FloatArray]:
    """All places at which pieces meet each other, their own ends included.

    Args:
        pieces: The pieces, (n, 6).

    Returns:
        The two pieces of each meeting, (m, 2), and how far along each of them it is [m], (m, 2).
    """
    n = len(pieces)
    boxes = np.empty((n, 4))
    for i in range(n):
        boxes[i] = box_of(pieces[i])
    order = np.argsort(boxes[:, 0])
    which, places = np.empty((4 * n + 16, 2), dtype=np.intp), np.empty((4 * n + 16, 2))
    count, points = 0, np.empty((4, 2))
    for s in range(n):
        i = order[s]
        for t in range(s + 1, n):
            j = order[t]
            if boxes[j, 0] > boxes[i, 1] + SAME_PLACE:
                break
            apart = boxes[j, 2] > boxes[i, 3] + SAME_PLACE or boxes[i, 2] > boxes[j, 3] + SAME_PLACE
            for p in range(0 if apart else _common_points(pieces[i], pieces[j], points)):
                u = _place(pieces[i], points[p, 0], points[p, 1])
                v = _place(pieces[j], points[p, 0], points[p, 1])
                if not (
                    -SAME_PLACE <= u <= pieces[i, LENGTH] + SAME_PLACE
                    and -SAME_PLACE <= v <= pieces[j, LENGTH] + SAME_PLACE
                ):
                    continue
                if count == len(which):
                    which = np.concatenate((which, np.empty_like(which)))
                    places = np.concatenate((places, np.empty_like(places)))
                which[count, 0], which[count, 1] = i, j
                places[count, 0] = _snap(u, pieces[i, LENGTH])
                places[count, 1] = _snap(v, pieces[j, LENGTH])
                count += 1
    return which[:count], places[:count]
