"""Machines with three slides and two rotary axes, whose tool axis may be at the pole of the head.

The tool axis is `n = R(u, c) R(v, a) t` at the angles c and a of both rotary axes: u, v and t are
the directions of the first axis, the second axis and the tool at the zero position. The head is at
its pole where n is parallel to u, as a vertical torch on a C/A head: there every c gives the same
n, and near it a small change of n turns c far.

For given c, the best a puts the tool into the plane through n and the second axis, which has the
direction R(u, c) v. The remaining error is the difference of the angles of n and of the tool to
this axis. With `n . R(u, c) v = k + h cos(c - f)`, it is

    |asin(k + h cos(c - f)) - asin(t . v)|,

so the angles c whose error is within a tolerance are intervals, which are wide near the pole. The
chain of intervals along the path and an angle in each of them are found by dynamic programming; c
then gets the least rates and bends inside these intervals.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.errors import Unreachable
from armcontour.core.frames import exp
from armcontour.core.quintics import solve_banded
from armcontour.core.render import number
from armcontour.geometry import Path
from armcontour.planning.tracing.causes import Relaxation
from armcontour.planning.tracing.guide import Guide
from armcontour.planning.tracing.refusals import needs_all, needs_one
from armcontour.robot import SerialArm

# Angle by which the tool axis of such a machine may deviate from the required one where the path
# comes near the pole of the head [rad].
HEAD_TOLERANCE = float(np.radians(0.1))
# Number of joints of such a machine.
HEAD_JOINTS = 5
# Angle to the pole within which the path is near it [rad]. At larger angles, the tolerance changes
# the first axis by less than 2 degrees.
NEAR_POLE = float(np.radians(3.0))
# Number of places per piece of the orientation at which its angle to the pole is computed.
PLACES = 8
# Share of the tolerance that is used at the stations; the rest is for the path between them.
USED_TOLERANCE = 0.7
# Step of the angles that are tried for the first axis [rad]
ANGLE_STEP = float(np.radians(5.0))
# Largest change of the first axis between two stations [rad]
LARGEST_STEP = float(np.radians(90.0))
# Smallest distance of stations in the sum of length and turn of the tool axis, relative to the path
STATION_GAP = 1 / 1000
# Share of the length in this sum along a constant tool axis, where few stations are needed.
CONSTANT_SHARE = 0.05
# Smallest distance of stations, divided by the length of the path; a shorter one has large rounding
# errors in its slopes.
SHORTEST_GAP = 1e-5
# Angle beyond which an endless axis does not turn [rad], and the number of turns in it
ENDLESS = 6 * np.pi
MOST_TURNS = 4
# Factor of the number of knots, which must be close where the first axis turns fast.
HEAD_FINER = 12
# Weight of the change of an angle's rate, relative to the rate times the length of the path.
BEND_WEIGHT = 0.02
# Weight of the distance from the angles of the dynamic programming, which decides where nothing
# else does.
ANCHOR_WEIGHT = 1e-6
# Weight of the squared angle beyond a range [1/rad²], while the cause of a refusal is sought
EXCESS_WEIGHT = 1e3
# Decimals of the angles in the message of a refusal [rad]
SHOWN_DECIMALS = 12
# Weight of an angle that is given
FIXED_WEIGHT = 1e9
# Largest number of iterations of the interior-point method, its last complementarity, and the
# factor by which an iteration aims to reduce it
MAX_ITERATIONS = 60
COMPLEMENTARITY = 1e-9
CENTERING = 0.2
# Share of the way to the nearest bound that an iteration may go.
TO_BOUND = 0.95
# Smallest cosine that counts as defined for the interval of angles.
NO_RADIUS = 1e-12


@dataclass(frozen=True, slots=True, kw_only=True)
class Head:
    """The two rotary axes of a machine with three slides."""

    first: int  # Index of the rotary axis nearer to the base
    second: int  # Index of the other rotary axis
    pole: FloatArray  # Unit vector along the first axis, (3,)
    second_axis: FloatArray  # Unit vector along the second axis at the zero position, (3,)
    tool: FloatArray  # Unit vector along the tool at the zero position, (3,)

    def first_angles(self, axis: FloatArray, tolerance: float) -> Allowed:
        """Return the angles of the first axis with which the tool has given directions.

        - `axis`: required tool axes, (n, 3).
        - `tolerance`: largest angle from them [rad].
        """
        along = (axis @ self.pole) * (self.second_axis @ self.pole)
        cosine = axis @ self.second_axis - along
        sine = axis @ np.cross(self.pole, self.second_axis)
        radius = np.maximum(np.hypot(cosine, sine), NO_RADIUS)
        angle = np.arcsin(np.clip(self.tool @ self.second_axis, -1.0, 1.0))
        half_turn = np.pi / 2
        high = (np.sin(np.minimum(angle + tolerance, half_turn)) - along) / radius
        low = (np.sin(np.maximum(angle - tolerance, -half_turn)) - along) / radius
        exact = (np.sin(angle) - along) / radius
        return Allowed(
            middle=np.arctan2(sine, cosine),
            near=np.arccos(np.clip(high, -1.0, 1.0)),
            far=np.arccos(np.clip(low, -1.0, 1.0)),
            exact=np.arccos(np.clip(exact, -1.0, 1.0)),
            reached=(high >= -1.0) & (low <= 1.0),
        )

    def missed(self, axis: FloatArray) -> FloatArray:
        """Return the angles between required and nearest possible tool axes [rad], (n,).

        - `axis`: required tool axes, (n, 3).
        """
        along = (axis @ self.pole) * (self.second_axis @ self.pole)
        across = axis - (axis @ self.pole)[:, None] * self.pole
        second_across = self.second_axis - (self.second_axis @ self.pole) * self.pole
        radius = np.linalg.norm(across, axis=1) * np.linalg.norm(second_across)
        angle = np.arcsin(np.clip(self.tool @ self.second_axis, -1.0, 1.0))
        low = np.arcsin(np.clip(along - radius, -1.0, 1.0))
        high = np.arcsin(np.clip(along + radius, -1.0, 1.0))
        return np.asarray(np.maximum(np.maximum(angle - high, low - angle), 0.0))

    def rows(self, count: int) -> FloatArray:
        """Return the rows of a guide that fix both rotary axes at stations, (count, 2, 5)."""
        rows = np.zeros((count, 2, HEAD_JOINTS))
        rows[:, 0, self.first] = 1.0
        rows[:, 1, self.second] = 1.0
        return rows

    def second_angles(self, axis: FloatArray, first: FloatArray) -> FloatArray:
        """Return the angles of the second axis [rad] that bring the tool nearest to its direction.

        - `axis`: required tool axes, (..., 3).
        - `first`: angles of the first axis [rad], (...).
        """
        turned = np.einsum("...ji,...j->...i", exp(first[..., None] * self.pole), axis)
        across = np.cross(self.second_axis, self.tool)
        along = (turned @ self.second_axis) * (self.tool @ self.second_axis)
        return np.asarray(np.arctan2(turned @ across, turned @ self.tool - along))


@dataclass(frozen=True, slots=True, kw_only=True)
class Allowed:
    """Angles c of the first axis at n stations: `near <= |c - middle| <= far`, modulo a turn."""

    middle: FloatArray  # [rad], (n,)
    near: FloatArray  # From 0 to pi [rad], (n,)
    far: FloatArray  # From 0 to pi [rad], (n,)
    exact: FloatArray  # `|c - middle|` without an error of the tool axis [rad], (n,)
    reached: BoolArray  # False where no angle is allowed, (n,)

    def contains(self, i: int, c: FloatArray) -> BoolArray:
        """Return the mask of the angles [rad], (k,), that are allowed at station i."""
        away = self._away(i, c)
        return np.asarray((away >= self.near[i]) & (away <= self.far[i]))

    def interval(self, i: int, c: float) -> tuple[float, float]:
        """Return the ends of the interval of allowed angles around an allowed angle [rad]."""
        near = float(self.near[i])
        far = float(self.far[i])
        if near == 0.0 and far == np.pi:
            return -np.inf, np.inf
        difference = float(np.pi - np.mod(np.pi - (c - self.middle[i]), 2 * np.pi))
        middle = c - difference
        if near == 0.0:
            return middle - far, middle + far
        opposite = float(np.copysign(np.pi, difference))
        if far == np.pi:
            return middle + opposite - (np.pi - near), middle + opposite + (np.pi - near)
        ends = sorted(
            [middle + np.copysign(near, difference), middle + np.copysign(far, difference)]
        )
        return ends[0], ends[1]

    def _away(self, i: int, c: FloatArray) -> FloatArray:
        """Return `|c - middle|` at station i, from 0 to pi [rad]."""
        return np.asarray(np.abs(np.pi - np.mod(np.pi - (c - self.middle[i]), 2 * np.pi)))


def head_of(arm: SerialArm) -> Head | None:
    """Return the head of a machine with three slides and two rotary axes; None for other arms."""
    rotary = np.flatnonzero(~arm.chain.slides)
    if arm.dof != HEAD_JOINTS or len(rotary) != 2:
        return None
    zero = np.zeros(arm.dof)
    axes = arm.jacobian(zero)[3:, rotary].T
    return Head(
        first=int(rotary[0]),
        second=int(rotary[1]),
        pole=axes[0],
        second_axis=axes[1],
        tool=arm.poses(zero)[:, 2],
    )


def has_head_tolerance(path: Path, head: Head) -> bool:
    """Test whether HEAD_TOLERANCE applies to a path, because its tool axis comes near the pole.

    It does not apply to a path with a larger cone.
    """
    assert path.orientation is not None
    if not path.orientation.axis_only or path.orientation.cone >= HEAD_TOLERANCE:
        return False
    s = path.orientation.breaks
    s = np.interp(np.arange((len(s) - 1) * PLACES + 1) / PLACES, np.arange(len(s)), s)
    across = np.linalg.norm(np.cross(path.orientation(s)[:, :, 2], head.pole), axis=1)
    return bool(across.min() < np.sin(NEAR_POLE))


def is_away_from_pole(head: Head, axis: FloatArray) -> bool:
    """Test whether a required tool axis, (3,), is farther from the pole than NEAR_POLE."""
    return bool(np.linalg.norm(np.cross(axis, head.pole)) >= np.sin(NEAR_POLE))


def stations_of(s: FloatArray, axis: FloatArray, stops: FloatArray) -> IntArray:
    """Select knots at even distances in length and turn of the tool axis, all stops and both ends.

    - `s`: arc lengths of the knots [m], (n,).
    - `axis`: required tool axes at the knots, (n, 3).
    - `stops`: arc lengths of the stops [m].
    """
    turn = np.linalg.norm(np.diff(axis, axis=0), axis=1)
    share = 1.0 if turn.any() else CONSTANT_SHARE
    steps = share * np.diff(s) / s[-1] + turn / max(float(turn.sum()), 1.0)
    measure = np.append(0.0, np.cumsum(steps))
    needed = np.zeros(len(s), dtype=np.bool_)
    needed[np.searchsorted(s, stops)] = True
    needed[[0, -1]] = True
    selected = [0]
    for k in range(1, len(s)):
        last = selected[-1]
        is_close = measure[k] - measure[last] < STATION_GAP or s[k] - s[last] < SHORTEST_GAP * s[-1]
        if needed[k]:
            if is_close and not needed[last]:
                selected.pop()
            selected.append(k)
        elif not is_close:
            selected.append(k)
    return np.array(selected)


def guide_head(
    path: Path,
    arm: SerialArm,
    head: Head,
    s: FloatArray,
    poses: FloatArray,
    tolerance: float,
    seed: FloatArray | None,
) -> tuple[Guide, FloatArray]:
    """Choose both rotary axes along the whole path.

    Returns the guide with both rotary axes, and the joint positions at the stations, (n, 5).

    - `s`: arc lengths of the stations [m], (n,), which contain the stops.
    - `poses`: tool poses at the stations, (n, 3, 4).
    - `tolerance`: largest angle of the tool axis from the required one [rad].
    - `seed`: joint positions at the start, (5,); None if they are free.

    Raises:
        Unreachable: The head cannot turn the tool into a required direction.
    """
    axis = poses[:, :, 2]
    start = None if seed is None else float(seed[head.first])
    search = _Search(arm, head, s, axis, USED_TOLERANCE * tolerance)
    rough = search.run(start)
    if rough is None:
        raise _refusal(path, arm, search, start)
    lower, upper = search.intervals(rough)
    fixed = np.zeros(len(s), dtype=np.bool_)
    for k in (0, -1):
        # The next move, which may be away from the pole, begins with the required tool axis.
        if is_away_from_pole(head, axis[k]):
            rough[k] = search.nearest_exact(k, float(rough[k]))
            fixed[k] = True
    if start is not None and lower[0] < start < upper[0]:
        rough[0] = start
        fixed[0] = True
    first = bend_least(s, rough, lower, upper, fixed)
    second = search.turn_into_range(head.second_angles(axis, first))
    rows = head.rows(len(s))
    q = _slide(arm, head, poses, first, np.unwrap(second))
    return Guide.through(s, q, rows, path.stops), q


class _Search:
    """Dynamic programming over the angle of the first axis at all stations."""

    def __init__(
        self, arm: SerialArm, head: Head, s: FloatArray, axis: FloatArray, tolerance: float
    ) -> None:
        # `s`: arc lengths of the stations [m], (n,); `axis`: required tool axes, (n, 3).
        self.head = head
        self.s = s
        self.axis = axis
        self.tolerance = tolerance
        lower, upper = arm.limits.joint_range(arm.dof)
        joints = [head.first, head.second]
        self.first_range = np.clip([lower[head.first], upper[head.first]], -ENDLESS, ENDLESS)
        self.second_range = np.array([lower[head.second], upper[head.second]])
        # Ranges outside of which positions are expensive
        self.preferred = (self.first_range, self.second_range)
        self.pace = np.ones(2)
        if arm.limits.joint_velocity is not None:
            slowest = np.minimum(*np.abs(arm.limits.velocity_bounds(arm.dof)))[joints]
            # A joint without a limit counts as the faster one.
            slowest = np.minimum(slowest, slowest[np.isfinite(slowest)].max(initial=1.0))
            self.pace = slowest.min() / slowest
        self.allowed = head.first_angles(axis, tolerance)

    def without_ranges(self, joints: tuple[int, ...]) -> _Search:
        """Return the search in which some axes may leave their ranges, but do so little."""
        released = copy(self)
        if self.head.first in joints:
            released.first_range = np.array([-ENDLESS, ENDLESS])
        if self.head.second in joints:
            released.second_range = self._middle_of_second() + np.array([-np.pi, np.pi])
        return released

    def run(self, start: float | None) -> FloatArray | None:
        """Return the angles of the first axis with the least motion of both axes [rad], (n,).

        Returns None if no angles of both axes inside of their ranges give the tool its directions.

        - `start`: angle at the first station [rad]; None if it is free.
        """
        candidates = [self._candidates(i) for i in range(len(self.s))]
        if not all(len(first) for first, _ in candidates):
            return None
        first, second = candidates[0]
        # The nearest angle to the given start, or to zero, decides between equal costs.
        cost = ANCHOR_WEIGHT * np.abs(first - (start or 0.0))
        if start is not None:
            cost = np.square((first - start) * self.pace[0]) / STATION_GAP
        cost = cost + self._excess_cost(first, second)
        before: list[IntArray] = []
        widths = np.diff(self.s) / self.s[-1]
        for i, width in enumerate(widths, start=1):
            next_first, next_second = candidates[i]
            step = next_first[:, None] - first
            tilt = np.pi - np.mod(np.pi - (next_second[:, None] - second), 2 * np.pi)
            edges = (np.square(step * self.pace[0]) + np.square(tilt * self.pace[1])) / width
            total = np.where(np.abs(step) <= LARGEST_STEP, cost + edges, np.inf)
            best = np.argmin(total, axis=1)
            cost = total[np.arange(len(best)), best]
            if not np.isfinite(cost).any():
                return None
            cost += self._excess_cost(next_first, next_second)
            before.append(best)
            first, second = next_first, next_second
        k = int(np.argmin(cost))
        chosen = np.empty(len(self.s))
        for i in range(len(self.s) - 1, -1, -1):
            chosen[i] = candidates[i][0][k]
            if i:
                k = int(before[i - 1][k])
        return chosen

    def _excess_cost(self, first: FloatArray, second: FloatArray) -> FloatArray:
        """Return the cost of angles outside of the preferred ranges, (k,)."""
        cost = np.zeros(len(first))
        for angles, (lower, upper) in zip((first, second), self.preferred, strict=True):
            cost += EXCESS_WEIGHT * np.square(angles - np.clip(angles, lower, upper))
        return cost

    def _candidates(self, i: int) -> tuple[FloatArray, FloatArray]:
        """Return allowed angles of both axes at station i [rad], (k,) each."""
        lower, upper = self.first_range
        grid = np.arange(np.ceil(lower / ANGLE_STEP), np.floor(upper / ANGLE_STEP) + 1) * ANGLE_STEP
        grid = grid[self.allowed.contains(i, grid)]
        exact = self.allowed.middle[i] + self.allowed.exact[i] * np.array([[-1.0], [1.0]])
        turns = 2 * np.pi * np.arange(-MOST_TURNS, MOST_TURNS + 1)
        exact = (exact + turns).ravel() if self.allowed.reached[i] else np.zeros(0)
        first = np.concatenate([grid, exact[(exact >= lower) & (exact <= upper)]])
        second = self.turn_into_range(self.head.second_angles(self.axis[i], first))
        inside = (second >= self.second_range[0]) & (second <= self.second_range[1])
        return first[inside], second[inside]

    def nearest_exact(self, i: int, first: float) -> float:
        """Return the angle nearest to another one that gives the required tool axis [rad]."""
        exact = self.allowed.middle[i] + self.allowed.exact[i] * np.array([-1.0, 1.0])
        exact = exact + 2 * np.pi * np.rint((first - exact) / (2 * np.pi))
        return float(exact[np.argmin(np.abs(exact - first))])

    def turn_into_range(self, second: FloatArray) -> FloatArray:
        """Shift angles of the second axis by whole turns to the middle of its range [rad]."""
        middle = self._middle_of_second()
        return second - 2 * np.pi * np.rint((second - middle) / (2 * np.pi))

    def _middle_of_second(self) -> float:
        """Return the middle of the second axis's range, 0 for an endless one [rad]."""
        return float(np.mean(self.second_range)) if np.isfinite(self.second_range).all() else 0.0

    def intervals(self, first: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the ends of the intervals of allowed angles around angles, [rad], (n,) each."""
        ends = np.array([self.allowed.interval(i, x) for i, x in enumerate(first)])
        return np.maximum(ends[:, 0], self.first_range[0]), np.minimum(
            ends[:, 1], self.first_range[1]
        )


def _refusal(path: Path, arm: SerialArm, search: _Search, start: float | None) -> Unreachable:
    """Make the error for directions that both rotary axes do not reach in their ranges."""
    head = search.head
    alone = [y for x in (head.first, head.second) for y in _excesses(search, (x,), start)]
    if alone:
        return needs_one(path, arm, sorted(alone, key=lambda x: x.size))
    both = _excesses(search, (head.first, head.second), start)
    if both:
        return needs_all(path, arm, sorted(both, key=lambda x: -x.size))
    missed = head.missed(search.axis)
    i = int(np.argmax(missed))
    direction = tuple(np.round(search.axis[i], 6).tolist())
    return Unreachable(
        f"At {search.s[i]:.6g} m along the path the two rotary axes {arm.joint_names[head.first]} "
        f"and {arm.joint_names[head.second]} cannot turn the tool into the required direction "
        f"{direction}, but only to {number(float(missed[i]), 'rad')} from it. Turn the part or "
        "the tool.",
        s=float(search.s[i]),
        point=path(float(search.s[i])).tolist(),
        limit="orientation",
        needed=float(missed[i]),
        allowed=search.tolerance,
    )


def _excesses(search: _Search, released: tuple[int, ...], start: float | None) -> list[Relaxation]:
    """Return by how much axes leave their ranges if they may; empty if this is not enough."""
    head = search.head
    free = search.without_ranges(released)
    first = free.run(start)
    if first is None:
        return []
    second = free.turn_into_range(head.second_angles(free.axis, first))
    found = []
    # A position such as 1e-16 rad would be written with many digits.
    axes = ((head.first, first), (head.second, np.round(np.unwrap(second), SHOWN_DECIMALS)))
    for (joint, angles), (lower, upper) in zip(axes, search.preferred, strict=True):
        beyond = np.maximum(angles - upper, lower - angles)
        row = int(np.argmax(beyond))
        if beyond[row] <= 0.0:
            continue
        found.append(
            Relaxation(
                kind="range",
                joint=joint,
                s=float(free.s[row]),
                s_first=float(free.s[np.argmax(beyond > 0.0)]),
                least=float(angles.min()),
                most=float(angles.max()),
                lower=float(lower),
                upper=float(upper),
                needed=float(angles[row]),
                allowed=float(upper if angles[row] > upper else lower),
            )
        )
    return found


def bend_least(
    s: FloatArray, rough: FloatArray, lower: FloatArray, upper: FloatArray, fixed: BoolArray
) -> FloatArray:
    """Return values with the least squared slopes and bends between bounds, (n,).

    The minimum of `x . H x / 2 - g . x` is found by a primal-dual interior-point method.

    - `s`: arc lengths [m], (n,).
    - `rough`: values between the bounds, (n,).
    - `lower`, `upper`: bounds, (n,) each.
    - `fixed`: mask of the values that do not change, (n,).
    """
    n = len(s)
    if n < 3:
        return rough
    bands, gradient = _smoothness(s / s[-1], rough)
    bands[0, fixed] += FIXED_WEIGHT
    gradient[fixed] += FIXED_WEIGHT * rough[fixed]
    low = np.where(np.isfinite(lower), lower, rough - ENDLESS)
    high = np.where(np.isfinite(upper), upper, rough + ENDLESS)
    x = np.clip(rough, low + 0.05 * (high - low), high - 0.05 * (high - low))
    push_low = np.ones(n)
    push_high = np.ones(n)
    for _ in range(MAX_ITERATIONS):
        above = x - low
        below = high - x
        gap = float(push_low @ above + push_high @ below) / (2 * n)
        if gap < COMPLEMENTARITY:
            break
        target = CENTERING * gap
        diagonal = push_low / above + push_high / below
        right = gradient - _multiply(bands, x) + target / above - target / below
        step = _solve(bands, diagonal, right)
        change_low = target / above - push_low - push_low / above * step
        change_high = target / below - push_high + push_high / below * step
        pairs = ((above, step), (below, -step), (push_low, change_low), (push_high, change_high))
        share = min(_largest_share(value, change) for value, change in pairs)
        x = x + share * step
        push_low = push_low + share * change_low
        push_high = push_high + share * change_high
    return np.where(fixed, rough, x)


def _largest_share(values: FloatArray, change: FloatArray) -> float:
    """Return the largest share of a change, up to 1, with which all values stay positive."""
    falling = change < 0
    if not falling.any():
        return 1.0
    return min(1.0, TO_BOUND * float((-values[falling] / change[falling]).min()))


def _smoothness(x: FloatArray, anchor: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return H, its upper bands (3, n), and g of the squared slopes and bends over `x`, (n,)."""
    n = len(x)
    width = np.diff(x)
    bands = np.zeros((3, n))
    # Slopes (y[i + 1] - y[i]) / width[i], whose squares are integrated over width[i]
    slope = 1 / width
    bands[0, :-1] += slope
    bands[0, 1:] += slope
    bands[1, :-1] -= slope
    # Bends: differences of slopes at inner stations, over the mean of both widths
    mean = (width[1:] + width[:-1]) / 2
    weight = BEND_WEIGHT / mean
    rows = 1 / width[:-1], -1 / width[:-1] - 1 / width[1:], 1 / width[1:]
    for k, row in enumerate(rows):
        bands[0, k : n - 2 + k] += weight * row**2
    bands[1, : n - 2] += weight * rows[0] * rows[1]
    bands[1, 1 : n - 1] += weight * rows[1] * rows[2]
    bands[2, : n - 2] += weight * rows[0] * rows[2]
    bands[0] += ANCHOR_WEIGHT
    return bands, ANCHOR_WEIGHT * anchor


def _multiply(bands: FloatArray, x: FloatArray) -> FloatArray:
    """Return H x, (n,), for a symmetric matrix with the upper bands (3, n)."""
    product = bands[0] * x
    for k in (1, 2):
        product[:-k] += bands[k, :-k] * x[k:]
        product[k:] += bands[k, :-k] * x[:-k]
    return np.asarray(product)


def _solve(bands: FloatArray, diagonal: FloatArray, right: FloatArray) -> FloatArray:
    """Solve (H + diag) x = right, (n,)."""
    rows = np.ascontiguousarray(bands.T)
    rows[:, 0] += diagonal
    solution = right[:, None].copy()
    solve_banded(rows, solution)
    return solution[:, 0]


def _slide(
    arm: SerialArm, head: Head, poses: FloatArray, first: FloatArray, second: FloatArray
) -> FloatArray:
    """Return joint positions with given angles, whose slides bring the tool to its position."""
    q = np.zeros((len(poses), arm.dof))
    q[:, head.first] = first
    q[:, head.second] = second
    slides = np.flatnonzero(arm.chain.slides)
    gap = poses[:, :, 3] - arm.poses(q)[:, :, 3]
    directions = arm.jacobian(q)[:, :3][:, :, slides]
    q[:, slides] = np.linalg.solve(directions, gap[..., None])[..., 0]
    return q
