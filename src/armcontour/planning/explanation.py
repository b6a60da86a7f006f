"""Why a plan is not faster: which limit binds where, and how much runs at the assigned velocity."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from armcontour.core import checks
from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import checked
from armcontour.core.render import Result, number
from armcontour.core.result import TABLE, Data, Row, Table
from armcontour.motion import JointPath, Method, PathLaw, Trajectory
from armcontour.planning.common import with_reserve
from armcontour.planning.constraints import Constraint, IntervalEnds
from armcontour.planning.grid import Grid
from armcontour.planning.optimal import assigned_speeds
from armcontour.robot import Arm, Limits, resolve_limits
from armcontour.robot.limits import JOINT_LIMITS

# A limit binds on an interval from this used share on. Margins may take the rest; below this share
# the plan passes from one limit to another.
BINDS = 0.99
# Margins of wide intervals take more: next to an interval on which a limit binds it binds from this
# share on, as long as it is the limit that is used most, and on more intervals than a plan takes to
# pass from one limit to another.
BINDS_BESIDE, PASSES = 0.9, 2
# With limits of jerk it binds from this share on: its intervals are longer, and along one of them
# the share of a limit changes more.
BINDS_WITH_JERK = 0.9
# The assigned velocity counts as reached from this share of it on.
REACHED = 0.999
# The speed has passed an extreme when it has left the extreme by this share.
FLAT = 0.01
# What "nothing" is called for people.
BETWEEN = "between two limits"
# What takes time without being on a contour, by the kinds of moves.
RAPIDS, DWELLS = "rapids between contours", "dwells"
IDLE = {"rapid": RAPIDS, "dwell": DWELLS}
# What limits are called for people, in the order that decides between equal shares.
NAMES = {
    **{f"joint_{x}": x for x in ("torque", "velocity", "acceleration")},
    "speed": "assigned velocity",
    "centripetal_acceleration": "centripetal acceleration",
    "tool_acceleration": "tool acceleration",
    "angular_speed": "angular speed",
    "angular_acceleration": "angular acceleration",
    **{"joint_jerk": "jerk", "tool_jerk": "tool jerk", "path_jerk": "path jerk"},
}
# Fields of `_LawExplanation` that are added up over contours: lengths and times.
SUMMED = ("with_assigned", "reached")


@dataclass(frozen=True, slots=True, kw_only=True)
class Binding:
    """A part of the path on which one limit binds.

    Args:
        limit: Name of the limit, such as "acceleration" or "assigned velocity"; "nothing" where a
            plan passes from one limit to another.
        joint: Index of the joint, from 0, or None for a limit of the tool.
        t: Start and end times [s].
        s: Arc lengths of start and end [m].
        share: Largest used share of the limit on this part.
    """

    limit: str
    joint: int | None
    t: tuple[float, float]
    s: tuple[float, float]
    share: float

    @property
    def name(self) -> str:
        """The limit with its joint for messages, such as "joint 2 acceleration"."""
        return self.limit if self.joint is None else f"joint {self.joint + 1} {self.limit}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Shortfall:
    """An extreme of the tool speed below the assigned velocity, and the limit that causes it.

    Args:
        kind: "slowest" at a minimum of the speed, "fastest" at a maximum below the assigned
            velocity.
        s: Arc length of the extreme [m].
        speed: Tool speed there [m/s].
        assigned: The assigned velocity there [m/s].
        reason: The limit that binds there, such as "joint 2 acceleration".
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
    """Length and time for which one limit binds, or the time between contours.

    Args:
        kind: The limit, `BETWEEN`, `RAPIDS` or `DWELLS`.
        name: The limit with its joint; otherwise the kind.
        length: Length [m]; None off the contours.
        time: Time [s].
        of_length: Share of the length of all contours; None off the contours.
        of_time: Share of the duration of the motion.
        count: Number of parts of the path, or of moves.
    """

    kind: str
    name: str
    length: float | None
    time: float
    of_length: float | None
    of_time: float
    count: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Explanation(Result):
    """Which limits determine the duration of a plan.

    Args:
        bindings: The binding limits in order, from the start of the motion to its end.
        assigned_length: Share of the length at the assigned velocity, counted over the part of the
            path that has an assigned velocity; None if no part has one.
        assigned_time: Share of the time at the assigned velocity, counted over the same part; None
            if no part has one.
        shortfalls: Speed extremes below the assigned velocity, with their causes.
        jerk_stops: Arc lengths at which limits of jerk make the motion rest, because accelerations
            would jump there at any speed [m].
        idle: Durations of the moves between contours, by `RAPIDS` and `DWELLS` [s].
    """

    bindings: tuple[Binding, ...]
    assigned_length: float | None
    assigned_time: float | None
    shortfalls: tuple[Shortfall, ...]
    jerk_stops: tuple[float, ...] = ()
    idle: Mapping[str, tuple[float, ...]] = field(default_factory=dict)

    def __repr__(self) -> str:
        """The limits that bind, with their shares of the time."""
        shares = ", ".join(f"{x.name} {x.of_time:.0%}" for x in self.shares)
        stops = f"; {len(self.jerk_stops)} stops by jerk" if self.jerk_stops else ""
        return f"Explanation({shares}; {len(self.shortfalls)} shortfalls{stops})"

    def to_data(self) -> Data:
        """The shares at the assigned velocity, what binds, and places below it."""
        slowest = min(self.shortfalls, key=lambda x: x.speed / x.assigned, default=None)
        return Data(
            "Explanation",
            (
                Row("assigned_length", self.assigned_length, "1", "length at the assigned speed"),
                Row("assigned_time", self.assigned_time, "1"),
                Row("slowest", slowest and slowest.sentence, "", "slowest place"),
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
        """What takes the time, which report, page, print and files have alike."""
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
        """Share of the duration by the kinds of `shares`, of all joints together."""
        found: defaultdict[str, float] = defaultdict(float)
        for x in self.shares:
            found[x.kind] += x.of_time
        return dict(sorted(found.items(), key=lambda x: -x[1]))

    @property
    def longest(self) -> tuple[str, float] | None:
        """What takes the longest time, and its share; None if nothing is known."""
        return next(((x.name, x.of_time) for x in self.shares if x.name != BETWEEN), None)

    @property
    def shares(self) -> tuple[LimitShare, ...]:
        """What takes the time of the motion, the longest time first; all times add up to it."""
        sums: dict[tuple[str, str], FloatArray] = {}
        for x in self.bindings:
            key = (BETWEEN, BETWEEN) if x.limit == "nothing" else (x.limit, x.name)
            part = np.array([x.s[1] - x.s[0], x.t[1] - x.t[0], 1.0])
            sums[key] = sums.get(key, np.zeros(3)) + part
        length, time, _ = np.sum([np.zeros(3), *sums.values()], axis=0).tolist()
        time += sum(map(sum, self.idle.values()))
        rows = [(*key, *x.tolist()) for key, x in sums.items()]
        rows += [(key, key, None, sum(x), len(x)) for key, x in self.idle.items()]
        found = (
            LimitShare(
                kind=kind,
                name=name,
                length=its,
                time=t,
                of_length=None if its is None else its / (length or 1.0),
                of_time=t / (time or 1.0),
                count=int(count),
            )
            for kind, name, its, t, count in rows
        )
        return tuple(sorted(found, key=lambda x: -x.time))


@checked
def explain(
    trajectory: Trajectory,
    arm: Arm | Any,
    limits: Limits | None = None,
    *,
    constraints: Sequence[Constraint] = (),
) -> Explanation:
    """Explain which limit binds where on a plan of the method "optimal" or "shaped".

    Args:
        trajectory: The plan.
        arm: The arm that the plan was made for, or what has its `dof` and `limits`.
        limits: Limits in place of those of the plan, with which its reserve is taken off.
        constraints: The further constraints that the plan was made for.

    Raises:
        InvalidInput: The plan was made by another method, or is none.
    """
    reduced = trajectory.limits
    if reduced is not None:
        reduced = with_reserve(reduced, trajectory.reserve)
    bounds = resolve_limits("explain", arm, limits, reduced)
    constraints = checks.check_sequence("constraints", constraints, Constraint, "Constraints")
    laws: list[tuple[float, float, PathLaw]] = []
    stops: list[float] = []
    for x in trajectory.contour_spans:
        # Only the law of the method optimal has the grid intervals on which limits bind.
        law = None if x.trajectory is None else x.trajectory.laws[0]
        planned = trajectory.method in (Method.OPTIMAL, Method.SHAPED)
        if not planned or x.trajectory is None or not isinstance(law, PathLaw):
            raise InvalidInput(
                f"Only plans of the methods optimal and shaped can be explained, not of "
                f"{trajectory.method}."
            )
        laws.append((x.t[0], x.s[0], law))
        if bounds.jerk_limits:
            stops += (x.s[0] + find_jerk_stops(law.joint_path, x.trajectory)).tolist()
    found = _join([_explain_law(law, arm, bounds, constraints, (t, s)) for t, s, law in laws])
    idle: defaultdict[str, tuple[float, ...]] = defaultdict(tuple)
    for span in trajectory.spans:
        if span.kind in IDLE:
            idle[IDLE[span.kind]] += (span.t[1] - span.t[0],)
    return replace(found, jerk_stops=tuple(stops), idle=idle)


@dataclass(frozen=True, slots=True)
class _LawExplanation:
    """The explanation of one law.

    Args:
        bindings: The binding limits in order.
        shortfalls: Speed extremes below the assigned velocity.
        with_assigned: Length [m] and time [s] of the intervals that have an assigned velocity.
        reached: Length [m] and time [s] of the intervals at the assigned velocity.
    """

    bindings: tuple[Binding, ...]
    shortfalls: tuple[Shortfall, ...]
    with_assigned: tuple[float, float]
    reached: tuple[float, float]


def _join(parts: Sequence[_LawExplanation]) -> Explanation:
    """Join the explanations of all laws of a motion."""
    total, reached = (np.sum([getattr(x, name) for x in parts], axis=0) for name in SUMMED)
    shares = [None, None] if total[0] == 0 else (reached / total).tolist()
    return Explanation(
        bindings=tuple(x for part in parts for x in part.bindings),
        assigned_length=shares[0],
        assigned_time=shares[1],
        shortfalls=tuple(x for part in parts for x in part.shortfalls),
    )


def _explain_law(
    law: PathLaw,
    arm: Arm,
    bounds: Limits,
    constraints: Sequence[Constraint],
    offsets: tuple[float, float],
) -> _LawExplanation:
    """Explain one law; `offsets` are its start time [s] and start arc length [m] in the motion."""
    middle = (law.s[:-1] + law.s[1:]) / 2
    grid = Grid(law.joint_path, law.s, law.joint_path.locate(middle))
    ends = IntervalEnds(arm, law, grid)
    assigned = assigned_speeds(law.joint_path, bounds)[grid.piece]
    names: list[tuple[str, int | None]] = []
    used: list[FloatArray] = []
    reached = np.zeros(len(grid), dtype=bool)
    for limit, name in NAMES.items():
        if limit == "speed" and np.isfinite(assigned).any():
            speed, _ = ends.states.bound("speed")
            used.append((speed.reshape(-1, 2).max(axis=1) / assigned)[:, None])
            reached = (used[-1][:, 0] >= REACHED) & np.isfinite(assigned)
        elif limit != "speed" and getattr(bounds, limit) is not None:
            used.append(ends.largest_use(limit, bounds))
        else:
            continue
        joints = range(arm.dof) if limit in JOINT_LIMITS else (None,)
        names += [(name, x) for x in joints]
    for constraint in constraints:
        used.append(constraint.usage(ends))
        names += constraint.names
    shares = np.concatenate(used, axis=1)
    which = _find_binding(shares, BINDS_WITH_JERK if bounds.jerk_limits else BINDS)
    shortfalls = _shortfalls(law, assigned, reached, which, names)
    return _LawExplanation(
        _bindings(law, shares.max(axis=1), which, names, offsets),
        tuple(replace(x, s=offsets[1] + x.s) for x in shortfalls),
        _extent(law, np.isfinite(assigned)),
        _extent(law, reached),
    )


def _find_binding(shares: FloatArray, least: float) -> IntArray:
    """The column of the limit that binds on each interval, or -1, (n,).

    Args:
        shares: Used shares of all limits, (n, limits).
        least: From which share on a limit binds whatever its neighbours do.
    """
    share, most_used = shares.max(axis=1), shares.argmax(axis=1)
    certain = share >= least
    near = np.where(share >= min(least, BINDS_BESIDE), most_used, -1)
    starts, count = _runs(near)
    binds = np.repeat(np.maximum.reduceat(certain, starts), count)
    starts, count = _runs(2 * near + certain)
    return np.where(certain | (binds & (np.repeat(count, count) > PASSES)), near, -1)


def _runs(values: IntArray) -> tuple[IntArray, IntArray]:
    """Where runs of equal values start, and how long they are."""
    starts = np.append(0, np.flatnonzero(np.diff(values)) + 1)
    return starts, np.diff(np.append(starts, len(values)))


def find_jerk_stops(joint_path: JointPath, trajectory: Trajectory) -> FloatArray:
    """Where limits of jerk make a motion along one path rest, though its joint path has no stop.

    Args:
        joint_path: The joint path.
        trajectory: The motion along it.

    Returns:
        Arc lengths of breaks of the joint path [m].
    """
    places = np.setdiff1d(joint_path.breaks[1:-1], joint_path.stops)
    return np.asarray(places[trajectory.speed_at(places) == 0])


def _bindings(
    law: PathLaw,
    share: FloatArray,
    which: IntArray,
    names: list[tuple[str, int | None]],
    offsets: tuple[float, float],
) -> tuple[Binding, ...]:
    """Join neighbouring intervals on which the same limit binds.

    Args:
        law: The law.
        share: Largest used share of any limit on each interval, (n,).
        which: Index in `names` of the limit that binds on each interval, or -1, (n,).
        names: Name and joint number of each limit.
        offsets: Start time [s] and start arc length [m] of the law in the motion.
    """
    t_start, s_start = offsets
    edges = np.flatnonzero(np.diff(which)) + 1
    starts, ends = np.append(0, edges), np.append(edges, len(which))
    largest = np.maximum.reduceat(share, starts)
    found = []
    for i, k, most in zip(starts, ends, largest, strict=True):
        limit, joint = ("nothing", None) if which[i] < 0 else names[which[i]]
        t = (t_start + float(law.breaks[i]), t_start + float(law.breaks[k]))
        s = (s_start + float(law.s[i]), s_start + float(law.s[k]))
        found.append(Binding(limit=limit, joint=joint, t=t, s=s, share=float(most)))
    return tuple(found)


def _extent(law: PathLaw, where: BoolArray) -> tuple[float, float]:
    """Length [m] and time [s] of the intervals for which `where` is true."""
    return float(np.diff(law.s)[where].sum()), float(np.diff(law.breaks)[where].sum())


def _shortfalls(
    law: PathLaw,
    assigned: FloatArray,
    reached: BoolArray,
    which: IntArray,
    names: list[tuple[str, int | None]],
) -> tuple[Shortfall, ...]:
    """Extremes of the speed wherever it is below the assigned velocity, except for stops.

    Args:
        law: The law.
        assigned: Assigned velocity on each interval [m/s], infinite for none, (n,).
        reached: Whether each interval reaches the assigned velocity, (n,).
        which: Index in `names` of the limit that binds on each interval, or -1, (n,).
        names: Name and joint number of each limit.
    """
    speed = law.speeds
    # Between them the speed only rises, only falls or stays.
    turns = np.flatnonzero(np.diff(np.sign(np.diff(speed)))) + 1
    result = []
    reached = reached | ~np.isfinite(assigned)
    edges = np.flatnonzero(np.diff(np.concatenate([[1], reached, [1]]).astype(int)))
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        inner = turns[np.searchsorted(turns, first, side="right") : np.searchsorted(turns, last)]
        for i, k, kind in _turning_points(speed, int(first), [*inner.tolist(), int(last)]):
            if speed[i] == 0:
                continue
            # The limit that binds on most intervals at the extreme and next to it.
            near = which[max(i - 2, 0) : k + 2]
            near = near[near >= 0]
            reason = "the transition between two limits"
            if len(near):
                limit, joint = names[int(np.bincount(near).argmax())]
                reason = limit if joint is None else f"joint {joint + 1} {limit}"
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
    """Extremes of the speed between two points.

    An extreme is known once the speed has left it by the share `FLAT`. All points within `FLAT` of
    the extreme belong to it.

    Args:
        speed: Tool speed at the points [m/s].
        first: Index of the first point.
        points: Indices of the points at which the speed begins or ends to rise, fall or stay, and
            of the last point.

    Returns:
        First and last index of every extreme, and its kind: "fastest" or "slowest".
    """
    found: list[tuple[int, int, str]] = []
    rising: bool | None = None
    extreme = first
    for i in points:
        if rising is None:
            if abs(speed[i] - speed[extreme]) > FLAT * max(speed[i], speed[extreme]):
                rising, extreme = bool(speed[i] > speed[extreme]), i
            continue
        if (speed[i] > speed[extreme]) == rising:
            extreme = i
        elif abs(speed[i] - speed[extreme]) > FLAT * max(speed[i], speed[extreme]):
            off = np.abs(speed[first : i + 1] - speed[extreme]) > FLAT * speed[extreme]
            before, after = off[: extreme - first][::-1], off[extreme - first + 1 :]
            left = int(np.argmax(before)) if before.any() else len(before)
            right = int(np.argmax(after)) if after.any() else len(after)
            found.append((extreme - left, extreme + right, "fastest" if rising else "slowest"))
            rising, extreme = not rising, i
    return found
