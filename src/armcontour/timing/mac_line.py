"""One straight line by the paper's criteria: MAC from its start, MDC to its end, AVC between.

Both passes run over the whole line, each until it would break a joint limit. They are used up to
where they reach the assigned velocity, (23), and the tool moves with uniform acceleration between
those places, (24)-(25). Where the passes meet below the assigned velocity, on which the paper is
silent, they are switched there: one lap of uniform tool acceleration joins them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour._checks import FloatArray
from armcontour.arms import Arm
from armcontour.errors import NotRealizable
from armcontour.motion import JointPath, LawAlongPath, LineLaw
from armcontour.timing._laps import laps
from armcontour.timing.common import law_peaks, path_law, tool_path_of


@dataclass(frozen=True, slots=True)
class Pass:
    """A line run from one end with maximum joint acceleration; knots in the order they are met.

    Args:
        h: Lap times [s], (n,).
        speed: Tool speed at the knots [m/s], (n + 1,); NaN after the last good lap.
        dq: Joint velocities at the start of the laps [rad/s], (n, dof).
        ddq: Joint accelerations in the laps [rad/s²], (n, dof).
        done: Number of laps that keep the limit.
        joint: Joint that would break it in the next lap, from 0; -1 if there is none.
        needed: Acceleration that joint would need [rad/s²].
    """

    h: FloatArray
    speed: FloatArray
    dq: FloatArray
    ddq: FloatArray
    done: int
    joint: int
    needed: float

    def last_within(self, speed: float) -> int:
        """The last knot before the first that is faster than `speed`."""
        faster = np.flatnonzero(self.speed[: self.done + 1] > speed * (1 + 1e-12))
        return max(int(faster[0]) - 1, 0) if len(faster) else self.done


@dataclass(frozen=True, slots=True)
class Piece:
    """A law of motion and the rule that made it.

    Args:
        law: The law.
        kind: "MAC", "AVC" or "MDC"; "meeting" for the lap between MAC and MDC.
        s: Start and end on the path [m].
        switch: For a meeting lap, where in it the two passes have the same speed: time and arc
            length from its start [s, m].
    """

    law: LawAlongPath
    kind: str
    s: tuple[float, float]
    switch: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Part:
    """What one rule made of a line or a corner, and the laws it lies in.

    Args:
        name: Such as "line 1".
        kind: "MAC", "AVC", "MDC" or "corner".
        duration: Its time [s].
        s: Start and end on the path [m].
        laws: The laws it lies in, whole.
    """

    name: str
    kind: str
    duration: float
    s: tuple[float, float]
    laws: list[LawAlongPath]


def parts_by_rule(name: str, pieces: list[Piece]) -> list[Part]:
    """The parts of a line; a meeting lap is MAC before the switch and MDC after it."""
    parts = []
    for piece in pieces:
        time = float(piece.law.breaks[-1])
        if piece.kind != "meeting":
            parts.append(Part(name, piece.kind, time, piece.s, [piece.law]))
            continue
        before, way = piece.switch
        middle = piece.s[0] + way
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
        name: Such as "line 1".
        joint_path: The joint path it lies on.
        arm: The arm.
        limit: Joint acceleration limits [rad/s²], (dof,).
        s: Its knots [m], (n + 1,).
        assigned: Assigned velocity on it [m/s].
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
        path = tool_path_of(joint_path, "mac")
        self.point, self.direction = path(s[0]), path(s[0], 1)
        self.q = joint_path(s)
        # One-sided at both ends: the path may turn there.
        before, after = joint_path(s[-1:], 1, side="left"), joint_path(s[:-1], 1)
        self.dq_ds = np.concatenate([after, before])

    def forward(self, speed: float) -> Pass:
        """The pass from the start of the line, entered at `speed`."""
        return Pass(*laps(self.q, self.dq_ds, speed, self.limit))

    def reverse(self, speed: float) -> Pass:
        """The pass from the end of the line backwards in time, which leaves it at `speed`."""
        return Pass(*laps(self.q[::-1].copy(), -self.dq_ds[::-1], speed, self.limit))

    def plan(self, begin: float, end: float) -> list[Piece]:
        """The line from speed `begin` to speed `end`.

        Raises:
            NotRealizable: The passes neither reach the assigned velocity nor each other before a
                joint would break its limit.
        """
        forward, reverse = self.forward(begin), self.reverse(end)
        n = len(self.s) - 1
        backward = reverse.speed[::-1]  # the reverse pass in the order of the path
        last = forward.last_within(self.assigned)
        first = n - reverse.last_within(self.assigned)
        if first <= last:
            # They overlap: leave the forward pass at the last knot where it is the slower one.
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

    def _mac(self, run: Pass, last: int) -> Piece:
        return self._piece("MAC", 0, last, run.h[:last], run.dq[:last], run.ddq[:last])

    def _mdc(self, run: Pass, first: int) -> Piece:
        count = len(self.s) - 1 - first
        ends = run.dq[:count] + run.ddq[:count] * run.h[:count, None]
        h, dq, ddq = run.h[:count][::-1], -ends[::-1], run.ddq[:count][::-1]
        return self._piece("MDC", first, len(self.s) - 1, h, dq, ddq)

    def _piece(
        self, kind: str, first: int, last: int, h: FloatArray, dq: FloatArray, ddq: FloatArray
    ) -> Piece:
        """Laps from one knot to another one."""
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
        return Piece(law, kind, ends)

    def _meeting(
        self, low: int, high: int, forward: FloatArray, backward: FloatArray
    ) -> tuple[int, int]:
        """Knots around the place where the passes meet, between which the limit is kept.

        One lap; but where they meet next to one of its ends, it would be MAC or MDC throughout with
        uniform acceleration of the tool, not of the joints, and need a little too much: then two.
        """
        for begin, end in ((low, high), (low - 1, high), (low, high + 1)):
            if begin < 0 or end >= len(self.s) or np.isnan([forward[begin], backward[end]]).any():
                continue
            law = path_law(self.joint_path, self.s[[begin, end]], forward[[begin]], backward[[end]])
            if (law_peaks(law, self.arm).acceleration <= self.limit).all():
                return begin, end
        return low, high

    def _middle(
        self, low: int, high: int, forward: FloatArray, backward: FloatArray, meeting: bool
    ) -> Piece:
        s = self.s[[low, high]]
        begin, end = forward[low], backward[high]
        law = path_law(self.joint_path, s, np.array([begin]), np.array([end]))
        places = (float(s[0]), float(s[1]))
        if not meeting or np.isnan([forward[high], backward[low]]).any():
            return Piece(law, "AVC", places)
        ahead, after = backward[low] ** 2 - begin**2, forward[high] ** 2 - end**2
        way = float(s[1] - s[0]) * (ahead / (ahead + after) if ahead + after > 0 else 0.5)
        acceleration = law.rates.dds[0]
        time = 2 * way / (begin + np.sqrt(max(begin**2 + 2 * acceleration * way, 0.0)))
        return Piece(law, "meeting", places, (float(time), way))

    def _refuse_broken(self, forward: Pass, last: int, reverse: Pass, count: int) -> None:
        """Raise if a pass ended at a joint limit instead of at the assigned velocity."""
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
        s, point = float(self.s[knot]), self.arm.forward(self.q[knot]).tolist()
        allowed = float(self.limit[run.joint])
        raise NotRealizable(
            f"On {self.name} at {s:.4g} m along the path, joint {run.joint + 1} would need "
            f"{run.needed:.4g} rad/s² within one lap, but its limit is {allowed:g}: it "
            "cannot turn round in time, because the method does not look ahead; a lower assigned "
            "velocity or the method optimal helps.",
            point=point,
            s=s,
            joint=run.joint + 1,
            limit="joint_acceleration",
            needed=run.needed,
            allowed=allowed,
        )
