"""`Paper`: the timing of the paper, Sec. III-A.

Lines have maximum joint acceleration. Corners are arcs at one speed, (16)-(17). If a line is too
short to reach the speed of a corner or to brake to it, the speed of that corner is reduced to a
value that the line can reach; the paper has no rule for this case.

A line begins with MAC, the maximum joint acceleration, has AVC, the assigned velocity, in the
middle, and ends with MDC, the maximum deceleration. Two passes run along the line, one from each
end, until a joint limit would be violated. Each pass is used up to the knot at which it reaches the
assigned velocity, (23). Between those knots the tool moves with uniform acceleration, (24)-(25). If
the passes meet below the assigned velocity, one interval of uniform tool acceleration joins them;
the paper has no rule for this case.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput, NotRealizable
from armcontour.core.fields import declared
from armcontour.core.kernel_cache import compiled
from armcontour.core.quantities import NO_KEY, AtLeast, Interval
from armcontour.geometry import Path
from armcontour.motion import (
    DEFAULT_CYCLE,
    JointPath,
    LawAlongPath,
    LawPhase,
    Method,
    Trajectory,
    check_cycle,
)
from armcontour.paper.laws import LineLaw, law_peaks, path_law, require_speed, tool_path_of
from armcontour.planning import PlanOptions
from armcontour.planning.law_checks import check_limits, law_states
from armcontour.robot import Arm, Limits

# The tool speed is not computed from a joint that is slower than this share of the fastest joint.
MIN_JOINT_SPEED = 0.01
# An interval next to a rest is divided into this many parts, because the speed changes much in it.
PARTS_AT_REST = 10
# Limits that the method guarantees; all others are checked on every part.
GUARANTEED = ("speed", "centripetal_acceleration")
# Rounding error of the difference of two joint positions, as a fraction of the position's magnitude
# plus SMALL_POSITION [rad].
POSITION_ROUNDING = 8e-16
SMALL_POSITION = 1e-3
# Fraction of an acceleration limit by which rounding errors may exceed it.
LIMIT_ROUNDING = 1e-9
# Fraction of a speed by which rounding errors may exceed it.
SPEED_ROUNDING = 1e-12
# Smallest number of intervals per line of the paper's method. With fewer, a short line from rest to
# rest has none left for its motion.
FEWEST_LAPS = 8
# Largest number of intervals per line of the paper's method, which needs several GB for an arm with
# six joints.
MAX_LAPS = 5_000_000


@declared(eq=False)
class Paper(PlanOptions):
    """Options of the paper's method for lines and arcs, in addition to those of `PlanOptions`.

    >>> straight = ac.Path.polyline([(0.30, 0.20), (0.33, 0.20)])
    >>> ac.plan(straight, arm, limits, ac.Paper(knots=10)).method
    <Method.PAPER: 'paper'>

    Args:
        knots: Intervals of equal length per line. By default the distance between knots is at most
            the travel of the tool in one cycle at the assigned velocity. An interval next to a rest
            is subdivided.
        cycle: Cycle [s].

    Raises:
        InvalidInput: A value of the wrong type or out of range.
    """

    method = Method.PAPER
    only_arcs = True
    knots: Annotated[int, AtLeast(FEWEST_LAPS, MAX_LAPS)] | None = None
    cycle: Annotated[Interval, NO_KEY] = DEFAULT_CYCLE

    def _check_together(self) -> None:
        check_cycle(self.cycle)

    def time(self, joint_path: JointPath, arm: Arm, limits: Limits) -> Trajectory:
        """Plan the motion along a contour by the paper's method."""
        return plan_paper(joint_path, arm, limits, self)

    def at_cycle(self, cycle: float) -> Paper:
        """Return the options with the distance between knots for a cycle."""
        return replace(self, cycle=cycle)


@compiled()
def run_laps(
    q: FloatArray, dq_ds: FloatArray, speed: float, limit: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, int, int, float]:
    """Move from the first knot towards the last as fast as (18)-(20) of the paper allow.

    The paper does not state the velocity at the start of an interval. If every joint continued with
    `dq + ddq h`, a velocity error of a joint that does not determine h would alternate from
    interval to interval, and the acceleration that it causes would grow as 1 / h. Therefore only
    the joint that determines h continues with its velocity. The other joints get their velocities
    from the path by (28); the step in these velocities is of second order in h. In (18), d is the
    magnitude of a joint's step and w its velocity towards the next knot.

    Returns durations h of the intervals [s], (n,); tool speeds at the knots [m/s], (n + 1,), NaN
    beyond the last valid interval; joint velocities at the start of the intervals and joint
    accelerations in them, (n, dof) each; the number of valid intervals; and for the first invalid
    interval the joint, from 0 (-1 if none), and the acceleration that this joint would need.

    - `q`: joint positions at the knots [rad], (n + 1, dof).
    - `dq_ds`: derivatives of q along the path, of the same shape.
    - `speed`: tool speed at the first knot [m/s].
    - `limit`: largest joint accelerations [rad/s²], (dof,).
    """
    n = len(q) - 1
    dof = q.shape[1]
    h = np.empty(n)
    speeds = np.full(n + 1, np.nan)
    velocity = np.empty((n, dof))
    acceleration = np.empty((n, dof))
    speeds[0] = speed
    for k in range(n):
        longest = 0.0
        slowest = -1
        for j in range(dof):
            step = q[k + 1, j] - q[k, j]
            w = dq_ds[k, j] * speeds[k]
            velocity[k, j] = w
            # (18): shortest time in which the joint makes its step.
            if step == 0.0:
                time = 2.0 * abs(w) / limit[j]
            else:
                if step < 0.0:
                    w = -w
                root = math.sqrt(w * w + 2.0 * limit[j] * abs(step))
                # For w > 0, 2 d / (w + root) is equal to (18) and has no cancellation.
                time = 2.0 * abs(step) / (w + root) if w > 0.0 else (root - w) / limit[j]
            # (19): the slowest joint determines the duration.
            if time > longest:
                longest = time
                slowest = j
        h[k] = longest
        fastest = 0.0
        # (20): acceleration with which each joint makes its step in this duration.
        for j in range(dof):
            step = q[k + 1, j] - q[k, j]
            needed = 2.0 * (step - velocity[k, j] * longest) / (longest * longest)
            rounding = POSITION_ROUNDING * (abs(q[k, j]) + SMALL_POSITION) / (longest * longest)
            if j != slowest and abs(needed) > limit[j] * (1 + LIMIT_ROUNDING) + rounding:
                return h, speeds, velocity, acceleration, k, j, abs(needed)
            if abs(needed) > limit[j]:
                needed = math.copysign(limit[j], needed)
            acceleration[k, j] = needed
            fastest = max(fastest, abs(dq_ds[k + 1, j]))
        # Tool speed at the next knot, from the velocity of the joint that continues with it.
        continuing = slowest
        if abs(dq_ds[k + 1, continuing]) < MIN_JOINT_SPEED * fastest:
            for j in range(dof):
                if abs(dq_ds[k + 1, j]) == fastest:
                    continuing = j
        end_velocity = velocity[k, continuing] + acceleration[k, continuing] * longest
        speeds[k + 1] = max(end_velocity / dq_ds[k + 1, continuing], 0.0)
    return h, speeds, velocity, acceleration, n, -1, 0.0


@dataclass(frozen=True, slots=True)
class Pass:
    """Motion along a line from one end with maximum joint acceleration; knots in order of time."""

    durations: FloatArray  # Durations of the intervals [s], (n,)
    speed: FloatArray  # Tool speed at the knots [m/s], (n + 1,); NaN after the last valid interval
    dq: FloatArray  # Joint velocities at the start of the intervals [rad/s], (n, dof)
    ddq: FloatArray  # Joint accelerations in the intervals [rad/s²], (n, dof)
    valid_count: int  # Number of intervals that satisfy the limit
    joint: int  # Joint that would exceed the limit in the next interval, from 0; -1 for no joint
    needed: float  # Acceleration that this joint would need [rad/s²]

    def last_within(self, speed: float) -> int:
        """Return the index of the last knot before the tool speed first exceeds `speed` [m/s]."""
        valid_speeds = self.speed[: self.valid_count + 1]
        faster = np.flatnonzero(valid_speeds > speed * (1 + SPEED_ROUNDING))
        return max(int(faster[0]) - 1, 0) if len(faster) else self.valid_count


@dataclass(frozen=True, slots=True)
class LinePhase:
    """Time law on a part of a line, and the rule of the paper that determines it."""

    law: LawAlongPath
    kind: str  # Rule: "MAC", "AVC" or "MDC"; "meeting" for the interval between MAC and MDC
    s: tuple[float, float]  # Arc lengths of start and end on the path [m]
    # For a meeting interval, time [s] and arc length [m] from its start to the point where both
    # passes have the same speed
    meeting_point: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True, slots=True)
class RulePart:
    """A part of a line, or a corner, that is planned by one rule of the paper."""

    name: str  # Name of the line or corner, such as "line 1"
    kind: str  # Rule: "MAC", "AVC", "MDC" or "corner"
    duration: float  # Duration [s]
    s: tuple[float, float]  # Arc lengths of start and end on the path [m]
    laws: list[LawAlongPath]  # The complete laws that contain the part


def parts_by_rule(name: str, phases: list[LinePhase]) -> list[RulePart]:
    """Return the parts of a line by rule, in order; neighbouring phases of one rule are joined.

    A meeting interval is MAC up to the point where both passes have the same speed, then MDC.

    - `name`: name of the line, such as "line 1".
    """
    parts = []
    for phase in phases:
        duration = float(phase.law.breaks[-1])
        if phase.kind != "meeting":
            parts.append(RulePart(name, phase.kind, duration, phase.s, [phase.law]))
            continue
        mac_duration, mac_length = phase.meeting_point
        middle = phase.s[0] + mac_length
        mdc_duration = duration - mac_duration
        parts.append(RulePart(name, "MAC", mac_duration, (phase.s[0], middle), [phase.law]))
        parts.append(RulePart(name, "MDC", mdc_duration, (middle, phase.s[1]), [phase.law]))
    joined: list[RulePart] = []
    for part in parts:
        if joined and joined[-1].kind == part.kind:
            last = joined.pop()
            part = RulePart(
                name,
                part.kind,
                last.duration + part.duration,
                (last.s[0], part.s[1]),
                last.laws + part.laws,
            )
        joined.append(part)
    return joined


class PaperLine:
    """A straight segment of a traced path, with its knots."""

    def __init__(
        self,
        *,
        name: str,  # Name for messages, such as "line 1"
        joint_path: JointPath,  # The joint path that contains the line
        arm: Arm,
        limit: FloatArray,  # Joint acceleration limits [rad/s²], (dof,)
        s: FloatArray,  # Arc lengths of the knots [m], (n + 1,)
        assigned: float,  # Assigned velocity on the line [m/s]
    ) -> None:
        self.name = name
        self.joint_path = joint_path
        self.arm = arm
        self.limit = limit
        self.s = s
        self.assigned = assigned
        path = tool_path_of(joint_path, "paper")
        self.point = path(s[0])
        self.direction = path(s[0], 1)
        self.q = joint_path(s)
        # The derivatives at both ends are one-sided, because the path may turn there.
        before = joint_path(s[-1:], 1, side="left")
        after = joint_path(s[:-1], 1)
        self.dq_ds = np.concatenate([after, before])

    def forward(self, speed: float) -> Pass:
        """Return the pass from the start of the line, where the tool speed is `speed` [m/s]."""
        return Pass(*run_laps(self.q, self.dq_ds, speed, self.limit))

    def reverse(self, speed: float) -> Pass:
        """Return the pass backwards in time from the end of the line at `speed` [m/s]."""
        return Pass(*run_laps(self.q[::-1].copy(), -self.dq_ds[::-1], speed, self.limit))

    def final_speed(self, line_pass: Pass) -> float:
        """Return the tool speed at the end of a pass [m/s]; infinite if a limit ends it earlier."""
        last = line_pass.last_within(self.assigned)
        is_whole = line_pass.joint < 0 and last == len(self.s) - 1
        return float(line_pass.speed[-1]) if is_whole else np.inf

    def plan(self, start: float, end: float) -> list[LinePhase]:
        """Plan the line from the tool speed `start` to the tool speed `end` [m/s]."""
        forward = self.forward(start)
        reverse = self.reverse(end)
        n = len(self.s) - 1
        backward_speeds = reverse.speed[::-1]  # Speeds of the reverse pass in the order of the path
        # MAC ends at the knot `mac_end`, and MDC begins at the knot `mdc_start`.
        mac_end = forward.last_within(self.assigned)
        mdc_start = n - reverse.last_within(self.assigned)
        meeting = False
        if mdc_start <= mac_end:
            mac_end = _last_slower_knot(forward.speed, backward_speeds, mdc_start, mac_end)
            mdc_start = mac_end + 1
            if 0 <= mac_end and mdc_start <= n:
                meeting = True
                mac_end, mdc_start = self._find_meeting(
                    mac_end, mdc_start, forward.speed, backward_speeds
                )
        else:
            self._refuse_incomplete_pass(forward, mac_end, reverse, n - mdc_start)
        phases = []
        if mac_end > 0:
            phases.append(self._make_mac(forward, mac_end))
        low = max(mac_end, 0)
        if low < mdc_start <= n:
            middle = self._make_middle(low, mdc_start, forward.speed, backward_speeds, meeting)
            phases.append(middle)
        if mdc_start < n:
            phases.append(self._make_mdc(reverse, mdc_start))
        return phases

    def _make_mac(self, forward: Pass, last: int) -> LinePhase:
        """Return the phase of the forward pass from the first knot to the knot `last`."""
        return self._make_phase(
            "MAC", 0, last, forward.durations[:last], forward.dq[:last], forward.ddq[:last]
        )

    def _make_mdc(self, reverse: Pass, first: int) -> LinePhase:
        """Return the phase of the reverse pass from the knot `first` to the end, in path order."""
        count = len(self.s) - 1 - first
        durations = reverse.durations[:count]
        end_velocities = reverse.dq[:count] + reverse.ddq[:count] * durations[:, None]
        return self._make_phase(
            "MDC",
            first,
            len(self.s) - 1,
            durations[::-1],
            -end_velocities[::-1],
            reverse.ddq[:count][::-1],
        )

    def _make_phase(
        self,
        kind: str,  # Rule of the paper, such as "MAC"
        first: int,  # Index of the first knot
        last: int,  # Index of the last knot
        durations: FloatArray,  # Durations of the n intervals between these knots [s], (n,)
        dq: FloatArray,  # Joint velocities at the starts of the intervals [rad/s], (n, dof)
        ddq: FloatArray,  # Joint accelerations in the intervals [rad/s²], (n, dof)
    ) -> LinePhase:
        """Return a phase with uniform joint accelerations between knots, (21)."""
        ends = (float(self.s[first]), float(self.s[last]))
        law = LineLaw(
            breaks=np.concatenate([[0.0], np.cumsum(durations)]),
            q=self.q[first : last + 1],
            dq=dq,
            ddq=ddq,
            arm=self.arm,
            ends=ends,
            point=self.point + (ends[0] - self.s[0]) * self.direction,
            direction=self.direction,
        )
        return LinePhase(law, kind, ends)

    def _find_meeting(
        self, low: int, high: int, forward: FloatArray, backward: FloatArray
    ) -> tuple[int, int]:
        """Return the two knots between which the passes are joined within the limit.

        - `low`, `high`: the neighbouring knots between which the passes meet.
        - `forward`, `backward`: speeds of both passes at the knots [m/s], (n + 1,).
        """
        # Usually one interval joins the passes. If they meet close to its end, uniform acceleration
        # of the tool would need slightly more joint acceleration than the limit, so two intervals
        # join them.
        for start, end in ((low, high), (low - 1, high), (low, high + 1)):
            if start < 0 or end >= len(self.s) or np.isnan([forward[start], backward[end]]).any():
                continue
            law = path_law(self.joint_path, self.s[[start, end]], forward[[start]], backward[[end]])
            if (np.abs(law_states(law, self.arm).ddq) <= self.limit).all():
                return start, end
        return low, high

    def _make_middle(
        self, low: int, high: int, forward: FloatArray, backward: FloatArray, meeting: bool
    ) -> LinePhase:
        """Return the phase with uniform tool acceleration between both passes, (24)-(25).

        In a meeting interval, the squared speeds of both passes are nearly linear over arc length.
        The point where they are equal divides the interval in the ratio of their differences at its
        ends.

        - `low`, `high`: knots at which the forward pass ends and the reverse pass begins.
        - `forward`, `backward`: speeds of both passes at the knots [m/s], (n + 1,).
        - `meeting`: true if the passes meet below the assigned velocity.
        """
        s = self.s[[low, high]]
        start_speed = forward[low]
        end_speed = backward[high]
        law = path_law(self.joint_path, s, np.array([start_speed]), np.array([end_speed]))
        ends = (float(s[0]), float(s[1]))
        if not meeting or np.isnan([forward[high], backward[low]]).any():
            return LinePhase(law, "AVC", ends)
        start_gap = backward[low] ** 2 - start_speed**2
        end_gap = forward[high] ** 2 - end_speed**2
        both = start_gap + end_gap
        length = float(s[1] - s[0]) * (start_gap / both if both > 0 else 0.5)
        acceleration = law.rates.dds[0]
        meeting_speed = np.sqrt(max(start_speed**2 + 2 * acceleration * length, 0.0))
        time = 2 * length / (start_speed + meeting_speed)
        return LinePhase(law, "meeting", ends, (float(time), length))

    def _refuse_incomplete_pass(self, forward: Pass, last: int, reverse: Pass, count: int) -> None:
        """Raise NotRealizable if a joint limit ended a pass before the assigned velocity.

        - `last`: last knot of the forward pass that is used.
        - `count`: number of intervals of the reverse pass that are used.
        """
        if forward.joint >= 0 and forward.valid_count == last:
            ended = forward
            knot = forward.valid_count
        elif reverse.joint >= 0 and reverse.valid_count == count:
            ended = reverse
            knot = len(self.s) - 1 - reverse.valid_count
        else:
            return
        s = float(self.s[knot])
        point = self.arm.tool_position(self.q[knot]).tolist()
        allowed = float(self.limit[ended.joint])
        raise NotRealizable(
            f"On {self.name} at {s:.4g} m along the path, joint {ended.joint + 1} would need "
            f"{ended.needed:.4g} rad/s² within one interval, but its limit is {allowed:g} rad/s². "
            "The joint cannot reverse in time, because the method does not look ahead. Reduce the "
            "assigned velocity, or plan by the method optimal.",
            point=point,
            s=s,
            joint=ended.joint,
            limit="joint_acceleration",
            needed=ended.needed,
            allowed=allowed,
        )


def _last_slower_knot(forward: FloatArray, backward: FloatArray, first: int, last: int) -> int:
    """Return the last knot from `first` to `last` at which the forward pass is slower.

    Without such a knot it is the knot before `first`; -1 means that the whole line is MDC.

    - `forward`, `backward`: speeds of both passes at the knots [m/s], (n + 1,).
    """
    if first == 0 and forward[0] >= backward[0]:
        # The start speed is the largest from which the line can brake.
        return -1
    knots = np.arange(first, last + 1)
    slower = knots[forward[knots] <= backward[knots]]
    return int(slower[-1]) if len(slower) else first - 1


@dataclass(slots=True)
class Junction:
    """Part of a path before, between or after lines: arcs at one speed, a vertex, or a stop."""

    arcs: range  # Segment indices of the arcs; empty where lines meet
    # Tool speed through the junction [m/s]; reduced to a value that the lines can reach
    speed: float


def plan_paper(joint_path: JointPath, arm: Arm, limits: Limits, options: Paper) -> Trajectory:
    """Plan a path of lines and arcs by the paper's method.

    The centripetal acceleration determines the corner speed (16).

    - `joint_path`: a traced path of lines and arcs.
    - `limits`: limits with joint accelerations and an assigned velocity.
    """
    path = tool_path_of(joint_path, "paper")
    assigned = np.fmin(path.speeds, require_speed(limits, "paper"))
    _refuse_limits(limits)
    junctions = _find_junctions(path, _find_lines(path), assigned, limits)
    lines = _make_lines(joint_path, arm, limits, assigned, junctions, options)
    _match_speeds(lines, junctions)
    return _join(lines, junctions, arm, limits)


def _find_lines(path: Path) -> list[int]:
    """Return the segment indices of the lines of a path."""
    return list(np.flatnonzero(path.curvatures == 0).tolist())


def _make_lines(
    joint_path: JointPath,
    arm: Arm,
    limits: Limits,
    assigned: FloatArray,
    junctions: list[Junction],
    options: Paper,
) -> list[PaperLine]:
    """Return the lines of a path with their knots.

    - `assigned`: assigned velocity of each segment [m/s], (segments,).
    - `junctions`: the junctions before the first line and after each line, (lines + 1,).
    """
    path = tool_path_of(joint_path, "paper")
    lines = []
    for number, i in enumerate(_find_lines(path)):
        count = options.knots
        if count is None:
            count = _default_laps(path.lengths[i], assigned[i], options.cycle, number)
        at_rest = (junctions[number].speed == 0, junctions[number + 1].speed == 0)
        lines.append(
            PaperLine(
                name=f"line {number + 1}",
                joint_path=joint_path,
                arm=arm,
                limit=limits.acceleration_bounds(arm.dof)[1],
                s=_place_knots(path.breaks[i], path.breaks[i + 1], count, at_rest),
                assigned=float(assigned[i]),
            )
        )
    return lines


def _refuse_limits(limits: Limits) -> None:
    """Raise InvalidInput unless each joint has one acceleration limit for both directions."""
    if limits.joint_acceleration is None:
        raise InvalidInput(
            "The method paper needs limits of joint acceleration, but none are specified. Specify "
            "joint_acceleration [rad/s²]."
        )
    if not limits.same_both_ways():
        raise InvalidInput(
            "The method paper supports one acceleration limit per joint for both directions. "
            "Specify one value of joint_acceleration per joint, or plan by the method optimal."
        )


def _default_laps(length: float, speed: float, cycle: float, number: int) -> int:
    """Return a line's number of intervals, each at most one cycle long at the assigned velocity.

    - `length`: length of the line [m].
    - `speed`: assigned velocity [m/s].
    - `number`: index of the line, for the message.
    """
    count = length / (speed * cycle)
    if not count <= MAX_LAPS:
        raise InvalidInput(
            f"Line {number + 1} would have {count:.3g} intervals at {speed:g} m/s and a cycle of "
            f"{cycle:g} s, but at most {MAX_LAPS} are supported. Specify knots."
        )
    return max(FEWEST_LAPS, int(np.ceil(count)))


def _join(
    lines: list[PaperLine], junctions: list[Junction], arm: Arm, limits: Limits
) -> Trajectory:
    """Plan all lines between the speeds of their junctions, and join lines and corners."""
    joint_path = lines[0].joint_path
    laws: list[LawAlongPath] = []
    stretches: list[LawPhase] = []
    corner = 0
    for number, line in enumerate(lines):
        phases = line.plan(junctions[number].speed, junctions[number + 1].speed)
        laws += [phase.law for phase in phases]
        parts = parts_by_rule(line.name, phases)
        for i in junctions[number + 1].arcs:
            corner += 1
            parts.append(_arc_part(f"corner {corner}", joint_path, i, junctions[number + 1].speed))
            laws += parts[-1].laws
        for part in parts:
            start = stretches[-1].t[1] if stretches else 0.0
            stretches.append(_check_part(part, start, arm, limits))
    return Trajectory(
        laws=tuple(laws), method=Method.PAPER, path=joint_path.tool_path, stretches=tuple(stretches)
    )


def _find_junctions(
    path: Path, lines: list[int], assigned: FloatArray, limits: Limits
) -> list[Junction]:
    """Return the junctions before the first line and after each line, with their largest speeds.

    `lines` are the indices of straight segments, `assigned` the velocity of each segment [m/s].
    """
    ends = np.concatenate([[-1], lines, [len(path)]])
    stop_vertices = set(np.searchsorted(path.breaks, path.stops).tolist())
    result = []
    for number, (before, after) in enumerate(zip(ends[:-1], ends[1:], strict=True)):
        arcs = range(int(before) + 1, int(after))
        at_rest = number in (0, len(lines)) or any(
            vertex in stop_vertices for vertex in range(int(before) + 1, int(after) + 1)
        )
        if at_rest and len(arcs):
            s = float(path.breaks[arcs[0]])
            raise NotRealizable(
                f"At {s:.4g} m along the path the tool is at rest next to an arc, but the method "
                "paper moves along arcs only at constant speed. Start and end the path on lines, "
                "or plan by the method optimal.",
                s=s,
                point=path(s).tolist(),
            )
        speeds = [assigned[i] for i in range(max(int(before), 0), min(int(after) + 1, len(path)))]
        if limits.centripetal_acceleration is not None:
            speeds += [
                float(np.sqrt(limits.centripetal_acceleration / path.curvatures[i])) for i in arcs
            ]
        result.append(Junction(arcs, 0.0 if at_rest else float(min(speeds))))
    return result


def _place_knots(start: float, end: float, count: int, at_rest: tuple[bool, bool]) -> FloatArray:
    """Return the arc lengths of a line's knots [m], `count` equal intervals from start to end.

    An interval next to a rest is divided into parts of equal duration at constant acceleration.

    - `at_rest`: whether the tool is at rest at the start, and at the end, of the line.
    """
    shares = np.arange(count + 1) / count
    parts = (np.arange(1, PARTS_AT_REST) / PARTS_AT_REST) ** 2 / count
    if at_rest[0]:
        shares = np.concatenate([shares[:1], parts, shares[1:]])
    if at_rest[1]:
        shares = np.concatenate([shares[:-1], 1 - parts[::-1], shares[-1:]])
    s = start + (end - start) * shares
    s[-1] = end
    return s


def _match_speeds(lines: list[PaperLine], junctions: list[Junction]) -> None:
    """Reduce the speeds of junctions to speeds that the lines can reach."""
    for number, line in enumerate(lines):
        before, after = junctions[number : number + 2]
        after.speed = min(after.speed, line.final_speed(line.forward(before.speed)))
    for number, line in reversed(list(enumerate(lines))):
        before, after = junctions[number : number + 2]
        before.speed = min(before.speed, line.final_speed(line.reverse(after.speed)))


def _arc_part(name: str, joint_path: JointPath, segment: int, speed: float) -> RulePart:
    """Return the motion at constant speed [m/s] along the arc of a rounded corner, (17).

    - `segment`: index of the arc.
    """
    path = tool_path_of(joint_path, "paper")
    law = path_law(
        joint_path, path.breaks[segment : segment + 2], np.array([speed]), np.array([speed])
    )
    ends = (float(path.breaks[segment]), float(path.breaks[segment + 1]))
    return RulePart(name, "corner", float(law.breaks[-1]), ends, [law])


def _check_part(part: RulePart, start: float, arm: Arm, limits: Limits) -> LawPhase:
    """Return a part with its peak values; raise NotRealizable if it exceeds a limit.

    - `start`: time at which the part starts [s].
    """
    # The rules of the method do not include these limits: joint acceleration on the middle part and
    # on corners, joint velocities, torques, and the angular motion of the tool.
    check_limits(
        part.laws,
        arm,
        limits,
        ignored=GUARANTEED,
        location=f"On {part.name} ({part.kind}), between {part.s[0]:.4g} and {part.s[1]:.4g} m "
        "along the path",
        t=start,
        remedy="The method paper does not plan for this limit there. Reduce the assigned "
        "velocity or the centripetal acceleration, or plan by the method optimal",
    )
    return LawPhase(
        name=part.name,
        kind=part.kind,
        t=(start, start + part.duration),
        s=part.s,
        **law_peaks(part.laws, arm),
    )
