"""Explanation of a plan: active limits, and the fraction at the assigned velocity."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from armcontour.core import checks
from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import checked
from armcontour.core.memory import content_key, is_remembering, recall, remember
from armcontour.core.progress import Progress, contour_step
from armcontour.core.render import Result, number
from armcontour.core.result import TABLE, Data, Row, Table
from armcontour.core.text import limit_label
from armcontour.motion import Method, PathLaw, Trajectory, arm_of
from armcontour.planning.constraints import FROM_LIMITS, Constraint, IntervalEnds, assigned_speeds
from armcontour.planning.path_grid import Grid
from armcontour.robot import Arm, Limits, resolve_limits
from armcontour.robot.limit_use import States
from armcontour.robot.limits import JOINT_RANGE, LIMITS, reduce_limits

# A limit is active on an interval if its used fraction is at least this. Margins of the planner may
# use the remainder. Below this fraction, the plan is in transition between two limits.
ACTIVE = 0.99
# Used fraction from which a limit is active next to an interval on which it is active anyway,
# because margins are larger on wide intervals.
ACTIVE_ADJACENT = 0.9
# Largest number of consecutive intervals of a transition between two limits. On more intervals in a
# row, the most used limit is active from the fraction ACTIVE_ADJACENT on.
MAX_TRANSITION = 2
# Value of ACTIVE for plans with limits of jerk. Their intervals are longer, so the used fraction of
# a limit changes more along an interval.
ACTIVE_WITH_JERK = 0.9
# The assigned velocity counts as reached from this fraction of it on.
REACHED = 0.999
# An extreme of the speed is confirmed once the speed differs from it by this fraction.
FLAT_SPEED = 0.01
# Number of intervals of short laws whose limit use is computed at once, which limits the memory.
INTERVALS_AT_ONCE = 8192
# Order of the jerk as a derivative of the joint positions. Limits of this order can be used most
# inside an interval.
JERK = 3
# Label of the parts with the limit "nothing".
BETWEEN = "between two limits"
# Label of the time of rapid moves.
RAPIDS = "rapids between contours"
# Label of the time of dwells.
DWELLS = "dwells"
# Labels of the time outside contours, by kind of move.
IDLE = {"rapid": RAPIDS, "dwell": DWELLS}
# Limits that an explanation considers, those of the default constraints first. If used fractions
# of two limits are equal, the first one is active.
DEFAULT_ORDER = [name for kind in FROM_LIMITS for name in kind.serves]
EXPLAINED = (*DEFAULT_ORDER, *(x for x in LIMITS if x not in (*DEFAULT_ORDER, *JOINT_RANGE)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Binding:
    """Part of the path on which one limit is active.

    Args:
        limit: Name of the limit, such as "acceleration" or "assigned velocity"; "nothing" in a
            transition between two limits.
        joint: Index of the joint, from 0, or None for a limit of the tool.
        t: Start and end times [s].
        s: Arc lengths of start and end [m].
        share: Largest used fraction of the limit on this part.
    """

    limit: str
    joint: int | None
    t: tuple[float, float]
    s: tuple[float, float]
    share: float

    @property
    def name(self) -> str:
        """The limit with its joint for messages, such as "joint 2 acceleration"."""
        return limit_label(self.limit, self.joint)


@dataclass(frozen=True, slots=True, kw_only=True)
class Shortfall:
    """Extreme of the tool speed below the assigned velocity, and the limit that causes it.

    Args:
        kind: "slowest" at a minimum of the speed, "fastest" at a maximum below the assigned
            velocity.
        s: Arc length of the extreme [m].
        speed: Tool speed at the extreme [m/s].
        assigned: Assigned velocity at the extreme [m/s].
        reason: Active limit at the extreme, such as "joint 2 acceleration".
    """

    kind: str
    s: float
    speed: float
    assigned: float
    reason: str

    @property
    def sentence(self) -> str:
        """The shortfall as one line of a report."""
        speed, assigned = (number(x, "m/s") for x in (self.speed, self.assigned))
        return f"{self.reason} at s = {number(self.s, 'm')}: {speed} of {assigned}"


@dataclass(frozen=True, slots=True, kw_only=True)
class LimitShare:
    """Length and time of parts with the same active limit, or time between contours."""

    # Transitions between limits, without an active limit, are a separate kind of part (`BETWEEN`).
    kind: str  # The limit, `BETWEEN`, `RAPIDS` or `DWELLS`
    name: str  # The limit with its joint; otherwise the kind
    length: float | None  # Length [m]; None between contours
    time: float  # Time [s]
    of_length: float | None  # Fraction of the length of all contours; None between contours
    of_time: float  # Fraction of the duration of the motion
    count: int  # Number of parts of the path, or of moves


# The class has no slots, because `shares` is cached.
@dataclass(frozen=True, kw_only=True)
class Explanation(Result):
    """Limits that determine the duration of a plan.

    Args:
        bindings: The active limits in order, from the start of the motion to its end.
        assigned_length: Fraction of the length at the assigned velocity, counted over the part of
            the path that has an assigned velocity; None if no part has one.
        assigned_time: Fraction of the time at the assigned velocity, counted over the same part;
            None if no part has one.
        shortfalls: Speed extremes below the assigned velocity, with their causes.
        jerk_stops: Arc lengths at which limits of jerk require a stop, because accelerations
            would jump at any speed [m].
        idle: Durations of the moves between contours, by `RAPIDS` and `DWELLS` [s].
    """

    bindings: tuple[Binding, ...]
    assigned_length: float | None
    assigned_time: float | None
    shortfalls: tuple[Shortfall, ...]
    jerk_stops: tuple[float, ...] = ()
    idle: Mapping[str, tuple[float, ...]] = field(default_factory=dict)

    def __repr__(self) -> str:
        """Write the active limits with their shares of the time."""
        shares = ", ".join(f"{x.name} {x.of_time:.0%}" for x in self.shares)
        stops = f"; {len(self.jerk_stops)} stops by jerk" if self.jerk_stops else ""
        return f"Explanation({shares}; {len(self.shortfalls)} shortfalls{stops})"

    @property
    def slowest(self) -> Shortfall | None:
        """The point that is slowest relative to its assigned velocity; None without shortfalls."""
        return min(self.shortfalls, key=lambda x: x.speed / x.assigned, default=None)

    def to_data(self) -> Data:
        """Return the shares at the assigned velocity, active limits, and speed extremes."""
        slowest = self.slowest
        return Data(
            "Explanation",
            (
                Row("assigned_length", self.assigned_length, "1", "length at the assigned speed"),
                Row("assigned_time", self.assigned_time, "1"),
                Row("slowest", slowest and slowest.sentence, "", "slowest point"),
                Row("jerk_stops", len(self.jerk_stops) or None, "", "stops by limits of jerk"),
            ),
            (
                self.time_table,
                Table(
                    "bindings",
                    (
                        *(Row("limit", None), Row("joint", None), Row("t", None, "s")),
                        *(Row("s", None, "m"), Row("share", None, "1")),
                    ),
                    [
                        (x.limit, None if x.joint is None else x.joint + 1, x.t, x.s, x.share)
                        for x in self.bindings
                    ],
                ),
                Table(
                    "shortfalls",
                    (
                        *(Row("kind", None), Row("s", None, "m"), Row("speed", None, "m/s")),
                        *(Row("assigned", None, "m/s"), Row("reason", None)),
                    ),
                    [(x.kind, x.s, x.speed, x.assigned, x.reason) for x in self.shortfalls],
                ),
            ),
        )

    @property
    def time_table(self) -> Table:
        """Table of time, length and count for each active limit and each kind of move."""
        return Table(
            "time",
            (
                *(Row("kind", None), Row("name", None, "", "what takes the time")),
                *(Row("time", None, "s", "time"), Row("of_time", None, "1", "of the time")),
                *(Row("length", None, "m", "length"), Row("count", None, "", "parts")),
                Row("of_length", None, "1"),
            ),
            [
                (x.kind, x.name, x.time, x.of_time, x.length, x.count, x.of_length)
                for x in self.shares
            ],
            TABLE,
        )

    @property
    def kinds(self) -> dict[str, float]:
        """Fraction of the duration by limit (of all joints) or kind of move, the largest first."""
        shares: defaultdict[str, float] = defaultdict(float)
        for share in self.shares:
            shares[share.kind] += share.of_time
        return dict(sorted(shares.items(), key=lambda x: -x[1]))

    @property
    def longest(self) -> tuple[str, float] | None:
        """Limit or kind of move with the longest time, with its fraction; None if there is none."""
        return next(((x.name, x.of_time) for x in self.shares if x.name != BETWEEN), None)

    @cached_property
    def shares(self) -> tuple[LimitShare, ...]:
        """Time of each limit and each kind of move, the longest first; the sum is the duration."""
        # Length [m], time [s] and number of parts by kind and name
        sums: dict[tuple[str, str], list[float]] = {}
        for binding in self.bindings:
            if binding.limit == "nothing":
                key = (BETWEEN, BETWEEN)
            else:
                key = (binding.limit, binding.name)
            total = sums.setdefault(key, [0.0, 0.0, 0.0])
            total[0] += binding.s[1] - binding.s[0]
            total[1] += binding.t[1] - binding.t[0]
            total[2] += 1
        length = sum(x[0] for x in sums.values())
        time = sum(x[1] for x in sums.values()) + sum(map(sum, self.idle.values()))
        rows: list[Any] = [(*key, *x) for key, x in sums.items()]
        rows += [(key, key, None, sum(x), len(x)) for key, x in self.idle.items()]
        limit_shares = []
        for kind, name, part_length, t, count in rows:
            share = LimitShare(
                kind=kind,
                name=name,
                length=part_length,
                time=t,
                of_length=None if part_length is None else part_length / (length or 1.0),
                of_time=t / (time or 1.0),
                count=int(count),
            )
            limit_shares.append(share)
        return tuple(sorted(limit_shares, key=lambda x: -x.time))


@checked
def explain(
    trajectory: Trajectory,
    arm: Arm | Any | None = None,
    limits: Limits | None = None,
    *,
    constraints: Sequence[Constraint] = (),
) -> Explanation:
    """Determine the active limit at each point of a plan of the method "optimal" or "shaped".

    >>> ac.explain(planned, arm, limits)
    Explanation(joint 2 acceleration 74%, centripetal acceleration 16%, ...)

    Args:
        trajectory: The plan.
        arm: The arm that the plan was made for, or any object with its `dof` and `limits`; by
            default the arm of the plan.
        limits: Limits that replace those of the plan, which include its reserve.
        constraints: Additional constraints that the plan was made for.

    Raises:
        InvalidInput: The trajectory is not a plan of the method "optimal" or "shaped", or it was
            stretched, so that no limit is active.
    """
    return explain_all(trajectory, arm, limits, constraints=constraints)


def explain_all(
    trajectory: Trajectory,
    arm: Arm | Any | None = None,
    limits: Limits | None = None,
    *,
    constraints: Sequence[Constraint] = (),
    progress: Progress | None = None,
) -> Explanation:
    """Explain a plan as `explain` does.

    `progress`: called after every contour with the step "explanation" and the fraction done.
    """
    arm = arm_of(trajectory, arm)
    if trajectory.speed_factor != 1.0:
        raise InvalidInput(
            f"This plan was stretched to {100 * trajectory.speed_factor:.6g} % of its speed, so "
            "that no limit determines its speed. Explain the plan before `stretched`."
        )
    reduced = trajectory.limits
    if reduced is not None:
        reduced = reduce_limits(reduced, trajectory.reserve)
    bounds = resolve_limits("explain", arm, limits, reduced)
    constraints = checks.check_sequence("constraints", constraints, Constraint, "Constraints")
    laws: list[tuple[float, float, PathLaw]] = []
    stops = find_jerk_stops(trajectory).tolist() if bounds.limits_jerk else ()
    for x in trajectory.contour_spans:
        # Only laws of the methods "optimal" and "shaped" have the grid intervals of the limits.
        law = None if x.trajectory is None else x.trajectory.laws[0]
        planned = trajectory.method in (Method.OPTIMAL, Method.SHAPED)
        if not planned or x.trajectory is None or not isinstance(law, PathLaw):
            raise InvalidInput(
                f"Only plans of the methods optimal and shaped can be explained, not of "
                f"{trajectory.method}."
            )
        laws.append((x.t[0], x.s[0], law))
    key: tuple[Hashable, ...] = ()
    if is_remembering():
        key = arm, content_key(bounds), *constraints
    parts: list[_LawExplanation] = []
    for batch in _batches([law for *_, law in laws]):
        for part in _explain_batch(batch, key, arm, bounds, constraints):
            t, s, _ = laws[len(parts)]
            parts.append(part.moved(t, s))
            if progress is not None:
                progress(contour_step("explanation", len(parts), len(laws)))
    explanation = _join(parts)
    idle: defaultdict[str, tuple[float, ...]] = defaultdict(tuple)
    for span in trajectory.spans:
        if span.kind in IDLE:
            idle[IDLE[span.kind]] += (span.t[1] - span.t[0],)
    return replace(explanation, jerk_stops=tuple(stops), idle=idle)


@dataclass(frozen=True, slots=True)
class _LawExplanation:
    """Explanation of one law."""

    bindings: tuple[Binding, ...]
    shortfalls: tuple[Shortfall, ...]  # Speed extremes below the assigned velocity
    # Length [m] and time [s] of the intervals that have an assigned velocity
    with_assigned: tuple[float, float]
    # Length [m] and time [s] of the intervals at the assigned velocity
    reached: tuple[float, float]

    def moved(self, t: float, s: float) -> _LawExplanation:
        """Return the explanation if the law starts at a time [s] and an arc length [m]."""
        bindings = []
        for x in self.bindings:
            times = (t + x.t[0], t + x.t[1])
            lengths = (s + x.s[0], s + x.s[1])
            bindings.append(replace(x, t=times, s=lengths))
        shortfalls = tuple(replace(x, s=s + x.s) for x in self.shortfalls)
        return replace(self, bindings=tuple(bindings), shortfalls=shortfalls)


def _join(parts: Sequence[_LawExplanation]) -> Explanation:
    """Join the explanations of all laws, in the order of the motion."""
    total = np.sum([x.with_assigned for x in parts], axis=0)
    reached = np.sum([x.reached for x in parts], axis=0)
    shares = [None, None] if total[0] == 0 else (reached / total).tolist()
    return Explanation(
        bindings=tuple(x for part in parts for x in part.bindings),
        assigned_length=shares[0],
        assigned_time=shares[1],
        shortfalls=tuple(x for part in parts for x in part.shortfalls),
    )


def _batches(laws: Sequence[PathLaw]) -> Iterator[list[PathLaw]]:
    """Yield successive laws in batches whose limit use is computed at once."""
    batch: list[PathLaw] = []
    count = 0
    for law in laws:
        intervals = len(law.breaks) - 1
        if batch and count + intervals > INTERVALS_AT_ONCE:
            yield batch
            batch = []
            count = 0
        batch.append(law)
        count += intervals
    yield batch


def _explain_batch(
    laws: Sequence[PathLaw],
    key: tuple[Hashable, ...],
    arm: Arm,
    bounds: Limits,
    constraints: Sequence[Constraint],
) -> list[_LawExplanation]:
    """Explain laws, with times and arc lengths from their starts; known explanations are recalled.

    - `key`: what an explanation depends on besides the law.
    """
    explained: dict[PathLaw, _LawExplanation] = {}
    new = []
    for law in dict.fromkeys(laws):
        known = recall(("explanation", law, *key))
        if known is None:
            new.append(law)
        else:
            explained[law] = known
    if new:
        for law, part in zip(new, _explain_laws(new, arm, bounds, constraints), strict=True):
            remember(("explanation", law, *key), part)
            explained[law] = part
    return [explained[law] for law in laws]


def _explain_laws(
    laws: Sequence[PathLaw],
    arm: Arm,
    bounds: Limits,
    constraints: Sequence[Constraint],
) -> Iterator[_LawExplanation]:
    """Yield the explanation of each law, with times and arc lengths from its start."""
    ends = [ends_of_law(law, arm) for law in laws]
    assigned_of = [assigned_speeds(x.grid.joint_path, bounds)[x.grid.piece] for x in ends]
    assigned = np.concatenate(assigned_of)
    columns = zip(*(x.states.columns for x in ends), strict=True)
    states = States(arm, [np.concatenate(x) for x in columns])
    names: list[tuple[str, int | None]] = []
    used: list[FloatArray] = []
    reached = np.zeros(len(assigned), dtype=bool)
    for limit in EXPLAINED:
        if limit == "speed" and np.isfinite(assigned).any():
            speed, _ = states.measure("speed")
            used.append((speed.reshape(-1, 2).max(axis=1) / assigned)[:, None])
            reached = (used[-1][:, 0] >= REACHED) & np.isfinite(assigned)
        elif limit == "speed" or getattr(bounds, limit) is None:
            continue
        elif LIMITS[limit].order < JERK:
            # It is largest at an end of each interval.
            ratio = states.use(limit, bounds).ratio.reshape(len(assigned), 2, -1)
            used.append(np.maximum(ratio[:, 0], ratio[:, 1]))
        else:
            used.append(np.concatenate([x.largest_jerk_use(limit, bounds) for x in ends]))
        joints = range(arm.dof) if LIMITS[limit].kind == "joint" else (None,)
        names += [(LIMITS[limit].label, x) for x in joints]
    # Rows of limits are compared faster than columns.
    shares = np.concatenate([x.T for x in used])
    end = 0
    for one, assigned in zip(ends, assigned_of, strict=True):
        part = slice(end, end + len(assigned))
        end = part.stop
        yield _explain_law(
            one, shares[:, part], names, assigned, reached[part], bounds, constraints
        )


def ends_of_law(law: PathLaw, arm: Arm) -> IntervalEnds:
    """Return the motion of a law at the ends of its intervals."""
    middle = (law.s[:-1] + law.s[1:]) / 2
    return IntervalEnds(arm, law, Grid(law.joint_path, law.s, law.joint_path.locate(middle)))


def _explain_law(
    ends: IntervalEnds,
    shares: FloatArray,
    names: list[tuple[str, int | None]],
    assigned: FloatArray,
    reached: BoolArray,
    bounds: Limits,
    constraints: Sequence[Constraint],
) -> _LawExplanation:
    """Explain one law, with times and arc lengths from its start.

    - `shares`: largest used fraction of each limit on each interval, (limits, n).
    - `names`: limit and joint of each row of `shares`.
    - `assigned`, `reached`: as in `_shortfalls`.
    """
    law = ends.law
    if constraints:
        # A limit of the run that is also used up is the cause, not a slightly stricter constraint.
        free = shares.max(axis=0) < ACTIVE
        shares = np.concatenate([shares, *(x.usage(ends).T * free for x in constraints)])
        names = [*names, *(name for x in constraints for name in x.names)]
    limit_index = _find_active(shares, ACTIVE_WITH_JERK if bounds.limits_jerk else ACTIVE)
    shortfalls = _shortfalls(law, assigned, reached, limit_index, names)
    return _LawExplanation(
        _bindings(law, shares.max(axis=0), limit_index, names),
        shortfalls,
        _measure_extent(law, np.isfinite(assigned)),
        _measure_extent(law, reached),
    )


def _find_active(shares: FloatArray, threshold: float) -> IntArray:
    """Return the column of the active limit on each interval, (n,); -1 for none.

    `shares` are the used fractions, (limits, n).

    A limit is active from the fraction `threshold` on, regardless of neighbouring intervals.
    """
    share = shares.max(axis=0)
    most_used = shares.argmax(axis=0)
    certain = share >= threshold
    candidates = np.where(share >= min(threshold, ACTIVE_ADJACENT), most_used, -1)
    starts, count = _runs(candidates)
    binds = np.repeat(np.maximum.reduceat(certain, starts), count)
    starts, count = _runs(2 * candidates + certain)
    return np.where(certain | (binds & (np.repeat(count, count) > MAX_TRANSITION)), candidates, -1)


def _runs(values: IntArray) -> tuple[IntArray, IntArray]:
    """Find runs of equal values; return where each starts and how long it is."""
    starts = np.append(0, np.flatnonzero(np.diff(values)) + 1)
    return starts, np.diff(np.append(starts, len(values)))


def find_jerk_stops(trajectory: Trajectory) -> FloatArray:
    """Return the arc lengths of full stops that only the jerk limits cause [m]."""
    stops = [np.empty(0)]
    for span in trajectory.contour_spans:
        if span.trajectory is not None and isinstance(law := span.trajectory.laws[0], PathLaw):
            breaks = np.setdiff1d(law.joint_path.breaks[1:-1], law.joint_path.stops)
            stops.append(span.s[0] + breaks[span.trajectory.speed_at(breaks) == 0])
    return np.concatenate(stops)


def _bindings(
    law: PathLaw,
    share: FloatArray,
    limit_index: IntArray,
    names: list[tuple[str, int | None]],
) -> tuple[Binding, ...]:
    """Return the parts of a law with the same active limit, in order, from its start.

    - `share`: largest used fraction of a limit on each interval, (n,).
    - `limit_index`, `names`: as in `_shortfalls`.
    """
    starts, count = _runs(limit_index)
    largest = np.maximum.reduceat(share, starts)
    bindings = []
    for first, end, largest_share in zip(starts, starts + count, largest, strict=True):
        limit, joint = ("nothing", None) if limit_index[first] < 0 else names[limit_index[first]]
        t = (float(law.breaks[first]), float(law.breaks[end]))
        s = (float(law.s[first]), float(law.s[end]))
        bindings.append(Binding(limit=limit, joint=joint, t=t, s=s, share=float(largest_share)))
    return tuple(bindings)


def _measure_extent(law: PathLaw, mask: BoolArray) -> tuple[float, float]:
    """Return the total length [m] and time [s] of the selected intervals."""
    return float(np.diff(law.s)[mask].sum()), float(np.diff(law.breaks)[mask].sum())


def _shortfalls(
    law: PathLaw,
    assigned: FloatArray,
    reached: BoolArray,
    limit_index: IntArray,
    names: list[tuple[str, int | None]],
) -> tuple[Shortfall, ...]:
    """Find the extremes of the speed below the assigned velocity, except stops.

    - `assigned`: assigned velocity on each interval [m/s], (n,); infinite if none.
    - `reached`: mask of the intervals at the assigned velocity, (n,).
    - `limit_index`: column of the active limit on each interval, (n,); -1 for none.
    - `names`: limit and joint of each column.
    """
    speed = law.speeds
    # Between these points the speed is monotonic.
    turns = np.flatnonzero(np.diff(np.sign(np.diff(speed)))) + 1
    result = []
    reached = reached | ~np.isfinite(assigned)
    edges = np.flatnonzero(np.diff(np.concatenate([[1], reached, [1]]).astype(int)))
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        inner = turns[np.searchsorted(turns, first, side="right") : np.searchsorted(turns, last)]
        for i, k, kind in _turning_points(speed, int(first), [*inner.tolist(), int(last)]):
            if speed[i] == 0:
                continue
            # The reason is the limit that is active on most intervals at the extreme and next to
            # it.
            neighbours = limit_index[max(i - 2, 0) : k + 2]
            neighbours = neighbours[neighbours >= 0]
            reason = "the transition between two limits"
            if len(neighbours):
                reason = limit_label(*names[int(np.bincount(neighbours).argmax())])
            middle = (i + k) // 2
            result.append(
                Shortfall(
                    kind=kind,
                    s=float((law.s[i] + law.s[k]) / 2),
                    speed=float(speed[middle]),
                    assigned=float(assigned[min(middle, len(assigned) - 1)]),
                    reason=reason,
                )
            )
    return tuple(result)


def _turning_points(speed: FloatArray, first: int, points: list[int]) -> list[tuple[int, int, str]]:
    """Find the first and last index of each speed extreme, and its kind: "fastest" or "slowest".

    An extreme is confirmed once the speed differs from it by the fraction `FLAT_SPEED`. All points
    within `FLAT_SPEED` belong to it.

    `points` are the indices at which the sign of the slope changes, and the index of the last
    point.
    """
    extremes: list[tuple[int, int, str]] = []
    rising: bool | None = None
    begin = extreme = first
    # Numbers of a list are compared faster than those of an array.
    extreme_speed = float(speed[first])
    for i, value in zip(points, speed[points].tolist(), strict=True):
        differs = abs(value - extreme_speed) > FLAT_SPEED * max(value, extreme_speed)
        if rising is None:
            if differs:
                rising = value > extreme_speed
                extreme = i
                extreme_speed = value
            continue
        if (value > extreme_speed) == rising:
            extreme = i
            extreme_speed = value
        elif differs:
            outside = np.abs(speed[begin : i + 1] - extreme_speed) > FLAT_SPEED * extreme_speed
            before = outside[: extreme - begin][::-1]
            after = outside[extreme - begin + 1 :]
            first_index = int(np.argmax(before)) if before.any() else len(before)
            last_index = int(np.argmax(after)) if after.any() else len(after)
            extremes.append(
                (extreme - first_index, extreme + last_index, "fastest" if rising else "slowest")
            )
            # The speed at this extreme differs from that at the next one.
            begin = extreme
            rising = not rising
            extreme = i
            extreme_speed = value
    return extremes
