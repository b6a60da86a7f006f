"""Reparametrization of joint paths that follow straight lines at very uneven dq_ds.

Where all joints move along a line in joint space, the path is only the order of its points, and its
parameter s is arbitrary. If dq_ds is very small at a point that the joints pass quickly, ds and
d2s_dt2 are so large there that no affordable grid resolves them. The planner then uses another
parameter, in which |dq_ds| is even: it falls to zero only where the joints turn back, like that of
a parabola, which the joints pass at their full acceleration.
"""

from __future__ import annotations

import math
from math import comb

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.kernel_cache import compiled
from armcontour.motion import JointPath
from armcontour.motion.kernels import value_and_slopes
from armcontour.planning.path_grid import Grid

# A piece is straight if its distance from a line is at most the share STRAIGHT_DEVIATION of its
# size plus the share LINE_ROUNDING of its position.
STRAIGHT_DEVIATION = 1e-12
LINE_ROUNDING = 4e-15
# Lines in joint space with a larger sine of the angle between them have different directions.
SAME_DIRECTION = 1e-6
# Motions between two reversals shorter than this share of their line are rounding errors.
SHORTEST_MOTION = 1e-12
# Samples of a piece: EVEN_SAMPLES at even distances, and the distances 2^-1 to 2^-CLOSE_SAMPLES
# from both ends, because dq_ds often becomes small at a break.
EVEN_SAMPLES = 64
CLOSE_SAMPLES = 40
CLOSE_TO_BREAK = 0.5 ** np.arange(1, CLOSE_SAMPLES + 1)
SAMPLE_FRACTIONS = np.unique(
    np.concatenate([np.linspace(0.0, 1.0, EVEN_SAMPLES + 1), CLOSE_TO_BREAK, 1.0 - CLOSE_TO_BREAK])
)
# Converts coefficients of powers 0 to 4 to Bernstein coefficients, which enclose the polynomial.
BERNSTEIN = np.array([[comb(i, k) / comb(4, k) for k in range(5)] for i in range(5)])
# Bisections that locate a reversal between two samples.
TURN_BISECTIONS = 50
# A path needs another parameter if the grid loses this share of an acceleration limit.
LARGEST_SHARE = 1e-2
# Near a reversal, `2 D q2 / q1²` is 1, because the path is like a parabola. Up to this value it
# counts as a parabola; it is 4/3 if the path is like a cubic.
PARABOLA = 1.2
# Rounding error of distances, as a share of the length of all lines.
DISTANCE_ROUNDING = 1e-13


def replace_uneven_parameter(grid: Grid) -> JointPath | None:
    """Return a grid's joint path with an even parameter on straight pieces; None if it is even.

    Positions and stops stay the same. The parameter of other pieces changes by a constant.
    """
    path = grid.joint_path
    if path.tool_path is not None:
        return None
    pieces = len(path.coefficients)
    straight = np.empty(pieces, dtype=np.bool_)
    directions = np.empty((pieces, path.dof))
    if not mark_straight(path.coefficients, straight, directions):
        return None
    along = np.einsum("nkj,nj->nk", path.coefficients, directions)
    along[:, 0] = 0.0
    same = np.einsum("nj,nj->n", directions[1:], directions[:-1])
    same[np.abs(same) < 1 - SAME_DIRECTION**2] = 0.0
    same[np.isin(path.breaks[1:-1], path.stops)] = 0.0
    intervals = np.bincount(grid.piece, minlength=len(straight))
    if not is_uneven(along, np.sign(same), straight, intervals, SAMPLE_FRACTIONS):
        return None
    return _replace_lines(path, straight, directions, same == 0.0)


@compiled()
def mark_straight(c: FloatArray, straight: BoolArray, directions: FloatArray) -> bool:
    """Mark the pieces that move along a line in joint space; return whether there are any.

    - `c`: coefficients of the pieces, (n, 6, dof).
    - `straight`: output, mask of the straight pieces, (n,).
    - `directions`: output, unit vectors of the largest coefficients, (n, dof).
    """
    any_straight = False
    for i in range(c.shape[0]):
        straight[i] = _is_straight(c[i], directions[i])
        any_straight |= straight[i]
    return any_straight


@compiled(inner=True)
def _is_straight(c: FloatArray, direction: FloatArray) -> bool:
    """Return whether a piece, (6, dof), moves along a line, and write its direction, (dof,)."""
    dof = c.shape[1]
    largest = 0.0
    longest = 1
    for k in range(1, 6):
        square = 0.0
        for j in range(dof):
            square += c[k, j] * c[k, j]
        if square > largest:
            largest = square
            longest = k
    largest = math.sqrt(largest)
    farthest = 0.0
    for j in range(dof):
        direction[j] = c[longest, j] / largest if largest > 0.0 else 0.0
        farthest = max(farthest, abs(c[0, j]))
    allowed = LINE_ROUNDING * (1 + farthest) + STRAIGHT_DEVIATION * largest
    deviation = 0.0
    for k in range(1, 6):
        along = 0.0
        for j in range(dof):
            along += c[k, j] * direction[j]
        for j in range(dof):
            deviation = max(deviation, abs(c[k, j] - along * direction[j]))
    return deviation <= allowed and largest > 0.0


@compiled(inner=True)
def _along(c: FloatArray, x: float) -> tuple[float, float, float]:
    """Return the position along a piece's line, and its first and second derivative in x.

    - `c`: coefficients of the position, (6,).
    """
    return value_and_slopes(c[0], c[1], c[2], c[3], c[4], c[5], x)


@compiled()
def is_uneven(
    along: FloatArray,
    same: FloatArray,
    straight: BoolArray,
    intervals: IntArray,
    x: FloatArray,
) -> bool:
    """Test whether some straight piece is so uneven that its grid does not resolve d2s_dt2.

    From rest at a reversal, joints with the acceleration a reach the speed `v² = 2 a D` after the
    distance D. There d2s_dt2 cancels `v² q2 / q1²`, with the derivatives q1 and q2 in the
    parameter. Its linear course on an interval of width w leaves the share `2 D w² q2³ / q1⁴` of a.

    - `along`: coefficients of the positions along the lines of the pieces, (n, 6).
    - `same`: 1 where the direction of the line continues at an inner break, -1 where it is
      reversed, 0 at a stop or another line, (n - 1,).
    - `straight`: mask of straight pieces, (n,).
    - `intervals`: number of intervals of each piece, (n,).
    - `x`: increasing fractions of a piece at which it is sampled, (samples,).
    """
    n = len(straight)
    travel = np.empty((n, len(x)))
    turns = np.empty(n * len(x) + 2)
    last_turn = _measure_travel(along, same, straight, x, travel, turns)
    rounding = DISTANCE_ROUNDING * turns[last_turn]
    before = 0
    for i in range(n):
        if not straight[i]:
            continue
        for k in range(len(x)):
            while before + 1 < last_turn and turns[before + 1] <= travel[i, k]:
                before += 1
            distance = min(travel[i, k] - turns[before], turns[before + 1] - travel[i, k])
            distance -= rounding
            _, slope, bend = _along(along[i], x[k])
            if _is_unresolved(max(distance, 0.0), slope, bend, intervals[i]):
                return True
    return False


@compiled(inner=True)
def _measure_travel(
    along: FloatArray,
    same: FloatArray,
    straight: BoolArray,
    x: FloatArray,
    travel: FloatArray,
    turns: FloatArray,
) -> int:
    """Measure the way along all lines up to each sample, (n, samples), and to each turn.

    A turn is a reversal, or an end of a line. Returns the index of the last turn; its way is the
    length of all lines.
    """
    turns[0] = 0.0
    number = 1
    total = 0.0
    # Direction of the motion before a sample; 0 at the start of a line
    before = 0.0
    for i in range(len(straight)):
        if not straight[i]:
            before = 0.0
            continue
        if i > 0 and straight[i - 1]:
            if same[i - 1] == 0.0:
                before = 0.0
            else:
                before *= same[i - 1]
        if before == 0.0:
            turns[number] = total
            number += 1
        last, _, _ = _along(along[i], 0.0)
        for k in range(len(x)):
            value, slope, _ = _along(along[i], x[k])
            if slope * before < 0.0:
                turn = _find_turn(along[i], x[max(k - 1, 0)], x[k], before)
                turns[number] = total + abs(turn - last)
                number += 1
                total += abs(turn - last)
                last = turn
            total += abs(value - last)
            last = value
            travel[i, k] = total
            if slope != 0.0:
                before = slope
    turns[number] = total
    return number


@compiled(inner=True)
def _find_turn(c: FloatArray, low: float, high: float, before: float) -> float:
    """Return where a piece turns back between two samples, by bisection of its slope.

    `before` has the sign of the slope at the first sample.
    """
    for _ in range(TURN_BISECTIONS):
        middle = (low + high) / 2
        _, slope, _ = _along(c, middle)
        if slope * before > 0.0:
            low = middle
        else:
            high = middle
    turn, _, _ = _along(c, high)
    return turn


@compiled(inner=True)
def _is_unresolved(distance: float, slope: float, bend: float, intervals: int) -> bool:
    """Test whether the grid loses more than LARGEST_SHARE of an acceleration limit at a sample.

    - `distance`: distance D from the nearest turn.
    - `slope`, `bend`: derivatives q1 and q2 in the fraction of the piece.
    - `intervals`: number 1 / w of intervals of the piece.
    """
    squared = slope * slope
    share = 2 * distance * abs(bend)
    relative = bend / intervals
    lost = share * relative * relative
    return share > PARABOLA * squared and lost > LARGEST_SHARE * squared * squared


def _replace_lines(
    path: JointPath, straight: BoolArray, directions: FloatArray, separate: BoolArray
) -> JointPath:
    """Replace all runs of straight pieces by lines with an even parameter.

    `separate` is true at inner breaks with a stop or between different lines, (n - 1,).
    """
    n = len(straight)
    width = np.diff(path.breaks)
    is_stop = np.isin(path.breaks, path.stops)
    lengths: list[FloatArray] = []
    coefficients: list[FloatArray] = []
    stops: list[int] = []
    count = 0
    i = 0
    while i < n:
        if is_stop[i]:
            stops.append(count)
        end = i + 1
        if straight[i]:
            while end < n and straight[end] and not separate[end - 1]:
                end += 1
            new_lengths, c = _even_line(path, i, end, directions[i], is_stop)
        else:
            new_lengths = width[i:end]
            c = path.coefficients[i:end]
        lengths.append(new_lengths)
        coefficients.append(c)
        count += len(new_lengths)
        i = end
    breaks = path.breaks[0] + np.concatenate([[0.0], np.cumsum(np.concatenate(lengths))])
    return JointPath(breaks=breaks, coefficients=np.concatenate(coefficients), stops=breaks[stops])


def _even_line(
    path: JointPath, first: int, end: int, direction: FloatArray, is_stop: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """Return lengths, (n,), and coefficients, (n, 6, dof), that replace the pieces of one line.

    - `first`, `end`: the first piece, and the piece after the last one.
    - `direction`: unit vector along the line, (dof,).
    - `is_stop`: mask of the breaks at which the motion stops.
    """
    q = _find_turns(path.coefficients[first:end], direction)
    steps = np.diff(q, axis=0)
    rises = np.linalg.norm(steps, axis=1)
    # With this |d2q_dp2| at reversals, parts between two reversals keep the length of the pieces.
    length = path.breaks[end] - path.breaks[first]
    bend = 6 * (np.sqrt(rises).sum() / length) ** 2
    # The parts begin and end at reversals, and are cubics there: `step (3 x² - 2 x³)`.
    lengths = np.sqrt(6 * rises / bend)
    c = np.zeros((len(steps), 6, len(direction)))
    c[:, 0] = q[:-1]
    c[:, 2] = 3 * steps
    c[:, 3] = -2 * steps
    # Parts that begin or end at rest are half of such a cubic, twice as long, or a line.
    for k, at_start in ((-1, False), (0, True)):
        c[k, 1:] = 0.0
        if len(steps) == 1:
            c[k, 1] = steps[k]
            lengths[k] = np.sqrt(rises[k] / bend)
        elif at_start:
            c[k, 1] = 1.5 * steps[k]
            c[k, 3] = -0.5 * steps[k]
            lengths[k] = np.sqrt(3 * rises[k] / bend)
        else:
            c[k, 2] = 1.5 * steps[k]
            c[k, 3] = -0.5 * steps[k]
            lengths[k] = np.sqrt(3 * rises[k] / bend)
    # Next to a bent piece, |dq_ds| must not change.
    slopes = np.full(2, np.nan)
    if first > 0 and not is_stop[first]:
        slopes[0] = np.linalg.norm(path(path.breaks[first], 1))
    if end < len(path.coefficients) and not is_stop[end]:
        slopes[1] = np.linalg.norm(path(path.breaks[end], 1, side="left"))
    return _keep_slopes(lengths, c, steps, slopes)


def _keep_slopes(
    lengths: FloatArray, c: FloatArray, steps: FloatArray, slopes: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Divide the first and the last part in two halves of linear |dq_dp| if an end specifies it.

    - `lengths`, `c`: lengths and coefficients of the parts.
    - `steps`: changes of q along the parts, (n, dof).
    - `slopes`: |dq_dp| at the start and the end of the line, or NaN.
    """
    n = len(steps)
    for k in (n - 1, 0):
        ends = np.zeros(2)
        if k == 0:
            ends[0] = slopes[0]
        if k == n - 1:
            ends[1] = slopes[1]
        if not ((k == 0 and slopes[0] >= 0) or (k == n - 1 and slopes[1] >= 0)):
            continue
        half = steps[k] / 2
        rise = float(np.linalg.norm(half))
        middle = 3 * rise / lengths[k]
        begin, end = np.where(np.isnan(ends), middle, ends)
        halves = np.zeros((2, *c.shape[1:]))
        for i, (before, after) in enumerate(((begin, middle), (middle, end))):
            halves[i, 0] = c[k, 0] + i * half
            halves[i, 1] = half * (2 * before / (before + after))
            halves[i, 2] = half * ((after - before) / (before + after))
        widths = 2 * rise / (np.array([begin, end]) + middle)
        c = np.concatenate([c[:k], halves, c[k + 1 :]])
        lengths = np.concatenate([lengths[:k], widths, lengths[k + 1 :]])
    return lengths, c


def _find_turns(pieces: FloatArray, direction: FloatArray) -> FloatArray:
    """Find the ends of a line and the points at which it turns back, (n, dof).

    - `pieces`: coefficients of the pieces of the line, (k, 6, dof).
    - `direction`: unit vector along the line, (dof,).
    """
    along = pieces @ direction
    slope = along[:, 1:] * np.arange(1.0, 6.0)
    bernstein = slope @ BERNSTEIN.T
    turns_back = (bernstein.min(axis=1) < 0) & (bernstein.max(axis=1) > 0)
    x = np.full((len(pieces), 5), np.nan)
    x[turns_back, :4] = _roots(slope[turns_back])
    x[~((x > 0) & (x < 1))] = np.nan
    x[:, 4] = 1.0
    x.sort(axis=1)
    piece, column = np.nonzero(x > 0)
    powers = x[piece, column][:, None] ** np.arange(6)
    inner = np.einsum("mk,mkj->mj", powers, pieces[piece])
    q = np.concatenate([pieces[:1, 0], inner])
    return np.asarray(q[_find_reversals((q - q[0]) @ direction)])


def _roots(c: FloatArray) -> FloatArray:
    """Return the real parts of quartics' roots, (n, 4); NaN where the degree is lower.

    `c` are the coefficients of powers 0 to 4, (n, 5).
    """
    roots = np.full((len(c), 4), np.nan)
    degrees = 4 - np.argmax(c[:, ::-1] != 0, axis=1)
    for degree in range(1, 5):
        rows = np.flatnonzero(degrees == degree)
        companion = np.zeros((len(rows), degree, degree))
        companion[:, range(1, degree), range(degree - 1)] = 1.0
        companion[:, 0] = -c[rows, degree - 1 :: -1][:, :degree] / c[rows, degree, None]
        roots[rows, :degree] = np.linalg.eigvals(companion).real
    return roots


def _find_reversals(values: FloatArray) -> list[int]:
    """Return the indices at which positions along a line begin, turn back and end."""
    small = SHORTEST_MOTION * float(np.abs(np.diff(values)).sum())
    kept = [0]
    for k in range(1, len(values)):
        step = values[k] - values[kept[-1]]
        if len(kept) > 1 and step * (values[kept[-1]] - values[kept[-2]]) >= 0:
            kept[-1] = k
        elif abs(step) > small:
            kept.append(k)
    if kept[-1] != len(values) - 1:
        kept[-1 if len(kept) > 1 else 0] = len(values) - 1
    return kept
