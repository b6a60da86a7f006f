"""The pieces of an execution that are evaluated one by one: the contours of a program."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from armcontour._checks import FloatArray
from armcontour.arms import SerialArm
from armcontour.errors import InvalidInput
from armcontour.evaluation.angular_deviation import angle_off
from armcontour.evaluation.cornering_deviations import CornerDeviation, corner_deviations
from armcontour.evaluation.error_profile import ErrorProfile, Missed
from armcontour.evaluation.following import Followed, follow_path
from armcontour.evaluation.speed_shares import measure_shares
from armcontour.geometry import Path
from armcontour.geometry.biarcs import length
from armcontour.motion import Execution, Span
from armcontour.program import Program

# The tool is at rest below this speed [m/s].
REST_SPEED = 1e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class Piece:
    """An execution along one path.

    Args:
        executed: The whole execution.
        path: The path that the tool was to follow.
        objective: The path before rounding, or None if unknown.
        which: The samples of the piece.
        until: End of the piece [s].
        beyond: Index after the last sample at which the tool may still be on the path.
        work: Places between which parts of the path count that the tool leaves out [m].
        before_work: The same on the objective path, or None if unknown.
        offset: Length of the contours before the piece [m], added to arc lengths.
    """

    executed: Execution
    path: Path
    objective: Path | None
    which: slice
    until: float
    beyond: int
    work: tuple[float, float]
    before_work: tuple[float, float] | None = None
    offset: float = 0.0

    @cached_property
    def t(self) -> FloatArray:
        """Times [s], (n,)."""
        return self.executed.t[self.which]

    @cached_property
    def q(self) -> FloatArray:
        """Joint positions [rad], (n, dof)."""
        return self.executed.q[self.which]

    @cached_property
    def _around(self) -> tuple[FloatArray, slice]:
        """Tool points of the piece and around it [m], and which of them are those of the piece."""
        # The tool is at the start of the work between two samples.
        first = max(self.which.start - 1, 0)
        points = self.executed.arm.forward(self.executed.q[first : self.beyond])
        return points, slice(self.which.start - first, self.which.stop - first)

    @property
    def tool(self) -> FloatArray:
        """Tool points [m], (n, dimension)."""
        points, own = self._around
        return points[own]

    @cached_property
    def speed(self) -> FloatArray:
        """Tool speed [m/s], (n,)."""
        velocity = self.executed.arm.tool_velocity(self.q, self.executed.dq[self.which])
        return length(velocity)

    @cached_property
    def found(self) -> Followed:
        """Places of the tool on the path."""
        return self._follow(self.path, self.work)

    @cached_property
    def on_path(self) -> FloatArray:
        """Points of the path at which the tool is found [m], (n, dimension)."""
        return self.path(self.found.s)

    @cached_property
    def off_objective(self) -> Followed | None:
        """Places of the tool on the objective path; None if unknown."""
        return None if self.objective is None else self._follow(self.objective, self.before_work)

    def _follow(self, path: Path, work: tuple[float, float] | None) -> Followed:
        """Places of the tool on a path."""
        points, own = self._around
        return follow_path(path, points, work=work, judged=own)

    @property
    def contour_error(self) -> ErrorProfile:
        """Distance from the tool to the path [m]."""
        s = self.found.s
        side = None
        if self.path.dimension == 2:
            side = _side(self.path, s, self.tool - self.on_path)
        return self._over_time(self.found.distance, s, side)

    @property
    def missed(self) -> Missed:
        """Largest distance from the path to the tool [m]."""
        return self._most_missed(self.found)

    def speed_shares(self, limit: float | None, *, between: bool = False) -> FloatArray:
        """Tool speed over the velocity assigned at its place, (n,); see `measure_shares`."""
        return measure_shares(self.path, self.found, self.speed, limit, between=between)

    @property
    def tracking_error(self) -> ErrorProfile:
        """Distance from the tool to its planned position at the same time [m]."""
        trajectory = self.executed.taught.trajectory
        planned = trajectory(np.clip(self.t, 0.0, trajectory.duration))
        off = length(self.tool - self.executed.arm.forward(planned))
        return self._over_time(off, self.found.s)

    @property
    def objective_error(self) -> ErrorProfile | None:
        """Distance from the tool to the objective path [m]; None if unknown."""
        found = self.off_objective
        return None if found is None else self._over_time(found.distance, found.s)

    @property
    def objective_missed(self) -> Missed | None:
        """Largest distance from the objective path to the tool [m]; None if unknown."""
        found = self.off_objective
        return None if found is None else self._most_missed(found)

    @property
    def orientation_error(self) -> ErrorProfile | None:
        """Angle between the tool and the required tool orientation [rad]; None if not required."""
        arm = self.executed.arm
        if self.path.orientation is None or not isinstance(arm, SerialArm):
            return None
        angle = angle_off(self.path.orientation, self.found.s, arm.pose(self.q)[1])
        return self._over_time(angle, self.found.s)

    @property
    def corners(self) -> tuple[CornerDeviation, ...]:
        """Cornering deviations at the corners of the objective path; empty if unknown."""
        if self.objective is None or self.off_objective is None:
            return ()
        judged = self.t <= self.until
        return corner_deviations(self.tool[judged], self.objective, self.off_objective.s[judged])

    def _most_missed(self, found: Followed) -> Missed:
        """The place of a path that is the farthest from the tool, of all that it passes."""
        i = int(np.argmax(found.missed))
        return Missed(
            max=max(0.0, float(found.missed[i])),
            t_max=float(self.t[i]),
            s_max=float(found.missed_s[i]) + self.offset,
        )

    def _over_time(
        self, values: FloatArray, s: FloatArray, side: FloatArray | None = None
    ) -> ErrorProfile:
        """The profile of values at the samples, (n,), with the arc lengths of their points."""
        return ErrorProfile.over_time(self.t, values, s + self.offset, self.until, side)


def settling_time(executed: Execution, speed: FloatArray) -> float:
    """Time after which the tool stays at rest [s].

    Args:
        executed: The execution.
        speed: Its tool speeds [m/s], (n,).
    """
    moving = np.flatnonzero(speed > REST_SPEED)
    return float(executed.t[moving[-1]]) if len(moving) else 0.0


def pieces_of(
    executed: Execution, path: Program, objective: Program | None, until: float
) -> list[Piece]:
    """Split an execution into its contours, each while the process is at work on it.

    A single path is one piece, from the first set-point to `until`.

    Args:
        executed: The execution.
        path: The program that was planned.
        objective: The program before rounding, or None if unknown.
        until: End of the evaluation of a single path [s].

    Raises:
        InvalidInput: The execution or the objective has another number of contours than the path.
    """
    spans = executed.taught.trajectory.contour_spans
    count = len(spans)
    if len(path.contours) != count:
        raise InvalidInput(
            f"The execution has {count} contour{'s' if count != 1 else ''}: evaluate it with the "
            "program that was planned."
        )
    if objective is not None and len(objective.contours) != count:
        raise InvalidInput(
            f"The objective must be a program of {count} contours, as the planned one is."
        )
    if path.single_path is None:
        judged = [_find_window(executed, x) for x in spans]
    else:
        judged = [(slice(0, len(executed.t)), until, 0.0)]
    starts = [which.start for which, _, _ in judged[1:]]
    beyond = [*starts, len(executed.t)]
    before = [None] * count if objective is None else objective.contours
    return [
        Piece(
            executed=executed,
            path=contour.path,
            objective=None if first is None else first.path,
            which=which,
            until=end,
            beyond=last,
            work=contour.at_work,
            before_work=None if first is None else first.at_work,
            offset=offset,
        )
        for contour, first, (which, end, offset), last in zip(
            path.contours, before, judged, beyond, strict=True
        )
    ]


def _find_window(executed: Execution, span: Span) -> tuple[slice, float, float]:
    """Find the samples of a contour, its end time [s] and the length of the contours before [m]."""
    assert span.work is not None
    start, end = np.searchsorted(executed.t, span.work)
    # At least two samples, however short the contour is.
    start = min(int(start), len(executed.t) - 2)
    return slice(start, max(int(end), start + 2)), span.work[1], span.s[0]


def _side(path: Path, s: FloatArray, offset: FloatArray) -> FloatArray:
    """1 where the tool is to the left of a path in the plane, -1 to its right.

    Args:
        path: The path.
        s: Places of the tool on the path [m], (n,).
        offset: From these places to the tool [m], (n, 2).
    """
    tangent = path(s, 1)
    # At a corner, the sum of both tangents decides.
    corner = np.isin(s, path.breaks)
    tangent[corner] += path(s[corner], 1, side="left")
    return np.where(tangent[:, 0] * offset[:, 1] < tangent[:, 1] * offset[:, 0], -1.0, 1.0)
