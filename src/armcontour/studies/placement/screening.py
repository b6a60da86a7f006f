"""Lower bounds on the duration of a job at a place, from joint positions at some of its poses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from armcontour.core.checks import BoolArray, FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.quintics import quintic
from armcontour.geometry import Path
from armcontour.motion import JointPath
from armcontour.planning.duration_bound import bound_duration
from armcontour.planning.tracing.configurations import MAX_STARTS, follow_branches, subdivide
from armcontour.planning.tracing.knots import (
    OUT_OF_REACH,
    PLACES,
    FirstPoses,
    first_knots,
    row_of_poses,
    task_dimension,
    tool_errors,
)
from armcontour.planning.tracing.ranges import ROUNDING
from armcontour.planning.tracing.serial_solver import SINGULAR
from armcontour.planning.tracing.solver import Ends
from armcontour.program import Contour, Dwell, Program
from armcontour.robot import Limits, SerialArm, newton
from armcontour.robot.inverse import WHOLE, configurations, out_of_reach
from armcontour.studies.placement.manipulability import least_singular_value
from armcontour.studies.placement.reach import beyond_links

# Quintics through the first knots stand for the joint path if they keep the tool this near to its
# path [m, rad]; else nothing is known of a duration.
NEAR, NEAR_ANGLE = 1e-5, 1e-4
# Poses that are farther out of reach than this are refused without tracing, which meets poses far
# closer [m].
BEYOND = 1e-6
# Kinds of refusals.
REACH, RANGE, SINGULAR_ARM = "reach", "joint range", "singularity"
# Where a path cannot be followed, so many of the poses ahead are tried for being in reach.
POSES_AHEAD = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class Screened:
    """What is known of a place without a plan.

    Args:
        duration: No plan is shorter, but for the share that `bound_duration` may be off [s].
        singular: Least singular value at some places of the path: the largest of all
            configurations or, unless that is asked for, of the one with the least duration. Not a
            number if it is unknown.
        refusal: Kind of the refusal where the path cannot be traced, which tracing finds too.
    """

    duration: float = 0.0
    singular: float = np.nan
    refusal: str = ""


class Screen:
    """Bounds for one program and arm with as many joints as the task has dimensions.

    Args:
        program: The program that the tool follows, with rounded corners.
        arm: The arm, which may stand anywhere.
        limits: The limits.
        seed: Joint positions near the start [rad], (dof,); None for any.
        of_all: Whether the least singular values of all configurations are asked for.
    """

    def __init__(
        self,
        program: Program,
        arm: SerialArm,
        limits: Limits,
        seed: npt.ArrayLike | None,
        *,
        of_all: bool = False,
    ) -> None:
        self.limits, self.of_all, self._arm = limits.without_jerk, of_all, arm
        given = seed is not None and isinstance(program.moves[0], Contour)
        self.contours = [
            _Poses(x.path, arm, np.asarray(seed, dtype=float) if given and k == 0 else None)
            for k, x in enumerate(program.contours)
        ]
        self.dwells = sum(x.duration for x in program.moves if isinstance(x, Dwell))

    @staticmethod
    def fits(program: Program, arm: object) -> bool:
        """Whether there are such bounds: redundant joints and the plane have none."""
        return isinstance(arm, SerialArm) and all(
            x.path.dimension == 3 and task_dimension(x.path, arm) == arm.dof
            for x in program.contours
        )

    def refuses(self, bases: FloatArray) -> BoolArray:
        """In which places a pose is surely out of reach of the arm, (n,).

        Args:
            bases: Rotations and positions of its base in the work frame, (n, 3, 4).
        """
        found = np.zeros(len(bases), dtype=np.bool_)
        for x in self.contours:
            found[~found] = x.refuses(self._arm, bases[~found])
        return found

    def look(self, arm: SerialArm) -> Screened:
        """What is known of the program on the arm where it stands.

        Args:
            arm: The arm in another place.
        """
        duration, singular = self.dwells, np.inf
        for x in self.contours:
            found = x.look(arm, self.limits, self.of_all)
            if found.refusal:
                return found
            duration += found.duration
            singular = min(singular, found.singular)
        return Screened(duration=duration, singular=singular)


class _Poses:
    """Poses of a path at its first knots, and what arms in several places make of them.

    Args:
        path: The path.
        arm: The arm.
        seed: As of the screen.
    """

    def __init__(self, path: Path, arm: SerialArm, seed: FloatArray | None) -> None:
        self.path, self.seed = path, seed
        self.task = task_dimension(path, arm)
        knots = first_knots(path, arm.span)
        self.first = FirstPoses.at_knots(path, knots)
        fine, self.at = subdivide(path, knots, self.first.row)
        self.fine = self.first.row if len(fine) == len(knots) else row_of_poses(path, fine)
        self.breaks = np.append(knots.s0, path.length)
        self.width = knots.u1 - knots.u0

    def refuses(self, arm: SerialArm, bases: FloatArray) -> BoolArray:
        """In which places of an arm's base a pose is surely out of its reach, (n,)."""
        closed = arm.closed_form
        if self.task == WHOLE and closed is not None:
            return closed.beyond(bases, self.fine, BEYOND) > BEYOND
        return beyond_links(arm.chain, self.task, self.first.row, bases) > 0

    def look(self, arm: SerialArm, limits: Limits, of_all: bool) -> Screened:
        """What is known of the path on an arm."""
        starts = configurations(arm, self.fine[0], self.task, self.seed)[:MAX_STARTS]
        if len(starts) == 0:
            return Screened(refusal=REACH)
        ways, reached = follow_branches(arm, self.fine, self.task, starts)
        followed = [ways[k, self.at] for k in np.flatnonzero(reached == len(self.fine))]
        if not followed:
            best = int(np.argmax(reached))
            farthest, last = int(reached[best]), ways[best, reached[best] - 1]
            ahead = np.linspace(farthest, len(self.fine) - 1, POSES_AHEAD).astype(np.intp)
            gaps = out_of_reach(arm, self.fine[ahead], self.task, last[None])
            return Screened(refusal=REACH if gaps.max() > OUT_OF_REACH else SINGULAR_ARM)
        inside = [q for q in followed if _fits_range(q, limits, arm.dof)]
        if not inside:
            return Screened(refusal=RANGE)
        return self._bound(arm, limits, np.array(inside), of_all)

    def _bound(self, arm: SerialArm, limits: Limits, q: FloatArray, of_all: bool) -> Screened:
        """Bounds over all configurations.

        Args:
            arm: The arm.
            limits: The limits.
            q: Joint positions at the knots in each configuration [rad], (k, n + 1, dof).
            of_all: Whether the least singular values of all are asked for.
        """
        begin, end, sound = self._ends(arm, q)
        if not sound.any():
            return Screened(refusal=SINGULAR_ARM)
        exact = self._exact(arm, begin, end)
        which = np.flatnonzero(sound)
        durations = [
            self._duration([x[k] for x in begin], [x[k] for x in end], limits) if exact[k] else 0.0
            for k in which
        ]
        looked = which if of_all else which[[int(np.argmin(durations))]]
        values = [least_singular_value(arm, q[k], self.task) for k in looked]
        return Screened(duration=min(durations), singular=max(values))

    def _duration(self, begin: list[FloatArray], end: list[FloatArray], limits: Limits) -> float:
        """A lower bound on the duration in one configuration [s]; 0 if there is none.

        Args:
            begin: q, dq_ds and d2q_ds2 at the starts of all intervals, (n, dof) each.
            end: The same at their ends.
            limits: The limits.
        """
        try:
            joint_path = JointPath.hermite(
                self.breaks,
                (begin[0], begin[1], begin[2]),
                (end[0], end[1], end[2]),
                stops=self.first.stops,
                tool_path=self.path,
            )
        except InvalidInput:
            # Newton's method has left the configuration.
            return 0.0
        return bound_duration(joint_path, limits)

    def _ends(self, arm: SerialArm, q: FloatArray) -> tuple[Ends, Ends, BoolArray]:
        """q, dq_ds and d2q_ds2 at the starts and at the ends of all intervals.

        Args:
            arm: The arm.
            q: Joint positions at the knots in each configuration [rad], (k, n + 1, dof).

        Returns:
            The three at starts and at ends, (k, n, dof) each, and of each configuration whether no
            place is singular, (k,).
        """
        k, n, dof, first = len(q), q.shape[1] - 1, q.shape[2], self.first
        alone = first.ends >= n
        rows = np.concatenate([q[:, :-1], q[:, 1:][:, alone]], axis=1).reshape(-1, dof)
        m = len(rows)
        poses, rates = np.tile(first.poses, (k, 1, 1)), np.tile(first.rates, (k, 1, 1))
        w, g = np.zeros((m, 3, 0, dof)), np.zeros((m, 3, dof))
        links = arm.link_table
        found = newton.newton(links, self.task, rows, poses, w, g)
        dq_ds, d2q_ds2, pivots = newton.path_derivatives(links, self.task, rows, poses, rates, w, g)
        good = found & (pivots > SINGULAR) & np.isfinite(d2q_ds2).all(axis=1)
        q, dq_ds, d2q_ds2 = (x.reshape(k, -1, dof) for x in (rows, dq_ds, d2q_ds2))
        begin = q[:, :n], dq_ds[:, :n], d2q_ds2[:, :n]
        end = q[:, first.ends], dq_ds[:, first.ends], d2q_ds2[:, first.ends]
        return begin, end, np.asarray(good.reshape(k, -1).all(axis=1))

    def _exact(
        self,
        arm: SerialArm,
        begin: Ends,
        end: Ends,
    ) -> FloatArray:
        """Whether quintics between the knots keep the tool near to its path, (k,)."""
        k, n, dof = begin[0].shape
        flat = [tuple(x.reshape(k * n, dof) for x in ends) for ends in (begin, end)]
        coefficients = quintic(np.tile(self.width, k), *flat)  # type: ignore[arg-type]
        q = np.einsum("pk,ikj->pij", PLACES[:, None] ** np.arange(6), coefficients)
        targets = np.tile(self.first.between.reshape(len(PLACES), 1, n, 3, 4), (1, k, 1, 1, 1))
        q, targets = q.reshape(-1, dof), targets.reshape(-1, 3, 4)
        errors = tool_errors(arm, q, targets, self.task, (NEAR, NEAR_ANGLE))
        return np.asarray((errors.reshape(len(PLACES), k, n) <= 1).all(axis=(0, 2)))


def _fits_range(q: FloatArray, limits: Limits, dof: int) -> bool:
    """Whether whole turns of the joints put positions [rad], (n, dof), into their ranges."""
    lower, upper = limits.joint_range(dof)
    least = np.ceil((lower - ROUNDING - q.min(axis=0)) / (2 * np.pi))
    most = np.floor((upper + ROUNDING - q.max(axis=0)) / (2 * np.pi))
    return bool((least <= most).all())
