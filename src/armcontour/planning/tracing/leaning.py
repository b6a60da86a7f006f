"""Joint paths along which the tool leans: in the cone of a path, or near the pole of a head.

The tool point stays exactly on the path. For an arm with a cone, the joint paths with the required
tool axis are smoothed again, with the axis free inside the cone. They stay candidates, and the
fastest joint path is chosen later. If the arm cannot follow the path with the required axis, the
smoothing starts from joint paths whose tool leans by a constant rotation.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import NamedTuple, NoReturn, Protocol

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import Unreachable
from armcontour.core.frames import angle_between, exp, shortest
from armcontour.geometry import Path
from armcontour.motion import JointPath
from armcontour.planning.tracing.branch_solutions import Solution, find_solutions
from armcontour.planning.tracing.guide import Guide
from armcontour.planning.tracing.knots import (
    FINER,
    Knots,
    first_knots,
    row_of_poses,
    task_dimension,
    without_held,
)
from armcontour.planning.tracing.path_samples import PathSamples
from armcontour.planning.tracing.refusals import numbered_as
from armcontour.planning.tracing.smoothing import (
    guide_at_stations,
    interpolate_paths,
    null_space,
    smooth,
)
from armcontour.planning.tracing.stations import choose_stations
from armcontour.planning.tracing.tool_cone import check_cone, cone_of
from armcontour.planning.tracing.two_axis_head import (
    HEAD_FINER,
    HEAD_TOLERANCE,
    Head,
    guide_head,
    has_head_tolerance,
    head_of,
    stations_of,
)
from armcontour.robot import SerialArm
from armcontour.robot.inverse_kinematics import POINT

# Shares of a cone, or of a head's tolerance, that are used at the stations. The next one is tried
# if the tool leans too far between the stations.
SHARES = (1.0, 0.85, 0.6, 0.4)
# Number of times that stations become closer where the tool of a head leans too far, and number of
# intervals on both sides of this place that are halved
HEAD_REFINEMENTS = 12
HALVED_AROUND = 6
# Number of iterations of this smoothing
LEANING_ROUNDS = 40
# Number of directions in which the tool leans by a constant rotation, and the share of the cone by
# which it does
LEAN_DIRECTIONS = 8
CONSTANT_LEAN = 0.8
# Distance of a seed's tool point from the start of a path below which the joint path starts there.
SAME_POINT = 1e-6
# Angle of a seed's tool axis from the required one below which the tool does not lean [rad]
NO_LEAN = 1e-6

Attempt = Callable[[], JointPath]


class Refine(Protocol):
    """A function that refines joint positions near those at knots, as the tracer does."""

    def __call__(
        self, path: Path, knots: Knots, q: FloatArray, task: int, guide: Guide | None
    ) -> JointPath:
        """Return the joint path along a path.

        - `q`: joint positions at the knots of the joints that are not held [rad], (n + 1, joints).
        - `task`: task dimension; the guide determines the other motions.
        """


def may_lean(path: Path, arm: SerialArm) -> bool:
    """Test whether the tool may lean along a path: in a cone, or near the pole of a head."""
    head = head_of(arm)
    return cone_of(path) > 0.0 or (head is not None and has_head_tolerance(path, head))


def attempts(
    path: Path, arm: SerialArm, seed: FloatArray | None, refine: Refine
) -> Iterator[Attempt]:
    """Yield functions that trace a path on which the tool may lean, or raise Unreachable.

    - `seed`: as in `trace`, for the joints that are not held [rad], (joints,).
    """
    moving, _ = without_held(arm)
    head = head_of(moving)
    traced: list[JointPath] = []

    def counted(attempt: Attempt) -> Attempt:
        """Return a function that also adds its joint path to `traced`."""

        def run() -> JointPath:
            joint_path = attempt()
            traced.append(joint_path)
            return joint_path

        return run

    if head is not None:
        yield counted(partial(_trace_head, path, arm, head, seed, refine))
    for base in _bases(path, moving, seed):
        yield from map(counted, _attempts_along(path, base, arm, seed, refine))
    if not traced and cone_of(path) > 0.0 and seed is None:
        for base in leaned_paths(path):
            yield from _attempts_along(path, base, arm, None, refine)


def _bases(path: Path, arm: SerialArm, seed: FloatArray | None) -> list[Path]:
    """Return paths whose tool axis a joint path may begin with: the given one, or that of a seed.

    If the seed is at the start of the path, the joint path begins with its tool axis.
    """
    leaning = None if seed is None else _lean_of(path, arm, seed)
    if leaning is None:
        return [path]
    leaned = _leaned(path, leaning.rotation)
    return [leaned] if leaning.is_start else [path, leaned]


def _attempts_along(
    path: Path, base: Path, arm: SerialArm, seed: FloatArray | None, refine: Refine
) -> Iterator[Attempt]:
    """Yield functions that trace along the tool axis of another path, and from there in the cone.

    - `base`: the path with this tool axis.
    """
    try:
        solutions = _Solutions(path, base, arm, seed)
    except Unreachable as error:
        yield partial(_raise, error)
        return
    yield from solutions.attempts(refine)


def constant_leans(path: Path) -> list[FloatArray]:
    """Return rotations by less than the cone, about axes across the mean tool axis, (3, 3) each."""
    assert path.orientation is not None
    axis = path.orientation(path.orientation.breaks)[:, :, 2].mean(axis=0)
    across = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    across /= np.linalg.norm(across)
    along = axis / max(float(np.linalg.norm(axis)), 1e-9)
    angles = np.arange(LEAN_DIRECTIONS) * 2 * np.pi / LEAN_DIRECTIONS
    size = CONSTANT_LEAN * path.orientation.cone
    return [exp(size * (np.cos(x) * across + np.sin(x) * np.cross(along, across))) for x in angles]


def leaned_paths(path: Path) -> list[Path]:
    """Return the path with its tool axis turned by each of the `constant_leans`."""
    return [_leaned(path, x) for x in constant_leans(path)]


def _leaned(path: Path, rotation: FloatArray) -> Path:
    """Return a path with its tool orientation turned by a rotation matrix, without a cone."""
    assert path.orientation is not None
    return replace(path, orientation=path.orientation.with_cone(0.0).place(rotation, 1.0))


class _Lean(NamedTuple):
    """Tool axis of a seed that differs from the required one."""

    rotation: FloatArray  # Rotation from the required axis to that of the seed, (3, 3)
    is_start: bool  # True if the tool point of the seed is at the start of the path


def _lean_of(path: Path, arm: SerialArm, seed: FloatArray) -> _Lean | None:
    """Return how the tool leans at a seed [rad], (dof,); None if it does not, or too much."""
    assert path.orientation is not None
    pose = arm.poses(seed)
    turn = shortest(path.orientation(0.0)[:, 2], pose[:, 2])
    if not NO_LEAN < np.linalg.norm(turn) <= path.orientation.cone:
        return None
    distance = np.linalg.norm(pose[:, 3] - path.start)
    return _Lean(exp(turn), bool(distance < SAME_POINT))


def _raise(error: Unreachable) -> NoReturn:
    """Raise an error that is already known."""
    raise error


class _Solutions:
    """Joint positions at the knots of a path whose tool axis is that of another path."""

    def __init__(self, path: Path, base: Path, arm: SerialArm, seed: FloatArray | None) -> None:
        # `base`: the path with the tool axis of the solutions; others as in `attempts`.
        self.path = path
        self.base = base
        self.arm = arm
        self.seed = seed
        self.moving, _ = without_held(arm)
        self.task = task_dimension(path, self.moving)
        self.knots = first_knots(path, arm.span, FINER)
        self.samples = PathSamples(path=base, knots=self.knots)
        with numbered_as(arm):
            self.solutions = find_solutions(self.samples, self.moving, self.task, seed)

    def attempts(self, refine: Refine) -> Iterator[Attempt]:
        """Yield functions that trace along the base, and functions that lean inside the cone."""
        for solution in self.solutions:
            yield partial(self._follow_base, solution, refine)
        if cone_of(self.path) == 0.0:
            return
        for solution in self.solutions:
            yield partial(self._lean, solution, refine)

    def _follow_base(self, solution: Solution, refine: Refine) -> JointPath:
        """Trace along the base with its tool axis."""
        q = solution.q
        guide = None
        if self.task < self.moving.dof:
            guide = guide_at_stations(self.samples, self.moving, self.task, q)
        traced = refine(self.base, self.knots, q, self.task, guide)
        return replace(traced, tool_path=self.path)

    def _lean(self, solution: Solution, refine: Refine) -> JointPath:
        """Trace with a tool axis inside the cone."""
        return lean_from(
            self.path,
            self.arm,
            self.knots,
            solution.q,
            refine,
            start_stays=self.seed is not None,
        )


def lean_from(
    path: Path,
    arm: SerialArm,
    knots: Knots,
    q: FloatArray,
    refine: Refine,
    *,
    start_stays: bool,
) -> JointPath:
    """Smooth joint positions with the tool axis free in the cone, and trace the path near them.

    - `q`: joint positions at the knots with the tool on the path, of the joints that are not held
      [rad], (n + 1, joints).
    - `start_stays`: true if the first joint positions do not change.

    Raises:
        Unreachable: The tool leaves the cone, or as in `trace`.
    """
    moving, _ = without_held(arm)
    poses = row_of_poses(path, knots)
    s = np.append(knots.s0, path.length)
    index = choose_stations(path, knots, poses).index
    at_stations = np.ascontiguousarray(poses[index])

    def attempt(share: float) -> JointPath:
        """Trace with a share of the cone at the stations."""
        smoothed, _ = smooth(
            moving, s[index], at_stations, POINT, q[index][None],
            start_stays=start_stays, rounds=LEANING_ROUNDS, cone=share * cone_of(path),
        )  # fmt: skip
        rows = null_space(moving, at_stations, POINT, smoothed[0])
        guide = Guide.through(s[index], smoothed[0], rows, path.stops)
        between = interpolate_paths(s[index], smoothed, s)
        return refine(path, knots, between[0], POINT, guide)

    return _within(cone_of(path), arm, attempt)


def leans(path: Path, arm: SerialArm, poses: FloatArray, q: FloatArray) -> bool:
    """Test whether the tool leans at joint positions q at knots [rad], (n, dof), or may by a head.

    - `poses`: required tool poses there, (n, 3, 4).
    """
    if cone_of(path) == 0.0:
        # Near the pole of a head, the required axis may be singular even if the tool has it.
        return may_lean(path, arm)
    return bool(angle_between(arm.poses(q)[:, :, 2], poses[:, :, 2]).max() > NO_LEAN)


def trace_leaning(
    path: Path, arm: SerialArm, knots: Knots, q: FloatArray, met: float, refine: Refine
) -> JointPath:
    """Trace a path near joint positions at which the tool leans.

    - `q`: joint positions at the knots of the joints that are not held [rad], (n + 1, joints).
    - `met`: arc length of a knot at which the joint path has exactly these positions [m].
    """
    moving, _ = without_held(arm)
    head = head_of(moving)
    allowed = cone_of(path) if head is None else max(HEAD_TOLERANCE, cone_of(path))
    poses = row_of_poses(path, knots)
    s = np.append(knots.s0, path.length)
    index = stations_of(s, poses[:, :, 2], np.union1d(path.stops, met))
    if head is None:
        at_stations = np.ascontiguousarray(poses[index])
        rows = null_space(moving, at_stations, POINT, q[index])
    else:
        rows = head.rows(len(index))
    guide = Guide.through(s[index], q[index], rows, path.stops)
    traced = refine(path, knots, q, POINT, guide)
    check_cone(traced, arm, allowed)
    return traced


def _within(cone: float, arm: SerialArm, attempt: Callable[[float], JointPath]) -> JointPath:
    """Return the first joint path whose tool stays in a cone, of those that use shares of it.

    Raises:
        Unreachable: As in `check_cone` for the last share, or as raised by `attempt`.
    """
    for share in SHARES[:-1]:
        traced = attempt(share)
        with suppress(Unreachable):
            check_cone(traced, arm, cone)
            return traced
    traced = attempt(SHARES[-1])
    check_cone(traced, arm, cone)
    return traced


def _trace_head(
    path: Path, arm: SerialArm, head: Head, seed: FloatArray | None, refine: Refine
) -> JointPath:
    """Trace a path with a head near its pole; the tool axis is within a tolerance."""
    knots = first_knots(path, arm.span, HEAD_FINER)
    needed = path.stops
    for _ in range(HEAD_REFINEMENTS):
        try:
            return _trace_head_at(path, arm, head, seed, refine, knots, needed)
        except Unreachable as error:
            if error.limit != "cone" or error.s is None:
                raise
            # The first axis turns too fast for the stations near this place.
            knots, needed = _finer_near(path, knots, needed, error.s)
    return _trace_head_at(path, arm, head, seed, refine, knots, needed)


def _finer_near(
    path: Path, knots: Knots, needed: FloatArray, place: float
) -> tuple[Knots, FloatArray]:
    """Halve the intervals of knots near a place, where all knots become stations.

    Returns the knots and the arc lengths that must be stations [m].

    - `needed`: arc lengths that must be stations so far [m].
    - `place`: arc length of the place [m].
    """
    i = int(np.searchsorted(knots.s0, place, side="right")) - 1
    near = np.zeros(len(knots), dtype=np.bool_)
    near[max(i - HALVED_AROUND, 0) : i + HALVED_AROUND + 1] = True
    finer = knots.halve(near, ((knots.u0 + knots.u1) / 2)[near])[0]
    s = np.append(finer.s0, path.length)
    first, last = np.flatnonzero(near)[[0, -1]]
    ends = np.append(knots.s0, path.length)[[first, last + 1]]
    return finer, np.union1d(needed, s[(s >= ends[0]) & (s <= ends[1])])


def _trace_head_at(
    path: Path,
    arm: SerialArm,
    head: Head,
    seed: FloatArray | None,
    refine: Refine,
    knots: Knots,
    needed: FloatArray,
) -> JointPath:
    """Trace a path as `_trace_head`, with given knots.

    - `needed`: arc lengths of knots that must be stations [m].
    """
    moving, _ = without_held(arm)
    cone = max(HEAD_TOLERANCE, cone_of(path))
    s = np.append(knots.s0, path.length)
    poses = row_of_poses(path, knots)
    stations = stations_of(s, poses[:, :, 2], needed)

    def attempt(share: float) -> JointPath:
        """Trace with a share of the tolerance at the stations."""
        with numbered_as(arm):
            guide, q = guide_head(
                path, moving, head, s[stations], poses[stations], share * cone, seed
            )
        between = np.stack([np.interp(s, s[stations], x) for x in q.T], axis=1)
        return refine(path, knots, between, POINT, guide)

    return _within(cone, arm, attempt)
