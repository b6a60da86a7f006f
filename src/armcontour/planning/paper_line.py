"""One straight line by the paper's criteria: MAC from its start, MDC to its end, AVC between.

Two passes run over the line, one from each end, each until it would break a joint limit. Each pass
is used up to the knot where it reaches the assigned velocity, (23). Between those knots the tool
moves with uniform acceleration, (24)-(25). Where the passes meet below the assigned velocity, one
lap of uniform tool acceleration joins them; the paper has no rule for this case.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import NotRealizable
from armcontour.motion import JointPath, LawAlongPath, LineLaw
from armcontour.planning._laps import laps
from armcontour.planning.common import law_states, path_law, tool_path_of
from armcontour.robot import Arm


@dataclass(frozen=True, slots=True)
class Pass:
    """Motion along a line from one end with maximum joint acceleration; knots in order of time.

    Args:
        h: Lap times [s], (n,).
        speed: Tool speed at the knots [m/s], (n + 1,); NaN after the last good lap.
        dq: Joint velocities at the start of the laps [rad/s], (n, dof).
        ddq: Joint accelerations in the laps [rad/s²], (n, dof).
        done: Number of laps that keep the limit.
        joint: Joint that would break the limit in the next lap, from 0; -1 for no joint.
        needed: Acceleration that this joint would need [rad/s²].
    """

    h: FloatArray
    speed: FloatArray
    dq: FloatArray
    ddq: FloatArray
    done: int
    joint: int
    needed: float

    def last_within(self, speed: float) -> int:
        """The last knot before the tool speed exceeds `speed` [m/s] for the first time."""
        faster = np.flatnonzero(self.speed[: self.done + 1] > speed * (1 + 1e-12))
        return max(int(faster[0]) - 1, 0) if len(faster) else self.done


@dataclass(frozen=True, slots=True)
class LinePhase:
    """A time law and the rule that made it.

    Args:
        law: The law.
        kind: "MAC", "AVC" or "MDC"; "meeting" for the lap between MAC and MDC.
        s: Arc lengths of start and end on the path [m].
        switch: For a meeting lap, time [s] and arc length [m] from its start to the point where
            both passes have the same speed.
    """

    law: LawAlongPath
    kind: str
    s: tuple[float, float]
    switch: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Part:
    """The part of a line or a corner that one rule made.

    Args:
        name: Name of the line or corner, such as "line 1".
        kind: "MAC", "AVC", "MDC" or "corner".
        duration: Duration [s].
        s: Arc lengths of start and end on the path [m].
        laws: The whole laws that contain the part.
    """

    name: str
    kind: str
    duration: float
    s: tuple[float, float]
    laws: list[LawAlongPath]


def parts_by_rule(name: str, pieces: list[LinePhase]) -> list[Part]:
    """Group the pieces of a line by rule; a meeting lap is MAC before its switch and MDC after."""
    parts = []
    for piece in pieces:
        time = float(piece.law.breaks[-1])
        if piece.kind != "meeting":
            parts.append(Part(name, piece.kind, time, piece.s, [piece.law]))
            continue
        before, length = piece.switch
        middle = piece.s[0] + length
        parts.append(Part(name, "MAC", before, (piece.s[0], middle), [piece.law]))
        parts.append(Part(name, "MDC", time - before, (middle, piece.s[1]), [piece.law]))
    joined: list[Part] = []
    for part in parts:
        if joined and joined[-1].kind == part.kind:
            last = joined.pop()
            part = Part(
                name,
                part.kind,
                last.duration + part.duration,
                (last.s[0], part.s[1]),
                last.laws + part.laws,
            )
        joined.append(part)
    return joined


class Line:
    """A straight segment of a traced path, with its knots.

    Args:
        name: Name for messages, such as "line 1".
        joint_path: The joint path that contains the line.
        arm: The arm.
        limit: Joint acceleration limits [rad/s²], (dof,).
        s: Arc lengths of the knots [m], (n + 1,).
        assigned: Assigned velocity on the line [m/s].
    """

    def __init__(
        self,
        *,
        name: str,
        joint_path: JointPath,
        arm: Arm,
        limit: FloatArray,
        s: FloatArray,
        assigned: float,
    ) -> None:
        self.name, self.joint_path, self.arm, self.limit = name, joint_path, arm, limit
        self.s, self.assigned = s, assigned
        path = tool_path_of(joint_path, "paper")
        self.point, self.direction = path(s[0]), path(s[0], 1)
        self.q = joint_path(s)
        # One-sided at both ends: the path may turn there.
        before, after = joint_path(s[-1:], 1, side="left"), joint_path(s[:-1], 1)
        self.dq_ds = np.concatenate([after, before])

    def forward(self, speed: float) -> Pass:
        """Run the pass from the start of the line, with the tool speed `speed` [m/s] there."""
        return Pass(*laps(self.q, self.dq_ds, speed, self.limit))

    def reverse(self, speed: float) -> Pass:
        """Run the pass backwards in time from the end of the line, with the tool speed `speed`."""
        return Pass(*laps(self.q[::-1].copy(), -self.dq_ds[::-1], speed, self.limit))

    def plan(self, start: float, end: float) -> list[LinePhase]:
        """Plan the line from the tool speed `start` to the tool speed `end` [m/s].

        Raises:
            NotRealizable: The passes reach neither the assigned velocity nor each other before a
                joint would break its limit.
        """
        forward, reverse = self.forward(start), self.reverse(end)
        n = len(self.s) - 1
        backward = reverse.speed[::-1]  # the reverse pass in the order of the path
        last = forward.last_within(self.assigned)
        first = n - reverse.last_within(self.assigned)
        if first <= last:
            # The passes overlap: leave the forward pass at the last knot where it is slower.
            both = np.arange(first, last + 1)
            slower = both[forward.speed[both] <= backward[both]]
            last = int(slower[-1]) if len(slower) else first - 1
            if first == 0 and forward.speed[0] >= backward[0]:
                last = -1  # the start was lowered to what the line can brake from: MDC throughout
            first = last + 1
            meeting = 0 <= last and first <= n
            if meeting:
                last, first = self._meeting(last, first, forward.speed, backward)
        else:
            self._refuse_broken(forward, last, reverse, n - first)
            meeting = False
        pieces = [self._mac(forward, last)] if last > 0 else []
        low, high = max(last, 0), first
        if low < high <= n:
            pieces.append(self._middle(low, high, forward.speed, backward, meeting))
        if first < n:
            pieces.append(self._mdc(reverse, first))
        return pieces

    def _mac(self, run: Pass, last: int) -> LinePhase:
        """The forward pass up to the knot `last`."""
        return self._piece("MAC", 0, last, run.h[:last], run.dq[:last], run.ddq[:last])

    def _mdc(self, run: Pass, first: int) -> LinePhase:
        """The reverse pass, turned round in time, from the knot `first` on."""
        count = len(self.s) - 1 - first
        ends = run.dq[:count] + run.ddq[:count] * run.h[:count, None]
        h, dq, ddq = run.h[:count][::-1], -ends[::-1], run.ddq[:count][::-1]
        return self._piece("MDC", first, len(self.s) - 1, h, dq, ddq)

    def _piece(
        self, kind: str, first: int, last: int, h: FloatArray, dq: FloatArray, ddq: FloatArray
    ) -> LinePhase:
        """The laps from the knot `first` to the knot `last`, with their times and joint motion."""
        ends = (float(self.s[first]), float(self.s[last]))
        law = LineLaw(
            breaks=np.concatenate([[0.0], np.cumsum(h)]),
            q=self.q[first : last + 1],
            dq=dq,
            ddq=ddq,
            arm=self.arm,
            ends=ends,
            point=self.point + (ends[0] - self.s[0]) * self.direction,
            direction=self.direction,
        )
        return LinePhase(law, kind, ends)

    def _meeting(
        self, low: int, high: int, forward: FloatArray, backward: FloatArray
    ) -> tuple[int, int]:
        """Knots around the point where the passes meet, between which the limit is kept.

        One lap is usual. Where the passes meet next to an end of the lap, uniform acceleration of
        the tool would need slightly more joint acceleration than the limit: then two laps.

        Args:
            low: Knot before the meeting point.
            high: Knot after the meeting point.
            forward: Tool speed of the forward pass at the knots [m/s], (n + 1,).
            backward: Tool speed of the reverse pass at the knots [m/s], (n + 1,).
        """
        for start, end in ((low, high), (low - 1, high), (low, high + 1)):
            if start < 0 or end >= len(self.s) or np.isnan([forward[start], backward[end]]).any():
                continue
            law = path_law(self.joint_path, self.s[[start, end]], forward[[start]], backward[[end]])
            if (np.abs(law_states(law, self.arm).ddq) <= self.limit).all():
                return start, end
        return low, high

    def _middle(
        self, low: int, high: int, forward: FloatArray, backward: FloatArray, meeting: bool
    ) -> LinePhase:
        """The piece with uniform tool acceleration between the passes; arguments as `_meeting`."""
        s = self.s[[low, high]]
        start, end = forward[low], backward[high]
        law = path_law(self.joint_path, s, np.array([start]), np.array([end]))
        places = (float(s[0]), float(s[1]))
        if not meeting or np.isnan([forward[high], backward[low]]).any():
            return LinePhase(law, "AVC", places)
        ahead, after = backward[low] ** 2 - start**2, forward[high] ** 2 - end**2
        length = float(s[1] - s[0]) * (ahead / (ahead + after) if ahead + after > 0 else 0.5)
        acceleration = law.rates.dds[0]
        time = 2 * length / (start + np.sqrt(max(start**2 + 2 * acceleration * length, 0.0)))
        return LinePhase(law, "meeting", places, (float(time), length))

    def _refuse_broken(self, forward: Pass, last: int, reverse: Pass, count: int) -> None:
        """Refuse a line on which a pass ended at a joint limit, not at the assigned velocity.

        Args:
            forward: The forward pass.
            last: Last knot of the forward pass that is used.
            reverse: The reverse pass.
            count: Number of its laps that are used.

        Raises:
            NotRealizable: A pass ended at a joint limit.
        """
        broken = [
            (run, place)
            for run, end, place in (
                (forward, last, forward.done),
                (reverse, count, len(self.s) - 1 - reverse.done),
            )
            if run.joint >= 0 and end == run.done
        ]
        if not broken:
            return
        run, knot = broken[0]
        s, point = float(self.s[knot]), self.arm.tool_position(self.q[knot]).tolist()
        allowed = float(self.limit[run.joint])
        raise NotRealizable(
            f"On {self.name} at {s:.4g} m along the path, joint {run.joint + 1} would need "
            f"{run.needed:.4g} rad/s² within one lap, but its limit is {allowed:g}: it "
            "cannot reverse in time, because the method does not look ahead; a lower assigned "
            "velocity or the method optimal helps.",
            point=point,
            s=s,
            joint=run.joint,
            limit="joint_acceleration",
            needed=run.needed,
            allowed=allowed,
        )
